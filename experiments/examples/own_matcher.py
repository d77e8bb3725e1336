"""Add your own matcher, and compare it with `limit` on the same trials.

`python -m experiments.examples.own_matcher`. Whatever takes the beams of a scan and a predicted pose
and returns a `ScanMatch` is a matcher: `Localizer` does the rest, be it on a real log or simulated.
"""

import math
from dataclasses import dataclass

import numpy as np

from experiments.localization import run_trial
from experiments.methods import METHODS, KnownPlace, Method
from experiments.trials import TrialConfig, generator
from slam import SE2, Beams, MatchStatus, PointMap, ScanMatch


@dataclass(frozen=True)
class MyMatcher:
    """Point-to-point ICP in the plane whose pairs draw nearer: far at first, within 5 cm in the end."""

    point_map: PointMap
    reaches_m: tuple[float, ...] = (0.5, 0.3, 0.2, 0.1, *[0.05] * 10)

    def __call__(self, beams: Beams, T_predicted: SE2) -> ScanMatch:
        """The pose at which the points of the scan lie on those of the map."""
        pose, points = T_predicted, beams.points  # (N, 2), as seen from the robot
        for reach_m in self.reaches_m:
            pairs = self.point_map.nearest(pose @ points, reach_m)
            if len(pairs) < 20:
                return ScanMatch(pose, MatchStatus.LOST)
            scan, on_map = points[pairs.scan_ids], self.point_map.points[pairs.map_ids]
            pose = best_pose(scan, on_map)
        error_m2 = float(np.square(pose @ scan - on_map).sum(axis=1).mean())
        # what is believed is the matcher's to say: here, if three quarters of the points found a wall
        is_matched = len(pairs) > 0.75 * len(points)
        status = MatchStatus.MATCHED if is_matched else MatchStatus.LOST
        return ScanMatch(pose, status, error_m2, len(pairs))


def best_pose(scan: np.ndarray, on_map: np.ndarray) -> SE2:
    """The pose that takes points (P, 2) nearest to others, in the sense of least squares."""
    middle, middle_on_map = scan.mean(axis=0), on_map.mean(axis=0)
    (x, y), (u, v) = (scan - middle).T, (on_map - middle_on_map).T
    turn = SE2(0.0, 0.0, math.atan2(float(x @ v - y @ u), float(x @ u + y @ v)))
    shift = middle_on_map - (turn @ middle[np.newaxis])[0]
    return SE2(shift[0], shift[1], turn.theta)


def my_method(known: KnownPlace) -> MyMatcher:
    """The matcher, given what the robot knows of a place."""
    return MyMatcher(known.point_map)


def main(trials: int = 20) -> dict[str, float]:
    """Position RMSE [mm] of each method over the trials that it won."""
    METHODS["mine"] = Method(my_method)  # from now on a method like any other
    config = TrialConfig(poses="random", methods=("mine", "limit")).checked()
    results = [run_trial(config, generator("localization", 1, i)) for i in range(trials)]
    rmse_mm = {}
    for name in config.methods:
        won = [one.outcomes[name] for one in results if one.outcomes[name].is_success]
        squares = [np.square(outcome.error[:2]).sum() for outcome in won]
        rmse_mm[name] = 1e3 * math.sqrt(np.mean(squares)) if won else math.nan
        cpu_ms = 1e3 * np.median([one.cpu_s[name] for one in results])
        found = f"found {len(won)} of {trials}"
        print(f"{name:6} {found}, RMSE {rmse_mm[name]:.2f} mm, {cpu_ms:.1f} ms a scan")
    return rmse_mm


if __name__ == "__main__":
    main()

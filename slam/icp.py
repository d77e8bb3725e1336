"""The paper's ICP: one scan matched with the point map (Sections 3.1 and 3.2, Fig. 2)."""

from __future__ import annotations

import enum
import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from slam.arrays import FloatArray, checked_points
from slam.open3d_backend import best_pose_open3d, registration_icp
from slam.point_map import Pairs, PointMap, thinned
from slam.scan_match import IcpStep as IcpStep
from slam.scan_match import MatchStatus as MatchStatus
from slam.scan_match import ScanMatch as ScanMatch
from slam.se2 import SE2


class StopRule(enum.Enum):
    """When step 5 ends the loop."""

    FIRST_BELOW = "first below"  # Fig. 2: as soon as F is below the threshold
    CONVERGED = "converged"  # Fig. 3, step 8: F below the threshold and the pose settled


@dataclass(frozen=True)
class IcpConfig:
    """What `match_scan` needs to know; the paper gives none of these values.

    threshold_m2: F, expression (1), of a match. It has a floor that no pose gets below, see
    `error_floor_m2`: a map spaced 1 cm and a range noise of 2 cm (1 % of 2 m, an URG-04LX in a
    room of 6 m) make 4.1e-4 m2. The default is two and a half times that, since ranges of 4 m
    come with a noise of 4 cm. Keep it above the floor of your own map and sensor.
    max_pair_distance_m: inf is the paper's own (it names no limit). With a limit, one beam in fifty
    that hangs in the air behind an edge adds up to 0.02 * 0.5**2 / 3 = 17e-4 m2 to F, with a metre
    four times that: then nothing is below the threshold any more. A metre and more reach farther
    after a kidnap.
    min_pair_ratio: share of the scan that a match must explain; without it, a few points that
    happen to lie near the map would have a small F. A half: chosen.
    The tolerances say when the pose has settled: a hundredth of what one scan can tell (1 mm).
    """

    max_iterations: int = 200
    max_pair_distance_m: float = 0.5
    min_pairs: int = 10
    min_pair_ratio: float = 0.5
    threshold_m2: float = 1e-3
    stop_rule: StopRule = StopRule.FIRST_BELOW
    translation_tolerance_m: float = 1e-5
    rotation_tolerance_rad: float = 1e-5

    def __post_init__(self) -> None:
        # Fewer than two pairs do not fix a heading, and none would let Open3D's 0.0 through.
        if self.min_pairs < 2 or self.max_iterations < 1:
            raise ValueError(f"a match needs 2 pairs and 1 iteration at least, not {self}")

    def is_below(self, step: IcpStep) -> bool:
        """True when F is below the threshold."""
        return step.error_m2 < self.threshold_m2

    def has_settled(self, history: Sequence[IcpStep]) -> bool:
        """True when the last step moved the pose by less than the tolerances."""
        if len(history) < 2:
            return False
        change = history[-2].T_map_base.inverse() @ history[-1].T_map_base
        return is_small(change, self.translation_tolerance_m, self.rotation_tolerance_rad)

    def is_done(self, history: Sequence[IcpStep]) -> bool:
        """Whether step 5 ends the loop. A settled pose ends it under both rules: no later step
        would change F any more."""
        if self.stop_rule is StopRule.FIRST_BELOW and self.is_below(history[-1]):
            return True
        return self.has_settled(history)

    def judged(self, history: Sequence[IcpStep], point_count: int) -> ScanMatch:
        """The verdict on the last step of a history, for a scan of so many points."""
        is_settled = self.has_settled(history)
        is_good = (
            self.is_below(history[-1])
            and history[-1].pair_count >= self.min_pair_ratio * point_count
        )
        if is_good and (is_settled or self.stop_rule is StopRule.FIRST_BELOW):
            return ScanMatch.from_history(history, MatchStatus.MATCHED)
        status = MatchStatus.LOST if is_settled or not is_good else MatchStatus.NOT_CONVERGED
        return ScanMatch.from_history(history, status)


def match_scan(
    points_base: FloatArray, point_map: PointMap, T_map_base: SE2, config: IcpConfig
) -> ScanMatch:
    """Pose of one scan on the map: steps 2 to 7 of Fig. 2.

    points_base: (N, 2) [m], base frame. T_map_base: the pose that odometry predicts.
    """
    history: list[IcpStep] = []
    points_map = T_map_base @ points_base  # step 2
    for _ in range(config.max_iterations):
        pairs = point_map.nearest(points_map, config.max_pair_distance_m)  # step 3
        error_m2 = mean_squared_distance(points_map, point_map, pairs)  # step 4, expression (1)
        history.append(IcpStep(T_map_base, error_m2, len(pairs)))
        if len(pairs) < config.min_pairs:
            return ScanMatch.lost(history)
        if config.is_done(history):  # step 5
            return config.judged(history, len(points_base))
        T_map_base = best_pose(points_base, point_map, pairs)  # step 6
        points_map = T_map_base @ points_base  # step 7, expression (2)
    return config.judged(history, len(points_base))


def mean_squared_distance(points_map: FloatArray, point_map: PointMap, pairs: Pairs) -> float:
    """The evaluation function F, expression (1) [m2]; inf without pairs.

    Open3D reports 0.0 there, which is below any threshold: a scan that sees nothing of the map
    would count as a perfect match.
    """
    if len(pairs) == 0:
        return math.inf
    differences = points_map[pairs.scan_ids] - point_map.points[pairs.map_ids]
    return float(np.mean(np.sum(differences**2, axis=1)))


def best_pose(points_base: FloatArray, point_map: PointMap, pairs: Pairs) -> SE2:
    """The pose that brings the scan closest to its related points (Trans and Rot of step 6).

    Fits the scan as measured, so the result is the whole pose: no increments to multiply.
    """
    return best_pose_open3d(points_base[pairs.scan_ids], point_map.points[pairs.map_ids])


def error_floor_m2(map_spacing_m: float, range_sigma_m: float) -> float:
    """About the smallest F [m2] at the true pose.

    The nearest of points spaced s apart on a wall lies up to s/2 to the side, evenly spread:
    s**2 / 12; the noise of the ranges adds its variance (less where beams graze a wall).
    """
    return map_spacing_m**2 / 12.0 + range_sigma_m**2


def is_small(change: SE2, translation_m: float, rotation_rad: float) -> bool:
    """Translation and rotation each within its own limit: metres and radians do not add."""
    return math.hypot(change.x, change.y) <= translation_m and abs(change.theta) <= rotation_rad


@dataclass(frozen=True)
class CoarseToFineConfig:
    """What `match_scan_coarse_to_fine` needs to know.

    pair_distances_m: how far related points may be apart, stage by stage: a metre reaches over the
    error of the odometry, a tenth leaves out what the map does not know (people, furniture moved).
    coarse_spacing_m: the stages work on a scan thinned to this spacing, then the last one once more
    on all points. Beams are dense on a wall near by, and its many pairs hold the scan where it is
    along that wall: without thinning 1 start in 50 within 10 cm and 5 degrees ended 7 cm off.
    max_iterations: Open3D's, for each of up to max_rounds calls per stage.
    start_headings_rad: tried from the predicted pose; the start whose coarse end explains the scan
    best goes on to the last stage. ICP undoes 5 degrees nearly anywhere, but among furniture
    seldom the 10 that the odometry of a real robot is off after two metres (Intel log: 3 to 6
    degrees per metre); and along a round wall it slides into a local minimum from one start in 50
    within 10 cm and 5 degrees, yet not from its neighbours. Not a search: no start is far.

    The match is judged at the last distance d. min_inlier_ratio: share of the scan that must then
    have a partner. At the right pose all but a few points have, 0.77 the least of 601 scans of
    real logs on maps made of half the scans; at a wrong one, after a kidnap in a room, two thirds
    in the median, but now and then nearly all: one scan's word is no proof.
    threshold_m2: limit of F over those pairs. Residuals spread evenly over [0, d], as those of a
    scan that has nothing to do with the map, make d**2 / 3 = 33e-4 m2; a right pose makes 2e-4 in
    a room and at most 16e-4 on a real log's map (5 cm spacing, poses wrong by 3 cm).
    """

    pair_distances_m: tuple[float, ...] = (1.0, 0.3, 0.1)
    coarse_spacing_m: float = 0.05
    max_iterations: int = 100
    max_rounds: int = 5
    start_headings_rad: tuple[float, ...] = (0.0, 0.175, -0.175, 0.35, -0.35)
    min_pairs: int = 10
    min_inlier_ratio: float = 0.7
    threshold_m2: float = 20e-4
    translation_tolerance_m: float = 1e-5
    rotation_tolerance_rad: float = 1e-5

    def __post_init__(self) -> None:
        distances = self.pair_distances_m
        if not distances or min(distances) <= 0.0:
            raise ValueError(f"pair_distances_m needs distances above 0, not {distances}")
        if not self.coarse_spacing_m > 0.0:
            raise ValueError(f"coarse_spacing_m must be above 0, not {self.coarse_spacing_m}")
        if not self.start_headings_rad:
            raise ValueError("start_headings_rad needs at least one heading: (0.0,)")
        if self.min_pairs < 2 or self.max_iterations < 1 or self.max_rounds < 1:
            raise ValueError(f"a match needs 2 pairs, 1 iteration, 1 round at least, not {self}")

    def judged(self, history: Sequence[IcpStep], point_count: int, is_settled: bool) -> ScanMatch:
        """The verdict on the last step of a history, for a scan of so many points."""
        last = history[-1]
        has_inliers = last.pair_count >= max(self.min_inlier_ratio * point_count, self.min_pairs)
        if not (has_inliers and last.error_m2 < self.threshold_m2):
            return ScanMatch.lost(history)
        status = MatchStatus.MATCHED if is_settled else MatchStatus.NOT_CONVERGED
        return ScanMatch.from_history(history, status)


def match_scan_coarse_to_fine(
    points_base: FloatArray, point_map: PointMap, T_map_base: SE2, config: CoarseToFineConfig
) -> ScanMatch:
    """Pose of one scan on the map by Open3D's own ICP, from far pairs to near ones.

    points_base: (N, 2) [m], base frame. T_map_base: the pose that odometry predicts.
    Matched when the last stage settled, and its inliers and error are those of a right pose.
    """
    points_base = checked_points(points_base, "points_base")
    coarse_points = thinned(points_base, config.coarse_spacing_m)
    starts = [T_map_base @ SE2(0.0, 0.0, heading_rad) for heading_rad in config.start_headings_rad]
    ends = [
        _settled(coarse_points, point_map, T_start, config.pair_distances_m, config)
        for T_start in starts
    ]
    best = min(ends, key=lambda end: _cost_m2(end.history[-1], len(coarse_points), config))
    T_coarse, final_m = best.history[-1].T_map_base, config.pair_distances_m[-1]
    last = _settled(points_base, point_map, T_coarse, (final_m,), config)
    return config.judged([*best.history, *last.history], len(points_base), last.is_settled)


@dataclass(frozen=True)
class _Descent:
    """The steps of some stages from one start, and whether the last of them settled."""

    history: tuple[IcpStep, ...]
    is_settled: bool


def _cost_m2(end: IcpStep, point_count: int, config: CoarseToFineConfig) -> float:
    """How badly a pose explains a scan of so many points: the mean of squared distances [m2], each
    counted as the last pair distance at most (MSAC; Torr and Zisserman, 2000)."""
    limit_m2 = config.pair_distances_m[-1] ** 2
    outliers = point_count - end.pair_count
    inliers_m2 = end.error_m2 * end.pair_count if end.pair_count else 0.0
    return (inliers_m2 + outliers * limit_m2) / max(point_count, 1)


def _settled(
    points_base: FloatArray,
    point_map: PointMap,
    T_map_base: SE2,
    distances_m: tuple[float, ...],
    config: CoarseToFineConfig,
) -> _Descent:
    """Each stage run until a further step would not move the pose: the start and a step per round.

    Ends unsettled where too few points have a partner.
    """
    step, _ = _judged_step(points_base, point_map, T_map_base, distances_m[0])
    history, is_settled = [step], False
    for distance_m in distances_m:
        for _ in range(config.max_rounds):
            T_map_base = history[-1].T_map_base
            reach, _ = _judged_step(points_base, point_map, T_map_base, distance_m)
            if reach.pair_count < config.min_pairs:
                return _Descent((*history, reach), False)
            T_map_base = registration_icp(
                points_base, point_map, T_map_base, distance_m, config.max_iterations
            )
            step, is_settled = _settled_step(points_base, point_map, T_map_base, distance_m, config)
            history.append(step)
            if is_settled:
                break
    return _Descent(tuple(history), is_settled)


def _judged_step(
    points_base: FloatArray, point_map: PointMap, T_map_base: SE2, distance_m: float
) -> tuple[IcpStep, Pairs]:
    points_map = T_map_base @ points_base
    pairs = point_map.nearest(points_map, distance_m)
    error_m2 = mean_squared_distance(points_map, point_map, pairs)
    return IcpStep(T_map_base, error_m2, len(pairs)), pairs


def _settled_step(
    points_base: FloatArray,
    point_map: PointMap,
    T_map_base: SE2,
    distance_m: float,
    config: CoarseToFineConfig,
) -> tuple[IcpStep, bool]:
    """The step at a pose, and whether one more by our own hands would leave the pose there.

    Open3D's own flag is not asked: it looks at the change of fitness and RMSE only.
    """
    step, pairs = _judged_step(points_base, point_map, T_map_base, distance_m)
    if len(pairs) == 0:
        return step, True
    change = T_map_base.inverse() @ best_pose(points_base, point_map, pairs)
    tolerances = config.translation_tolerance_m, config.rotation_tolerance_rad
    return step, is_small(change, *tolerances)

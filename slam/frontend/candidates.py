"""Where a scan may lie: where the wheels lead, or around; and what the last keyframes deny of it."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from slam.arrays import FloatArray
from slam.beams import Beams
from slam.frontend.contradictions import passed
from slam.frontend.keyframes import Keyframe
from slam.frontend.open_matches import LITTLE, closed_match
from slam.frontend.prediction import Prediction
from slam.frontend.seen_before import LastSeen
from slam.frontend.strays import apart_m
from slam.frontend.told_steps import GUESS_M
from slam.kernels.normal_equations import inverse_of
from slam.kernels.visibility import contradictions
from slam.se2 import SE2
from slam.surface.surface_match import SurfaceMatch

_WIDER = 1.5
"""Of a search's reach: matches may slide off from where it looked; farther, they are of something
else. Chosen."""
_MOST, _MOST_FAR = 3, 9
"""Starts of each search, and of one that goes metres along a corridor. Chosen."""
_LOOKED_THROUGH = 3
"""Of so many points, one is asked whether beams went through. Chosen: all would take a tenth of the
front end's time."""


class Candidates:
    """Matches of a scan with the surfaces that the last keyframes saw."""

    def __init__(self, last: LastSeen) -> None:
        self._last, self._surfaces = last, last.surfaces
        self._keyframes, self._config = last.keyframes, last.config

    def led(self, points: FloatArray, beams: Beams, told: Prediction) -> SurfaceMatch:
        """The match of faced points (N, 3) of a scan where the wheels lead."""
        config, T_predicted = self._config, told.T_map_base
        match = self._surfaces.match(points, T_predicted, T_predicted, told.odometry)
        better = config.better if told.is_coasting else config.better_guess
        for start in told.others:
            other = self._surfaces.match(points, start, T_predicted, told.odometry)
            match = other if other.cost < match.cost - better else match
        if told.other is not None:
            # odometry jumped, or did not: the robot went the one way or the other
            ends = [T_predicted, *told.others]
            match = match if self._is_from(match, ends, config.reach_m) else self.held(points, told)
        if told.squared(match) > config.trust:
            # walls seen for the first time may draw a scan along those known, and people
            is_denied = told.is_denying(match, config.surely_wrong)
            held = self.held(points, told)
            if held.cost < match.cost + (config.better_against if is_denied else config.better):
                match = held
        if match.least_facing < config.least_facing:
            before = self._last.before(points, beams)
            match = closed_match(
                self._surfaces, points, T_predicted, told.odometry, match, config, told.noise,
                # walls that wheels slip along, or tell late of, were there
                lambda one: told.is_denying(one, config.surely_wrong) and before.are_people(one, T_predicted),
            )  # fmt: skip
        return match

    def held(self, points: FloatArray, told: Prediction) -> SurfaceMatch:
        """The match from where the wheels lead that gives in to the scan less than others do."""
        T, share = told.T_map_base, self._config.surfaces.share
        return self._surfaces.match(points, T, T, told.odometry, pull=share)

    def around(self, points: FloatArray, told: Prediction, usual: SE2 | None) -> SurfaceMatch:
        """The best match from where the robot was last and from all around where it may be: there, where
        the wheels lead, and where it is if it went on as before, whatever the wheels say: by the usual
        motion, None where that is not known."""
        config, T_last, T_predicted = self._config, told.T_last, told.T_map_base
        middles = [T_last, T_predicted]
        middles += [] if usual is None else [T_last @ usual]
        found = [
            self._surfaces.match(points, T_predicted, T_predicted, told.odometry, config.trust)
        ]
        starts, reach_m, most = [T_last], config.reach_m, _MOST
        if told.sigma_m > config.lost_m:  # wheels that stood for seconds while the robot drove on
            middles, reach_m = [T_predicted], min(2.0 * told.sigma_m, config.lost_reach_m)
            most = _MOST_FAR
        for middle in middles:
            starts += self._surfaces.searched(points, middle, reach_m, config.reach_rad, most=most)
        # wheels that are that far off tell little of where along a wall the robot is
        loose = LITTLE * told.odometry
        for start in starts:
            match = self._surfaces.match(points, start, T_predicted, loose)
            if self._is_from(match, middles, reach_m):
                found.append(match)
        return min(found, key=lambda match: match.cost)

    def _is_from(self, match: SurfaceMatch, middles: Sequence[SE2], reach_m: float) -> bool:
        """Whether a match is of what was looked for at most so far around any of some poses."""
        reach = _WIDER * reach_m, _WIDER * self._config.reach_rad
        return any(match.T_map_base.is_near(middle, *reach) for middle in middles)

    def is_better(
        self,
        match: SurfaceMatch,
        led: SurfaceMatch,
        told: Prediction,
        points: FloatArray,
        beams: Beams,
        usual: SE2 | None,
    ) -> bool:
        """Whether a match is to be believed rather than the one where the wheels lead; who hardly know of the
        way know no better than that the robot goes on by its usual motion."""
        config, better = self._config, self._config.better
        if told.is_guess and told.other is None and usual is not None:
            goes_on = apart_m(match.T_map_base, told.T_last @ usual) < GUESS_M
            better = 0.0 if goes_on else better
        if not match.T_map_base.is_near(told.T_map_base, config.most_off_m, math.inf):
            # over a long way wheels are no more than a guess, and yet know how far off they may be
            is_denied = told.squared(match) > told.noise * config.surely_wrong
            if not told.others or (is_denied and not told.is_coasting):
                return False
        if told.squared(match) > config.trust:
            better = self._better_against(match, led, points, beams)
        return match.cost < led.cost - better

    def is_borne_out(
        self, match: SurfaceMatch, told: Prediction, points: FloatArray, beams: Beams
    ) -> bool:
        """Whether a scan that fits badly, or after a long way, was taken where the wheels lead all the
        same: they are sure of it, and of what the last keyframes and the scan have in view, hardly
        anything is denied by the other."""
        config, variances = self._config, told.noise * np.diag(told.covariance)
        if (
            variances[0] + variances[1] > config.denial.sure[0] ** 2
            or variances[2] > config.denial.sure[1] ** 2
            or told.squared(match, inverse_of(told.covariance)) > config.trust
            or match.seen_ratio < config.least_seen_ratio
        ):
            return False
        seen, denied = self.denied(match.T_map_base, points, beams)
        return seen >= config.least_begun and denied <= config.denial.most * seen

    def denied(self, T_map_base: SE2, points: FloatArray, beams: Beams) -> tuple[int, int]:
        """Of what a scan at a pose and the last keyframes have in view of one another: how many points,
        and how many of them the other's beams went through."""
        config, nothing = self._config.denial, np.zeros((3, 3))
        ends = np.ascontiguousarray(points[:, :2])
        scan = Keyframe(0.0, T_map_base, SE2.identity(), nothing, ends, beams, is_break=False)
        seen = denied = 0
        for keyframe in reversed(self._keyframes[-config.witnesses :]):
            there = keyframe.T_map_base.between(T_map_base)
            counts = passed(scan, keyframe, there, config.margins, config.aside_m)
            seen, denied = seen + counts[0], denied + counts[1]
            if keyframe.is_break:
                break
        return seen, denied

    def passed(self, T_map_base: SE2, beams: Beams) -> float:
        """Share of what the last keyframe but one shows in a scan's view that its beams went through; 0
        where the last one stands alone."""
        if len(self._keyframes) < 2 or self._keyframes[-1].is_break:
            return 0.0
        before, config = self._keyframes[-2], self._config
        T_base_before = T_map_base.between(before.T_map_base)
        seen, through = contradictions(
            before.points[::_LOOKED_THROUGH], T_base_before.x, T_base_before.y, T_base_before.theta,
            beams.middle_m, beams.angles_rad, beams.ranges_m, *config.denial.margins, 0.0,
        )  # fmt: skip
        enough = _LOOKED_THROUGH * seen >= config.min_points
        return through / seen if enough else 0.0

    def _better_against(
        self, match: SurfaceMatch, led: SurfaceMatch, points: FloatArray, beams: Beams
    ) -> float:
        """Cost by which a match must be better that the wheels contradict: the next door of a corridor
        fits better than new places do where they lead. None is that the last keyframes deny more than
        where the wheels lead; where they deny that, odometry has jumped or lags."""
        config = self._config
        (seen, denied), (seen_led, denied_led) = (
            self.denied(one.T_map_base, points, beams) for one in (match, led)
        )
        more = denied / max(seen, 1) - denied_led / max(seen_led, 1)
        if more > config.denial.more[0]:
            return math.inf
        return config.better if more < -config.denial.more[1] else config.better_against

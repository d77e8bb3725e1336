"""Where a scan may lie: where the wheels lead, or around; and what the last keyframes deny of it."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from slam.arrays import FloatArray
from slam.beams import Beams
from slam.contradictions import passed
from slam.front_end_config import GUESS_M, FrontEndConfig
from slam.kernels.normal_equations import inverse_of
from slam.kernels.visibility import contradictions
from slam.keyframes import Keyframe
from slam.open_matches import LITTLE, closed_match
from slam.people_along import SeenBefore
from slam.se2 import SE2
from slam.still_scans import StillScans
from slam.strays import apart_m
from slam.surface_map import SurfaceMap, SurfaceMatch

_WIDER = 1.5
"""Of a search's reach: matches may slide off from where it looked; farther, they are of something
else. Chosen."""
_GUESS_RAD = 0.3
"""As `GUESS_M`, of the heading. Chosen."""
_STANDS = 1e-6
"""[m], [rad]: odometry that tells of less tells of nothing."""
_SPUN, _STILL = (0.15, 0.05), (0.05, 0.02)
"""[m], [rad] by which wheels must lead off where the robot stood, and within which a scan says that it stands.
Chosen."""
_KNOWN_FROM = 4
"""Keyframes in a row that a place is known from. Chosen: by two, pillars where the wheels led fitted worse than
those alike where the robot had been."""
_STILL_FITS, _STILL_BETTER = 0.95, 0.05
"""Share of a scan on surfaces where the robot stood, and cost by which it must fit better there. Chosen: in a
corridor with doors, wheels that spun by 0.25 to 0.5 m between two scans made it 0.07 to 0.23."""
_SLIPPED, _SLIP_BETTER = (0.1, 0.1), 0.03
"""[m], [rad] off where the wheels hold a scan, and cost by which it must fit better, for them to have slipped.
Chosen: between doors, wheels that told of twice or half of a metre's way made it 0.03 to 0.12 for one scan of three at
least."""
_MOST_FACING, _DRAWN = 0.15, (1.0, 6.0)
"""Share of a scan across a direction that people may make up, and normalised error squared of the wheels, as noisy
as they show, by which they draw a scan aside: with them, and alone. Chosen: of people ahead, who leave a scan
each 0.05 to 0.1 m where it was, and of five real logs 155 scans of 8157 were asked, one was of people."""
_CLEAN = 0.08
"""Cost of a scan alone, beyond which, over a short way, little is said by beams that seem to look through what
others met. Chosen: in a mine, between rough walls, of which half the beams come back, a scan alone costs 0.09 to
0.31; where people draw it along, 0.03 to 0.07."""
_SHORT_M = 0.3
"""Of the wheels since the last scan; after more, people are asked of where a scan is farther off than wheels are.
Chosen: with a scan each metre, wheels off by a third of that were believed rather than right scans."""
_LOOKED_THROUGH = 3
"""Of so many points, one is asked whether beams went through. Chosen: all would take a tenth of the
front end's time."""


@dataclass(frozen=True, eq=False)
class Prediction:
    """Where the wheels lead from the last scan's pose, and the covariance (3, 3) of that.

    odometry: (3, 3) information by which matches are held there; not the inverse of the covariance
    if is_coasting: nobody measured the motion, and the robot goes on as it did. noise: of the wheels,
    see `WheelScale`. other: a motion that may have been in its place. are_people: from the last
    keyframe, since what scans saw walked along.
    """

    T_last: SE2
    T_map_base: SE2
    covariance: FloatArray
    odometry: FloatArray
    noise: float
    is_coasting: bool
    other: SE2 | None = None
    are_people: bool = False

    @property
    def is_guess(self) -> bool:
        """Whether next to nothing is known of the way since the last scan."""
        P = self.covariance
        return bool(max(P[0, 0], P[1, 1]) > GUESS_M**2 or P[2, 2] > _GUESS_RAD**2)

    @property
    def way_m(self) -> float:
        """From there to where the wheels lead."""
        return apart_m(self.T_last, self.T_map_base)

    @property
    def others(self) -> list[SE2]:
        """Where the robot may be as well: it has stopped, or odometry jumped, or did not."""
        if not (self.is_coasting or self.is_guess):
            return []
        return [self.T_last] if self.other is None else [self.T_last, self.T_last @ self.other]

    def is_denying(self, match: SurfaceMatch, most: float) -> bool:
        """Whether the wheels, as noisy as they show, deny a match by more than so much of their normalised
        error squared. Those that stand may tell late of a way, and deny nothing."""
        stands = self.T_map_base.is_near(self.T_last, _STANDS, _STANDS)
        return not stands and self.squared(match) > self.noise * most

    def squared(self, match: SurfaceMatch, information: FloatArray | None = None) -> float:
        """Normalised innovation squared of a match, by an information (3, 3); None: the odometry's."""
        innovation = (self.T_map_base.inverse() @ match.T_map_base).log()
        information = self.odometry if information is None else information
        return float(innovation @ information @ innovation)


class Candidates:
    """Matches of a scan with the surfaces that the last keyframes saw, and with where the robot stood."""

    def __init__(
        self, surfaces: SurfaceMap, keyframes: Sequence[Keyframe], config: FrontEndConfig
    ) -> None:
        self._surfaces, self._keyframes, self._config = surfaces, keyframes, config
        self.still = StillScans()

    def led(self, points: FloatArray, beams: Beams, told: Prediction) -> SurfaceMatch:
        """The match of faced points (N, 3) of a scan where the wheels lead."""
        config, T_predicted = self._config, told.T_map_base
        match = self._surfaces.match(points, T_predicted, T_predicted, told.odometry)
        better = config.better if told.is_coasting else config.better_guess
        for start in told.others:
            other = self._surfaces.match(points, start, T_predicted, told.odometry)
            match = other if other.cost < match.cost - better else match
        if told.squared(match) > config.trust:
            # walls seen for the first time may draw a scan along those known, and people
            is_denied = told.is_denying(match, config.surely_wrong)
            held = self.held(points, told)
            if held.cost < match.cost + (config.better_against if is_denied else config.better):
                match = held
        if match.least_facing < config.least_facing:
            before = SeenBefore(self._keyframes, points, beams, config)
            match = closed_match(
                self._surfaces, points, T_predicted, told.odometry, match, config, told.noise,
                # walls that wheels slip along, or tell late of, were there
                lambda one: told.is_denying(one, config.surely_wrong) and before.are_people(one, T_predicted),
            )  # fmt: skip
        return match

    def stood(
        self, points: FloatArray, beams: Beams, told: Prediction, led: SurfaceMatch
    ) -> SurfaceMatch | None:
        """The match of faced points (N, 3) where the robot was when a scan looked the same, if its wheels
        spun since: they fit there, and far worse where these lead. None where they did not."""
        if led.cost < _STILL_BETTER or not self._is_known(told):
            return None
        T_still = self.still.place(beams, told.T_last, told.way_m)
        if T_still is None or led.T_map_base.is_near(T_still, *_SPUN):
            return None
        alone = self._alone(points, T_still)
        fits = min(alone.inlier_ratio, alone.seen_ratio) > _STILL_FITS
        if not (fits and alone.T_map_base.is_near(T_still, *_STILL)):
            return None
        if alone.cost > led.cost - _STILL_BETTER:
            return None
        if self._are_people(points, beams, told, alone):
            return None
        return self._held_little(points, told, T_still)

    def slipped(
        self, points: FloatArray, beams: Beams, told: Prediction, led: SurfaceMatch
    ) -> SurfaceMatch | None:
        """The match of faced points (N, 3) where they tell alone that they are, against wheels that slipped
        on part of the way: found from where these lead as from where the robot was, and fitting far better
        than where the wheels hold the scan. None where they did not."""
        if led.cost < _STILL_BETTER or led.least_facing > _MOST_FACING or not self._is_known(told):
            return None
        alone = self._alone(points, told.T_map_base)
        is_clean = min(alone.inlier_ratio, alone.seen_ratio) > _STILL_FITS and alone.cost < _CLEAN
        if not is_clean or alone.cost > led.cost - _SLIP_BETTER:
            return None
        is_off = not led.T_map_base.is_near(alone.T_map_base, *_SLIPPED)
        if not is_off or not told.is_denying(alone, self._config.surely_wrong):
            return None
        other = self._alone(points, told.T_last)
        if not other.T_map_base.is_near(alone.T_map_base, *_STILL):
            return None
        if self._are_people(points, beams, told, alone):
            return None
        return self._held_little(points, told, alone.T_map_base)

    def may_be_people(self, told: Prediction, match: SurfaceMatch) -> bool:
        """Whether it is worth to ask `are_people`: wheels that had spun when scans denied them lead on from
        there, and do not deny the next ones."""
        if match.least_facing > _MOST_FACING:
            return False
        is_asked = told.way_m <= _SHORT_M or told.squared(match) > self._config.trust
        return is_asked and told.is_denying(match, _DRAWN[0])

    def are_people(
        self,
        points: FloatArray,
        beams: Beams,
        told: Prediction,
        since: Prediction,
        match: SurfaceMatch,
    ) -> bool:
        """Whether people who walked along drew a match of faced points (N, 3) aside of where the wheels led
        since the last keyframe, and since the last scan: told."""
        if not (self.may_be_people(told, match) and since.is_denying(match, _DRAWN[0])):
            return False
        alone = self._alone(points, match.T_map_base)
        off = alone.T_map_base.inverse() @ since.T_map_base
        is_turned = math.hypot(off.x, off.y) < abs(off.theta)  # walls tell the heading
        is_clean = alone.cost < _CLEAN or told.way_m > _SHORT_M
        if is_turned or not is_clean or not since.is_denying(alone, _DRAWN[1]):
            return False
        return self._are_people(points, beams, since, alone)

    def held_along(
        self, points: FloatArray, since: Prediction, match: SurfaceMatch
    ) -> SurfaceMatch:
        """As `held`, but only along the way that people drew a match aside: walls tell the rest."""
        T, share = since.T_map_base, self._config.surfaces.share
        off = T.inverse() @ self._alone(points, match.T_map_base).T_map_base
        way = np.array([off.x, off.y, 0.0]) / math.hypot(off.x, off.y)
        along = np.outer(way, way) / float(way @ since.covariance @ way)
        return self._surfaces.match(points, T, T, along, pull=share)

    def _is_known(self, told: Prediction) -> bool:
        """Whether the last keyframes know the place, and the wheels something of the way."""
        last = self._keyframes[-_KNOWN_FROM:]
        is_known = len(last) == _KNOWN_FROM and not any(one.is_break for one in last)
        return is_known and not told.is_guess

    def _are_people(
        self, points: FloatArray, beams: Beams, told: Prediction, alone: SurfaceMatch
    ) -> bool:
        """Whether what drew a scan to a match without the wheels walked along."""
        before = SeenBefore(self._keyframes, points, beams, self._config)
        return before.are_people(alone, told.T_map_base)

    def _held_little(self, points: FloatArray, told: Prediction, T_start: SE2) -> SurfaceMatch:
        """The match near a pose, the wheels pulling a little."""
        return self._surfaces.match(points, T_start, told.T_map_base, LITTLE * told.odometry)

    def _alone(self, points: FloatArray, T_start: SE2) -> SurfaceMatch:
        """The match near a pose without the wheels."""
        return self._surfaces.match(points, T_start, T_start, np.zeros((3, 3)))

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
        starts = [T_last]
        for middle in middles:
            starts += self._surfaces.searched(points, middle, config.reach_m, config.reach_rad)
        # wheels that are that far off tell little of where along a wall the robot is
        loose = LITTLE * told.odometry
        for start in starts:
            match = self._surfaces.match(points, start, T_predicted, loose)
            reach = _WIDER * config.reach_m, _WIDER * config.reach_rad
            if any(match.T_map_base.is_near(middle, *reach) for middle in middles):
                found.append(match)
        return min(found, key=lambda match: match.cost)

    def is_better(
        self,
        match: SurfaceMatch,
        led: SurfaceMatch,
        told: Prediction,
        points: FloatArray,
        beams: Beams,
    ) -> bool:
        """Whether a match is to be believed rather than the one where the wheels lead."""
        config, better = self._config, self._config.better
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
            there = keyframe.T_map_base.inverse() @ T_map_base
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
        T_base_before = T_map_base.inverse() @ before.T_map_base
        seen, through = contradictions(
            before.points[::_LOOKED_THROUGH], T_base_before.as_array(), beams.middle_m,
            beams.angles_rad, beams.ranges_m, *config.denial.margins, 0.0,
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

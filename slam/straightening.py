"""Scans of a moving robot matched as if taken at once, and how late those are that cannot be."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace

import numpy as np

from slam.arrays import FloatArray
from slam.beams import Beams
from slam.deskew import BodyMotion, SweepClock, deskewed
from slam.fusion import mixed
from slam.measurements import LaserScan
from slam.scan_match import ScanMatch
from slam.se2 import SE2

MatchBeams = Callable[[Beams], ScanMatch]
"""Finds the pose of beams, from a prediction and on a map that it knows."""

_LATE = 9.0
"""Chosen: squared lateness, in standard deviations of the match, that is worth a word."""
_CHANGE_ODDS = np.array([-2.0, 0.0, -5.0, -5.0, -5.0])
"""Chosen, log of, for `BodyMotion.alternatives`: robots speed up evenly, most of the time."""
_TRUST = 0.1
"""Chosen: beams that pass edges make a scan's log-likelihood jump by 15 from pose to pose."""
_AFTER_S = 0.005
"""Chosen: beams fired so long after the stamp are worth a word; drivers' clocks differ by less."""
_NO_JITTER_S = 1e-6
_JITTERED = 1.4
"""Of an interval that is wrong by so much, the lateness: 1 as the speed that it makes of the way, and
0.4 as the change of that speed."""
_PROBES = np.diag([0.02, 0.0, 0.02])[[0, 2]]
"""Ways within a sweep by which a first scan is tried for motion: 2 cm ahead, 20 mrad of a turn;
shorter ones tell less than beams at edges make the log-likelihood jump."""
_IS_MOVING = 15.0
"""Chosen: gain in log-likelihood. In 15 poses each of room_fig4 a robot at rest exceeded it in one,
at 0.5 rad/s in all, at 0.2 m/s in ten, at 0.1 rad/s in two: slow motion is missed."""


class Straightener:
    """Straightens the scans of one robot by how it moved, as far as that is known.

    deskew, sweep_s, fastest: as in `LocalizerConfig`. late: (3, 3) [m], [rad] by how much the pose
    last matched may be late, as a covariance in the base frame, which no other scan averages out;
    zeros where the scan could be straightened.
    """

    def __init__(
        self,
        T_base_laser: SE2,
        *,
        deskew: bool = True,
        sweep_s: float = 0.1,
        fastest: tuple[float, float] = (0.5, 1.0),
    ) -> None:
        self.T_base_laser = T_base_laser
        self.late: FloatArray = np.zeros((3, 3))
        self._deskew, self._sweep_s, self._fastest = deskew, sweep_s, fastest
        self._clock = SweepClock()
        self._lead_s = 0.0
        self._motion: BodyMotion | None = None
        self._moved: FloatArray = np.zeros(3)
        self._sigma: FloatArray = np.zeros(3)
        self._straightened: tuple[LaserScan, Beams] | None = None
        self._rested: tuple[FloatArray, Beams] | None = None

    def duration_s(self, time_s: float, motion: SE2) -> float:
        """How long the motion up to a stamp took [s]; inf while no interval is known."""
        return self._clock.duration_s(time_s, motion)

    def pass_over(self, time_s: float) -> None:
        """Notes the stamp of a scan that nobody asks to be straightened."""
        self._clock.pass_over(time_s)

    def take_motion(
        self,
        time_s: float,
        beam_times_s: FloatArray | None,
        moved: SE2,
        duration_s: float,
        sigma: FloatArray | None = None,
    ) -> None:
        """Notes the motion up to a stamp; none where it is not known how long it took.

        sigma: (3,) of the motion [m], [m], [rad]; by default as good as none.
        """
        self._sigma = np.zeros(3) if sigma is None else sigma
        end_s = time_s
        if beam_times_s is not None and len(beam_times_s):
            if self._clock.is_told:
                self._lead_s = end_s - float(beam_times_s.max())
            else:  # a stamp not to believe: the beams' own times tell when it ended
                end_s = float(beam_times_s.max()) + self._lead_s
        self._moved, before, self._motion = moved.log(), self._motion, None
        self._straightened = None
        if np.isfinite(duration_s):
            start_s = end_s - duration_s
            before = None if before is None else before.ended(start_s)
            self._motion = BodyMotion.over(moved, start_s, end_s, before)

    def beams(self, scan: LaserScan) -> Beams:
        """The beams of a scan, straightened where the motion and their times are known."""
        # a matcher and a guard ask for the same ones
        if self._straightened is None or self._straightened[0] is not scan:
            self._straightened = scan, self._along(scan, self._motion)
        return self._straightened[1]

    def matched(
        self, scan: LaserScan, match_beams: MatchBeams
    ) -> tuple[ScanMatch, tuple[str, ...]]:
        """The match of a scan, straightened as far as it can be, and what is to be said of it."""
        self.late = np.zeros((3, 3))
        motion = self._motion
        if motion is None:
            return self._match_of_unknown_motion(scan, match_beams)
        if not self._can_straighten(scan):
            return self._match_skewed(scan, motion, match_beams)
        return self._match_along(scan, motion, match_beams), _said_of_late(scan, motion.end_s)

    def _can_straighten(self, scan: LaserScan) -> bool:
        return self._deskew and scan.beam_times_s is not None

    def _along(self, scan: LaserScan, motion: BodyMotion | None) -> Beams:
        if motion is None or not self._can_straighten(scan):
            return self._at_rest(scan)
        return deskewed(scan, self.T_base_laser, motion)

    def _at_rest(self, scan: LaserScan) -> Beams:
        """The beams of a scan from where it was taken, of which most look where those of the last did."""
        if self._rested is None or self._rested[0] is not scan.angles_rad:
            self._rested = scan.angles_rad, Beams.of(scan, self.T_base_laser)
            return self._rested[1]
        return self._rested[1].with_ranges(scan.ranges_m)

    def _match_along(
        self, scan: LaserScan, motion: BodyMotion, match_beams: MatchBeams
    ) -> ScanMatch:
        """The match of a scan straightened by a motion, or by others of the same way, mixed."""
        unknown = self._after_stamp(scan, motion)
        # the scan tells where the robot was amid its sweep: from there on goes half of the motion
        unknown = unknown + np.diag((self._sigma / 2.0) ** 2)
        if self._clock.jitter_s > _NO_JITTER_S:
            jitter_s = _JITTERED * self._clock.jitter_s
            unknown = unknown + motion.lateness(jitter_s, self._lever_m(scan))
        if unknown.any():
            unsteadiness = np.sqrt(motion.unsteadiness**2 + np.diag(unknown))
            motion = replace(motion, unsteadiness=unsteadiness)
        match = _less_sure(match_beams(self.beams(scan)), motion)
        if match.information is None or motion.is_steady(match.information):
            return match
        found = [
            match if way is motion else _less_sure(match_beams(self._along(scan, way)), way)
            for way in motion.alternatives()
        ]
        return _likeliest(found, _CHANGE_ODDS)

    def _after_stamp(self, scan: LaserScan, motion: BodyMotion) -> FloatArray:
        """(3, 3) by how much a scan is off as beams were still fired after the stamp.

        What speed the robot changed to at the stamp the wheels tell with the next scan. As standard
        deviation of it: half of the fastest, or of the speed now if that is faster.
        """
        if scan.beam_times_s is None:
            return np.zeros((3, 3))
        after_s = np.maximum(scan.beam_times_s - motion.end_s, 0.0)
        if not after_s.any():
            return np.zeros((3, 3))
        fastest = np.array([self._fastest[0], 0.0, self._fastest[1]])
        change = replace(motion, velocity=np.maximum(fastest, np.abs(motion.velocity)) / 2.0)
        return np.diag(np.diag(change.lateness(2.0 * float(after_s.mean()), self._lever_m(scan))))

    def _lever_m(self, scan: LaserScan) -> float:
        """How far the points of a scan are from the base on average [m]."""
        points = self.beams(scan).points
        return float(np.hypot(*points.T).mean()) if len(points) else 0.0

    def _match_skewed(
        self, scan: LaserScan, motion: BodyMotion, match_beams: MatchBeams
    ) -> tuple[ScanMatch, tuple[str, ...]]:
        """The match of a scan as it is, its lateness noted: an error that never averages out."""
        beams, sweep_s = self.beams(scan), self._sweep_s
        match = match_beams(beams)
        if scan.beam_times_s is not None and len(beams):
            sweep_s = float(np.abs(scan.beam_times_s - motion.end_s).max())
        longest_s = motion.end_s - motion.start_s
        self.late = motion.lateness(min(sweep_s, longest_s), self._lever_m(scan))
        self.late = self.late + self._after_stamp(scan, motion)
        said = _said_of_late(scan, motion.end_s)
        if match.information is None or np.trace(match.information @ self.late) < _LATE:
            return match, said
        speed_mps, turn_radps = math.hypot(*motion.velocity[:2]), abs(motion.velocity[2])
        why = "it has no beam times" if scan.beam_times_s is None else "deskew is switched off"
        return match, (
            f"scan not straightened: {why}, and the robot moved at {speed_mps:.2f} m/s and"
            f" {turn_radps:.2f} rad/s",
            *said,
        )

    def _match_of_unknown_motion(
        self, scan: LaserScan, match_beams: MatchBeams
    ) -> tuple[ScanMatch, tuple[str, ...]]:
        """The match of a scan before any motion is known: at rest, unless it says otherwise."""
        match, times_s = match_beams(self.beams(scan)), scan.beam_times_s
        sweep_s = np.inf if times_s is None or not len(times_s) else float(np.ptp(times_s))
        if sweep_s == 0.0:
            return match, ()
        # the motion told took as long as the sweep at least
        self.late = np.outer(self._moved, self._moved) / 4.0
        if np.isinf(sweep_s) or match.information is None or match.log_likelihood is None:
            return match, ()
        late, is_moving = np.zeros((3, 3)), False
        fastest = np.array([self._fastest[0], 0.0, self._fastest[1]])
        for probe in _PROBES:
            gain, slope = self._tried(scan, match, probe / sweep_s, match_beams)
            is_moving = is_moving or gain > _IS_MOVING
            off = slope * float(fastest @ (probe > 0.0)) * sweep_s / probe.max()
            late += np.outer(off, off)
        if not is_moving:
            return match, ()
        self.late = self.late + late
        return match, (
            "scan not straightened: the robot moved while it was taken, and nothing tells how",
        )

    def _tried(
        self, scan: LaserScan, match: ScanMatch, velocity: FloatArray, match_beams: MatchBeams
    ) -> tuple[float, FloatArray]:
        """Most that a motion along a velocity (3,) gains in log-likelihood over a match of the scan
        at rest; half the change (3,) of the pose from minus to plus that velocity."""
        end_s, back = scan.time_s, match.T_map_base.inverse()
        found = []
        for sign in (-1.0, 1.0):
            motion = BodyMotion.over(SE2.exp(sign * velocity), end_s - 1.0, end_s)
            found.append(match_beams(deskewed(scan, self.T_base_laser, motion)))
        before, after = (
            -math.inf if one.log_likelihood is None else one.log_likelihood for one in found
        )
        first, last = ((back @ one.T_map_base).log() for one in found)
        assert match.log_likelihood is not None
        half, bend = (after - before) / 2.0, 2.0 * match.log_likelihood - before - after
        best = half * half / (2.0 * bend) if bend > 0.0 else 0.0
        gain = max(best, before - match.log_likelihood, after - match.log_likelihood)
        return gain, (last - first) / 2.0


def _said_of_late(scan: LaserScan, stamp_s: float) -> tuple[str, ...]:
    """That beams were fired after the stamp of a scan, in words; nothing where hardly any were."""
    if scan.beam_times_s is None:
        return ()
    after_s = float(scan.beam_times_s.max(initial=stamp_s)) - stamp_s
    if not after_s > _AFTER_S:
        return ()
    return (
        f"beams were fired up to {1000.0 * after_s:.0f} ms after the stamp, and how the robot moved"
        " then is a guess: stamp the measurement when the last beam is fired, and give the wheels'"
        " motion up to there",
    )


def _less_sure(match: ScanMatch, motion: BodyMotion) -> ScanMatch:
    """A match, less sure by what the motion that straightened its scan does not know."""
    if match.information is None:
        return match
    smooth = match.smooth
    if smooth is not None:
        smooth = replace(smooth, information=motion.less_sure(smooth.information))
    return replace(match, information=motion.less_sure(match.information), smooth=smooth)


def _likeliest(found: list[ScanMatch], log_odds: FloatArray) -> ScanMatch:
    """Those of several matches that hold, mixed by their odds and by what each says of the scan."""
    usable = [
        k for k, match in enumerate(found) if match.is_matched and match.information is not None
    ]
    if not usable:
        return found[0]
    log_likelihoods = np.array([found[k].log_likelihood or 0.0 for k in usable])
    return mixed([found[k] for k in usable], log_odds[usable] + _TRUST * log_likelihoods)

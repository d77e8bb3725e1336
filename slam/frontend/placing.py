"""Which match of a scan is believed: the verdict on each step of the front end."""

from __future__ import annotations

from slam.arrays import FloatArray
from slam.beams import Beams
from slam.frontend.candidates import Candidates
from slam.frontend.front_end_config import FrontEndConfig
from slam.frontend.keyframes import StepStatus
from slam.frontend.pauses import Pauses
from slam.frontend.prediction import Prediction, is_told
from slam.frontend.seen_before import LastSeen
from slam.frontend.slipped_wheels import SlippedWheels
from slam.frozen_laser import FrozenLaser
from slam.measurements import Measurement
from slam.surface.surface_match import SurfaceMatch


class Placing:
    """Finds where scans were taken, near where wheels lead or around, and says whether that is to be believed."""

    def __init__(self, last: LastSeen, config: FrontEndConfig) -> None:
        self._config, self._last = config, last
        self.candidates, self.slipped_wheels = Candidates(last), SlippedWheels(last)
        self.pauses, self._laser = Pauses(config.pauses), FrozenLaser()

    def believed(
        self, measurement: Measurement, points: FloatArray, beams: Beams, told: Prediction
    ) -> tuple[SurfaceMatch | None, StepStatus, float]:
        """The match of a scan to be believed, if there is one, and what it looks through there."""
        match, status = self._placed(measurement, points, beams, told)
        passed_ratio = self.candidates.passed(match.T_map_base, beams) if match else 0.0
        if passed_ratio > self._config.most_passed:
            match, status = None, StepStatus.BROKEN
        if status is StepStatus.BROKEN and len(points) < self._config.least_begun:
            status = StepStatus.CARRIED
        return match, status, passed_ratio

    def _placed(
        self,
        measurement: Measurement,
        points: FloatArray,
        beams: Beams,
        told: Prediction,
    ) -> tuple[SurfaceMatch | None, StepStatus]:
        """The match of a scan to be believed, if there is one."""
        config, is_frozen = self._config, self._laser.repeats(measurement.scan)
        has_paused = self.pauses.take(told.elapsed_s, measurement.motion)
        if len(points) < config.min_points or is_frozen or not self._last.keyframes:
            return None, StepStatus.CARRIED
        most_m = config.blind_m if is_told(measurement) else (config.guess_blind_m,) * 2
        if told.blind_m > most_m[1]:
            return None, StepStatus.BROKEN
        led = match = self.candidates.led(points, beams, told)
        least = config.pause_inlier_ratio if has_paused else config.least_inlier_ratio
        good = config.guess_inlier_ratio if told.is_guess else config.good_inlier_ratio
        status, is_blind = StepStatus.MATCHED, told.blind_m > most_m[0]
        against = self.slipped_wheels.against(points, beams, told, led)
        if against is not None:
            match, status = against, StepStatus.SEARCHED
        elif match.inlier_ratio < max(good, least):
            usual = None if told.is_coasting else told.usual
            best = self.candidates.around(points, told, usual)
            if self.candidates.is_better(best, led, told, points, beams, usual):
                match, status = best, StepStatus.SEARCHED
        is_weak = len(points) < config.least_begun and not is_blind
        if is_weak and not told.is_guess and told.squared(match) > config.trust:
            return None, StepStatus.CARRIED  # few points against the wheels
        if told.sigma_m > config.lost_m and told.other is None:
            # what hardly fits, fits elsewhere too
            least = max(least, config.guess_inlier_ratio)
        fits = match.inlier_ratio >= least and match.seen_ratio >= config.least_seen_ratio
        if fits and not is_blind and not self._is_against(match, told):
            return match, status
        doubtful = (
            config.least_inlier_ratio if has_paused or is_blind else config.denial.doubtful_ratio
        )
        is_borne_out = self.candidates.is_borne_out
        for match in (led, self.candidates.held(points, told)):
            if match.inlier_ratio >= doubtful and is_borne_out(match, told, points, beams):
                return match, StepStatus.MATCHED
        return None, StepStatus.BROKEN

    def _is_against(self, match: SurfaceMatch, told: Prediction) -> bool:
        """Whether a scan fits badly, and where wheels that measured the way did not lead."""
        least, most = self._config.against
        return (
            not told.is_coasting
            and match.inlier_ratio < least
            and told.squared(match) > told.noise * most
        )

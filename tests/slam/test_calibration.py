"""Calibration against drives whose every number is known, then against simulated noise."""

from dataclasses import dataclass, field

import numpy as np
import pytest

from slam.beams import Beams
from slam.calibration import Calibration, CalibrationConfig, calibrate
from slam.measurements import LaserScan, Measurement
from slam.odometry import DifferentialDrive
from slam.scan_match import MatchStatus, ScanMatch
from slam.se2 import SE2

ASSUMED = DifferentialDrive((0.075, 0.075), 0.36, 132_000)
TRUE = DifferentialDrive((0.0752, 0.0749), 0.363, 132_000)
ASSUMED_MOUNT, TRUE_MOUNT = SE2(0.19, 0.0, 0.0), SE2(0.193, 0.004, 0.005)
TRUE_VALUES = np.array([0.0752, 0.0749, 0.363, 0.193, 0.004, 0.005])
MATCH_SIGMAS = np.array([0.001, 0.001, 0.0005])
MOTION_SIGMAS = np.array([1e-4, 1e-4, 2e-4])
PERIOD_S = 0.1

STRAIGHT, LEFT, RIGHT = (0.2, 0.0), (0.0, 0.5), (0.0, -0.5)
BOTH_WAYS = (STRAIGHT, LEFT, STRAIGHT, RIGHT, (0.2, 0.3), (0.2, -0.3), LEFT, RIGHT)
"""Legs of so much forward speed [m/s] and turn rate [rad/s]."""


@dataclass
class KnownPoses:
    """A matcher that knows each scan's pose from its only range, the scan's number.

    It finds where the laser is, as all do, and so the base where the assumed mounting puts it.
    """

    T_map_lasers: list[SE2] = field(default_factory=list)
    status: MatchStatus = MatchStatus.MATCHED
    wrong: frozenset[int] = frozenset()
    lost: frozenset[int] = frozenset()

    def __call__(self, beams: Beams, T_predicted: SE2) -> ScanMatch:
        number = int(beams.ranges_m[0])
        T_base_laser = SE2(*beams.origins_m[0], beams.angles_rad[0])
        T_map_base = self.T_map_lasers[number] @ T_base_laser.inverse()
        if number in self.lost:
            return ScanMatch(T_predicted, MatchStatus.LOST)
        if number in self.wrong:
            T_map_base = T_map_base @ SE2(0.05, -0.03, 0.02)
        return ScanMatch(T_map_base, self.status, information=np.diag(MATCH_SIGMAS**-2.0))


def drive(
    legs: tuple[tuple[float, float], ...],
    rng: np.random.Generator | None = None,
    leg_steps: int = 40,
) -> tuple[list[Measurement], KnownPoses]:
    """A drive of the true robot, without noise where there is no rng."""
    T, matcher, measurements = SE2(1.0, 2.0, 0.3), KnownPoses(), []
    speeds = [(0.0, 0.0), *(leg for leg in legs for _ in range(leg_steps))]
    for number, (v, w) in enumerate(speeds):
        # what the robot commands as it believes to be, its encoders count
        half = w * ASSUMED.track_m / 2.0
        angles = PERIOD_S * np.array([v - half, v + half]) / ASSUMED.wheel_radius_m
        ticks = angles * ASSUMED.ticks_per_turn / (2.0 * np.pi)
        T = T @ TRUE.motion(ticks)
        T_map_laser = T @ TRUE_MOUNT
        if rng is not None:
            T = T @ SE2.exp(rng.normal(0.0, MOTION_SIGMAS))
            noise = SE2.exp(-rng.normal(0.0, MATCH_SIGMAS))
            # the noise is of the base where the match has it
            T_map_laser = T @ TRUE_MOUNT @ ASSUMED_MOUNT.inverse() @ noise @ ASSUMED_MOUNT
        matcher.T_map_lasers.append(T_map_laser)
        time_s = PERIOD_S * number
        scan = LaserScan(time_s, np.zeros(1), np.array([float(number)]))
        motion = ASSUMED.motion(ticks)
        measurements.append(Measurement(time_s, motion, scan, np.diag(MOTION_SIGMAS**2)))
    return measurements, matcher


def calibrated(
    measurements: list[Measurement], matcher: KnownPoses, config: CalibrationConfig | None = None
) -> Calibration:
    start = SE2(1.0, 2.0, 0.3)
    return calibrate(measurements, matcher, start, ASSUMED_MOUNT, ASSUMED, config)


def test_drive_without_noise_gives_all_six():
    found = calibrated(*drive(BOTH_WAYS))
    # the priors, a tenth wide, pull by 1e-9 of what is off
    np.testing.assert_allclose(found.values, TRUE_VALUES, atol=1e-6)
    assert found.is_observable
    assert found.advice == ""
    assert found.drive.ticks_per_turn == ASSUMED.ticks_per_turn


@pytest.mark.slow
def test_errors_are_as_large_as_the_covariance_says():
    rng, errors, spreads = np.random.default_rng(7), [], []
    config = CalibrationConfig(passes=1)  # these matches do not depend on the deskewing
    for _ in range(40):
        found = calibrated(*drive(BOTH_WAYS, rng, leg_steps=20), config)
        error = found.values - TRUE_VALUES
        errors.append(error @ np.linalg.solve(found.covariance, error))
        spreads.append([found.chi2_match, found.chi2_wheels])
    # chi square of 6 has variance 12: the mean of 40 is 6 +- 0.55; three of these to either side
    assert 4.4 < np.mean(errors) < 7.6
    # one drive of 160 scans tells the wheels' noise, below the matches', to 20 %: 40 to 3 %
    np.testing.assert_allclose(np.mean(spreads, axis=0), 1.0, atol=0.1)


@pytest.mark.slow
def test_covariance_widens_where_matches_are_worse_than_promised():
    measurements, matcher = drive(BOTH_WAYS, np.random.default_rng(1))
    honest = calibrated(measurements, matcher)
    rng = np.random.default_rng(2)
    matcher.T_map_lasers = [
        T @ SE2.exp(rng.normal(0.0, 3.0 * MATCH_SIGMAS)) for T in matcher.T_map_lasers
    ]
    worse = calibrated(measurements, matcher)
    assert worse.chi2_match > 4.0
    assert honest.warnings == ()
    assert worse.warnings[0].startswith("scans scatter")
    assert (worse.sigmas > 1.2 * honest.sigmas).all()


@pytest.mark.parametrize(
    ("legs", "names", "way"),
    [
        ((STRAIGHT, STRAIGHT), {"track_m", "x_m", "y_m"}, "on the spot"),
        ((LEFT, RIGHT), {"theta_rad"}, "straight"),
        ((LEFT, LEFT, STRAIGHT), {"y_m"}, "as much to the right"),
    ],
)
def test_drive_that_shows_too_little_says_what_to_drive(legs, names, way):
    found = calibrated(*drive(legs, np.random.default_rng(3)))
    assert names <= set(found.not_observable)
    assert not found.is_observable
    assert way in found.advice
    # what is open stays about as assumed: within the prior's width
    assert np.abs(found.values - TRUE_VALUES).max() < 0.3


def test_place_that_holds_few_scans_is_what_is_to_be_changed():
    measurements, matcher = drive((LEFT, LEFT), np.random.default_rng(3))
    matcher.lost = frozenset(k for k in range(len(measurements)) if k % 4)
    found = calibrated(measurements, matcher)
    assert not found.is_observable
    assert f"{found.matched} of {len(measurements)} scans were matched" in found.advice
    assert "all directions" in found.advice


@pytest.mark.slow
def test_few_wrong_matches_do_little():
    measurements, matcher = drive(BOTH_WAYS, np.random.default_rng(4))
    matcher.wrong = frozenset(range(5, 300, 37))
    found = calibrated(measurements, matcher)
    # 50 mm off each; the same drive without them has sigmas of 0.1 mm
    assert np.abs(found.values - TRUE_VALUES)[3:5].max() < 0.001


def test_scans_that_do_not_match_are_bridged_by_the_wheels():
    measurements, matcher = drive(BOTH_WAYS)
    matcher.lost = frozenset(range(0, 300, 3)) | frozenset(range(100, 120))
    found = calibrated(measurements, matcher)
    assert found.matched == 321 - len(matcher.lost)
    np.testing.assert_allclose(found.values, TRUE_VALUES, atol=1e-6)


def test_drive_of_which_nothing_matches_is_refused():
    measurements, matcher = drive(BOTH_WAYS)
    matcher.status = MatchStatus.LOST
    with pytest.raises(ValueError, match="0 of 321 scans match"):
        calibrated(measurements, matcher)


def test_short_drive_is_refused():
    measurements, matcher = drive(BOTH_WAYS)
    with pytest.raises(ValueError, match="10 scans or more, not 9"):
        calibrated(measurements[:9], matcher)


def test_motion_without_covariance_is_refused():
    measurements, matcher = drive(BOTH_WAYS)
    bare = [Measurement(m.time_s, m.motion, m.scan, np.zeros((3, 3))) for m in measurements]
    with pytest.raises(ValueError, match="motion_covariance"):
        calibrated(bare, matcher)

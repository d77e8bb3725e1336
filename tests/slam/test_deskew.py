"""Scans straightened: what a moving robot saw lies on the walls again."""

import math

import numpy as np
import pytest

from slam.beams import Beams
from slam.deskew import BodyMotion, SweepClock, deskewed
from slam.measurements import LaserScan
from slam.se2 import SE2
from tests.slam.slow_twins import cast_all
from tests.slam.synthetic import ANGLES_RAD, ROOM_SEGMENTS

LASER = SE2(0.19, 0.03, 0.2)
WALLS = np.concatenate([ROOM_SEGMENTS, ROOM_SEGMENTS[:, ::-1]])
START = SE2(2.6, 1.9, 0.4)
PERIOD_S = 0.1


def driven(
    velocity: np.ndarray, acceleration: np.ndarray, times_s: np.ndarray, steps_per_s: int = 20_000
) -> list[SE2]:
    """Poses at increasing times, by tiny steps of the twist velocity + acceleration * time."""
    poses, pose, at_s = [], START, 0.0
    for time_s in times_s:
        count = max(1, math.ceil((time_s - at_s) * steps_per_s))
        step_s = (time_s - at_s) / count
        for k in range(count):
            middle_s = at_s + (k + 0.5) * step_s
            pose = pose @ SE2.exp((velocity + acceleration * middle_s) * step_s)
        poses.append(pose)
        at_s = time_s
    return poses


def seen(
    poses: list[SE2], beam_times_s: np.ndarray, angles_rad: np.ndarray = ANGLES_RAD
) -> LaserScan:
    """The scan whose beams were fired from these poses, one from each."""
    lasers = [pose @ LASER for pose in poses]
    origins = np.array([[laser.x, laser.y] for laser in lasers])
    headings = np.array([laser.theta for laser in lasers]) + angles_rad
    fired = Beams(origins, headings, np.full(len(poses), np.nan))
    ranges_m, _ = cast_all(WALLS, fired, SE2.identity())
    return LaserScan(beam_times_s.max(), angles_rad, ranges_m, beam_times_s)


def off_walls_m(points_map: np.ndarray) -> np.ndarray:
    a, along = ROOM_SEGMENTS[:, 0], ROOM_SEGMENTS[:, 1] - ROOM_SEGMENTS[:, 0]
    share = np.einsum("kij,ij->ki", points_map[:, None] - a, along) / np.sum(along**2, axis=1)
    feet = a + np.clip(share, 0.0, 1.0)[..., None] * along
    return np.hypot(*np.moveaxis(points_map[:, None] - feet, 2, 0)).min(axis=1)


SWEEP_S = PERIOD_S * (np.arange(len(ANGLES_RAD)) + 1.0) / len(ANGLES_RAD)


@pytest.mark.parametrize(
    "velocity",
    [(0.5, 0.0, 0.0), (0.0, 0.0, 1.5), (0.8, 0.0, -1.2), (0.3, 0.1, 0.0005), (0.0, 0.0, 0.0)],
)
def test_constant_twist_is_undone_to_the_micrometre(velocity):
    twist = np.array(velocity)
    poses = [START @ SE2.exp(twist * time_s) for time_s in SWEEP_S]
    motion = BodyMotion.over(SE2.exp(twist * PERIOD_S), 0.0, PERIOD_S)
    beams = deskewed(seen(poses, SWEEP_S), LASER, motion)
    straight_m = off_walls_m(START @ SE2.exp(twist * PERIOD_S) @ beams.points)
    assert straight_m.max() < 1e-6
    assert not motion.acceleration.any()
    assert not motion.unsteadiness.any()
    skewed = Beams.of(seen(poses, SWEEP_S), LASER)
    skewed_m = off_walls_m(START @ SE2.exp(twist * PERIOD_S) @ skewed.points)
    # centimetres, or this test would show nothing
    assert skewed_m.max() > 0.01 or not twist.any()


def test_beams_fired_from_elsewhere_than_the_stamp_are_seen_from_the_stamp():
    # driving ahead at 1 m/s, a beam fired 0.1 s before starts 0.1 m behind
    scan = LaserScan(1.0, np.array([0.0, 1.0]), np.array([2.0, 2.0]), np.array([0.9, 1.0]))
    motion = BodyMotion.over(SE2(0.1, 0.0, 0.0), 0.9, 1.0)
    beams = deskewed(scan, SE2(0.2, 0.0, 0.0), motion)
    np.testing.assert_allclose(beams.origins_m, [[0.1, 0.0], [0.2, 0.0]], atol=1e-12)
    # and turning at 1 rad/s it looked 0.1 rad more to the right
    beams = deskewed(scan, SE2.identity(), BodyMotion.over(SE2(0.0, 0.0, 0.1), 0.9, 1.0))
    np.testing.assert_allclose(beams.angles_rad, [-0.1, 1.0], atol=1e-12)


@pytest.mark.parametrize(
    ("velocity", "acceleration"),
    [((0.3, 0.0, 0.5), (0.0, 0.0, 1.0)), ((0.2, 0.0, 0.0), (1.0, 0.0, -1.0))],
)
def test_even_acceleration_is_undone_once_the_motion_before_is_known(velocity, acceleration):
    velocity, acceleration = np.array(velocity), np.array(acceleration)
    poses = driven(velocity, acceleration, np.concatenate([[PERIOD_S], PERIOD_S + SWEEP_S]))
    first, last = poses[0], poses[-1]
    before = BodyMotion.over(START.inverse() @ first, 0.0, PERIOD_S)
    times_s = PERIOD_S + SWEEP_S
    scan = seen(poses[1:], times_s)
    knowing = BodyMotion.over(first.inverse() @ last, PERIOD_S, 2.0 * PERIOD_S, before)
    straight_m = off_walls_m(last @ deskewed(scan, LASER, knowing).points)
    # what does not commute of a twist that changes: 1/12 a w T^3 = 0.04 mm at 0.5 m/s, 1 rad/s2
    assert straight_m.max() < 1e-4
    np.testing.assert_allclose(knowing.acceleration, acceleration, atol=0.02)
    ignorant = BodyMotion.over(first.inverse() @ last, PERIOD_S, 2.0 * PERIOD_S)
    # 1 rad/s2 in 0.1 s is 1.25 mrad off in the middle: 3 mm and more at 3 m
    assert off_walls_m(last @ deskewed(scan, LASER, ignorant).points).max() > 1e-3


def test_unsteadiness_is_a_sixteenth_of_what_the_acceleration_s_change_makes():
    steady = BodyMotion.over(SE2(0.1, 0.0, 0.0), 0.0, 0.1)
    pushed = BodyMotion.over(SE2(0.12, 0.0, 0.0), 0.1, 0.2, steady)
    # from 1.0 to 1.2 m/s in 0.1 s: 2 m/s2, after 0: 2 * 0.1^2 / 16
    np.testing.assert_allclose(pushed.unsteadiness, [0.02 / 16.0, 0.0, 0.0], atol=1e-12)
    going_on = BodyMotion.over(SE2(0.14, 0.0, 0.0), 0.2, 0.3, pushed)
    np.testing.assert_allclose(going_on.unsteadiness, 0.0, atol=1e-12)


def test_motion_before_a_gap_says_nothing():
    before = BodyMotion.over(SE2(0.1, 0.0, 0.0), 0.0, 0.1)
    after = BodyMotion.over(SE2(0.2, 0.0, 0.0), 0.15, 0.25, before)
    assert not after.acceleration.any()
    assert not after.unsteadiness.any()


@pytest.mark.parametrize("turn_radps", [-6.0, 6.0])
def test_beams_of_an_interlaced_laser_stay_sorted_however_fast_it_turns(turn_radps):
    # an LMS200: half a degree by two turns of the mirror, 1/75 s each
    angles_rad = np.radians(np.arange(361) * 0.5 - 90.0)
    index = np.arange(361)
    times_s = (index % 2) / 75.0 + index * 0.5 / 360.0 / 75.0
    end_s = times_s.max()
    twist = np.array([0.3, 0.0, turn_radps])
    poses = [START @ SE2.exp(twist * time_s) for time_s in times_s]
    scan = seen(poses, times_s, angles_rad)
    beams = deskewed(scan, LASER, BodyMotion.over(SE2.exp(twist * end_s), 0.0, end_s))
    # 0.08 rad from one to the next half: they have overtaken their neighbours
    fired_rad = angles_rad + turn_radps * (times_s - end_s)
    assert (np.diff(fired_rad) < 0.0).any()
    assert (np.diff(beams.angles_rad) >= 0.0).all()
    assert off_walls_m(START @ SE2.exp(twist * end_s) @ beams.points).max() < 1e-6
    assert sorted(beams.ranges_m) == sorted(scan.ranges_m)


def test_invalid_ranges_stay_with_their_beams():
    ranges_m = np.array([1.0, np.nan, np.inf, -np.inf])
    scan = LaserScan(0.1, np.array([0.0, 0.1, 0.2, 0.3]), ranges_m, np.full(4, 0.1))
    beams = deskewed(scan, SE2.identity(), BodyMotion.over(SE2(0.1, 0.0, 0.0), 0.0, 0.1))
    np.testing.assert_array_equal(beams.ranges_m, ranges_m)


def test_scan_without_beam_times_cannot_be_deskewed():
    scan = LaserScan(0.1, np.zeros(1), np.ones(1))
    with pytest.raises(ValueError, match="beam_times_s"):
        deskewed(scan, LASER, BodyMotion.over(SE2.identity(), 0.0, 0.1))


@pytest.mark.parametrize("end_s", [1.0, 0.5, math.nan])
def test_motion_over_no_time_is_refused(end_s):
    with pytest.raises(ValueError, match="start before its end"):
        BodyMotion.over(SE2.identity(), 1.0, end_s)


def test_alternatives_go_the_same_way_by_other_progress():
    before = BodyMotion.over(SE2(0.0, 0.0, 0.01), 0.0, 0.1)
    motion = BodyMotion.over(SE2(0.0, 0.0, 0.04), 0.1, 0.2, before)
    headings = [way.poses_at(np.array([0.1, 0.15, 0.2]))[:, 2] for way in motion.alternatives()]
    for heading in headings:
        # all of them turn by 40 mrad up to the stamp
        np.testing.assert_allclose(heading[[0, 2]], [-0.04, 0.0], atol=1e-12)
    # halfway: even speed; evenly faster, 0.3 rad/s an eighth of 0.1 s more; and kept at 0.1 rad/s
    # for a quarter, a half and three quarters of the time: 5 mrad less what 0.25, 0.5 s of it make
    middle = np.array([heading[1] for heading in headings])
    np.testing.assert_allclose(
        middle, [-0.02, -0.02375, -0.0375 * 2.0 / 3.0, -0.035, -0.035], atol=1e-12
    )


def test_change_of_speed_matters_from_a_fifth_of_a_sigma_on():
    before = BodyMotion.over(SE2(0.01, 0.0, 0.0), 0.0, 0.1)
    motion = BodyMotion.over(SE2(0.026, 0.0, 0.0), 0.1, 0.2, before)
    # 0.16 m/s more in 0.1 s: an eighth is 2 mm
    assert motion.is_steady(np.diag([0.011**-2.0, 1.0, 1.0]))
    assert not motion.is_steady(np.diag([0.009**-2.0, 1.0, 1.0]))


def clocked(stamps_s: list[float], speeds_mps: list[float]) -> list[float]:
    clock = SweepClock()
    return [
        clock.duration_s(stamp_s, SE2(0.1 * speed_mps, 0.0, 0.0))
        for stamp_s, speed_mps in zip(stamps_s, speeds_mps, strict=True)
    ]


@pytest.mark.parametrize("wrong_s", [0.1, -5.0, 90.0])
def test_wrong_stamp_counts_as_the_usual_interval_and_so_does_the_next(wrong_s):
    found_s = clocked([0.0, 0.1, 0.2, wrong_s, 0.4, 0.5], [1.0] * 6)
    assert found_s[0] == np.inf
    np.testing.assert_allclose(found_s[1:], 0.1)


def test_clock_that_was_set_goes_on_as_before():
    np.testing.assert_allclose(clocked([5.0, 5.1, 1.0, 1.1, 1.2], [1.0] * 5)[1:], 0.1)


def test_scans_without_beam_times_in_between_make_no_motion_longer():
    clock = SweepClock()
    for stamp_s in (0.0, 0.1):
        clock.duration_s(stamp_s, SE2(0.1, 0.0, 0.0))
    clock.pass_over(0.2)
    assert clock.duration_s(0.3, SE2(0.1, 0.0, 0.0)) == pytest.approx(0.1)


def jitter_of(stamps_s: np.ndarray, speeds_mps: np.ndarray) -> float:
    clock = SweepClock()
    for stamp_s, speed_mps in zip(stamps_s, speeds_mps, strict=True):
        clock.duration_s(float(stamp_s), SE2(0.1 * speed_mps, 0.0, 0.0))
    return clock.jitter_s


def test_clock_learns_by_how_much_stamps_are_wrong():
    stamps_s = 0.1 * np.arange(200) + np.random.default_rng(0).normal(0.0, 0.01, 200)
    # an interval has two of them, and only those that fit worse than the last are counted: 12 mm at
    # 1 m/s of sqrt(2) times 10, of the last 20 intervals
    assert 0.007 < jitter_of(stamps_s, np.ones(200)) < 0.02


def test_intervals_that_differ_as_the_way_does_are_no_jitter():
    lengths = np.random.default_rng(0).uniform(0.7, 1.3, 200)
    assert jitter_of(0.1 * np.cumsum(lengths), lengths) == 0.0
    # nor is a change of speed, nor a robot at rest
    assert jitter_of(0.1 * np.arange(200), lengths) < 1e-12
    assert jitter_of(0.1 * np.cumsum(lengths), np.zeros(200)) == 0.0


def test_pause_in_which_the_robot_went_on_is_no_wrong_stamp():
    found_s = clocked([0.0, 0.1, 0.2, 1.2], [1.0, 1.0, 1.0, 10.0])
    np.testing.assert_allclose(found_s[1:], [0.1, 0.1, 1.0])


def test_lateness_is_half_a_sweep_along_the_way():
    motion = BodyMotion.over(SE2(0.1, 0.0, 0.0), 0.0, 0.5)
    np.testing.assert_allclose(
        motion.lateness(0.1, 3.0), np.diag([0.01, 0.0, 0.0]) ** 2, atol=1e-15
    )
    turning = BodyMotion.over(SE2(0.0, 0.0, 0.04), 0.0, 0.1)
    # 20 mrad of heading, and 5 mrad of it bent, at 3 m
    expected = np.diag([0.015, 0.015, np.hypot(0.02, 0.005)]) ** 2
    np.testing.assert_allclose(turning.lateness(0.1, 3.0), expected, atol=1e-15)

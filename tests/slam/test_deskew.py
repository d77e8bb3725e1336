"""Scans straightened: what a moving robot saw lies on the walls again."""

import math

import numpy as np
import pytest

from slam.beams import Beams
from slam.deskew import BodyMotion, deskewed
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

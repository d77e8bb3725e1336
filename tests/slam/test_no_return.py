"""The range that a laser writes for no return, as a log shows it."""

import math
from collections.abc import Iterable, Sequence
from pathlib import Path

import numpy as np
import pytest

from slam.readers.carmen import read_carmen
from slam.readers.no_return import NoReturnSearch
from slam.readers.ticks import read_ticks
from slam.se2 import SE2
from tests.slam.synthetic import ROOM_SEGMENTS, room, round_wall, scan_of
from tests.slam.test_carmen import flaser, odom, written
from tests.slam.test_ticks import line

HALF_TURN_RAD = np.radians(np.arange(-90.0, 90.5, 0.5))
STEP_RAD = math.radians(0.5)
CORRIDOR = room(-1.0, -1.0, 41.0, 1.2)
"""With doors missing; a drive along it sees its end from 40 m away."""
ALONG = [SE2(0.5 * i, 0.0, 0.02 * math.sin(i)) for i in range(40)]
BACK_AND_FORTH = [SE2(2.0 + 0.5 * (i % 4), 2.0, 0.3 * i) for i in range(12)]


def ranges_at(
    walls: np.ndarray,
    poses: Iterable[SE2],
    end_m: float = math.inf,
    sigma_m: float = 0.01,
    cell_m: float = 0.01,
) -> list[np.ndarray]:
    """What a laser writes that ends at end_m, in steps of cell_m."""
    rng = np.random.default_rng(0)
    scans = [scan_of(walls, pose, rng, sigma_m, HALF_TURN_RAD, 100.0) for pose in poses]
    return [np.minimum(np.round(scan.ranges_m / cell_m) * cell_m, end_m) for scan in scans]


def found_m(scans: Sequence[np.ndarray], poses: Sequence[SE2] | None) -> float:
    """By scans from poses; None: from nobody knows where."""
    search = NoReturnSearch()
    for index, ranges_m in enumerate(scans):
        position = None if poses is None else (poses[index].x, poses[index].y)
        search.add(ranges_m, STEP_RAD, position)
    return search.no_return_m


@pytest.mark.parametrize("end_m", [4.0, 5.6, 8.18, 29.96])
def test_range_at_which_a_laser_ends_is_its_code(end_m):
    assert end_m - 0.05 < found_m(ranges_at(CORRIDOR, ALONG, end_m), ALONG) < end_m
    assert found_m(ranges_at(CORRIDOR, ALONG), ALONG) == math.inf


def test_codes_beside_each_other_are_all_found():
    scans = ranges_at(CORRIDOR, ALONG, 8.191)
    for index, ranges_m in enumerate(scans):
        ranges_m[(ranges_m == 8.191) & (np.arange(len(ranges_m)) % 3 == index % 3)] = 8.183
    assert 8.15 < found_m(scans, ALONG) < 8.183


def test_faulty_line_does_not_hide_the_code():
    scans = ranges_at(CORRIDOR, ALONG, 8.18)
    scans[7][100] = 31.7
    assert 8.15 < found_m(scans, ALONG) < 8.18


@pytest.mark.parametrize("sigma_m", [0.0, 0.01])
@pytest.mark.parametrize("cell_m", [0.001, 0.01, 0.05])
def test_farthest_wall_of_a_robot_that_stands_is_a_wall(sigma_m, cell_m):
    poses = [SE2(0.0, 0.1, 0.0)] * 100
    through_a_door = [
        [[8.0, -4.0], [8.0, 4.0]],
        [[3.0, -3.0], [3.0, -0.2]],
        [[3.0, 3.0], [3.0, 0.4]],
    ]
    for walls in (CORRIDOR, ROOM_SEGMENTS - 2.0, np.array(through_a_door)):
        scans = ranges_at(walls, poses, sigma_m=sigma_m, cell_m=cell_m)
        for where in (poses, None):
            assert found_m(scans, where) == math.inf


def test_walls_that_a_drive_without_noise_keeps_as_far_are_walls():
    # the two farthest beams end on the side walls at the same range from everywhere
    straight = [SE2(0.5 * i, 0.0, 0.0) for i in range(20)]
    scans = ranges_at(room(-500.0, -1.0, 500.0, 1.0), straight, sigma_m=0.0)
    scans = [np.where(ranges_m > 12.0, np.inf, ranges_m) for ranges_m in scans]
    assert found_m(scans, straight) == math.inf
    # about the middle of a round room: the far side
    round_it = [SE2(0.0, 0.0, 0.7 * i) @ SE2(1.0, 0.0, math.pi) for i in range(9)]
    scans = ranges_at(round_wall(5.0), round_it, sigma_m=0.0)
    assert np.ptp([ranges_m.max() for ranges_m in scans]) < 0.011
    assert found_m(scans, round_it) == math.inf


def test_range_that_many_see_is_no_code_where_others_see_farther():
    near, far = ranges_at(CORRIDOR, ALONG[:20], 8.18), ranges_at(CORRIDOR, ALONG[20:])
    assert found_m(near, ALONG[:20]) < 8.18
    assert found_m(near + far, ALONG) == math.inf


def test_few_scans_tell_of_no_code():
    for poses in (ALONG[:4], [ALONG[0]] * 40):
        assert found_m(ranges_at(CORRIDOR, poses, 8.18), poses) == math.inf
    # of what no wall can be, five scans from one place are enough
    poses = [SE2(2.0, 2.0, 0.0)] * 5
    assert 1.9 < found_m(ranges_at(ROOM_SEGMENTS, poses, 2.0), None) < 2.0


@pytest.mark.parametrize("range_m", [8.18, math.nan, 0.0, 90.0])
def test_carmen_log_in_which_nothing_came_back_is_blind(tmp_path, range_m):
    lines = [front_laser(np.full(361, range_m), pose, float(i)) for i, pose in enumerate(ALONG)]
    log = read_carmen(written(tmp_path, *lines))
    with pytest.raises(
        ValueError, match=r"/a\.clf: none of the 40 scans has a beam that came back"
    ):
        log.check_sees()
    one_m = front_laser(np.where(np.arange(361) < 1, 1.0, range_m), ALONG[0], 99.0)
    assert not read_carmen(written(tmp_path, *lines, one_m)).is_blind


def test_so_is_a_log_of_ticks(tmp_path):
    path = Path(tmp_path) / "a.dat"
    path.write_text(f"{line(0, 0, 0, (0, 7, 5600))}\n{line(1, 0, 0, (0, 0, 0))}\n")
    assert read_ticks(path).is_blind
    path.write_text(f"{line(0, 0, 0, (0, 7, 5500))}\n{line(1, 0, 0, (0, 0, 0))}\n")
    assert not read_ticks(path).is_blind


def robot_laser(ranges_m: np.ndarray, pose: SE2, time_s: float) -> str:
    """A line that announces a maximum of 81.92 m."""
    facts = f"0 {-math.pi / 2} {math.pi} {STEP_RAD} 81.92 0.01 0"
    at = f"{pose.x} {pose.y} {pose.theta}"
    ranges = f"{len(ranges_m)} {' '.join(map(str, ranges_m))}"
    return f"ROBOTLASER1 {facts} {ranges} 0 {at} {at} 0 0 0 0 0 {time_s} nohost {time_s}"


def raw_laser(ranges_m: np.ndarray, pose: SE2, time_s: float) -> str:
    """A line without a maximum, and the odometry of it."""
    facts = f"0 {-math.pi / 2} {math.pi} {STEP_RAD} 0 0.01 0"
    ranges = f"{len(ranges_m)} {' '.join(map(str, ranges_m))}"
    raw = f"RAWLASER1 {facts} {ranges} 0 {time_s} nohost {time_s}"
    return f"{raw}\n{odom(pose.x, pose.y, pose.theta, time_s)}"


def front_laser(ranges_m: np.ndarray, pose: SE2, time_s: float) -> str:
    return flaser(ranges_m.tolist(), pose, time_s)


@pytest.mark.parametrize("as_line", [front_laser, robot_laser, raw_laser])
def test_no_return_of_a_carmen_log_is_infinite_and_its_walls_stay(tmp_path, as_line):
    scans = ranges_at(CORRIDOR, ALONG, 8.18)
    lines = [as_line(scans[i], pose, float(i)) for i, pose in enumerate(ALONG)]
    log = read_carmen(written(tmp_path, *lines))
    for measurement, ranges_m in zip(log.measurements(), scans, strict=True):
        expected = np.where(ranges_m >= 8.17, np.inf, ranges_m)
        np.testing.assert_allclose(measurement.scan.ranges_m, expected)


def test_so_is_that_of_a_log_of_ticks_and_a_beam_that_has_no_other_is_blind(tmp_path):
    scans = ranges_at(ROOM_SEGMENTS, BACK_AND_FORTH, 2.5)
    ticks = [round(2000 * 0.5 * i / (2 * math.pi * 0.077)) for i in range(len(scans))]
    lines = []
    for i, ranges_m in enumerate(scans):
        ranges_m[:2] = 2.5
        ranges_mm = tuple(np.round(1000 * ranges_m).astype(int).tolist())
        lines.append(line(100_000 * i, ticks[i], ticks[i], ranges_mm))
    path = Path(tmp_path) / "a.dat"
    path.write_text("\n".join(lines) + "\n")
    for measurement, ranges_m in zip(read_ticks(path).measurements(), scans, strict=True):
        expected = np.where(ranges_m >= 2.5, np.inf, ranges_m)
        expected[:2] = np.nan
        np.testing.assert_allclose(measurement.scan.ranges_m, expected)

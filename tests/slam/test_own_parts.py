"""Parts of the robot in its laser's view are left out, walls that it keeps to are not."""

import math
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest

from slam.readers.carmen import read_carmen
from slam.readers.log_record import LogRecord
from slam.readers.own_parts import OwnPartsSearch, own_parts_said, without_own_parts
from slam.se2 import SE2
from tests.slam.synthetic import room, scan_of

ANGLES = np.radians(np.arange(-90.0, 90.5, 1.0))
WALLS = np.concatenate([room(0.0, 0.0, 12.0, 8.0), room(4.0, 3.0, 7.0, 5.0)])


def driven(poses, rng, posts=()):
    """Scans at poses, with posts (beams from, to, range [m]) of the robot before the laser."""
    for pose in poses:
        scan = scan_of(WALLS, pose, rng, 0.01, ANGLES)
        ranges_m = scan.ranges_m.copy()
        for first, end, post_m in posts:
            ranges_m[first:end] = post_m + rng.normal(0.0, 0.01, end - first)
        yield LogRecord(0.0, pose, replace(scan, ranges_m=ranges_m))


def around():
    corners = np.array([[2.0, 1.5], [10.0, 1.5], [10.0, 6.5], [2.0, 6.5], [2.0, 1.5]])
    for start, end in [*pairwise(corners), *pairwise(corners)]:
        heading = math.atan2(*(end - start)[::-1])
        for share in np.arange(0.0, 1.0, 0.04):
            x, y = start + share * (end - start)
            yield SE2(x, y, heading + 0.2 * math.sin(9.0 * share))


def own(records):
    search = OwnPartsSearch()
    for record in records:
        search.add(record.scan.ranges_m)
    return search.is_own


def test_posts_of_the_robot_are_found_and_left_out():
    rng = np.random.default_rng(0)
    records = list(driven(around(), rng, [(20, 24, 0.4), (150, 153, 0.42), (178, 181, 0.25)]))
    is_own = own(records)
    assert np.flatnonzero(is_own).tolist() == [*range(19, 25), *range(149, 154), *range(177, 181)]
    (said,) = own_parts_said(is_own)
    assert said.startswith("15 of 181 beams see the same")
    read = without_own_parts(lambda: iter(records), is_own)
    for before, after in zip(records, read(), strict=True):
        assert np.isnan(after.scan.ranges_m[is_own]).all()
        np.testing.assert_array_equal(after.scan.ranges_m[~is_own], before.scan.ranges_m[~is_own])


def test_a_robot_without_parts_in_view_keeps_all_its_beams():
    is_own = own(driven(around(), np.random.default_rng(0)))
    assert not is_own.any()
    assert own_parts_said(is_own) == ()


def test_a_robot_that_stands_sees_walls():
    poses = [SE2(1.0, 0.5, 0.0)] * 200
    assert not own(driven(poses, np.random.default_rng(0))).any()


@pytest.mark.parametrize("wobble_rad", [0.0, 0.01, 0.03])
def test_a_wall_that_the_robot_keeps_to_is_none_of_its_parts(wobble_rad):
    rng, search = np.random.default_rng(0), OwnPartsSearch()
    for _ in range(200):
        scan = scan_of(
            room(-60.0, 0.0, 60.0, 40.0),
            SE2(0.0, 0.5, rng.normal(0.0, wobble_rad)),
            rng,
            0.005,
            ANGLES,
        )
        other_m = rng.uniform(2.0, 30.0, len(ANGLES))
        search.add(np.where(ANGLES > -0.3, other_m, scan.ranges_m))
    assert not search.is_own.any()


def test_a_companion_for_a_third_of_the_way_is_none():
    rng = np.random.default_rng(0)
    poses = list(around())
    records = [*driven(poses[:70], rng, [(20, 24, 0.4)]), *driven(poses[70:], rng)]
    assert not own(records).any()
    assert not own(records[::-1]).any()


def test_reader_tells_and_leaves_out(tmp_path):
    lines = []
    for k, record in enumerate(driven(around(), np.random.default_rng(0), [(20, 24, 0.4)])):
        pose, ranges_m = record.T_odom_base, record.scan.ranges_m
        at = f"{pose.x:.6f} {pose.y:.6f} {pose.theta:.6f}"
        beams = " ".join(f"{one:.3f}" for one in ranges_m)
        lines.append(f"FLASER 181 {beams} {at} {at} {0.5 * k:.3f} robot {0.5 * k:.3f}")
    path = tmp_path / "posts.clf"
    path.write_text("\n".join(lines) + "\n")
    log = read_carmen(path)
    (said,) = log.notes
    assert said.startswith("6 of 181 beams")
    for measurement in log.measurements():
        assert np.flatnonzero(np.isnan(measurement.scan.ranges_m)).tolist() == [*range(19, 25)]

"""Poses that never change: of wheels that tell nothing, or of a robot that stands."""

import gzip
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest

from slam.readers.recognition import read_log
from slam.readers.silent_wheels import SILENT, SilentWheels
from slam.se2 import SE2
from tests.slam.turtlebot import Recording, write_bag

EXCERPT = Path(__file__).parents[1] / "data" / "fr101-excerpt.clf.gz"
HERE = SE2(1.0, 2.0, 0.3)


def told(poses, scans) -> bool:
    wheels = SilentWheels()
    for pose in poses:
        wheels.add_pose(pose)
    for ranges_m in scans:
        wheels.add_scan(np.asarray(ranges_m))
    return wheels.is_silent


def test_wheels_are_silent_where_most_of_what_is_seen_changes():
    rng = np.random.default_rng(0)
    views = rng.uniform(1.0, 8.0, (10, 90))
    assert told([HERE] * 3, views)
    assert not told([HERE, HERE @ SE2(0.0, 0.0, 1e-6)], views)
    stood = views[0] + rng.normal(0.0, 0.02, (10, 90))
    assert not told([HERE] * 3, stood)
    stood[3:, :40] = 0.7  # somebody came, and stays
    assert not told([HERE] * 3, stood)


def zeroed(path: Path, is_still: bool, with_odometry: bool) -> Path:
    """The excerpt with poses that say nothing; or its first scan again and again."""
    first = None
    with gzip.open(EXCERPT, "rt") as log, path.open("w") as out:
        for line in log:
            fields = line.split()
            if fields[0] == "ODOM" and with_odometry:
                fields[1:4] = ["0.0"] * 3
            elif fields[0] == "FLASER":
                count = int(fields[1])
                first = first or fields[2 : 2 + count]
                fields[2 + count : 8 + count] = ["0.0"] * 6
                if is_still:
                    fields[2 : 2 + count] = first
            elif fields[0] != "PARAM":
                continue
            out.write(" ".join(fields) + "\n")
    return path


@pytest.mark.parametrize("with_odometry", [False, True])
def test_log_of_poses_that_never_change_has_scans_alone(tmp_path, with_odometry):
    log = read_log(zeroed(tmp_path / "robot.clf", False, with_odometry))
    assert not log.has_odometry
    assert log.notes == (SILENT,)
    least = min(np.diag(one.motion_covariance)[0] for one in list(log.measurements())[1:])
    assert least > 0.5


def test_robot_that_stood_has_wheels(tmp_path):
    assert read_log(zeroed(tmp_path / "robot.clf", True, True)).has_odometry
    assert read_log(EXCERPT).has_odometry


@dataclass
class WithoutWheels(Recording):
    """Its odometry says that it stands."""

    @property
    def odometry(self):
        return [(time_s, HERE) for time_s, _ in super().odometry]


def test_bag_of_poses_that_never_change_has_scans_alone(tmp_path):
    write_bag(tmp_path / "robot", WithoutWheels(duration_s=12.0))
    assert not read_log(tmp_path / "robot").has_odometry
    write_bag(tmp_path / "wheels", Recording(duration_s=2.0))
    assert read_log(tmp_path / "wheels").has_odometry

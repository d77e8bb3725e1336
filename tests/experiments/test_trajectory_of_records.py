"""The pose of every record of a log, where nothing but scans tells it."""

import gzip
from pathlib import Path

import numpy as np
import pytest

from experiments.slam_log import default_mapped
from slam.readers.recognition import read_log

EXCERPT = Path(__file__).parents[1] / "data" / "fr101-excerpt.clf.gz"


@pytest.fixture(scope="module")
def silent_log(tmp_path_factory):
    """The excerpt, its odometry records without a motion, some before its first scan and after its last."""
    with gzip.open(EXCERPT, "rt") as lines:
        fields = [line.split() for line in lines]
    scans = [one for one in fields if one[0] == "FLASER"][:6]
    records = []
    for scan in scans:
        count = int(scan[1])
        scan[2 + count : 8 + count] = ["0.0"] * 6
        stamp = float(scan[-3])
        for before_s in (0.2, 0.1):
            time_s = str(stamp - before_s)
            records.append(["ODOM", *["0.0"] * 6, time_s, "robot", time_s])
        records.append(scan)
    time_s = str(stamp + 0.1)
    records.append(["ODOM", *["0.0"] * 6, time_s, "robot", time_s])
    path = tmp_path_factory.mktemp("logs") / "silent.clf"
    path.write_text("".join(" ".join(record) + "\n" for record in records))
    return read_log(path)


def test_records_of_wheels_that_tell_nothing_lie_between_the_scans(silent_log):
    assert not silent_log.has_odometry
    result = default_mapped(silent_log)
    poses, scans = result.trajectory.poses, result.slam_map.trajectory.poses
    assert len(poses) == len(silent_log.records) == 3 * len(scans) + 1
    assert poses[2::3] == pytest.approx(scans)
    assert poses[[0, 1, -1]] == pytest.approx(scans[[0, 0, -1]])
    assert np.hypot(*(scans[-1, :2] - scans[0, :2])) > 0.3
    for before, after, between in zip(
        scans[:-1], scans[1:], poses[3:-1].reshape(-1, 3, 3), strict=True
    ):
        assert between[0] == pytest.approx(before + (after - before) / 3.0)
        assert between[1] == pytest.approx(before + (after - before) / 1.5)

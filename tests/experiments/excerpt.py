"""A piece of fr101, with its reference: what benchmarks that change a log are tried on."""

from itertools import pairwise
from pathlib import Path

import numpy as np

from slam.measurements import LaserScan
from slam.readers.log import Log

DATA = Path(__file__).parents[1] / "data"
LOG, REFERENCE = DATA / "fr101-excerpt.clf.gz", DATA / "fr101-excerpt.reference.tum"


def scans(log: Log) -> list[LaserScan]:
    return [record.scan for record in log.records if record.scan is not None]


def steps(log: Log) -> np.ndarray:
    """(N - 1, 3) by the wheels, from each record to the next."""
    poses = [record.T_odom_base for record in log.records]
    return np.array([(a.inverse() @ b).as_array() for a, b in pairwise(poses)])


def read_twice(log: Log) -> Log:
    """The log, if both readings have the same in them, and as much as it says."""
    first, again = (np.concatenate([scan.ranges_m for scan in scans(log)]) for _ in range(2))
    np.testing.assert_array_equal(first, again)
    assert len(list(log.records)) == len(log.records)
    assert len(scans(log)) == log.scan_count
    return log

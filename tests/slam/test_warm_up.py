"""What is compiled before a robot drives is all that its scans need."""

import subprocess
import sys
from pathlib import Path

import pytest

CODE = """
import numpy as np
from slam import Mapper, warm_up
from tests.slam import ring
from tests.slam.compiled import loaded

warm_up()
before = loaded()
mapper = Mapper(ring.T_BASE_LASER)
for measurement in ring.drive(ring.way(1.1, 0.3), np.random.default_rng(0)):
    mapper.update(measurement)
print(sorted(name for name, _ in loaded() - before))
"""


CONTINUED = """
import numpy as np
from slam import Mapper, warm_up
from tests.slam import ring
from tests.slam.compiled import loaded

rng = np.random.default_rng(0)
first, later = (ring.drive(ring.way(1.1, 0.3), rng) for _ in range(2))
mapper = Mapper(ring.T_BASE_LASER)
for measurement in first:
    mapper.update(measurement)
slam_map = mapper.finish()
warm_up(is_continued=True)
mapper = Mapper.continued(slam_map, ring.T_BASE_LASER)
before = loaded()
for measurement in later:
    mapper.update(measurement)
print(sorted(name for name, _ in loaded() - before))
"""


SUSPECTED = """
import numpy as np
from slam import SE2, Beams, LaserScan, warm_up
from slam.frontend.still_scans import StillScans
from tests.slam.compiled import loaded

scan = LaserScan(0.0, np.radians(np.arange(-90.0, 91.0)), np.full(181, 3.0))
warm_up()
before = loaded()
still, beams = StillScans(), Beams.of(scan, SE2.identity())
still.take(beams, SE2.identity())
still.place(beams, SE2.identity(), 0.0)
print(sorted(name for name, _ in loaded() - before))
"""
"""Scans that nobody expects to look so: asked while the robot drives, first of all after minutes."""


@pytest.mark.slow
@pytest.mark.parametrize(
    "code", [CODE, CONTINUED, SUSPECTED], ids=["new", "continued", "suspected"]
)
def test_no_scan_waits_for_compiled_code(code):
    done = subprocess.run(
        [sys.executable, "-c", code], cwd=Path(__file__).parents[2], capture_output=True, text=True,
        check=True,
    )  # fmt: skip
    assert done.stdout.split("\n")[-2] == "[]"

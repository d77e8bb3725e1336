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


@pytest.mark.slow
@pytest.mark.parametrize("code", [CODE, CONTINUED], ids=["new", "continued"])
def test_no_scan_waits_for_compiled_code(code):
    done = subprocess.run(
        [sys.executable, "-c", code], cwd=Path(__file__).parents[2], capture_output=True, text=True,
        check=True,
    )  # fmt: skip
    assert done.stdout.split("\n")[-2] == "[]"

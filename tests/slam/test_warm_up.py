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


@pytest.mark.slow
def test_no_scan_waits_for_compiled_code():
    done = subprocess.run(
        [sys.executable, "-c", CODE], cwd=Path(__file__).parents[2], capture_output=True, text=True,
        check=True,
    )  # fmt: skip
    assert done.stdout.split("\n")[-2] == "[]"

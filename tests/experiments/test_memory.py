"""Memory as it is told: what was held for a moment too."""

from pathlib import Path

import numpy as np
import pytest

from experiments.memory import MemoryGrowth

pytestmark = pytest.mark.skipif(
    not Path("/proc/self/clear_refs").exists(), reason="the system does not tell"
)


def held_mb(count: int) -> float:
    """Held for a moment, so much that it is not of pages that were given back before."""
    return float(np.ones(count).sum()) * 8.0 / 1e6


def test_growth_is_the_most_that_was_held_and_not_what_is_left():
    growth = MemoryGrowth()
    assert held_mb(10_000_000) == 80.0
    told_mb = growth.most_mb()
    assert told_mb is not None
    assert 75.0 < told_mb < 100.0


def test_what_was_held_before_does_not_count():
    held_mb(20_000_000)
    growth = MemoryGrowth()
    held_mb(10_000_000)
    told_mb = growth.most_mb()
    assert told_mb is not None
    assert 75.0 < told_mb < 100.0

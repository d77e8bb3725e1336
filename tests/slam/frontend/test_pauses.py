"""Pauses between scans: too long for the way that the wheels tell of."""

from __future__ import annotations

import math

import pytest

from slam.frontend.pauses import Pauses
from slam.se2 import SE2


def driven(pauses, count=30):
    """A log that keeps a scan each 0.7 m and each 20 degrees; twenty such turns to ten metres."""
    for k in range(count):
        if k % 3:
            assert not pauses.take(0.2, SE2(0.0, 0.0, 0.35))
        else:
            assert not pauses.take(2.1, SE2(0.7, 0.0, 0.0))
    return pauses


def test_first_scan_comes_after_no_pause():
    assert not Pauses().take(math.inf, SE2.identity())
    assert Pauses().usual_interval_s == 0.0


@pytest.mark.parametrize(
    ("elapsed_s", "motion", "is_pause"),
    [
        (2.2, SE2(0.7, 0.0, 0.0), False),  # as fast as ever
        (3.9, SE2(0.7, 0.0, 0.0), False),  # half as fast
        (2.2, SE2.identity(), True),  # stood
        (6.0, SE2(0.7, 0.0, 0.0), True),  # drove, and stood for longer than that took
        (6.0, SE2(0.9, 0.0, 0.0), False),  # too far to have been carried at that time
        (1.0, SE2.identity(), False),
    ],
)
def test_pause_is_what_the_way_does_not_take(elapsed_s, motion, is_pause):
    pauses = driven(Pauses())
    assert pauses.usual_interval_s == 0.2
    assert pauses.take(elapsed_s, motion) is is_pause


def test_stamps_that_jump_are_no_pause_and_teach_no_pace():
    pauses = driven(Pauses())
    for _ in range(8):
        assert not pauses.take(-100.0, SE2(0.7, 0.0, 0.0))
    assert not pauses.take(2.2, SE2(0.7, 0.0, 0.0))

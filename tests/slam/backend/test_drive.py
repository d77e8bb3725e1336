"""What is kept of a drive: little of a scan that adds nothing to the map."""

from __future__ import annotations

import gc
import tracemalloc
from dataclasses import replace

import numpy as np

from slam.mapping import Mapper
from slam.se2 import SE2
from tests.slam import ring

_SETTLED, _MORE = 100, 1100
_MOST_BYTES = 300
"""Of a scan; the lists of things that were kept before took 840, and 1180 where a scan told nothing."""


def kept_of_a_scan(mapper: Mapper, is_seen: bool) -> float:
    """Bytes kept of each scan of a robot that stands, by its scans if is_seen, else by wheels alone."""
    (one,) = ring.drive(ring.way(0.1, 0.1)[:1], np.random.default_rng(0))
    ranges_m = one.scan.ranges_m if is_seen else np.full_like(one.scan.ranges_m, np.inf)
    mapper.update(one)
    before = 0
    tracemalloc.start()
    for k in range(1, _SETTLED + _MORE):
        if k == _SETTLED:
            gc.collect()
            before = tracemalloc.get_traced_memory()[0]
        scan = replace(one.scan, time_s=0.1 * k, ranges_m=ranges_m + 1e-4 * (k % 7))
        still = replace(
            one,
            time_s=0.1 * k,
            scan=scan,
            motion=SE2.identity(),
            motion_covariance=1e-6 * np.eye(3),
        )
        mapper.update(still)
    gc.collect()
    grown = tracemalloc.get_traced_memory()[0] - before
    tracemalloc.stop()
    return grown / _MORE


def test_of_a_scan_that_adds_nothing_its_place_is_kept_and_what_wheels_told():
    mapper = Mapper(ring.T_BASE_LASER)
    assert kept_of_a_scan(mapper, is_seen=True) < _MOST_BYTES
    assert len(mapper.finish().steps) == _SETTLED + _MORE


def test_of_a_scan_that_tells_nothing_how_unsure_its_place_is_is_kept_as_well():
    assert kept_of_a_scan(Mapper(ring.T_BASE_LASER), is_seen=False) < 2 * _MOST_BYTES

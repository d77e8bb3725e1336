"""Driving on with kidnaps, people and sensors that fail: what is counted, and what the faults are."""

import math

import numpy as np
import pytest

from experiments.bench.soak import FAULTS, Faults, soaked
from experiments.trials import TrialConfig
from kitasap_sim.simulation import SensorFrame


def frames(count):
    for number in range(count):
        time_s = 0.1 * number
        yield SensorFrame(time_s, np.full(2, 10.0 * number), np.full(9, 2.0), np.full(9, time_s))


def test_each_fault_comes_and_goes():
    faults, seen = Faults(np.random.default_rng(0)), {}
    for frame in frames(12_000):
        came = faults.frame(frame)
        seen.setdefault(faults.now, []).append((frame, came))
    assert set(seen) == {"", *FAULTS}
    assert all(came is None for _, came in seen["missing"])
    assert all((came.ranges_m == math.inf).all() for _, came in seen["nothing"])
    assert all(np.isnan(came.ranges_m).all() for _, came in seen["invalid"])
    assert all((came.ranges_m == 0.05).sum() == 3 for _, came in seen["covered"])
    assert all((came.ranges_m != 2.0).sum() == 3 for _, came in seen["noisy"])
    assert all((came.ranges_m == frame.ranges_m).all() for frame, came in seen[""])
    assert len(seen[""]) > 6000


def test_some_seconds_are_counted_to_the_last_scan(box_room):
    config = TrialConfig(place=box_room, methods=("limit",), laser="urg_04lx")
    soak = soaked(config, 0.0015, 0)
    assert sum(soak.said.values()) == pytest.approx(10 * soak.simulated_s, abs=2)
    assert soak.said["tracked"] > 40
    assert soak.said["wrong and sure"] == 0


@pytest.mark.slow
def test_ten_minutes_with_kidnaps_keep_memory_flat(box_room):
    config = TrialConfig(place=box_room, methods=("limit",), people=1)
    soak = soaked(config, 1 / 6, 0)
    assert soak.kidnaps >= 4
    assert soak.found_again >= soak.kidnaps - 1
    assert soak.grown_mb < 20.0

"""`kitasap bench wheels`: maps by the wheels assumed and by those found, of the same beams."""

from pathlib import Path

import numpy as np
import pytest

from experiments.bench import wheels
from tests.experiments.refusals import refusal

LOG = Path(__file__).parents[1] / "data" / "fr101-excerpt.clf.gz"


def test_log_without_ticks_is_refused_in_one_line(capsys):
    assert "expected a log of encoder ticks" in refusal(capsys, "bench", "wheels", str(LOG))


def test_each_repeat_loses_other_beams_and_the_same_by_either_wheels():
    log = wheels.read_log(LOG)
    drawn = [
        [
            np.isnan(one.scan.ranges_m)
            for one in wheels._thinned(log, np.random.default_rng(children))
        ]
        for children in (0, 0, 1)
    ]
    whole = [np.isnan(one.scan.ranges_m) for one in log.measurements()]
    lost = np.concatenate(drawn[0]) & ~np.concatenate(whole)
    # 20 scans of 360 beams: within four standard deviations
    assert lost.mean() == pytest.approx(0.1, abs=4 * np.sqrt(0.09 / lost.size))
    assert np.array_equal(np.concatenate(drawn[0]), np.concatenate(drawn[1]))
    assert not np.array_equal(np.concatenate(drawn[0]), np.concatenate(drawn[2]))


def test_spread_and_its_error_are_those_of_the_maps():
    worth = wheels.WheelWorth("found", 0.1, (0.08, 0.1, 0.12), 2)
    assert worth.mean_m == pytest.approx(0.1)
    assert worth.error_m == pytest.approx(0.02 / np.sqrt(3))

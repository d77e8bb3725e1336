"""Confidence sequences: true at all looks at once, and known closed forms."""

import math

import numpy as np
import pytest

from experiments.sequential import RatesKnown, rate_interval


def test_interval_where_all_succeed_has_a_closed_form():
    # p^n times 20 is the mixture there
    for trials in (1, 20, 200):
        mixed = math.lgamma(trials + 0.5) - math.lgamma(trials + 1) - math.lgamma(0.5)
        low, high = rate_interval(trials, trials)
        assert low == pytest.approx(math.exp((mixed + math.log(0.05)) / trials), abs=1e-9)
        assert high == 1.0
        assert rate_interval(0, trials) == pytest.approx((0.0, 1.0 - low))
    assert rate_interval(0, 0) == (0.0, 1.0)


@pytest.mark.slow
def test_truth_is_left_by_at_most_one_drive_of_looks_in_twenty():
    rng, missed = np.random.default_rng(0), 0
    for _ in range(400):
        won = np.cumsum(rng.random(300) < 0.9)
        intervals = [rate_interval(int(won[n - 1]), n) for n in range(10, 301, 10)]
        missed += any(not low <= 0.9 <= high for low, high in intervals)
    assert missed <= 20


def test_enough_is_when_each_method_is_known():
    def records(trials: int, wrong: int) -> list[dict]:
        methods = [{"a": {"success": True}, "b": {"success": k >= wrong}} for k in range(trials)]
        return [{"status": "ok", "methods": one} for one in methods]

    enough = RatesKnown(0.05, ("a", "b"))
    low, high = rate_interval(200, 200)
    assert (high - low) / 2 <= 0.05
    assert enough(records(200, 0))
    assert not enough(records(200, 100))
    assert not enough(records(20, 0))
    assert enough.looks[:3] == [20, 40, 60]
    # at the last look even the widest is narrow
    last = enough.looks[-1]
    low, high = rate_interval(last // 2, last)
    assert (high - low) / 2 <= 0.05
    assert all(
        after - before >= 20 for before, after in zip(enough.looks, enough.looks[1:], strict=False)
    )


@pytest.mark.parametrize("half_width", [0.0, -1.0, 0.5, math.nan])
def test_width_that_no_interval_can_have_is_refused(half_width):
    with pytest.raises(ValueError, match="--until-ci lies from"):
        RatesKnown(half_width, ("a",))

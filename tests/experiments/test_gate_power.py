"""The tests of the gate: exact where they can be counted, at the stated rate, and strong enough."""

import itertools

import numpy as np
import pytest
from scipy.stats import binomtest, fisher_exact, mannwhitneyu, wilcoxon

from experiments.bench import gate as bench
from experiments.bench.planted import PLANTS
from experiments.gate.baseline import RunValues
from experiments.gate.check import checked
from experiments.gate.permutation import (
    Scores,
    adjusted_p,
    centred,
    paired_rank_scores,
    rank_scores,
)
from experiments.trials import TrialConfig

CLOSE = 0.012
"""Four standard errors of a p estimated by 16 384 draws."""


def alone(scores, new_count):
    return float(adjusted_p([Scores(scores[:, None], new_count)])[0][0])


def test_events_of_runs_are_tested_as_fisher_does():
    old, new = np.array([1.0] * 2 + [0.0] * 18), np.array([1.0] * 7 + [0.0] * 11)
    table = [[7, 11], [2, 18]]
    p = alone(centred(np.concatenate([old, new])), len(new))
    assert p == pytest.approx(fisher_exact(table, alternative="greater").pvalue, abs=CLOSE)


def test_events_of_pairs_are_tested_as_mcnemar_does():
    p = alone(np.array([1.0] * 8 + [-1.0] * 2 + [0.0] * 30), None)
    assert p == pytest.approx(binomtest(8, 10, alternative="greater").pvalue, abs=CLOSE)


def test_ranks_are_tested_as_wilcoxon_and_mann_whitney_do():
    rng = np.random.default_rng(3)
    old, new = rng.exponential(size=15), 1.6 * rng.exponential(size=15)
    p = alone(paired_rank_scores(new - old), None)
    assert p == pytest.approx(wilcoxon(new - old, alternative="greater").pvalue, abs=CLOSE)
    p = alone(rank_scores(np.concatenate([old, new])), 15)
    expected = mannwhitneyu(new, old, alternative="greater", method="exact").pvalue
    assert p == pytest.approx(expected, abs=CLOSE)


def test_the_correction_is_holms_where_questions_have_nothing_in_common():
    # of ten pairs each, and all for the same: p = 2**-10 each, times as many as are asked
    rng = np.random.default_rng(0)
    groups = [Scores(rng.uniform(0.5, 1.5, size=(10, 1)), None) for _ in range(20)]
    alone_p, corrected = adjusted_p(groups)
    assert alone_p == pytest.approx(np.full(20, 2.0**-10), abs=1e-3)
    assert corrected.min() == pytest.approx(1.0 - (1.0 - 2.0**-10) ** 20, abs=0.006)


def test_asking_the_same_twenty_times_costs_nothing():
    scores = np.random.default_rng(0).uniform(0.5, 1.5, size=(10, 1)).repeat(20, axis=1)
    alone_p, corrected = adjusted_p([Scores(scores, None)])
    assert corrected == pytest.approx(alone_p)


def test_what_cannot_be_told_costs_nothing():
    # no event in either run, in fifty quantities
    told, empty = np.ones((10, 1)), np.zeros((10, 50))
    _, corrected = adjusted_p([Scores(np.concatenate([told, empty], axis=1), None)])
    assert corrected[0] == pytest.approx(2.0**-10, abs=1e-3)
    assert (corrected[1:] == 1.0).all()


def made_run(rng, trials=20, *, seed=0, scale=1.0, methods=("fast", "limit")):
    """A run of errors as heavy-tailed as those of real ones: one in twenty is ten times as large."""
    values = {}
    for name in methods:
        tails = np.where(rng.random(trials) < 0.05, 10.0, 1.0)
        errors = 1e-3 * scale * tails * rng.rayleigh(size=(2, trials))
        values[name] = {
            "failed": (rng.random(trials) < 0.1).astype(float).tolist(),
            "position_error_m": errors[0].tolist(),
            "heading_error_rad": (0.5 * errors[1]).tolist(),
            "nees": rng.chisquare(3, size=trials).tolist(),
            "pairs": rng.integers(650, 680, size=trials).tolist(),
        }
    config = vars(TrialConfig()) | {"methods": list(methods)}
    return RunValues("localization", config, seed, trials, {}, str(rng.random()), values)


def alarms(checks):
    return sum(bool(check.worse) for check in checks)


@pytest.mark.slow
@pytest.mark.parametrize("is_paired", [False, True])
def test_false_alarms_are_as_rare_as_stated(is_paired):
    # a rate, so that it can be counted, which is far above the gate's own; no margin to help it
    rng, seed, one = np.random.default_rng(11), 0 if is_paired else 1, ("limit",)
    pairs = [
        (made_run(rng, 10, methods=one), made_run(rng, 10, seed=seed, methods=one))
        for _ in range(25)
    ]
    found = alarms(checked([pair], alpha=0.2, margin=0.0) for pair in pairs)
    # binomial of 25 and 0.2: 11 or more in one of a hundred and eighty
    assert found <= 10


@pytest.mark.slow
def test_errors_half_as_large_again_are_found_in_three_hundred_trials():
    rng = np.random.default_rng(5)
    old = made_run(rng, 300)
    assert checked([(old, made_run(rng, 300, scale=1.5))]).worse
    assert not checked([(old, made_run(rng, 300))]).worse


def test_a_few_large_errors_are_found_though_most_are_as_they_were():
    old = made_run(np.random.default_rng(1), 60, methods=("limit",))
    new = made_run(np.random.default_rng(1), 60, methods=("limit",))
    errors = new.values["limit"]["position_error_m"]
    new.values["limit"]["position_error_m"] = [
        0.04 if at % 5 == 0 else one for at, one in enumerate(errors)
    ]
    (found,) = checked([(old, new)]).worse
    assert found.quantity.name == "position_error_m"
    assert found.change == pytest.approx(1.0)  # in the median of all pairs


def test_a_change_within_the_margin_is_not_worse():
    # the same draws: with pairs, a change of 1 % in each trial would be seen without a margin
    old = made_run(np.random.default_rng(1), 100)
    new = made_run(np.random.default_rng(1), 100, scale=1.01)
    assert not checked([(old, new)]).worse
    assert checked([(old, new)], margin=0.0).worse


@pytest.mark.parametrize(
    ("before", "now", "verdict"),
    [
        (1.0, 2.0, "worse"),  # overconfident
        (1.0, 0.4, "worse"),  # far too cautious
        (0.5, 1.0, "better"),  # it was too cautious, and is right now
        (2.0, 1.0, "better"),
    ],
)
def test_a_nees_is_judged_by_what_is_honest(before, now, verdict):
    old = made_run(np.random.default_rng(1), 60, methods=("limit",))
    new = made_run(np.random.default_rng(1), 60, methods=("limit",))
    for run, factor in ((old, before), (new, now)):
        run.values["limit"]["nees"] = [factor * one for one in run.values["limit"]["nees"]]
    findings = {one.quantity.name: one.verdict for one in checked([(old, new)]).findings}
    assert findings["nees"] == verdict


def test_ten_pairs_are_enough_for_a_beam_in_ten():
    old = made_run(np.random.default_rng(1), 10)
    new = made_run(np.random.default_rng(2), 10)
    for told in new.values.values():
        told["pairs"] = [0.9 * one for one in told["pairs"]]
    assert {one.quantity.name for one in checked([(old, new)]).worse} == {"pairs"}


def test_a_trial_that_raised_has_failed_and_nothing_else():
    old = made_run(np.random.default_rng(1), 20, methods=("limit",))
    new = made_run(np.random.default_rng(1), 20, methods=("limit",))
    for at in range(15):
        for told in new.values["limit"].values():
            told[at] = None
        new.values["limit"]["failed"][at] = 1.0
    old.values["limit"]["failed"] = [0.0] * 20
    assert {one.quantity.name for one in checked([(old, new)]).worse} == {"failed"}


@pytest.mark.slow
@pytest.mark.parametrize(("name", "trials"), [*zip(PLANTS, (100, 10, 50, 100), strict=True)])
def test_planted_regressions_are_found(name, trials):
    experiment, config = bench.WHERE[name]
    for seed in (21, 22):
        old = bench.measured(experiment, config, seed, trials)
        new = bench.measured(experiment, config, seed, trials, PLANTS[name])
        assert checked([(old, new)]).worse, f"{name}, seed {seed}"
        assert not checked([(old, old)]).worse


@pytest.mark.slow
def test_honest_reruns_are_left_alone():
    experiment, config = bench.WHERE["laser noise +20 %"]
    runs = [bench.measured(experiment, config, 900 + seed, 10) for seed in range(201)]
    found = alarms(checked([pair]) for pair in itertools.pairwise(runs))
    # at the stated rate, 1 of 100: 7 or more of 200 in one of two hundred
    assert found <= 6

"""The figures of recovery, from records made by hand."""

import pytest

from experiments.recovery import recovery_figures


def record(*, success=True, verdict="tracking", detected=True, false_alarm=False, looks=1):
    """A trial of `limit`, beside a method that cannot say that it is lost."""
    outcome = {
        "success": success,
        "verdict": verdict,
        "detected": detected,
        "false_alarm": false_alarm,
        "looks": [{}] * looks,
    }
    paper = {"success": success, "verdict": "tracking", "status": "matched"}
    return {"status": "ok", "methods": {"limit": outcome, "paper": paper}}


RAISED = {"status": "error", "error": "FloatingPointError: the floor is gone"}
RECORDS = [
    record(),
    record(looks=2),
    record(looks=6, false_alarm=True),
    record(success=False, detected=False),
    record(success=False, verdict="unsure", looks=6),
    RAISED,
]
TIMINGS = [
    {"cpu_s": 1.0, "methods": {"limit": seconds, "paper": 0.5}} for seconds in (0.1, 0.2, 0.6)
]


def test_rates_are_over_the_trials_that_ran():
    figures = recovery_figures(RECORDS, [*TIMINGS, {"cpu_s": 1.0}], "limit")
    assert figures["detected_rate"] == pytest.approx(4 / 5)
    assert figures["false_alarms"] == 1
    # believed and wrong: not the one that said that it is unsure
    assert figures["confident_wrong"] == 1
    assert figures["unsure_rate"] == pytest.approx(1 / 5)
    # only of those that ended right: 1, 2 and 6 scans
    assert figures["scans_to_recover"] == {"median": 2.0, "max": 6}
    # the timing of the trial that raised has no methods
    assert figures["query_cpu_ms"]["median"] == pytest.approx(200.0)
    assert 200.0 < figures["query_cpu_ms"]["p99"] < 600.0


def test_method_that_cannot_say_that_it_is_lost_has_nulls():
    figures = recovery_figures(RECORDS, TIMINGS, "paper")
    for name in ("detected_rate", "false_alarms", "unsure_rate"):
        assert figures[name] is None
    assert figures["scans_to_recover"] == {"median": None, "max": None}
    # what its matches say of themselves stays as the statistics count it
    assert "confident_wrong" not in figures
    assert figures["query_cpu_ms"]["median"] == pytest.approx(500.0)


def test_nothing_that_ran_gives_nulls():
    figures = recovery_figures([RAISED], [], "limit")
    assert figures["query_cpu_ms"] == {"median": None, "p99": None}
    assert figures["detected_rate"] is None


def test_no_recovery_has_no_time_to_recover():
    lost = record(success=False, verdict="lost", looks=6)
    figures = recovery_figures([lost], TIMINGS, "limit")
    assert figures["scans_to_recover"] == {"median": None, "max": None}
    assert (figures["confident_wrong"], figures["unsure_rate"]) == (0, 1.0)

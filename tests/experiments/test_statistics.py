"""The figures of summary.json, against values worked out by hand or by SciPy."""

import math

import pytest
from scipy.stats import binomtest

from experiments.statistics import summarised, wilson_interval


def trial(x_cm: float, y_cm: float, theta_rad: float, *, success=True, status="matched") -> dict:
    outcome = {
        "status": status,
        "success": success,
        "x_error_m": x_cm / 100,
        "y_error_m": y_cm / 100,
        "theta_error_rad": theta_rad,
    }
    return {"status": "ok", "methods": {"line": outcome}}


RAISED = {"status": "error", "error": "ValueError: no", "traceback": ""}


def test_errors_are_those_of_the_successes_and_rates_those_of_all_trials():
    records = [
        trial(1.0, -2.0, 0.001),
        trial(3.0, 0.0, -0.02),
        trial(-4.0, -1.0, 0.001),
        trial(90.0, 90.0, 1.0, success=False),  # sure of itself
        trial(80.0, 80.0, 1.0, success=False, status="lost"),  # says so
        RAISED,
    ]
    result = summarised(records, ("line",))["line"]
    assert result["success_rate"] == 3 / 6
    assert (result["failures"], result["raised"], result["confident_wrong"]) == (3, 1, 1)
    assert result["matched"] == 4
    # of the three, the second is 0.02 rad off and the third 4.1 cm
    assert result["within_paper_margins"] == 1
    x_cm, y_cm, theta_rad = result["x_cm"], result["y_cm"], result["theta_rad"]
    assert x_cm["mean"] == pytest.approx(0.0, abs=1e-12)
    assert x_cm["max"] == pytest.approx(-4.0)  # with its sign
    assert x_cm["std"] == pytest.approx(math.sqrt((1 + 9 + 16) / 2))  # divided by n - 1
    assert x_cm["rmse"] == pytest.approx(math.sqrt((1 + 9 + 16) / 3))
    assert y_cm["mean"] == pytest.approx(-1.0)
    assert y_cm["max"] == pytest.approx(-2.0)
    assert y_cm["std"] == pytest.approx(1.0)
    assert theta_rad["max"] == pytest.approx(-0.02)
    assert result["rmse_mm"] == pytest.approx(math.sqrt((500 + 900 + 1700) / 3))
    assert result["rmse_mrad"] == pytest.approx(math.sqrt((1 + 400 + 1) / 3))


@pytest.mark.parametrize(
    ("successes", "trials"), [(0, 5), (5, 5), (1, 1), (3, 7), (88, 100), (100, 100)]
)
def test_wilson_interval_is_scipys(successes, trials):
    exact = binomtest(successes, trials).proportion_ci(method="wilson")
    assert wilson_interval(successes, trials) == pytest.approx((exact.low, exact.high), abs=1e-12)


def test_no_trials_tell_nothing():
    assert wilson_interval(0, 0) == (0.0, 1.0)
    result = summarised([], ("line",))["line"]
    assert (result["success_rate"], result["failures"], result["rmse_mm"]) == (None, 0, None)


def test_no_success_has_no_errors_and_one_has_no_deviation():
    nothing = {"mean": None, "max": None, "std": None, "rmse": None}
    lost = summarised([trial(1, 1, 0, success=False)], ("line",))["line"]
    assert (lost["x_cm"], lost["rmse_mm"], lost["success_rate"]) == (nothing, None, 0.0)
    one = summarised([trial(1.0, 2.0, 0.0)], ("line",))["line"]
    assert one["x_cm"]["mean"] == pytest.approx(1.0)
    assert one["x_cm"]["std"] is None

"""The figures of summary.json, against values worked out by hand or by SciPy."""

import math

import numpy as np
import pytest
from scipy.stats import binomtest, chi2

from experiments.statistics import independent_count, nees_band, summarised, wilson_interval

BOUND = {"position_m": 0.002, "heading_rad": 0.001}


def trial(
    x_cm: float,
    y_cm: float,
    theta_rad: float,
    *,
    success=True,
    status="matched",
    nees=None,
    index=0,
) -> dict:
    outcome = {
        "status": status,
        "success": success,
        "x_error_m": x_cm / 100,
        "y_error_m": y_cm / 100,
        "theta_error_rad": theta_rad,
        "nees": nees,
        "warnings": [],
    }
    return {"index": index, "status": "ok", "crlb": BOUND, "methods": {"line": outcome}}


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


def test_errors_are_counted_in_units_of_the_bound_over_the_successes():
    records = [
        trial(0.3, 0.0, 0.002),
        trial(0.0, -0.4, -0.001),
        trial(90.0, 0.0, 1.0, success=False),
        RAISED,
    ]
    result = summarised(records, ("line",))["line"]
    assert result["crlb_mm"] == pytest.approx(2.0)
    assert result["crlb_mrad"] == pytest.approx(1.0)
    assert result["crlb_ratio"] == pytest.approx(math.sqrt((9 + 16) / 2) / 2)
    assert result["crlb_ratio_theta"] == pytest.approx(math.sqrt((4 + 1) / 2))


def test_scan_that_leaves_a_direction_open_has_no_bound_to_compare_with():
    blind = trial(0.3, 0.0, 0.0) | {"crlb": {"position_m": None, "heading_rad": None}}
    result = summarised([blind], ("line",))["line"]
    assert (result["crlb_mm"], result["crlb_ratio"]) == (None, None)


def test_nees_is_over_all_that_was_believed_right_or_wrong():
    records = [
        trial(0.1, 0.0, 0.0, nees=2.0),
        trial(90.0, 0.0, 0.0, nees=400.0, success=False),  # sure of itself
        trial(90.0, 0.0, 0.0, nees=900.0, success=False, status="lost"),  # says so
    ]
    result = summarised(records, ("line",))["line"]
    assert result["nees"] == pytest.approx(201.0)
    assert result["nees_band95"] == pytest.approx(nees_band(2))


def test_nees_of_one_drive_count_for_as_many_as_are_independent():
    rng = np.random.default_rng(5)
    drives = np.repeat(np.arange(100), 15)
    free = rng.chisquare(3, 1500)
    assert independent_count(free, drives) > 1000
    # all alike within a drive: as many as there are drives
    assert independent_count(np.repeat(free[:100], 15), drives) == pytest.approx(100, rel=0.02)
    # of means of such samples, 95 of 100 lie in the band, and far fewer in that of all of them
    inside = np.zeros(2)
    for _ in range(400):
        shared = rng.normal(size=(3, 100)).repeat(15, axis=1)
        values = np.square(0.8 * shared + 0.6 * rng.normal(size=(3, 1500))).sum(axis=0)
        for which, count in enumerate((independent_count(values, drives), 1500)):
            low, high = nees_band(count)
            inside[which] += low < values.mean() < high
    assert inside[0] / 400 > 0.91
    assert inside[1] / 400 < 0.75


def test_nees_band_of_a_run_is_that_of_its_drives():
    records = [trial(0.1, 0.0, 0.0, nees=one, index=i) for i, one in enumerate([1.0, 5.0])]
    alone = summarised(records, ("line",))["line"]["nees_band95"]
    assert alone == pytest.approx(nees_band(2))
    assert summarised(records * 9, ("line",))["line"]["nees_band95"] == pytest.approx(alone)


@pytest.mark.parametrize("count", [10, 100, 1000])
def test_nees_band_is_that_of_chi_square(count):
    low, high = nees_band(count)
    assert low == pytest.approx(chi2.ppf(0.025, 3 * count) / count, rel=1e-3)
    assert high == pytest.approx(chi2.ppf(0.975, 3 * count) / count, rel=1e-3)


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


def test_tail_of_the_nees_is_told_beside_its_mean():
    # chi-square(3) exceeds 16.27 once in a thousand
    assert chi2.sf(16.27, 3) == pytest.approx(1e-3, rel=0.01)
    records = [trial(0.1, 0.0, 0.0, nees=nees) for nees in (1.0, 2.0, 16.0, 17.0)]
    result = summarised(records, ("line",))["line"]
    assert result["nees_median"] == pytest.approx(9.0)
    assert result["nees_beyond"] == pytest.approx(0.25)
    assert "nees_all_scans" not in result


def test_nees_of_a_drive_is_over_all_of_its_scans():
    first = trial(0.1, 0.0, 0.0, nees=2.0) | {"scans_nees": {"line": [40.0, None, 2.0]}}
    second = trial(0.1, 0.0, 0.0, nees=4.0) | {"scans_nees": {"line": [2.0, 4.0]}}
    result = summarised([first, second, RAISED], ("line",))["line"]
    assert result["nees"] == pytest.approx(3.0)
    assert result["nees_all_scans"] == pytest.approx(12.0)
    assert result["nees_all_scans_beyond"] == pytest.approx(0.25)

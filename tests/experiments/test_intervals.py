"""The bootstrap's intervals hold what they promise, and promise nothing of a handful of trials."""

import numpy as np
import pytest

from experiments.intervals import error_intervals, median_interval
from experiments.statistics import summarised


def test_interval_of_a_mean_is_that_of_the_textbook():
    # of 400 normal errors, mean +- 1.96 sigma / 20 and sigma +- 1.96 sigma / sqrt(800): the
    # bootstrap of 2000 resamples finds the ends to a tenth of the half width
    errors = np.random.default_rng(1).normal([0.01, -0.02, 0.001], [0.004, 0.002, 0.0005], (400, 3))
    found = error_intervals(errors, np.arange(400))
    for k, (axis, scale) in enumerate((("x_cm", 100), ("y_cm", 100), ("theta_rad", 1))):
        mean, std = scale * errors[:, k].mean(), scale * errors[:, k].std(ddof=1)
        half = 1.96 * std / 20
        assert found[axis]["mean"] == pytest.approx((mean - half, mean + half), abs=0.15 * half)
        half = 1.96 * std / np.sqrt(800)
        assert found[axis]["std"] == pytest.approx((std - half, std + half), abs=0.3 * half)
    rms = 1000 * np.sqrt((errors[:, :2] ** 2).sum(axis=1).mean())
    assert found["rmse_mm"][0] < rms < found["rmse_mm"][1]
    assert found == error_intervals(errors, np.arange(400))


def test_samples_of_one_drive_are_drawn_together():
    # twenty drives, each with one error all along: a hundred samples of each tell nothing more
    errors = np.random.default_rng(2).normal(0.0, 0.01, (20, 3))
    alone = error_intervals(errors, np.arange(20))
    often = error_intervals(np.repeat(errors, 100, axis=0), np.repeat(np.arange(20), 100))
    assert often["x_cm"]["mean"] == pytest.approx(alone["x_cm"]["mean"])
    assert often["rmse_mm"] == pytest.approx(alone["rmse_mm"])


def test_many_trials_in_groups_are_as_sure_as_they_are():
    errors = np.random.default_rng(3).normal(0.0, 0.01, (50_000, 3))
    low, high = error_intervals(errors, np.arange(50_000))["x_cm"]["mean"]
    assert high - low == pytest.approx(2 * 1.96 / np.sqrt(50_000), rel=0.1)


def test_fewer_than_ten_trials_have_no_interval():
    nine = np.zeros((9, 3))
    assert error_intervals(nine, np.arange(9))["rmse_mm"] is None
    assert error_intervals(np.zeros((90, 3)), np.repeat(np.arange(9), 10))["x_cm"]["mean"] is None
    assert error_intervals(np.zeros((0, 3)), np.zeros(0))["theta_rad"]["std"] is None
    assert median_interval(np.zeros(9)) is None
    assert median_interval(np.full(10, 2.0)) == (2.0, 2.0)


def test_summary_has_an_interval_around_each_of_its_means():
    rng = np.random.default_rng(4)

    def record(index):
        x, y, theta = rng.normal(0.0, 0.003, 3).tolist()
        outcome = {"status": "matched", "success": index > 2, "nees": None, "warnings": []}
        outcome |= {"x_error_m": x, "y_error_m": y, "theta_error_rad": theta}
        bound = {"position_m": 0.001, "heading_rad": 0.001}
        return {"index": index, "status": "ok", "crlb": bound, "methods": {"one": outcome}}

    told = summarised([record(index) for index in range(40)], ("one",))["one"]
    for axis in ("x_cm", "y_cm", "theta_rad"):
        for key in ("mean", "std"):
            low, high = told["ci95"][axis][key]
            assert low < told[axis][key] < high
    assert told["ci95"]["rmse_mm"][0] < told["rmse_mm"] < told["ci95"]["rmse_mm"][1]

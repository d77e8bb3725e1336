"""The warnings: each in its situation, and not otherwise."""

import math

import numpy as np
import pytest

from slam.consistency import InnovationMonitor
from slam.range_noise import RangeNoise
from slam.scan_match import RangeFit

OFFSET_SIGMA_M = 0.0005


def fit(
    scale: float = 1.0,
    offset_m: float = 0.0,
    sigma_m: float = OFFSET_SIGMA_M,
    missing_ratio: float = 0.0,
    noise: RangeNoise | None = None,
) -> RangeFit:
    return RangeFit(0.98, scale, offset_m, sigma_m, missing_ratio, noise)


def warned(nis: float | None, range_fit: RangeFit | None, count: int = 60) -> tuple[str, ...]:
    monitor = InnovationMonitor()
    for _ in range(count):
        monitor.take(nis, range_fit)
    return monitor.warnings


def test_nothing_is_said_before_the_first_scan():
    assert InnovationMonitor().warnings == ()


@pytest.mark.parametrize("seed", range(5))
def test_scans_as_assumed_are_never_warned_of(seed):
    rng = np.random.default_rng(seed)
    monitor = InnovationMonitor()
    for _ in range(500):
        # 481 beams tell a scale to 5 %
        drawn = fit(rng.normal(1.0, 0.05), rng.normal(0.0, OFFSET_SIGMA_M))
        monitor.take(rng.chisquare(3), drawn)
        assert monitor.warnings == ()


@pytest.mark.parametrize("scale", [2.0, 1.4, 0.6])
def test_noise_of_another_width_is_said_with_its_width(scale):
    (said,) = warned(3.0, fit(scale))
    assert f"scatter {scale:.2f} times" in said


@pytest.mark.parametrize(
    ("noise", "scale", "advice"),
    [
        (
            ((0.0, 0.02),), 0.66,
            "give it a sigma of 0.013 m, where it has 0.02 m (of a log: --range-sigma 0.013)",
        ),
        (((1.0, 0.01), (5.6, 0.056)), 2.0, "give it sigmas from 0.02 m at 1 m to 0.11 m at 5.6 m"),
        # less would be refused
        (
            ((0.0, 0.02),), 0.01,
            "give it a sigma of 0.001 m, where it has 0.02 m (of a log: --range-sigma 0.001)",
        ),
    ],
)  # fmt: skip
def test_noise_that_would_fit_is_said_where_that_assumed_is_known(noise, scale, advice):
    (said,) = warned(3.0, fit(scale, noise=RangeNoise(noise)))
    assert said.endswith(f" noise says: {advice}")


@pytest.mark.parametrize("scale", [1.25, 0.8])
def test_noise_nearly_right_is_not(scale):
    assert warned(3.0, fit(scale)) == ()


@pytest.mark.parametrize("offset_m", [0.005, -0.005])
def test_offset_is_said_with_its_sign_and_size(offset_m):
    (said,) = warned(3.0, fit(offset_m=offset_m))
    assert f"{1000.0 * offset_m:+.1f} mm" in said


def test_offset_below_a_millimetre_or_within_its_uncertainty_is_not():
    assert warned(3.0, fit(offset_m=0.0008)) == ()
    # 5 mm, known to 50 mm by each of 30 scans
    assert warned(3.0, fit(offset_m=0.005, sigma_m=0.05), 30) == ()
    # a scan that cannot tell it at all
    assert warned(3.0, fit(offset_m=0.005, sigma_m=math.inf)) == ()


def test_mean_offset_is_weighted_by_what_each_scan_tells():
    monitor = InnovationMonitor()
    monitor.take(None, fit(offset_m=0.004, sigma_m=0.001))
    monitor.take(None, fit(offset_m=0.000, sigma_m=0.002))
    assert monitor.offset_m == pytest.approx(0.0032)  # 4 : 1


def test_odometry_that_contradicts_the_matches_is_said_after_thirty_scans():
    assert warned(12.0, None, 29) == ()
    (said,) = warned(12.0, None, 30)
    assert "normalised innovation 12.0" in said


def test_one_slip_is_no_trend():
    monitor = InnovationMonitor()
    for nis in [3.0] * 60 + [500.0] + [3.0] * 5:
        monitor.take(nis, fit())
        assert monitor.warnings == ()


def test_wrong_that_was_put_right_is_forgotten():
    monitor = InnovationMonitor()
    for scale in [2.0] * 50 + [1.0] * 200:
        monitor.take(3.0, fit(scale))
    assert monitor.warnings == ()


def test_all_that_is_wrong_is_said_at_once():
    assert len(warned(12.0, fit(2.0, 0.005))) == 3


def test_scans_that_matched_nothing_raise_no_word():
    assert warned(None, None, 100) == ()


def test_walls_that_beams_go_through_are_warned_of_once_they_last():
    (said,) = warned(3.0, fit(missing_ratio=0.01))
    assert said.startswith("1.0 % of the beams go through walls of the map")
    assert warned(3.0, fit(missing_ratio=0.01), count=10) == ()
    assert warned(3.0, fit(missing_ratio=0.002)) == ()

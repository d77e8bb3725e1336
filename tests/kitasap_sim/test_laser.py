import math
from dataclasses import replace

import numpy as np
import pytest

from kitasap_sim import LASERS, LaserSpec
from kitasap_sim.laser import laser, measured_ranges

DATA_SHEETS = {  # beams, field of view from first to last beam [deg], period [s], farthest [m]
    "urg_04lx": (682, 239.414, 0.1, 5.6),
    "utm_30lx": (1081, 270, 0.025, 30),
    "ust_10lx": (1081, 270, 0.025, 10),
    "lms200": (361, 180, 2 / 75, 8.191),
    "lms1xx": (541, 270, 0.02, 20),
    "tim571": (811, 270, 1 / 15, 25),
    "rplidar_a1": (360, 359, 1 / 5.5, 12),
    "rplidar_a2": (400, 359.1, 0.1, 12),
    "ld06": (450, 359.2, 0.1, 12),
}


def measured(spec, range_m, count=20_000, seed=0):
    spec = replace(spec, beam_count=count, step_rad=1e-5)
    return measured_ranges(spec, np.full(count, range_m), np.random.default_rng(seed))


@pytest.mark.parametrize("name", LASERS)
def test_presets_have_their_data_sheets_numbers(name):
    spec, (beams, view_deg, period_s, farthest_m) = laser(name), DATA_SHEETS[name]
    angles_deg = np.degrees(spec.angles_rad)
    assert len(angles_deg) == beams
    assert angles_deg[-1] - angles_deg[0] == pytest.approx(view_deg, abs=1e-3)
    assert (np.diff(angles_deg) > 0).all()
    assert spec.period_s == pytest.approx(period_s)
    assert spec.range_max_m == farthest_m
    assert 0 <= spec.delays_s().min() < spec.delays_s().max() < spec.period_s


def test_the_urgs_first_beam_is_step_44_of_1024_with_384_ahead():
    spec = laser("urg_04lx")
    assert np.degrees(spec.angles_rad[[0, -1]]) == pytest.approx([-119.531, 119.883], abs=1e-3)
    assert spec.delays_s()[[0, -1]] == pytest.approx([0.1 * 44 / 1024, 0.1 * 725 / 1024])


def test_clockwise_lasers_fire_the_last_angle_first():
    delays_s = laser("rplidar_a2").delays_s()
    assert delays_s.argmin() == 399
    assert (np.diff(delays_s) < 0).all()


def test_the_lms200_takes_half_degrees_from_a_second_turn_of_its_mirror():
    delays_s = laser("lms200").delays_s()
    assert delays_s[1] - delays_s[0] == pytest.approx(1 / 75 + 0.5 / 360 / 75)


@pytest.mark.parametrize(("range_m", "sigma_m"), [(0.5, 0.010), (2.0, 0.020), (4.0, 0.040)])
def test_the_urgs_noise_grows_with_range_as_its_data_sheet_says(range_m, sigma_m):
    ranges_m = measured(replace(laser("urg_04lx"), dropout_rate=0.0), range_m)
    # 20,000 draws: the standard deviation is known to 0.5 %, four of which are allowed
    assert ranges_m.std() == pytest.approx(sigma_m, rel=0.02)
    assert ranges_m.mean() == pytest.approx(range_m, abs=5 * sigma_m / math.sqrt(20_000))


def test_ranges_are_quantised():
    ranges_m = measured(replace(laser("urg_04lx"), dropout_rate=0.0), 1.0, 1000)
    assert np.abs(ranges_m * 1000 - np.round(ranges_m * 1000)).max() < 1e-9


def test_no_return_too_close_and_invalid_follow_rep_117():
    spec = replace(laser("utm_30lx"), sigma_at_m=(), dropout_rate=0.0)
    assert (measured(spec, math.inf, 10) == math.inf).all()
    assert (measured(spec, 30.5, 10) == math.inf).all()
    assert (measured(spec, 0.05, 10) == -math.inf).all()
    dropped = np.isnan(measured(replace(spec, dropout_rate=0.01), 1.0))
    assert dropped.mean() == pytest.approx(0.01, rel=0.3)


def test_mixed_pixels_lie_between_the_two_surfaces_of_an_edge():
    spec = replace(laser("ust_10lx"), sigma_at_m=(), resolution_m=0.0, dropout_rate=0.0)
    true_m = np.tile([1.0] * 10 + [3.0] * 10, 54)
    ranges_m = measured_ranges(replace(spec, beam_count=1080), true_m, np.random.default_rng(0))
    mixed = (ranges_m > 1.0 + 1e-9) & (ranges_m < 3.0 - 1e-9)
    assert mixed.sum() == pytest.approx(0.3 * 107, rel=0.35)
    # the last beam before an edge or the first behind it, as often: neither side is favoured
    at = np.flatnonzero(mixed) % 10
    assert set(at) == {0, 9}
    assert np.mean(at == 0) == pytest.approx(0.5, abs=0.25)


def test_every_imperfection_can_be_switched_off():
    true_m = np.linspace(0.001, 100.0, 681)
    true_m = np.append(true_m, math.inf)
    ranges_m = measured_ranges(laser("urg_04lx").without_errors(), true_m, np.random.default_rng(0))
    assert np.array_equal(ranges_m, true_m)


def test_a_switch_does_not_move_the_other_random_numbers():
    spec, rng = laser("urg_04lx"), np.random.default_rng
    true_m = np.full(682, 2.0)
    with_drops = measured_ranges(spec, true_m, rng(5))
    without = measured_ranges(replace(spec, dropout_rate=0.0), true_m, rng(5))
    is_left = ~np.isnan(with_drops)
    assert is_left.sum() < 682
    assert np.array_equal(with_drops[is_left], without[is_left])


def test_a_bias_shifts_every_range_by_itself_and_moves_no_random_number():
    spec = replace(laser("urg_04lx"), resolution_m=0.0)
    true_m = np.append(np.linspace(0.5, 4.0, 681), math.inf)
    plain, generator = np.random.default_rng(5), np.random.default_rng(5)
    without = measured_ranges(spec, true_m, plain)
    shifted = measured_ranges(replace(spec, range_bias_m=0.03), true_m, generator)
    assert plain.bit_generator.state == generator.bit_generator.state
    is_hit = np.isfinite(without)
    assert shifted[is_hit] - without[is_hit] == pytest.approx(0.03, abs=1e-12)
    assert np.array_equal(shifted[~is_hit], without[~is_hit], equal_nan=True)
    assert replace(spec, range_bias_m=0.03).without_errors().range_bias_m == 0.0


def test_an_impossible_laser_is_refused():
    with pytest.raises(ValueError, match="more than a full turn"):
        LaserSpec("mine", 400, 0.0, math.radians(1), 0.1)
    with pytest.raises(ValueError, match="must be positive"):
        LaserSpec("mine", 0, 0.0, math.radians(1), 0.1)
    with pytest.raises(ValueError, match="after the period"):
        LaserSpec("mine", 360, 0.0, math.radians(1), 0.1, first_beam_s=0.05)


@pytest.mark.parametrize(
    ("change", "reason"),
    [
        ({"range_min_m": 6.0}, "range_min_m < range_max_m"),
        ({"resolution_m": -0.001}, "resolution_m >= 0"),
        ({"dropout_rate": 2.0}, "between 0 and 1"),
        ({"sigma_at_m": ((2.0, 0.01), (1.0, 0.02))}, "increasing ranges"),
        ({"period_s": math.nan}, "must be positive"),
        ({"mount_m": (0.2, 0.0, -0.1)}, "above the floor"),
        ({"range_bias_m": math.nan}, "finite"),
    ],
)
def test_figures_that_no_laser_has_are_refused(change, reason):
    with pytest.raises(ValueError, match=reason):
        replace(laser("urg_04lx"), **change)


def obvious_ranges(spec, true_ranges_m, rng):
    """`measured_ranges` in NumPy, an imperfection a line."""
    ranges_m = true_ranges_m.copy()
    chosen, share = rng.random((2, len(ranges_m)))
    normal, dropped = rng.standard_normal(len(ranges_m)), rng.random(len(ranges_m))
    before_m, behind_m = true_ranges_m[:-1], true_ranges_m[1:]
    with np.errstate(invalid="ignore"):
        step_m = behind_m - before_m
    is_edge = (np.abs(step_m) > spec.mixed_pixel_jump_m) & np.isfinite(step_m)
    for edge in np.flatnonzero(is_edge & (chosen[:-1] < spec.mixed_pixel_rate))[::-1]:
        beam = edge + (chosen[edge] >= spec.mixed_pixel_rate / 2)
        ranges_m[beam] = before_m[edge] + share[edge] * step_m[edge]
    ranges_m = ranges_m + (normal * spec.sigma_m(ranges_m) + spec.range_bias_m)
    ranges_m = np.rint(ranges_m / spec.resolution_m) * spec.resolution_m
    ranges_m[ranges_m > spec.range_max_m] = np.inf
    ranges_m[ranges_m < spec.range_min_m] = -np.inf
    ranges_m[dropped < spec.dropout_rate] = np.nan
    return ranges_m


@pytest.mark.parametrize("name", LASERS)
def test_errors_are_those_that_the_obvious_formula_gives(name):
    spec, rng = (
        replace(laser(name), dropout_rate=0.05, range_bias_m=0.004),
        np.random.default_rng(1),
    )
    # stretches of wall with edges between, some out of reach, some nothing at all
    walls_m = rng.uniform(0.0, 1.2 * spec.range_max_m, spec.beam_count // 5 + 1)
    walls_m[rng.random(len(walls_m)) < 0.1], walls_m[0] = np.inf, 0.0
    true_m = np.repeat(walls_m, 5)[: spec.beam_count]
    found = measured_ranges(spec, true_m, np.random.default_rng(2))
    np.testing.assert_array_equal(found, obvious_ranges(spec, true_m, np.random.default_rng(2)))
    assert np.isposinf(found).any()
    assert np.isneginf(found).any() or spec.range_min_m == 0.0
    assert np.isnan(found).any()

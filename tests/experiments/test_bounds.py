"""The bound of a trial: what a scan of the default laser tells in the laboratory."""

import math
from dataclasses import replace

import numpy as np
import pytest

from experiments.assumptions import ASSUMED_LASERS, assumed_laser, assumed_mount_sigma
from experiments.bounds import nees, scan_bound
from experiments.methods import KnownPlace
from experiments.sources import MeasurementSource
from experiments.trials import TrialConfig
from kitasap_sim import Simulation
from kitasap_sim.laser import LASERS, laser
from slam.measurements import LaserScan


@pytest.fixture(scope="module")
def known() -> KnownPlace:
    return TrialConfig().known_place


@pytest.fixture(scope="module")
def seen(known: KnownPlace) -> tuple[LaserScan, np.ndarray]:
    """A scan at the laboratory's start, and the true pose there."""
    simulation = Simulation(known.place, known.laser, "as_built", rng=np.random.default_rng(0))
    source = MeasurementSource(known.laser, simulation.wheel_ticks())
    scan = source.measurement(simulation.next_frame()).scan
    return scan, simulation.truth().pose


def position_m(bound: np.ndarray) -> float:
    return math.sqrt(bound[0, 0] + bound[1, 1])


def with_ranges(scan: LaserScan, ranges_m: np.ndarray) -> LaserScan:
    return LaserScan(scan.time_s, scan.angles_rad, ranges_m, scan.beam_times_s)


def test_default_laser_tells_its_place_in_the_laboratory_to_a_millimetre(known, seen):
    bound = scan_bound(known, known.laser, *seen)
    # 682 beams of 10 to 50 mm: 30 mm / sqrt(682) = 1.1 mm, give or take the walls' directions
    assert 0.0004 < position_m(bound) < 0.004
    assert 0.0002 < math.sqrt(bound[2, 2]) < 0.004
    np.testing.assert_allclose(bound, bound.T)


def test_beams_that_end_on_people_tell_nothing(known, seen):
    scan, true = seen
    people, lost = scan.ranges_m.copy(), scan.ranges_m.copy()
    people[100:200] = 0.4  # half a metre and more before the walls
    lost[100:200] = np.nan
    free = scan_bound(known, known.laser, scan, true)
    hidden = scan_bound(known, known.laser, with_ranges(scan, people), true)
    without = scan_bound(known, known.laser, with_ranges(scan, lost), true)
    np.testing.assert_array_equal(hidden, without)
    # less is told: each variance is larger
    assert (np.linalg.eigvalsh(hidden - free) > 0.0).all()


def test_bound_goes_with_the_square_of_the_noise(known, seen):
    scan, true = seen
    noisy = replace(
        known.laser, sigma_at_m=tuple((at, 2.0 * sigma) for at, sigma in known.laser.sigma_at_m)
    )
    plain = scan_bound(known, known.laser, scan, true)
    doubled = scan_bound(known, noisy, scan, true)
    # a few more beams count as undisturbed
    assert position_m(doubled) / position_m(plain) == pytest.approx(2.0, rel=0.05)


def test_scan_without_a_return_bounds_nothing(known, seen):
    scan, true = seen
    blind = with_ranges(scan, np.full(len(scan.ranges_m), np.inf))
    assert np.isinf(np.diag(scan_bound(known, known.laser, blind, true))).all()


def test_nees_is_the_squared_error_in_standard_deviations():
    covariance = np.diag([4.0, 9.0, 16.0])
    assert nees(np.array([2.0, 6.0, 4.0]), covariance) == pytest.approx(1.0 + 4.0 + 1.0)


def test_each_laser_has_a_model_of_its_own_assumed():
    assert set(ASSUMED_LASERS) == set(LASERS)
    for name, spec in LASERS.items():
        model = assumed_laser(name)
        # a table of its own: what the simulator draws from is not read
        assert model.noise.sigma_at_m is not spec.sigma_at_m
        assert type(model) is not type(spec)
        # of the same data sheets
        assert model.range_max_m == pytest.approx(spec.range_max_m)
        at_m = np.linspace(model.range_min_m, model.range_max_m, 20)
        np.testing.assert_allclose(model.noise.sigma_m(at_m), laser(name).sigma_m(at_m))


def test_robot_on_smaller_wheels_than_it_believes_leans_no_farther_than_is_assumed():
    # wheels smaller by a thousandth: what stands 10 cm above the axle is 32 um ahead of its place
    simulation = Simulation("room_fig4", "ust_10lx", "as_built", rng=np.random.default_rng(0))
    simulation.run(0.2)
    ahead, aside = simulation.data.body("kitasap2/base").xmat[[2, 5]] * (0.17 - 0.075)
    forward_m, aside_m, turn_rad = assumed_mount_sigma(laser("ust_10lx"))
    assert 0.8 < np.hypot(ahead, aside) / forward_m < 1.2
    assert aside_m < 0.2 * forward_m
    assert turn_rad == 0.0


def test_unknown_laser_is_told_with_those_there_are():
    with pytest.raises(ValueError, match=r"no laser called 'x'.*urg_04lx"):
        assumed_laser("x")

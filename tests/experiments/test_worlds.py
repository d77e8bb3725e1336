"""The worlds that differ from what is assumed: each in what it says, and in nothing else."""

import math
from dataclasses import asdict

import numpy as np
import pytest

from experiments.assumptions import assumed_laser
from experiments.trials import TrialConfig
from experiments.worlds import (
    MISMATCHES,
    checked_mismatch,
    moved_furniture,
    simulated,
    true_laser,
)
from kitasap_sim.laser import LASERS, laser

LASER = "urg_04lx"


def changed(mismatch: str, name: str = LASER) -> dict[str, tuple]:
    """The fields of the laser that differ, as sold and as it truly is."""
    sold, true = asdict(laser(name)), asdict(true_laser(name, mismatch))
    return {key: (sold[key], true[key]) for key in sold if sold[key] != true[key]}


@pytest.mark.parametrize("name", LASERS)
@pytest.mark.parametrize(("mismatch", "factor"), [("noisy", 2.0), ("quiet", 0.5)])
def test_noise_alone_is_scaled(name, mismatch, factor):
    differs = changed(mismatch, name)
    assert set(differs) == {"sigma_at_m"}
    sold, true = (np.array(values) for values in differs["sigma_at_m"])
    np.testing.assert_array_equal(true[:, 0], sold[:, 0])
    np.testing.assert_allclose(true[:, 1], factor * sold[:, 1])


def test_offset_alone_is_5_mm():
    assert changed("offset") == {"range_bias_m": (0.0, 0.005)}


def test_mount_is_5_mm_and_a_third_of_a_degree_off():
    differs = changed("mount")
    assert set(differs) == {"mount_m", "first_angle_rad"}
    shift_m = np.subtract(differs["mount_m"][1], differs["mount_m"][0])
    assert np.hypot(*shift_m[:2]) == pytest.approx(0.005)
    assert shift_m[2] == 0.0
    assert np.diff(differs["first_angle_rad"])[0] == pytest.approx(math.radians(0.3))


@pytest.mark.parametrize("mismatch", ["none", "chair"])
def test_laser_itself_is_as_sold_otherwise(mismatch):
    assert changed(mismatch) == {}


def test_presets_are_not_touched():
    before = asdict(laser(LASER))
    for mismatch in MISMATCHES:
        true_laser(LASER, mismatch)
    assert asdict(laser(LASER)) == before
    # nor what the estimators assume
    assert assumed_laser(LASER).noise.sigma_at_m == ((1.0, 0.010), (5.6, 0.056))


@pytest.mark.parametrize("mismatch", ["noisy", "offset", "mount"])
def test_configuration_assumes_the_laser_as_sold(mismatch):
    config = TrialConfig(mismatch=mismatch)
    assert config.known_place.laser == laser(LASER)
    assert config.true_laser == true_laser(LASER, mismatch)
    assert config.true_laser != laser(LASER)


def test_furniture_moves_by_20_cm_is_seen_and_the_map_stays():
    place = TrialConfig().known_place.place
    ((piece, shift_m),) = moved_furniture(place, LASER).items()
    assert "chair" in piece
    assert np.hypot(*shift_m) == pytest.approx(0.2)
    assert moved_furniture(place, LASER) == {piece: shift_m}
    ranges_m = {}
    for mismatch in ("none", "chair"):
        simulation = simulated(
            place, LASER, "as_built", np.random.default_rng(0), mismatch=mismatch
        )
        assert simulation.place is place
        assert (simulation.world is place) == (mismatch == "none")
        # from near by, so that it is in view wherever it stands
        ranges_m[mismatch] = [
            simulated_ranges(simulation, place.free_centres_m[i]) for i in range(0, 4000, 400)
        ]
    off_m = np.abs(np.subtract(ranges_m["chair"], ranges_m["none"]))
    # the beams on the piece change, and those behind it; not half of the room
    assert 0.002 < (off_m > 0.01).mean() < 0.3


def simulated_ranges(simulation, at_m: np.ndarray) -> np.ndarray:
    simulation.reset(np.array([*at_m, 0.0]))
    return np.minimum(simulation.true_ranges_m(), 100.0)


def test_unknown_mismatch_is_told_with_those_there_are():
    with pytest.raises(ValueError, match=r"no mismatch called 'x'.*chair"):
        checked_mismatch("x")
    with pytest.raises(ValueError, match="no mismatch called 'x'"):
        TrialConfig(mismatch="x").checked()
    for name in MISMATCHES:
        assert checked_mismatch(name) == name

"""Random rooms: as difficult as asked for, and always to be driven in."""

import pickle

import mujoco
import numpy as np
import pytest

from kitasap_sim.random_rooms import random_room


def test_equal_generators_draw_equal_rooms():
    one, same, other = (random_room(np.random.default_rng(seed), 0.7) for seed in (1, 1, 2))
    assert one.digest == same.digest != other.digest


def test_harder_rooms_have_more_in_them_and_less_floor():
    counts, floors = [], []
    for difficulty in (0.0, 0.5, 1.0):
        rooms = [random_room(np.random.default_rng(seed), difficulty) for seed in range(3)]
        counts.append(np.mean([room.model.ngeom for room in rooms]))
        floors.append(np.mean([len(room.free_centres_m) for room in rooms]))
    assert counts[0] == 5.0
    assert counts[0] < counts[1] < counts[2]
    assert floors[0] > floors[1] > floors[2]


@pytest.mark.parametrize("seed", range(12))
def test_a_quarter_of_the_hardest_room_can_be_reached(seed):
    room = random_room(np.random.default_rng(seed), 1.0)
    lower, upper = room.bounds_m
    floor_m2 = float(np.prod(upper - lower))
    assert len(room.free_centres_m) * room.free_cell_m**2 > 0.2 * floor_m2
    assert room.is_free(room.start[:2])[0]


@pytest.mark.parametrize("difficulty", [-0.1, 1.1, np.nan])
def test_other_difficulties_are_refused(difficulty):
    with pytest.raises(ValueError, match="between 0 and 1"):
        random_room(np.random.default_rng(0), difficulty)


@pytest.mark.parametrize("seed", range(6))
def test_room_that_was_sent_to_another_process_is_the_same_to_the_bit(seed):
    room = random_room(np.random.default_rng(seed), 1.0)
    there = pickle.loads(pickle.dumps(room))
    for name in ("geom_pos", "geom_quat", "geom_size", "body_pos", "site_pos"):
        np.testing.assert_array_equal(getattr(room.model, name), getattr(there.model, name))
    np.testing.assert_array_equal(room.start, there.start)
    np.testing.assert_array_equal(room.free_centres_m, there.free_centres_m)


@pytest.mark.parametrize("seed", range(6))
@pytest.mark.parametrize("difficulty", [0.0, 1.0])
def test_all_but_one_thing_of_a_twofold_room_stands_there_twice(seed, difficulty):
    room = random_room(np.random.default_rng(seed), difficulty, is_twofold=True)
    model = room.model
    solid = model.geom_type != mujoco.mjtGeom.mjGEOM_PLANE
    spots_m, sizes_m = model.geom_pos[solid][:, :2], model.geom_size[solid]
    turned_m = 2.0 * model.stat.center[:2] - spots_m
    apart_m = np.hypot(*(spots_m[:, None] - turned_m[None]).transpose(2, 0, 1))
    is_like = np.abs(sizes_m[:, None] - sizes_m[None]).max(axis=2) < 1e-6
    lone = ~((apart_m < 1e-4) & is_like).any(axis=1)
    assert lone.sum() == 1
    assert len(lone) % 2 == 1
    # and can be seen: nothing else stands where its middle is
    assert np.hypot(*(spots_m[~lone] - spots_m[lone]).T).min() > 0.25

"""Walls of floor plans: corners closed, doors open, faces where the plan has them."""

import math

import mujoco
import numpy as np
import pytest

from kitasap_sim.built_places import Block, Pillar, place_mjcf
from kitasap_sim.floor_plan import FloorPlan, Wall
from kitasap_sim.places import Place

SQUARE = ((0.0, 0.0), (4.0, 0.0), (4.0, 4.0), (0.0, 4.0))


def place_of(*walls: Wall, things: tuple[Block | Pillar, ...] = (), start=(1.0, 1.0, 0.0)) -> Place:
    mjcf = place_mjcf("plan", "a test", FloorPlan(walls, things).solids(), start)
    return Place.of_mjcf(mujoco.MjSpec.from_string(mjcf), "plan")


def ranges_from(place: Place, x: float, y: float, angles: np.ndarray) -> np.ndarray:
    data = mujoco.MjData(place.model)
    mujoco.mj_kinematics(place.model, data)
    ways = np.stack([np.cos(angles), np.sin(angles), 0.0 * angles], axis=1)
    hit, ranges_m = np.zeros(len(angles), dtype=np.int32), np.zeros(len(angles))
    mujoco.mj_multiRay(
        place.model, data, np.array([x, y, 0.1]), ways.ravel(), None, 1, -1,
        hit, ranges_m, None, len(angles), mujoco.mjMAXVAL,
    )  # fmt: skip
    return np.where(hit < 0, np.inf, ranges_m)


def test_walls_stand_half_their_thickness_to_either_side_of_their_line():
    place = place_of(Wall(SQUARE, 0.2, 0.8, is_closed=True))
    found = ranges_from(place, 1.0, 1.5, np.arange(4) * math.pi / 2)
    np.testing.assert_allclose(found, [2.9, 2.4, 0.9, 1.4], atol=1e-6)
    np.testing.assert_allclose(place.bounds_m, [[-0.1, -0.1], [4.1, 4.1]], atol=1e-6)


@pytest.mark.parametrize("sides", [3, 4, 5, 12, 40])
def test_closed_walls_let_no_beam_out_at_their_corners(sides):
    turns = np.arange(sides) * 2 * math.pi / sides
    line = tuple((3 * math.cos(a), 3 * math.sin(a)) for a in turns)
    place = place_of(Wall(line, 0.1, 0.8, is_closed=True), start=(0.0, 0.0, 0.0))
    angles = np.concatenate([np.random.default_rng(3).uniform(0, 7, 2000), turns])
    apothem = 3 * math.cos(math.pi / sides)
    found = ranges_from(place, 0.0, 0.0, angles)
    assert found.min() > apothem - 0.05 - 1e-6
    assert found.max() < 3.0
    # and from outside none in: what looks at a corner sees its tip, mitred
    away = 10.0
    outside = ranges_from(place, away, 0.0, np.array([math.pi]))
    tip = min(3 + 0.05 / math.cos(math.pi / sides), 3 + 0.05 * math.sqrt(5))
    assert away - outside[0] == pytest.approx(tip, abs=0.03 if sides == 3 else 1e-5)


def test_a_door_is_as_wide_as_it_says():
    place = place_of(Wall(SQUARE, 0.1, 0.8, doors_m=((5.0, 6.0),), is_closed=True))
    # on the second side, from y = 1 to 2
    for y, is_open in ((0.99, False), (1.01, True), (1.99, True), (2.01, False)):
        found = ranges_from(place, 2.0, y, np.zeros(1))
        assert np.isinf(found[0]) == is_open


def test_doors_may_reach_from_corner_to_corner():
    wall = Wall(SQUARE, 0.1, 0.8, doors_m=((4.0, 8.0), (13.0, 14.0)), is_closed=True)
    assert len(wall.blocks()) == 4
    assert np.isinf(ranges_from(place_of(wall), 2.0, 2.0, np.zeros(1)))[0]


def test_an_open_wall_ends_where_its_line_does():
    (block,) = Wall(((0.0, 0.0), (3.0, 4.0)), 0.1, 0.8).blocks()
    assert (block.width_m, block.depth_m) == (pytest.approx(5.0), 0.1)
    assert (block.x_m, block.y_m) == (pytest.approx(1.5), pytest.approx(2.0))


@pytest.mark.parametrize(
    ("line", "doors", "closed", "said"),
    [
        (((0.0, 0.0),), (), False, "at least two, not 1"),
        (((0.0, 0.0), (1.0, 0.0)), (), True, "at least three, if it is closed, not 2"),
        (((0.0, 0.0), (0.0, 0.0)), (), False, "in a row are the same"),
        (SQUARE[:2], ((2.0, 5.0),), False, r"within 0 and 4.000 m, not from 2 to 5"),
        (SQUARE[:2], ((3.0, 2.0),), False, r"not from 3 to 2"),
        (SQUARE[:2], ((-1.0, 2.0),), False, r"not from -1 to 2"),
    ],
)
def test_walls_that_are_none_are_refused(line, doors, closed, said):
    with pytest.raises(ValueError, match=said):
        Wall(line, 0.1, 0.8, doors, closed)


def test_things_stand_where_they_are_put_and_can_be_pushed():
    things = (
        Block(3.0, 2.0, 0.5, 0.2, 0.7, math.pi / 2, "chair"),
        Pillar(1.0, 3.0, 0.2, 0.8, "post"),
    )
    place = place_of(Wall(SQUARE, 0.1, 0.8, is_closed=True), things=things)
    found = ranges_from(place, 1.0, 2.0, np.array([0.0, math.pi / 2]))
    np.testing.assert_allclose(found, [1.9, 0.8], atol=1e-6)
    assert place.movable(0.1) == "chair"


def test_a_place_of_nothing_is_refused():
    with pytest.raises(ValueError, match="a place needs something"):
        place_mjcf("nothing", "", [], None)


def test_names_and_sources_cannot_break_the_file():
    mjcf = place_mjcf('"><!--&{x}', "--> <x/> --", [Block(0, 0, 1, 1, 1, name="a<b>&\"'")], None)
    spec = mujoco.MjSpec.from_string(mjcf)
    assert spec.modelname == '"><!--&{x}'
    assert spec.geom("a<b>&\"'") is not None

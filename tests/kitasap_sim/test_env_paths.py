"""What tasks count as done: a path that returns beside itself, floor that no beam can reach."""

import gymnasium
import mujoco
import numpy as np
import pytest

import kitasap_sim  # noqa: F401  registers the tasks
from kitasap_sim.env.path import Path
from kitasap_sim.places import Place

TWO_ROOMS = """
<mujoco>
  <worldbody>
    <geom type="box" size="4.1 0.05 0.5" pos="4 -0.05 0.5"/>
    <geom type="box" size="4.1 0.05 0.5" pos="4 3.05 0.5"/>
    <geom type="box" size="0.05 1.6 0.5" pos="-0.05 1.5 0.5"/>
    <geom type="box" size="0.05 1.6 0.5" pos="8.05 1.5 0.5"/>
    <geom type="box" size="0.05 1.4 0.5" pos="4 1.6 0.5"/>
    <site name="start" pos="1.5 1.5 0"/>
  </worldbody>
</mujoco>
"""
"""Two rooms of 12 m2, and a gap of 0.2 m at the end of the wall between them."""


def test_who_returns_beside_the_first_leg_is_not_taken_back_along_it():
    # a hairpin of 0.1 rad: 0.5 m behind its corner the legs are 5 cm apart
    path = Path(np.array([[0.0, 0.0], [2.0, 0.0], [0.0, 0.2]]))
    along_m = 0.0
    for x in np.arange(0.0, 1.95, 0.02):
        along_m, _ = path.nearest(np.array([x, 0.0]), along_m)
    for x in np.arange(1.95, 0.5, -0.02):
        # on the way back 3 cm off, to the side of the first leg
        along_m, _ = path.nearest(np.array([x, (2.0 - x) * 0.1 - 0.03]), along_m)
    assert along_m > 3.4  # 2 m there, 1.5 m back


def test_floor_that_no_beam_can_reach_does_not_count():
    place = Place.of_mjcf(mujoco.MjSpec.from_string(TWO_ROOMS), "two_rooms")
    env = gymnasium.make("Kitasap2/Explore-v0", place=place)
    env.reset(seed=0)
    # its own room, and of the other what is seen through the gap: not the 24 m2 of both
    assert 11.5 < 0.01 * env.unwrapped._to_see < 17.0


def test_points_along_a_path_are_those_of_its_legs_and_its_ends_beyond():
    path = Path(np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 0.0], [1.0, 0.5], [-2.0, 0.5]]))
    lengths_m = np.array([-0.3, 0.0, 0.4, 1.0, 1.2, 1.5, 2.0, 4.5, 9.0])
    expected_m = [
        (0, 0),
        (0, 0),
        (0.4, 0),
        (1, 0),
        (1, 0.2),
        (1, 0.5),
        (0.5, 0.5),
        (-2, 0.5),
        (-2, 0.5),
    ]
    np.testing.assert_allclose(path.seen(lengths_m, np.zeros(3)), expected_m, atol=1e-12)
    assert path.at(1.2) == pytest.approx((1.0, 0.2))
    # from (1, 0), looking along y, what lies to the left is behind the second corner
    seen_m = path.seen(np.array([1.2, 2.0]), np.array([1.0, 0.0, np.pi / 2]))
    np.testing.assert_allclose(seen_m, [(0.2, 0.0), (0.5, 0.5)], atol=1e-12)
    assert path.heading_rad(1.2) == pytest.approx(np.pi / 2)

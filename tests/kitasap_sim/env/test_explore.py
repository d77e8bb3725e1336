"""What Explore counts: cells that beams went through, of those that they can reach at all."""

import math

import numpy as np

from kitasap_sim.env.explore import ExploreEnv
from kitasap_sim.env.kernels import see

CLOSET = """
<mujoco>
  <worldbody>
    <geom type="box" size="3.05 0.05 0.5" pos="3 -0.05 0.5"/>
    <geom type="box" size="3.05 0.05 0.5" pos="3 4.05 0.5"/>
    <geom type="box" size="0.05 2 0.5" pos="-0.05 2 0.5"/>
    <geom type="box" size="0.05 2 0.5" pos="6.05 2 0.5"/>
    <geom type="box" size="0.01 1 0.5" pos="4.5 1 0.5"/>
    <geom type="box" size="0.75 0.01 0.5" pos="5.25 2 0.5"/>
    <site name="start" pos="1.5 1.5 0"/>
  </worldbody>
</mujoco>
"""


def cells_of(start, angle, length):
    """Cells that a ray goes through, by its crossings of all lines one by one."""
    along = np.array([math.cos(angle), math.sin(angle)])
    ways = [0.0, length]
    for axis in range(2):
        for line in range(-40, 80):
            if (
                abs(along[axis]) > 1e-12
                and 0.0 < (way := (line - start[axis]) / along[axis]) < length
            ):
                ways.append(way)
    ways.sort()
    middles = (np.array(ways[1:]) + ways[:-1]) / 2.0
    return {tuple(cell) for cell in np.floor(start + middles[:, np.newaxis] * along).astype(int)}


def test_cells_seen_are_all_that_the_beams_cross_from_where_they_are_fired():
    rng = np.random.default_rng(0)
    for _ in range(30):
        before = np.array([*rng.uniform(5.0, 15.0, 2), rng.uniform(-7.0, 7.0)])
        now = before + rng.uniform(-1.0, 1.0, 3)
        shares, angles = np.linspace(0.0, 0.9, 12), rng.uniform(-2.1, 2.1, 12)
        ranges = rng.uniform(0.0, 12.0, 12)
        ranges[0] = math.inf
        is_left = rng.random((20, 22)) < 0.7
        expected = set()
        for share, angle, length in zip(shares, angles, np.minimum(ranges, 9.0), strict=True):
            x, y, heading = before + share * (now - before)
            expected |= cells_of(np.array([x, y]), heading + angle, length)
        expected &= set(zip(*(ids.tolist() for ids in np.nonzero(is_left)), strict=True))
        left = is_left.copy()
        assert see(left, before, now, shares, angles, ranges, 9.0) == len(expected)
        assert {tuple(cell) for cell in np.argwhere(is_left & ~left)} == expected


def test_floor_behind_a_wall_thinner_than_a_cell_is_not_to_be_seen(tmp_path):
    # a closet with walls of 2 cm and no door, 1.5 by 2 m of 6 by 4
    path = tmp_path / "closet.xml"
    path.write_text(CLOSET)
    env = ExploreEnv(place=path)
    env.reset(seed=0)
    told_m2 = 0.01 * env._to_see
    assert 20.0 < told_m2 < 22.5

"""Small worlds for the simulator's tests."""

from pathlib import Path

import numpy as np
import pytest

from kitasap_sim import Place, Simulation

OPEN_FLOOR = """
<mujoco>
  <worldbody>
    <geom type="plane" size="50 50 0.1"/>
    <geom type="box" size="0.5 0.5 0.5" pos="40 40 0.5"/>
    <site name="start"/>
  </worldbody>
</mujoco>
"""

BOX_ROOM = """
<mujoco>
  <worldbody>
    <geom name="floor" type="plane" size="9 9 0.1"/>
    <geom type="box" size="2.1 0.05 0.5" pos="2 -0.05 0.5"/>
    <geom type="box" size="2.1 0.05 0.5" pos="2 3.05 0.5"/>
    <geom type="box" size="0.05 1.6 0.5" pos="-0.05 1.5 0.5"/>
    <geom type="box" size="0.05 1.6 0.5" pos="4.05 1.5 0.5"/>
    <geom name="pillar" type="cylinder" size="0.2 0.5" pos="3 2 0.5"/>
    <geom name="table_top" type="box" size="0.4 0.4 0.02" pos="0.6 2.4 0.7"/>
    <geom name="shelf" type="box" size="0.3 0.2 0.01" pos="3.6 0.3 0.3"/>
    <geom name="glass" type="box" size="0.1 0.1 0.3" pos="0.2 0.2 0.3" rgba="0 0 0 0"/>
    <site name="start" pos="1.5 1.2 0" euler="0 0 30"/>
  </worldbody>
</mujoco>
"""


@pytest.fixture(scope="session")
def place_file(tmp_path_factory: pytest.TempPathFactory):
    """Writes MJCF text to a file and gives its path."""

    def write(text: str, name: str = "place.xml") -> Path:
        path = tmp_path_factory.mktemp("places") / name
        path.write_text(text)
        return path

    return write


@pytest.fixture(scope="session")
def open_floor(place_file) -> Place:
    return Place(place_file(OPEN_FLOOR))


@pytest.fixture(scope="session")
def box_room(place_file) -> Place:
    """4 x 3 m, inner corner at the origin, a pillar, a table, a low shelf and a glass box."""
    return Place(place_file(BOX_ROOM))


@pytest.fixture
def make():
    """A simulation with a seed of its own."""

    def simulation(place, laser="urg_04lx", odometry="ideal", seed=0) -> Simulation:
        return Simulation(place, laser, odometry, rng=np.random.default_rng(seed))

    return simulation

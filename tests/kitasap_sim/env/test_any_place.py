"""The driving tasks in places of one's own: floors and walls of any make, made by a program, named."""

import copy
import pickle

import gymnasium
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env

from kitasap_sim.env.goto import GoToEnv
from kitasap_sim.places import Place
from kitasap_sim.random_rooms import random_room

_WALLS = "".join(
    f'<geom type="box" size="{sx} {sy} .4" pos="{x} {y} .4"/>'
    for sx, sy, x, y in ((3, 0.1, 0, 3), (3, 0.1, 0, -3), (0.1, 3, 3, 0), (0.1, 3, -3, 0))
)
_FLOORS = {
    "box": '<geom type="box" size="10 10 .1" pos="0 0 -.1"/>',
    "cylinder": '<geom type="cylinder" size="10 .1" pos="0 0 -.1"/>',
    "two_tiles": '<geom type="box" size="5 10 .1" pos="-5 0 -.1"/>'
    '<geom type="box" size="5 10 .1" pos="5 0 -.1"/>',
    "none": "",
}
_OBSTACLES = {
    "glass": '<geom type="box" size=".1 2 .4" pos="1.5 0 .4" rgba="1 1 1 0"/>',
    "plane": '<geom type="plane" size="2 2 .1" pos="1.5 0 0" zaxis="-1 0 0"/>',
    "box": '<geom type="box" size=".1 2 .4" pos="1.5 0 .4"/>',
}


def room(floor: str, things: str = "") -> str:
    return f"<mujoco><worldbody>{floor}{_WALLS}{things}</worldbody></mujoco>"


@pytest.mark.parametrize("floor", _FLOORS)
def test_a_floor_of_any_make_is_no_collision(tmp_path, floor):
    path = tmp_path / "place.xml"
    path.write_text(room(_FLOORS[floor]))
    env = GoToEnv(place=path)
    env.reset(seed=1, options={"pose": (0.0, 0.0, 0.0)})
    for _ in range(20):
        *_, info = env.step(np.array([0.2, 0.1]))
        assert not info["collision"]


@pytest.mark.parametrize("thing", _OBSTACLES)
def test_whatever_stops_the_robot_is_a_collision(tmp_path, thing):
    path = tmp_path / "place.xml"
    path.write_text(room(_FLOORS["none"], _OBSTACLES[thing]))
    env = GoToEnv(place=path)
    env.reset(seed=1, options={"pose": (0.0, 0.0, 0.0)})
    for _ in range(120):
        *_, is_over, _, info = env.step(np.array([1.0, 0.0]))
        if is_over:
            break
    assert info["collision"]


def test_a_place_made_by_a_program_is_a_keyword_like_any_other():
    place = random_room(np.random.default_rng(4), 0.3)
    env = gymnasium.make("kitasap_sim:Kitasap2/GoTo-v0", place=place)
    check_env(env.unwrapped, skip_render_check=True)
    spec = pickle.loads(pickle.dumps(env.spec))
    observations = [gymnasium.make(one).reset(seed=2)[0]["scan"] for one in (env.spec, spec)]
    np.testing.assert_allclose(*observations, atol=2e-3)  # a range is told in millimetres
    assert copy.deepcopy(place) is place


def test_places_come_out_of_a_pickle_as_they_were():
    moved = Place("room_fig4").rearranged({"office_chair": (0.2, 0.1)})
    for place in (Place("room_fig4"), moved, random_room(np.random.default_rng(5), 0.8)):
        again = pickle.loads(pickle.dumps(place))
        assert (again.name, again.path) == (place.name, place.path)
        assert np.array_equal(again.start, place.start)
        # MJCF is written with seven digits
        np.testing.assert_allclose(again.bounds_m, place.bounds_m, atol=1e-5)
        np.testing.assert_allclose(again.model.geom_pos, place.model.geom_pos, atol=1e-5)


@pytest.mark.parametrize(
    ("keywords", "said"),
    [
        ({"place": ["room_fig4", "rom_fig4"]}, "place: no place called 'rom_fig4'"),
        ({"place": 3}, "place: a name, the path of an MJCF file, or a Place, not 3"),
        # the robot would not stand as it should, which the reset of some episode would find
        ({"wheel_radii": (-0.1, 0.1)}, "wheel_radii: between -0.05 and 0.05"),
        ({"beams": 60.5}, "beams: a whole number from 1 to 4096, not 60.5"),
        ({"laser": None}, "laser: a name or a LaserSpec, not None"),
    ],
)
def test_what_no_episode_could_begin_with_is_refused_at_once(keywords, said):
    with pytest.raises(ValueError, match=said):
        GoToEnv(**keywords)


@pytest.mark.parametrize("laser", ["urg_04lx", "ust_10lx", "rplidar_a2"])
def test_two_beams_are_enough(laser):
    env = GoToEnv(place="symmetric_room", beams=2, laser=laser)
    assert env.reset(seed=0)[0]["scan"].shape == (2,)


def test_a_reset_that_failed_has_begun_no_episode():
    env = GoToEnv(place="symmetric_room")
    for _ in range(2):
        with pytest.raises(ValueError, match="pose: something stands"):
            env.reset(options={"pose": (-5.0, 1.0, 0.0)})
        with pytest.raises(RuntimeError, match="call reset"):
            env.step(np.zeros(2))
        env.reset(seed=1)


def test_numbers_too_large_for_32_bits_are_clipped_and_text_is_no_action():
    env = GoToEnv(place="symmetric_room")
    env.reset(seed=0)
    env.step(np.array([-1e39, 0.0]))
    assert env.step([1e300, 0.0])[0]["last_action"].tolist() == [1.0, 0.0]
    for action in ([10**400, 0], ["1", "0"], np.array([1j, 0.0])):
        with pytest.raises(ValueError, match="two finite numbers"):
            env.step(action)

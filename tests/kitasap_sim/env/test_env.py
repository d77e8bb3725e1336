"""The driving tasks: Gymnasium's contract, determinism, what actions and options may be."""

import contextlib
import subprocess
import sys
import threading
import time
from dataclasses import replace
from pathlib import Path

import gymnasium
import mujoco
import mujoco.viewer
import numpy as np
import pytest
from gymnasium.envs.registration import EnvSpec
from gymnasium.error import ClosedEnvironmentError
from gymnasium.utils.env_checker import check_env
from gymnasium.vector import AutoresetMode

import kitasap_sim
from kitasap_sim import window
from kitasap_sim.env.base import KitasapEnv
from kitasap_sim.env.explore import ExploreEnv
from kitasap_sim.env.goto import GoToEnv
from kitasap_sim.env.track import TrackEnv
from kitasap_sim.laser import LASERS
from kitasap_sim.people import People
from kitasap_sim.places import Place
from kitasap_sim.rendering import RenderingError, render
from kitasap_sim.simulation import Simulation

TASKS = ("GoTo", "Explore", "Relocalize", "Track")
IDS = [f"Kitasap2/{task}-v0" for task in TASKS]
FORWARD = np.array([0.4, 0.3], dtype=np.float32)
VARIED = {
    "people": (0, 2),
    "friction": (0.5, 1.0),
    "wheel_radii": (-0.01, 0.01),
    "laser_noise": (0.5, 2.0),
    "latency_s": (0.0, 0.12),
    "place": ["random", "room_fig4"],
}
VARIANTS = [
    {},
    {"beams": 1},
    {"beams": 181, "laser": "rplidar_a2"},
    {"control": "wheels"},
    {"place": "symmetric_room", "odometry": "rough_floor"},
    {"place": "twofold", "difficulty": 1.0},
    VARIED,
]
CHECKED = [
    pytest.param(
        keywords,
        marks=pytest.mark.slow if keywords else [],
        id="-".join(keywords) or "plain",
    )
    for keywords in VARIANTS
]
SOME_SLOW = [
    pytest.param(one, marks=pytest.mark.slow if "Explore" in one or "Track" in one else [])
    for one in IDS
]


def task(env_id: str, **keywords) -> KitasapEnv:
    env = gymnasium.make(env_id, **keywords).unwrapped
    assert isinstance(env, KitasapEnv)
    return env


def equal(one, other) -> bool:
    if isinstance(one, dict):
        return one.keys() == other.keys() and all(equal(one[key], other[key]) for key in one)
    return bool(np.array_equal(one, other))


def rollout(env, count: int, seed: int = 3) -> list:
    rng = np.random.default_rng(seed)
    steps = [env.reset(seed=seed)]
    for _ in range(count):
        steps.append(env.step(rng.uniform(-1.2, 1.2, 2).astype(np.float32)))
    return steps


def same(one: list, other: list) -> bool:
    return all(
        equal(a, b) for x, y in zip(one, other, strict=True) for a, b in zip(x, y, strict=True)
    )


@pytest.mark.parametrize("env_id", SOME_SLOW)
@pytest.mark.parametrize("keywords", CHECKED)
def test_gymnasium_s_checker_finds_nothing(env_id, keywords):
    check_env(task(env_id, **keywords), skip_render_check=True)


@pytest.mark.parametrize("env_id", IDS)
@pytest.mark.parametrize("keywords", CHECKED)
def test_checker_of_stable_baselines_finds_nothing(env_id, keywords):
    checker = pytest.importorskip(
        "stable_baselines3.common.env_checker", reason="the extra rl is not installed"
    )
    checker.check_env(gymnasium.make(env_id, **keywords), skip_render_check=True)


def test_importing_the_package_registers_without_mujoco_or_open3d():
    script = (
        "import sys, kitasap_sim, gymnasium\n"
        "assert 'Kitasap2/GoTo-v0' in gymnasium.registry\n"
        "assert not {'mujoco', 'open3d', 'numba', 'slam'} & set(sys.modules)\n"
    )
    subprocess.run([sys.executable, "-c", script], check=True)


def test_module_form_of_an_id_makes_the_task():
    env = gymnasium.make("kitasap_sim:Kitasap2/GoTo-v0")
    assert type(env.unwrapped).__name__ == "GoToEnv"
    kitasap_sim.register_envs()  # again: nothing happens, no warning


@pytest.mark.parametrize("env_id", IDS)
def test_equal_seeds_give_equal_bytes_also_after_pickling_the_spec(env_id):
    env = gymnasium.make(env_id, **VARIED)
    first = rollout(env, 15)
    assert same(first, rollout(env, 15))
    copy = gymnasium.make(EnvSpec.from_json(env.spec.to_json()))
    assert same(first, rollout(copy, 15))
    assert not same(first, rollout(env, 15, seed=4))


def test_a_spec_with_objects_for_keywords_is_json_and_made_again_is_the_same(tmp_path):
    mine = tmp_path / "mine.xml"
    mine.write_bytes(Path(Place("symmetric_room").path).read_bytes())
    sharp = replace(LASERS["ust_10lx"], name="sharp", sigma_at_m=((1.0, 0.002), (5.0, 0.004)))
    keywords = {
        "place": (mine, Place("room_fig4"), "random"),
        "laser": sharp,
        "beams": np.int64(31),
        "people": np.array([0, 1]),
        "difficulty": (np.float32(0.25), 0.5),
    }
    env = gymnasium.make(IDS[0], **keywords)
    copied = gymnasium.make(EnvSpec.from_json(env.spec.to_json()))
    assert copied.unwrapped.sold_laser == sharp
    assert same(rollout(env, 3), rollout(copied, 3))
    vector = gymnasium.make_vec(IDS[0], 2, autoreset_mode=AutoresetMode.SAME_STEP, **keywords)
    spec = EnvSpec.from_json(vector.spec.to_json())
    again = gymnasium.make_vec(spec)
    assert again.metadata["autoreset_mode"] is AutoresetMode.SAME_STEP
    for env in (vector, again):
        env.close()


@pytest.mark.parametrize(
    "mode", [*(pytest.param(mode, marks=pytest.mark.slow) for mode in ("sync", "async")), None]
)
def test_vector_envs_give_what_single_ones_do(mode):
    keywords = {"difficulty": 0.3, "max_episode_steps": 15}
    vector = gymnasium.make_vec(IDS[0], 2, mode, **keywords)
    singles = [gymnasium.make(IDS[0], **keywords) for _ in range(2)]
    observations, infos = vector.reset(seed=5)
    expected = [env.reset(seed=5 + k) for k, env in enumerate(singles)]
    is_over, rng = [False, False], np.random.default_rng(0)
    for _ in range(40):
        for k, (observation, info) in enumerate(expected):
            assert equal({key: value[k] for key, value in observations.items()}, observation)
            assert np.array_equal(infos["pose_true"][k], info["pose_true"])
            assert infos["reward_terms"]["progress"][k] == info["reward_terms"]["progress"]
        actions = rng.uniform(-1, 1, (2, 2)).astype(np.float32)
        observations, rewards, terminations, truncations, infos = vector.step(actions)
        for k, env in enumerate(singles):
            if is_over[k]:
                expected[k], told = env.reset(), (0.0, False, False)
            else:
                observation, *told, info = env.step(actions[k])
                expected[k] = observation, info
            assert (rewards[k], terminations[k], truncations[k]) == tuple(told)
            is_over[k] = told[1] or told[2]
    vector.close()


@pytest.mark.slow
@pytest.mark.parametrize("mode", AutoresetMode, ids=lambda mode: mode.name)
def test_native_vector_env_begins_anew_as_gymnasium_s_own(mode):
    keywords = {"difficulty": 0.0, "max_episode_steps": 3}
    native = gymnasium.make_vec(IDS[0], 3, autoreset_mode=mode.value, **keywords)
    plain = gymnasium.make_vec(
        IDS[0], 3, "sync", vector_kwargs={"autoreset_mode": mode}, **keywords
    )
    assert native.metadata["autoreset_mode"] is mode
    envs, rng = (native, plain), np.random.default_rng(0)
    both = [env.reset(seed=5) for env in envs]
    anew, ended = np.array([True, False, False]), 0
    for number in range(12):
        assert told_alike(*both)
        # the first one, once, so that it ends later than the others; then those that nobody resets
        if number == 1 or (number > 1 and mode is AutoresetMode.DISABLED and anew.any()):
            both = [env.reset(options={"reset_mask": anew.copy()}) for env in envs]
            anew[:] = False
            continue
        actions = rng.uniform(-1, 1, (3, 2)).astype(np.float32)
        both = [env.step(actions) for env in envs]
        if number > 0:
            anew = both[0][2] | both[0][3]
            ended += int(anew.any())
        for last in filter(None, both[0][4].get("final_obs", ())):
            assert mode is AutoresetMode.SAME_STEP
            assert native.single_observation_space.contains(last)
    assert ended >= 3
    native.close()
    plain.close()


def told_alike(one, other) -> bool:
    """As `equal`, of what vector envs give: arrays of objects too."""
    if isinstance(one, np.ndarray) and one.dtype == object:
        one, other = one.tolist(), other.tolist()
    if isinstance(one, tuple | list):
        return len(one) == len(other) and all(map(told_alike, one, other))
    if isinstance(one, dict):
        return one.keys() == other.keys() and all(told_alike(one[k], other[k]) for k in one)
    return bool(np.array_equal(one, other))


def test_native_vector_env_says_what_it_cannot_do():
    with pytest.raises(
        ValueError, match="autoreset_mode: NextStep, SameStep, Disabled, not 'never'"
    ):
        gymnasium.make_vec(IDS[0], 2, autoreset_mode="never")
    vector = gymnasium.make_vec(
        IDS[0], 2, autoreset_mode="Disabled", difficulty=0.0, max_episode_steps=1
    )
    vector.reset(seed=0)
    actions = np.zeros((2, 2), dtype=np.float32)
    vector.step(actions)
    with pytest.raises(RuntimeError, match=r"\[0, 1\] are over: reset them"):
        vector.step(actions)
    vector.close()
    with pytest.raises(ClosedEnvironmentError, match=r"after close\(\)"):
        vector.step(actions)


@pytest.mark.parametrize("env_id", IDS)
@pytest.mark.parametrize(
    "action", [[np.nan, 0.0], [np.inf, 0.0], [0.0], [0.0, 0.0, 0.0], "left", None, [[0.0, 0.0]]]
)
def test_what_is_no_action_is_refused_and_nothing_moves(env_id, action):
    env = task(env_id, place="symmetric_room")
    env.reset(seed=0)
    before = env.simulation.time_s
    with pytest.raises(ValueError, match="two finite numbers"):
        env.step(action)
    assert env.simulation.time_s == before
    env.step(FORWARD)
    assert env.simulation.time_s == pytest.approx(0.05)


def test_actions_beyond_their_bounds_are_clipped():
    env = task(IDS[0], place="symmetric_room")
    env.reset(seed=0)
    observation, *_ = env.step([7.0, -9.0])
    assert observation["last_action"].tolist() == [1.0, -1.0]


def test_vector_env_with_a_bad_action_moves_none():
    vector = gymnasium.make_vec(IDS[0], 2, difficulty=0.0)
    vector.reset(seed=0)
    with pytest.raises(ValueError, match="two finite numbers"):
        vector.step(np.array([[0.0, 0.0], [np.nan, 0.0]], dtype=np.float32))
    with pytest.raises(ValueError, match="one for each of 2 episodes, not 3"):
        vector.step(np.zeros((3, 2), dtype=np.float32))
    with pytest.raises(ValueError, match="one for each of 2 episodes, not None"):
        vector.step(None)
    assert [env.unwrapped.simulation.time_s for env in vector.envs] == [0.0, 0.0]
    vector.close()


@pytest.mark.parametrize("env_id", IDS)
def test_reward_is_the_sum_of_its_terms_and_info_keeps_its_keys(env_id):
    env = task(env_id, difficulty=0.5) if env_id != IDS[2] else task(env_id)
    _, told = env.reset(seed=2)
    for _ in range(30):
        _, reward, _, _, info = env.step(FORWARD)
        assert info.keys() == told.keys()
        assert info["reward_terms"].keys() == told["reward_terms"].keys()
        assert reward == pytest.approx(sum(info["reward_terms"].values()))


def test_driving_into_a_wall_is_a_collision_that_ends_the_episode():
    env = task(IDS[0], place="symmetric_room")
    env.reset(seed=0, options={"pose": (3.0, 2.0, 0.0), "goal": (2.0, 2.0, 0.0)})
    for _ in range(400):
        _, _, is_over, _, info = env.step([1.0, 0.0])
        if is_over:
            break
    assert info["collision"]
    assert info["reward_terms"]["collision"] == -5.0
    assert not info["is_success"]


def test_goal_is_reached_and_told():
    env = task(IDS[0], place="symmetric_room")
    observation, _ = env.reset(seed=0, options={"pose": (2.5, 2.0, 0.0), "goal": (3.7, 2.0, 0.0)})
    assert observation["goal"] == pytest.approx([1.2, 0.0, 1.0, 0.0], abs=1e-6)
    total = 0.0
    for _ in range(200):
        _, reward, is_over, _, info = env.step([0.6, 0.0])
        total += reward
        if is_over:
            break
    assert info["is_success"]
    assert info["success"]
    assert info["straight_m"] < 0.2
    # the way of a metre, the turning that was none, 5 for the goal
    assert total == pytest.approx(5.0 + 1.0, abs=0.8)


def test_what_the_wheels_tell_is_not_what_is_true():
    env = task(IDS[0], place="symmetric_room", wheel_radii=(0.05, 0.05))
    env.reset(seed=0, options={"pose": (2.5, 2.0, 0.0), "goal": (3.9, 2.0, 0.0)})
    for _ in range(40):
        observation, *_, info = env.step([0.5, 0.0])
    moved_m = info["pose_true"][0] - 2.5
    assert observation["odometry"][0] == pytest.approx(moved_m / 1.05, rel=0.005)
    assert observation["velocity"][0] == pytest.approx(0.25, abs=0.01)


def test_latency_delays_the_motion_by_as_much():
    poses = []
    for latency_s in (0.0, 0.13):
        env = task(IDS[0], place="symmetric_room", latency_s=latency_s)
        env.reset(seed=0, options={"pose": (2.5, 2.0, 0.0), "goal": (3.9, 2.0, 0.0)})
        for _ in range(30):
            *_, info = env.step([1.0, 0.0])
        poses.append(info["pose_true"][0])
    # at 0.5 m/s
    assert poses[0] - poses[1] == pytest.approx(0.13 * 0.5, abs=0.005)


def test_scan_is_what_the_beams_see_with_nothing_returned_at_the_range():
    env = task(IDS[0], place="place_fig6", beams=31, laser_noise=0.0)
    observation, _ = env.reset(seed=1)
    true_m = env.simulation.true_ranges_m()
    is_near = true_m < 5.5
    seen_m = observation["scan"][is_near]
    # but for the beams that are lost, one in 500
    assert np.mean(np.abs(seen_m - true_m[is_near]) < 2e-3) > 0.9
    assert (observation["scan"][true_m > 5.6] == np.float32(5.6)).all()


def test_explorer_sees_more_by_turning_and_never_less():
    env = task(IDS[1], place="symmetric_room")
    _, info = env.reset(seed=0)
    shares = [info["seen_share"]]
    for _ in range(60):
        *_, info = env.step([0.0, 1.0])
        shares.append(info["seen_share"])
    assert (np.diff(shares) >= 0.0).all()
    assert shares[-1] > shares[0] + 0.1


def test_track_is_lost_by_driving_away_from_it():
    env = task(IDS[3], place="symmetric_room")
    env.reset(seed=0, options={"path": [(2.5, 2.0), (4.0, 2.0)]})
    for _ in range(200):
        _, _, is_over, _, info = env.step([0.5, 0.5])
        if is_over:
            break
    assert info["collision"]
    assert info["aside_m"] > 0.4


@pytest.mark.slow
@pytest.mark.parametrize("env_id", IDS)
def test_pictures_change_nothing(env_id):
    place = {} if env_id == IDS[2] else {"place": "random"}
    env = gymnasium.make(env_id, render_mode="rgb_array", **place)
    plain = rollout(gymnasium.make(env_id, **place), 6)
    steps = [env.reset(seed=3)]
    rng = np.random.default_rng(3)
    try:
        for _ in range(6):
            picture = env.render()
            steps.append(env.step(rng.uniform(-1.2, 1.2, 2).astype(np.float32)))
    except RenderingError:
        pytest.skip("no OpenGL here")
    assert same(plain, steps)
    assert picture.shape == (480, 640, 3)
    assert picture.std() > 10.0
    env.close()


def test_goal_is_in_the_picture():
    env = gymnasium.make(IDS[0], render_mode="rgb_array", place="symmetric_room")
    env.reset(seed=0, options={"pose": (2.5, 2.0, 0.0), "goal": (4.0, 2.2, 1.0)})
    try:
        picture = env.render().astype(int)
    except RenderingError:
        pytest.skip("no OpenGL here")
    red, green, blue = np.moveaxis(picture, 2, 0)
    assert ((green > 1.5 * red) & (green > 1.5 * blue)).sum() > 100
    # beams as well
    assert ((red > 1.4 * green) & (red > 1.4 * blue)).sum() > 300
    env.close()


class Handle:
    """What MuJoCo's viewer has of interest here."""

    def __init__(self, model, data, **_):
        self.data = data
        self.user_scn = mujoco.MjvScene(model, maxgeom=500)
        self.opt, self.cam = mujoco.MjvOption(), mujoco.MjvCamera()
        self.synced = 0
        self.is_over = threading.Event()
        self.drawing = threading.Thread(target=self._draw)
        self.drawing.start()

    def _draw(self):
        self.is_over.wait()
        time.sleep(0.05)  # its last picture

    def lock(self):
        return contextlib.nullcontext()

    def sync(self):
        self.synced += 1

    def close(self):
        self.is_over.set()


def test_window_shows_beams_and_goal_and_is_brought_up_to_date_each_step(monkeypatch):
    monkeypatch.setattr(window, "why_not", lambda: None)
    monkeypatch.setattr(mujoco.viewer, "launch_passive", Handle)
    env = GoToEnv(render_mode="human", place="symmetric_room")
    env.reset(seed=0)
    shown = env._renderer._viewer.handle
    waits = []
    monkeypatch.setattr("kitasap_sim.env.picture.time.sleep", waits.append)
    for _ in range(3):
        env.step(FORWARD)
    assert shown.synced == 4
    # people watch: it does not run faster than the robot
    assert len(waits) >= 2
    assert 0.0 < max(waits) <= 0.05
    # disc, pole and arrow of the goal, and nearly all 60 beams
    assert 55 < shown.user_scn.ngeom <= 63
    # what a mouse does to what is shown, the episode does not feel
    data = env.simulation.data
    assert np.array_equal(shown.data.qpos, data.qpos)
    shown.data.xfrc_applied[:] = 100.0
    assert not data.xfrc_applied.any()
    # Python may end right after it: a window that still drew then would end it by a fault
    env.close()
    assert not shown.drawing.is_alive()


@pytest.mark.slow
@pytest.mark.skipif(sys.platform != "linux", reason="a display is told by DISPLAY")
def test_no_display_or_one_that_does_not_answer_is_told_and_nothing_is_shown():
    script = (
        "import os, warnings\n"
        "from kitasap_sim.env.goto import GoToEnv\n"
        "os.environ.pop('WAYLAND_DISPLAY', None)\n"
        "env = GoToEnv(render_mode='human', place='symmetric_room')\n"
        "for display in ('', ':977'):\n"
        "    os.environ['DISPLAY'] = display\n"
        "    with warnings.catch_warnings(record=True) as said:\n"
        "        warnings.simplefilter('always')\n"
        "        env.reset(seed=0)\n"
        "    assert env.render() is None\n"
        "    print(said[0].message)\n"
    )
    # the viewer itself would end the process without a word to Python
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    assert done.stdout.count("render_mode='human' needs a display") == 2


def test_list_of_pictures_is_collected():
    env = gymnasium.make(IDS[0], render_mode="rgb_array_list", place="symmetric_room")
    try:
        env.reset(seed=0)
    except RenderingError:
        pytest.skip("no OpenGL here")
    env.step(FORWARD)
    assert [picture.shape for picture in env.render()] == [(480, 640, 3)] * 2
    env.close()


def test_render_of_a_simulation_leaves_it_as_it_was():
    simulation = Simulation("symmetric_room", None, rng=np.random.default_rng(0))
    simulation.drive(0.2, 0.3)
    simulation.run(0.5)
    before = simulation.data.qacc_warmstart.copy(), simulation.data.time
    try:
        render(simulation, size_px=(160, 120))
    except RenderingError:
        pytest.skip("no OpenGL here")
    assert np.array_equal(before[0], simulation.data.qacc_warmstart)
    assert simulation.data.time == before[1]


@pytest.mark.parametrize(
    ("keywords", "named"),
    [
        ({"place": "nowhere"}, "no place called"),
        ({"difficulty": 1.5}, "difficulty"),
        ({"difficulty": (0.8, 0.2)}, "difficulty"),
        ({"beams": 0}, "beams"),
        ({"beams": 10**7}, "beams: a whole number from 1 to 4096"),
        ({"laser": {"name": "mine", "teeth": 3}}, "laser: the fields"),
        ({"laser": 4}, "laser: a name"),
        ({"laser": "sonar"}, "no laser"),
        ({"control": "legs"}, "control"),
        ({"people": -1}, "people"),
        ({"people": 2.5}, "people"),
        ({"people": True}, "people"),
        ({"place": {"room_fig4", "symmetric_room"}}, "place: a list"),
        ({"difficulty": {0.1, 0.5}}, "difficulty"),
        ({"friction": 0.0}, "friction"),
        ({"laser_noise": np.nan}, "laser_noise"),
        ({"latency_s": "late"}, "latency_s"),
        ({"tolerance": (0.0, 1.0)}, "tolerance"),
        ({"tolerance": None}, "tolerance"),
        ({"tolerance": ("near", 1.0)}, "tolerance"),
        ({"odometry": "good"}, "no odometry preset"),
    ],
)
def test_keywords_that_make_no_sense_are_refused_by_name(keywords, named):
    with pytest.raises(ValueError, match=named):
        task(IDS[0], **keywords).reset(seed=0)


@pytest.mark.parametrize(("kind", "keyword"), [(ExploreEnv, "share"), (TrackEnv, "most_aside_m")])
@pytest.mark.parametrize("value", ["much", None, 0.0, np.nan, True])
def test_what_a_task_is_told_is_a_number_of_its_range(kind, keyword, value):
    with pytest.raises(ValueError, match=keyword):
        kind(**{keyword: value})


@pytest.mark.parametrize("scalar", [np.float32, np.float64, np.int64])
def test_numbers_of_numpy_are_numbers(scalar):
    keywords = {"difficulty": 1, "laser_noise": (0, 1)}
    of_numpy = {"difficulty": scalar(1), "laser_noise": np.array([0, 1], dtype=scalar)}
    steps = [rollout(task(IDS[0], **given), 2) for given in (keywords, of_numpy)]
    assert same(*steps)


def test_places_to_draw_from_may_come_one_by_one_and_headings_are_wrapped():
    env = task(IDS[0], place=(name for name in ("symmetric_room",)))
    for _ in range(2):
        _, info = env.reset(seed=0, options={"pose": (3.0, 1.2, 10.0)})
        assert info["pose_true"][2] == pytest.approx(10.0 - 4.0 * np.pi)
        np.testing.assert_allclose(info["pose_odometry"], info["pose_true"])


@pytest.mark.slow
def test_picture_is_drawn_anew_by_who_asks_for_it_though_another_thread_began_the_episode():
    envs = gymnasium.make_vec(IDS[0], 2, render_mode="rgb_array", max_episode_steps=2)
    envs.reset(seed=0)
    try:
        for _ in range(4):
            pictures = envs.render()
            envs.step(np.zeros((2, 2), dtype=np.float32))
    except RenderingError:
        pytest.skip("no OpenGL here")
    finally:
        envs.close()
    assert all(picture.std() > 10.0 for picture in pictures)


@pytest.mark.parametrize(
    ("options", "named"),
    [
        ({"goal": (0.0, 0.0, 0.0)}, "something stands"),
        ({"pose": (1.0, 2.0)}, "three finite numbers"),
        ({"pose": "abc"}, "three finite numbers"),
        ("pose", "options: a dict"),
        ({"start": 1}, "no option called start"),
        ({1: 2, "a": 3}, "no option called 1, a"),
    ],
)
def test_options_that_make_no_sense_are_refused(options, named):
    env = task(IDS[0], place="symmetric_room")
    with pytest.raises(ValueError, match=named):
        env.reset(seed=0, options=options)


@pytest.mark.parametrize(
    "path", ["abc", None, [(1.0, 2.0)], [(1.0, 2.0), (3.0,)], [(1.0, np.nan)] * 2]
)
def test_path_that_is_none_is_refused(path):
    with pytest.raises(ValueError, match="path:"):
        TrackEnv(place="symmetric_room").reset(seed=0, options={"path": path})


def test_unknown_render_mode_is_refused():
    with pytest.raises(ValueError, match="render_mode"):
        GoToEnv(render_mode="oil")


def test_place_of_one_episode_is_an_option():
    env = task(IDS[0], place="symmetric_room")
    for name in ("room_fig4", "random", Place("round_room")):
        env.reset(seed=0, options={"place": name})
        assert env.place.name == getattr(name, "name", name)
    env.reset()
    assert env.place.name == "symmetric_room"


def test_people_are_placed_once_for_an_episode(monkeypatch):
    placed = []
    reset = People.reset
    monkeypatch.setattr(
        People, "reset", lambda self, robot_m: (placed.append(robot_m), reset(self, robot_m))[1]
    )
    env = task(IDS[0], place="room_fig4", people=2)
    _, info = env.reset(seed=0)
    # their ways take longer than all else that a reset does
    np.testing.assert_array_equal(placed, [info["pose_true"][:2]])


def test_step_before_reset_says_so():
    with pytest.raises(RuntimeError, match="reset"):
        task(IDS[0]).step(FORWARD)

"""The wrappers that join `slam` to the driving tasks, and the policy that turns to be certain."""

import math
import warnings
from itertools import pairwise

import gymnasium
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env

import experiments.beliefs
import kitasap_sim  # noqa: F401, registers the tasks
from experiments.beliefs import BeliefReward
from experiments.methods import KnownPlace
from experiments.observations import ObservationSource, known_place
from experiments.policies.relocalize import TurnToDisambiguate
from experiments.slam_pose import SlamPose
from kitasap_sim.places import Place
from slam import SE2, Localizer
from slam.matchers import OdometryMatcher


def goto(**keywords):
    return gymnasium.make("Kitasap2/GoTo-v0", place="room_fig4", **keywords)


def track(**keywords):
    return gymnasium.make("Kitasap2/Track-v0", place="room_fig4", **keywords)


def relocalize(place="symmetric_room", **keywords):
    return gymnasium.make("Kitasap2/Relocalize-v0", place=place, **keywords)


def rolled(env, seed, steps=40):
    """All that a rollout under seeded actions brings."""
    rng = np.random.default_rng(seed)
    seen = [env.reset(seed=seed)]
    for _ in range(steps):
        seen.append(env.step(rng.uniform([0.0, -1.0], [0.4, 1.0]).astype(np.float32)))
        if seen[-1][2]:
            break
    return seen


def same(a, b):
    if isinstance(a, dict):
        return a.keys() == b.keys() and all(same(a[key], b[key]) for key in a)
    if isinstance(a, tuple | list):
        return len(a) == len(b) and all(same(x, y) for x, y in zip(a, b, strict=True))
    return np.array_equal(a, b)


WRAPPED = {
    "goto": lambda: SlamPose(goto()),
    "track": lambda: SlamPose(track()),
    "relocalize": lambda: BeliefReward(relocalize()),
}


@pytest.mark.parametrize(
    "name",
    [*(pytest.param(one, marks=pytest.mark.slow) for one in ("goto", "track")), "relocalize"],
)
def test_wrapped_task_passes_the_checker(name):
    env = WRAPPED[name]()
    with warnings.catch_warnings():
        # the checker would rather see the task alone
        warnings.filterwarnings("ignore", ".*different from the unwrapped version.*")
        check_env(env, skip_render_check=True)


@pytest.mark.slow
@pytest.mark.parametrize("name", WRAPPED)
def test_equal_seeds_give_equal_rollouts(name):
    assert same(rolled(WRAPPED[name](), seed=3), rolled(WRAPPED[name](), seed=3))
    assert not same(rolled(WRAPPED[name](), seed=3), rolled(WRAPPED[name](), seed=4))


@pytest.mark.parametrize("name", WRAPPED)
def test_info_has_the_same_keys_always(name):
    (_, info), *steps = rolled(WRAPPED[name](), seed=5, steps=5)
    assert all(step[4].keys() == info.keys() for step in steps)
    assert all(step[4]["reward_terms"].keys() == info["reward_terms"].keys() for step in steps)


def across(env, steps):
    """Observation and info of each step of a drive through room_fig4, 1.5 m ahead in 5 s."""
    place, rng = Place("room_fig4"), np.random.default_rng(0)
    while True:
        pose, goal = place.draw_free_pose(rng), place.draw_free_pose(rng)
        ahead_m = 1.8 * np.array([math.cos(pose[2]), math.sin(pose[2])])
        is_elsewhere = math.hypot(*(goal - pose)[:2] - ahead_m) > 2.0
        if is_elsewhere and place.is_way_free(pose[:2], pose[:2] + ahead_m):
            break
    yield env.reset(seed=1, options={"pose": pose, "goal": goal})
    for _ in range(steps):
        observation, _, is_over, _, info = env.step(np.array([0.6, 0.0], dtype=np.float32))
        assert not is_over
        yield observation, info


def test_slam_pose_holds_what_odometry_lets_drift():
    # with wheels 2 % larger than believed, 5 s of driving
    env = SlamPose(goto(wheel_radii=(0.02, 0.02)))
    errors_m, off_m, drift_m = [], [], []
    for observation, info in across(env, 100):
        true, goal = SE2.from_array(info["pose_true"]), SE2.from_array(info["goal_true"])
        errors_m.append(math.hypot(*(info["pose_slam"] - info["pose_true"])[:2]))
        drift_m.append(math.hypot(*(info["pose_odometry"] - info["pose_true"])[:2]))
        seen = true.inverse() @ goal
        off_m.append(math.hypot(observation["goal"][0] - seen.x, observation["goal"][1] - seen.y))
        assert np.allclose(observation["pose_slam"], info["pose_slam"], atol=1e-5)
    assert len(errors_m) == 101
    assert max(errors_m) < 0.01
    assert max(drift_m) > 0.02
    # the goal is as good as the pose: 5 mm and 3 mrad wrong, 4 m away
    assert max(off_m) < 0.02


def test_goal_keeps_the_heading_of_the_goal():
    env = SlamPose(goto(wheel_radii=(-0.02, 0.02)))
    *_, (observation, info) = across(env, 60)
    seen = SE2.from_array(info["pose_true"]).inverse() @ SE2.from_array(info["goal_true"])
    heading = math.atan2(observation["goal"][3], observation["goal"][2])
    assert abs(math.remainder(heading - seen.theta, math.tau)) < 0.01
    assert abs(info["pose_odometry"][2] - info["pose_true"][2]) > 0.02
    assert math.hypot(*observation["goal"][2:]) == pytest.approx(1.0, abs=1e-6)


def test_path_lies_where_it_truly_is():
    # where the task alone shows it by drifting encoders
    env = SlamPose(track(wheel_radii=(-0.02, 0.02)))
    observation, _ = env.reset(seed=2)
    path, off_m, drift_m = env.unwrapped.path, [], []
    for _ in range(120):
        # towards the second point ahead
        x, y = observation["path"][2:4]
        action = np.array([0.5, 1.5 * math.atan2(y, x)], dtype=np.float32)
        observation, _, is_over, _, info = env.step(action)
        assert not is_over
        points = observation["path"].reshape(-1, 2).astype(float)
        points = SE2.from_array(info["pose_true"]) @ points
        off_m += [min(aside(p, a, b) for a, b in pairwise(path.corners_m)) for p in points]
        drift_m.append(math.hypot(*(info["pose_odometry"] - info["pose_true"])[:2]))
    assert max(off_m) < 0.02
    assert max(drift_m) > 0.05
    # the nearest to the robot, not to where its encoders have it
    ahead = np.array(path.at(info["along_m"] + 0.2))
    assert math.hypot(*(points[0] - ahead)) < 0.02


def aside(point, start, end):
    share = np.clip((point - start) @ (end - start) / ((end - start) @ (end - start)), 0.0, 1.0)
    return math.hypot(*(point - start - share * (end - start)))


def test_beams_are_told_when_they_were_fired():
    for name in ("urg_04lx", "rplidar_a2"):
        env = goto(laser=name)
        task = env.unwrapped
        first = env.reset(seed=1)
        source = ObservationSource(task)
        source.measurement(*first)
        for _ in range(3):
            observation, _, _, _, info = env.step(np.array([0.4, 0.2], dtype=np.float32))
            scan = source.measurement(observation, info).scan
            fired_s = task.simulation.data.history[task.simulation._beam_clock]
            assert np.abs(scan.beam_times_s - fired_s).max() < 0.0021  # a physics step


def test_bounds_of_a_scan_say_that_nothing_was_measured():
    env = goto(beams=5)
    observation, info = env.reset(seed=1)
    range_m = env.unwrapped.laser.range_max_m
    observation["scan"] = np.array([0.0, 1.0, 2.0, range_m, 3.0], dtype=np.float32)
    ranges_m = ObservationSource(env.unwrapped).measurement(observation, info).scan.ranges_m
    assert ranges_m.tolist() == [-np.inf, 1.0, 2.0, np.inf, 3.0]


def policy_run(env, seed):
    """Reward and terms of each step of an episode under the policy, and its last info."""
    policy = TurnToDisambiguate(env.unwrapped.laser)
    observation, info = env.reset(seed=seed)
    rewards, is_over, is_late = [], False, False
    while not (is_over or is_late):
        observation, reward, is_over, is_late, info = env.step(policy(observation))
        rewards.append((reward, info["reward_terms"]))
    return rewards, info


@pytest.mark.slow
def test_policy_becomes_certain_and_right_in_the_symmetric_room():
    env = BeliefReward(relocalize())
    lengths = []
    for seed in range(200, 212):
        rewards, info = policy_run(env, seed)
        assert info["is_success"]
        assert info["success"]
        assert info["is_certain"]
        assert math.hypot(*(info["pose_slam"] - info["pose_true"])[:2]) < 0.05
        assert all(reward == sum(terms.values()) for reward, terms in rewards)
        assert [terms["certain"] for _, terms in rewards] == [0.0] * (len(rewards) - 1) + [5.0]
        lengths.append(len(rewards))
    # one scan alone tells at some places, not at others
    assert min(lengths) <= 3
    assert max(lengths) > 3


def test_robot_that_is_certain_and_wrong_is_penalised(monkeypatch):
    def misled(method, known):
        # tells its prediction and claims to know it to 1 mm, always of the same spot
        localizer = Localizer(OdometryMatcher(), SE2(1.0, 1.0, 0.0), known.T_base_laser)
        return Certain(localizer)

    monkeypatch.setattr(experiments.beliefs, "lost_localizer", misled)
    env = BeliefReward(relocalize(), scans=4)
    observation, info = env.reset(seed=1)
    for step in range(3):
        assert not info["is_certain"]
        assert observation["belief"][7] == pytest.approx((step + 1) / 4)
        observation, reward, is_over, _, info = env.step(np.zeros(2, dtype=np.float32))
    assert is_over
    assert info["is_certain"]
    assert not info["is_success"]
    assert info["reward_terms"]["certain"] == -5.0
    assert reward == pytest.approx(-5.01)


class Certain:
    """A localizer whose estimates claim to be sure."""

    def __init__(self, localizer):
        self._localizer = localizer

    def update(self, measurement):
        estimate = self._localizer.update(measurement)
        object.__setattr__(estimate, "covariance", 1e-6 * np.eye(3))
        object.__setattr__(
            estimate, "verdict", type(estimate.verdict)(experiments.beliefs.Status.TRACKING)
        )
        return estimate

    def telling_turn_rad(self):
        return 0.0


def test_wrappers_refuse_what_they_cannot_wrap():
    with pytest.raises(TypeError, match="SlamPose wraps the tasks"):
        SlamPose(gymnasium.make("CartPole-v1"))
    with pytest.raises(ValueError, match="no method called 'paper'"):
        BeliefReward(relocalize(), method="paper")
    for scans in (0, 2.5, True):
        with pytest.raises(ValueError, match="scans: a whole number, 1 or more"):
            BeliefReward(relocalize(), scans=scans)
    with pytest.raises(ValueError, match="no method called 'none'"):
        SlamPose(goto(), method="none")


def test_known_place_is_made_once_for_each_place():
    env = goto()
    env.reset(seed=1)
    first = known_place(env.unwrapped)
    env.reset(seed=2)
    assert known_place(env.unwrapped) is first
    assert isinstance(first, KnownPlace)
    assert first.laser_model.range_max_m == 5.6

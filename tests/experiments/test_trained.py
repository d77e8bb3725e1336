"""The policy that ships for GoTo: its file, and that it drives as it was trained."""

import math
from pathlib import Path

import gymnasium
import numpy as np
import pytest

import kitasap_sim
from experiments.policies import policy
from experiments.policies.surroundings import FEATURES, SECTORS, Surroundings
from experiments.policies.trained import (
    SHIPPED,
    GoToTrained,
    answer,
    load_network,
    save_network,
    told,
)

kitasap_sim.register_envs()
PATH = Path(str(SHIPPED))


def test_network_that_ships_is_small_and_tells_how_it_was_trained():
    assert PATH.stat().st_size < 1_000_000
    assert told().startswith("python -m experiments.train GoTo --steps")


@pytest.mark.slow
def test_trained_policy_reaches_goals_in_bare_rooms_and_touches_nothing():
    env = gymnasium.make("Kitasap2/GoTo-v0", place="random", difficulty=0.0)
    driver = policy("GoTo", "trained", env)
    reached = 0
    for seed in range(40, 44):
        observation, info = env.reset(seed=seed)
        driver.reset()
        is_over = False
        while not is_over:
            observation, _, is_done, is_late, info = env.step(driver(observation))
            is_over = is_done or is_late
        assert not info["collision"]
        reached += info["is_success"]
    assert reached >= 3


def test_network_comes_back_as_it_was_saved(tmp_path):
    layers = load_network(PATH)
    save_network(tmp_path / "copy.npz", layers, "nobody")
    again = load_network(tmp_path / "copy.npz")
    features = np.random.default_rng(0).normal(size=layers[0][0].shape[1]).astype(np.float32)
    assert np.array_equal(answer(layers, features), answer(again, features))
    assert told(tmp_path / "copy.npz") == "nobody"
    assert (np.abs(answer(layers, 100.0 * features)) <= 1.0).all()


@pytest.mark.parametrize("content", [b"", b"no network", None])
def test_file_without_a_network_is_refused_by_name(tmp_path, content):
    path = tmp_path / "other.npz"
    if content is None:
        save_network(path, [(np.zeros((2, 3)), np.zeros(2))], "of another kind")
    else:
        path.write_bytes(content)
    env = gymnasium.make("Kitasap2/GoTo-v0")
    with pytest.raises(ValueError, match=r"other\.npz"):
        GoToTrained(env.unwrapped.laser, path)


@pytest.mark.parametrize("latency_s", [0.0, 0.1])
@pytest.mark.parametrize(
    "action",
    [
        (1.0, 0.0),
        pytest.param((1.0, 0.3), marks=pytest.mark.slow),
        pytest.param((0.6, -0.2), marks=pytest.mark.slow),
        (0.8, 1.0),
    ],
)
def test_whatever_the_network_says_the_robot_stops_before_what_it_saw(action, latency_s):
    env = gymnasium.make("Kitasap2/GoTo-v0", place="symmetric_room", latency_s=latency_s)
    surroundings = Surroundings(env.unwrapped.laser)
    observation, _ = env.reset(seed=1, options={"pose": (3.0, 2.0, 0.4), "goal": (2, 2, 0)})
    surroundings.see(observation)
    moved_m = 0.0
    for _ in range(160):
        action_held = surroundings.held_back(np.array(action, dtype=np.float32))
        observation, _, _, _, info = env.step(action_held)
        surroundings.see(observation)
        moved_m += 0.05 * float(observation["velocity"][0])
        assert not info["collision"]
    assert moved_m > 0.3
    features = surroundings.features()
    assert features.shape == (FEATURES,)
    assert np.isfinite(features).all()


def test_features_tell_where_it_is_free_and_where_the_goal_is():
    env = gymnasium.make("Kitasap2/GoTo-v0", place="symmetric_room", laser_noise=0.0)
    surroundings = Surroundings(env.unwrapped.laser)
    # a pillar 0.75 m ahead and to the right; the goal straight ahead, facing back
    observation, _ = env.reset(
        seed=1, options={"pose": (2.6, 1.5, 0.0), "goal": (4.1, 1.5, math.pi)}
    )
    surroundings.see(observation)
    features = surroundings.features()
    free_m = 3.0 * features[:SECTORS]
    true_m = env.unwrapped.simulation.true_ranges_m()
    assert free_m.min() == pytest.approx(true_m.min() + 0.1, abs=0.15)
    # straight behind nothing was seen yet
    assert free_m[0] == 3.0
    goal = features[SECTORS + 4 : SECTORS + 10]
    assert goal[0] == pytest.approx(0.5, abs=0.01)
    assert goal[2:] == pytest.approx([1.0, 0.0, -1.0, 0.0], abs=0.05)


def test_training_starts_and_tells_of_itself(tmp_path):
    pytest.importorskip("stable_baselines3", reason="the extra rl is not installed")
    from experiments.train import train

    # fewer than a round: what was learnt is kept all the same
    train("GoTo", 1000, 0, tmp_path)
    assert load_network(tmp_path / "goto.npz")
    header, row = (tmp_path / "curve.csv").read_text().splitlines()
    assert header.startswith("decisions,")
    assert row.startswith("2048,")
    assert (tmp_path / "curve.png").stat().st_size > 10_000

"""The policy that ships for GoTo: its file, and that it drives as it was trained."""

from pathlib import Path

import gymnasium
import numpy as np
import pytest

import kitasap_sim
from experiments.policies import policy
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


def test_training_starts_and_tells_of_itself(tmp_path):
    pytest.importorskip("stable_baselines3", reason="the extra rl is not installed")
    from experiments.train import train

    train("GoTo", 8192, 0, tmp_path)
    assert load_network(tmp_path / "goto.npz")
    assert (tmp_path / "curve.csv").read_text().startswith("decisions,")
    assert (tmp_path / "curve.png").stat().st_size > 10_000

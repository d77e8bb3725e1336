"""A million random steps, bad ones among them: never a state that is no number, no memory kept."""

from pathlib import Path

import gymnasium
import numpy as np
import pytest

import kitasap_sim

kitasap_sim.register_envs()
BAD = ([np.nan, 0.0], [0.0, np.inf], [1.0], np.zeros((2, 2)), "full speed", None)
_PAGE_BYTES = 4096


def resident_mb() -> float:
    return int(Path("/proc/self/statm").read_text().split()[1]) * _PAGE_BYTES / 1e6


def soak(env_id: str, steps: int) -> float:
    """Steps that many times, one in fifty with a bad action; the memory grown after a tenth [MB]."""
    env = gymnasium.make(
        env_id, place=["random", "symmetric_room"], difficulty=(0.0, 1.0), people=(0, 2),
        latency_s=(0.0, 0.1), wheel_radii=(-0.05, 0.05), friction=(0.3, 1.2),
    )  # fmt: skip
    rng = np.random.default_rng(0)
    observation, _ = env.reset(seed=0)
    before_mb = 0.0
    for number in range(steps):
        if number == steps // 10:
            before_mb = resident_mb()
        if rng.random() < 0.02:
            with pytest.raises(ValueError, match="two finite numbers"):
                env.step(BAD[int(rng.integers(len(BAD)))])
        # most within the bounds, some far beyond
        action = rng.normal(0.0, 0.7, 2) * (100.0 if rng.random() < 0.02 else 1.0)
        observation, reward, is_over, is_late, info = env.step(action)
        assert env.observation_space.contains(observation)
        assert np.isfinite(reward)
        assert np.isfinite(info["pose_true"]).all()
        if is_over or is_late:
            env.reset()
    assert np.isfinite(env.unwrapped.simulation.data.qpos).all()
    env.close()
    return resident_mb() - before_mb


@pytest.mark.parametrize("task", ["GoTo", "Explore", "Relocalize", "Track"])
def test_some_random_steps(task):
    soak(f"Kitasap2/{task}-v0", 300)


@pytest.mark.slow
@pytest.mark.skipif(not Path("/proc/self/statm").exists(), reason="memory is read from /proc")
@pytest.mark.parametrize("task", ["GoTo", "Explore", "Relocalize", "Track"])
def test_a_quarter_of_a_million_random_steps(task):
    # what episodes leave to the allocator; a leak of 1 kB a step would be 225 MB
    assert soak(f"Kitasap2/{task}-v0", 250_000) < 40.0

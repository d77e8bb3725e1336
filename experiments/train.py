"""`python -m experiments.train GoTo`: trains the policy that ships, by PPO of stable-baselines3.

Needs the extra `rl` (`pip install -e '.[rl]'`). Rooms and robots are drawn anew in each episode:
random rooms of difficulty 0.2 to 1, wheels wrong by 1 %, a laser half or twice as noisy, commands
up to 0.1 s late.
"""

import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np

from experiments.observations import task_of
from experiments.outputs import checked_folder
from experiments.policies.surroundings import FEATURES, REPEAT, Surroundings
from experiments.policies.trained import Layers, save_network

_VARIATION: dict[str, Any] = {
    "place": "random",
    "difficulty": (0.2, 1.0),
    "wheel_radii": (-0.01, 0.01),
    "laser_noise": (0.5, 2.0),
    "latency_s": (0.0, 0.1),
}
_ENVS = 8
_HIDDEN = [128, 128]
_ROLLOUT, _ROUND = 256, 4
"""Decisions of each episode that PPO learns from at once; rollouts until the curve is told."""
_FIRST_SEED = 100_000
"""Of the episodes; others are for judging."""


class Decisions(gymnasium.Wrapper[Any, Any, Any, Any]):
    """GoTo as the network sees it: `Surroundings.features`, and actions held for REPEAT steps."""

    def __init__(self, env: gymnasium.Env[Any, Any]) -> None:
        super().__init__(env)
        self.observation_space = gymnasium.spaces.Box(-10.0, 10.0, (FEATURES,), np.float32)
        self._surroundings = Surroundings(task_of(env, "Decisions").laser)

    def reset(self, **keywords: Any) -> tuple[np.ndarray, dict[str, Any]]:
        """The features of the first observation."""
        observation, info = self.env.reset(**keywords)
        self._surroundings.reset()
        self._surroundings.see(observation)
        return self._surroundings.features(), info

    def step(self, action: np.ndarray) -> tuple[np.ndarray, float, bool, bool, dict[str, Any]]:
        """REPEAT steps, each held back alone; their rewards added up."""
        total, action = 0.0, np.clip(action, -1.0, 1.0)
        for _ in range(REPEAT):
            held = self._surroundings.held_back_alone(action)
            observation, reward, is_over, is_late, info = self.env.step(held)
            total += float(reward)
            self._surroundings.see(observation)
            if is_over or is_late:
                break
        return self._surroundings.features(), total, is_over, is_late, info


def train(task: str, steps: int, seed: int, out: Path) -> None:
    """Trains a policy; writes goto.npz and curve.csv after each round, curve.png in the end.

    steps: decisions to learn from. Raises ValueError for a task without a network, or where the
    extra `rl` is missing.
    """
    if task != "GoTo":
        raise ValueError(f"nothing is trained for {task}: there is a network for GoTo")
    model = _model(seed)
    checked_folder(out).mkdir(parents=True, exist_ok=True)
    command = f"python -m experiments.train GoTo --steps {steps} --seed {seed}"
    curve = _Curve(out, command)
    model.learn(steps, callback=curve.callback())
    if not curve.rows or curve.rows[-1][0] < model.num_timesteps:
        curve.add(model)
    curve.draw()
    print(f"network and curve: {out}")


def _model(seed: int) -> Any:
    """PPO on episodes of its own seeds."""
    try:
        import torch
        from stable_baselines3 import PPO
        from stable_baselines3.common.vec_env import DummyVecEnv, VecMonitor
    except ModuleNotFoundError as error:
        raise ValueError(
            f"training needs {error.name}: install the extra, `pip install -e '.[rl]'`"
        ) from error
    torch.set_num_threads(1)
    envs = VecMonitor(
        DummyVecEnv([_made(seed, number) for number in range(_ENVS)]),
        info_keywords=("is_success", "collision"),
    )
    return PPO(
        "MlpPolicy", envs, n_steps=_ROLLOUT, batch_size=256, n_epochs=10, gamma=0.98,
        gae_lambda=0.95, ent_coef=0.002, learning_rate=5e-4, clip_range=0.2, seed=seed,
        device="cpu",
        policy_kwargs={
            "net_arch": _HIDDEN, "activation_fn": torch.nn.Tanh, "log_std_init": -0.5,
        },
    )  # fmt: skip


def _made(seed: int, number: int) -> Callable[[], Decisions]:
    def made() -> Decisions:
        env = Decisions(gymnasium.make("kitasap_sim:Kitasap2/GoTo-v0", **_VARIATION))
        env.reset(seed=_FIRST_SEED + 1000 * seed + number)
        return env

    return made


class _Curve:
    """How training goes, told and kept; and the network as it is by then."""

    def __init__(self, out: Path, command: str) -> None:
        self._out, self._command = out, command
        self._started_s = time.process_time()
        self.rows: list[tuple[float, ...]] = []

    def callback(self) -> Any:
        """What stable-baselines3 calls after each rollout."""
        from stable_baselines3.common.callbacks import BaseCallback

        curve = self

        class Told(BaseCallback):
            rollouts = 0

            def _on_rollout_end(self) -> None:
                self.rollouts += 1
                if self.rollouts % _ROUND == 0:
                    curve.add(self.model)

            def _on_step(self) -> bool:
                return True

        return Told()

    def add(self, model: Any) -> None:
        """One round more."""
        ended = list(model.ep_info_buffer)
        shares = [
            float(np.mean([episode[key] for episode in ended])) if ended else 0.0
            for key in ("is_success", "collision", "r")
        ]
        cpu_s = time.process_time() - self._started_s
        self.rows.append((model.num_timesteps, cpu_s, *shares))
        print(
            f"{model.num_timesteps} decisions, {cpu_s:.0f} s CPU: success {shares[0]:.2f},"
            f" collisions {shares[1]:.2f}, reward {shares[2]:.2f}",
            flush=True,
        )
        lines = ["decisions,cpu_s,success,collisions,reward"]
        lines += [",".join(f"{value:g}" for value in row) for row in self.rows]
        (self._out / "curve.csv").write_text("\n".join(lines) + "\n")
        told = f"{self._command}; after {model.num_timesteps} decisions"
        save_network(self._out / "goto.npz", layers_of(model), told)

    def draw(self) -> None:
        """The curve as a picture."""
        from experiments.figures.learning_curve import learning_curve

        learning_curve(self._out / "curve", np.array(self.rows))


def layers_of(model: Any) -> Layers:
    """The network that answers with the mean action, as plain arrays."""
    policy = model.policy
    parts = [*policy.mlp_extractor.policy_net, policy.action_net]
    return [
        (part.weight.detach().numpy(), part.bias.detach().numpy())
        for part in parts
        if hasattr(part, "weight")
    ]


if __name__ == "__main__":
    from experiments.cli import main

    sys.exit(main(["train", *sys.argv[1:]]))

"""Episodes of a driving task under a policy, and what they say: success, collisions, time."""

import json
import math
from collections.abc import Callable
from contextlib import closing
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
from rich import box
from rich.table import Table

from experiments.beliefs import BeliefReward
from experiments.policies import Policy, checked, policy
from experiments.statistics import wilson_interval
from kitasap_sim.env.base import KitasapEnv
from kitasap_sim.env.variation import DRAWN

_EPISODES_FILE, _SUMMARY_FILE = "episodes.jsonl", "summary.json"
_FRAME_STEPS = 2
"""Of 50 ms: pictures at 10 per second."""


@dataclass(frozen=True)
class DriveConfig:
    """Which episodes are driven, and by whom. place, difficulty, people: None is the task's own.

    Raises ValueError, naming what there is, for an unknown task or policy, or no episodes.
    """

    task: str
    policy: str = "baseline"
    episodes: int = 100
    seed: int = 0
    place: str | None = None
    difficulty: float | None = None
    people: int | None = None

    def __post_init__(self) -> None:
        checked(self.task, self.policy)
        if self.episodes < 1:
            raise ValueError(f"episodes: 1 or more, not {self.episodes}")

    def env(self, render_mode: str | None = None) -> gymnasium.Env:
        """The task's environment. Raises ValueError for a place or number that makes no sense."""
        named = {"place": self.place, "difficulty": self.difficulty, "people": self.people}
        keywords: dict[str, Any] = {key: value for key, value in named.items() if value is not None}
        task_id = f"kitasap_sim:Kitasap2/{self.task}-v0"
        env: gymnasium.Env = gymnasium.make(task_id, render_mode=render_mode, **keywords)
        assert isinstance(env.unwrapped, KitasapEnv)
        place = self.place or env.unwrapped.DEFAULT_PLACE
        if self.difficulty is not None and place not in DRAWN:
            env.close()
            raise ValueError(
                f"difficulty changes nothing of {place}: it is of place {' or '.join(DRAWN)}"
            )
        # the reward is of what is believed, which the simulator does not know
        return BeliefReward(env) if self.task == "Relocalize" else env


def run(
    config: DriveConfig,
    on_episode: Callable[[int, dict[str, Any]], None] = lambda done, record: None,
    on_frame: Callable[[np.ndarray], None] | None = None,
) -> list[dict[str, Any]]:
    """A record of each episode, in order; episode i has the i-th seed of the master seed.

    on_frame: gets the pictures of the first episode, 10 in a second; with None none are drawn.
    """
    state = np.random.SeedSequence(config.seed).generate_state(config.episodes + 1)
    actions_seed, *seeds = state.tolist()
    records = []
    with closing(config.env(None if on_frame is None else "rgb_array")) as env:
        driver = policy(config.task, config.policy, env, actions_seed)
        for index, seed in enumerate(seeds):
            record = _episode(env, driver, seed, on_frame if index == 0 else None)
            records.append({"index": index} | record)
            on_episode(index + 1, records[-1])
    return records


def _episode(
    env: gymnasium.Env,
    driver: Policy,
    seed: int,
    on_frame: Callable[[np.ndarray], None] | None,
) -> dict[str, Any]:
    observation, info = env.reset(seed=seed)
    driver.reset()
    reward, steps, is_over = 0.0, 0, False
    while not is_over:
        if on_frame is not None and steps % _FRAME_STEPS == 0:
            on_frame(np.asarray(env.render()))
        observation, gained, is_ended, is_late, info = env.step(driver(observation))
        reward += float(gained)
        steps += 1
        is_over = is_ended or is_late
    return {
        "seed": seed,
        "success": bool(info["is_success"]),
        "collision": bool(info["collision"]),
        "steps": steps,
        "time_s": round(float(info["time_s"]), 3),
        "reward": reward,
    }


def summarised(config: DriveConfig, records: list[dict[str, Any]]) -> dict[str, Any]:
    """What summary.json says; times are over the successes, None where there is none."""
    count = len(records)
    successes = sum(record["success"] for record in records)
    collisions = sum(record["collision"] for record in records)
    times_s = [record["time_s"] for record in records if record["success"]]
    return {
        "experiment": "drive",
        **asdict(config),
        "episodes": count,
        "success_rate": successes / count,
        "success_ci95": wilson_interval(successes, count),
        "collision_rate": collisions / count,
        "collision_ci95": wilson_interval(collisions, count),
        "time_s": {
            "median": float(np.median(times_s)) if times_s else None,
            "max": max(times_s, default=None),
        },
        "reward_mean": math.fsum(record["reward"] for record in records) / count,
    }


def write_episode(folder: Path, record: dict[str, Any]) -> None:
    """Appends an episode's line to episodes.jsonl in a folder, made if need be.

    The first episode takes away what a drive before it left there.
    """
    is_first = record["index"] == 0
    if is_first:
        folder.mkdir(parents=True, exist_ok=True)
        (folder / _SUMMARY_FILE).unlink(missing_ok=True)
    with (folder / _EPISODES_FILE).open("w" if is_first else "a", encoding="utf-8") as file:
        file.write(json.dumps(record) + "\n")


def write_summary(folder: Path, summary: dict[str, Any]) -> None:
    """Writes summary.json beside the episodes."""
    text = json.dumps(summary, indent=2) + "\n"
    (folder / _SUMMARY_FILE).write_text(text, encoding="utf-8")


def table(summary: dict[str, Any]) -> Table:
    """The summary for a terminal."""
    made = Table(
        title=f"{summary['task']}, {summary['policy']}: {summary['episodes']} episodes,"
        f" seed {summary['seed']}",
        caption="In brackets 95 % confidence (Wilson). Times of the successes.",
        box=box.SIMPLE_HEAD,
        show_header=False,
    )
    made.add_column("")
    made.add_column("", justify="right")
    for label, key in (("Success", "success"), ("Collision", "collision")):
        low, high = summary[f"{key}_ci95"]
        rate = summary[f"{key}_rate"]
        made.add_row(label, f"{100 * rate:.1f} % ({100 * low:.1f} to {100 * high:.1f})")
    for label, key in (("Time, median", "median"), ("Time, longest", "max")):
        time_s = summary["time_s"][key]
        made.add_row(label, "-" if time_s is None else f"{time_s:.1f} s")
    made.add_row("Reward, mean", f"{summary['reward_mean']:.2f}")
    return made

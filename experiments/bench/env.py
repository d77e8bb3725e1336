"""`kitasap bench env`: what the driving tasks cost beside the bare physics, and many at once."""

import os
import statistics
import time
from typing import Any

import gymnasium
import mujoco
import numpy as np
from rich.table import Table

from experiments.tables import wide_console
from kitasap_sim.env import ENTRY_POINTS
from kitasap_sim.env.base import KitasapEnv
from kitasap_sim.env.motors import CONTROL_S, MAX_SPEED_MPS, MAX_TURN_RATE_RADPS

_ROUNDS, _STEPS = 12, 60
"""Chosen: rounds take turns, so that what else the machine does meets both alike."""
_COMMANDS = np.array([0.3, 0.4], dtype=np.float32), np.array([0.3, -0.4], dtype=np.float32)
_NATIVE = 64


def print_benchmark(place: str, difficulty: float, seed: int) -> dict[str, Any]:
    """Measures and prints both tables; the figures."""
    console, figures = wide_console(), measured(place, difficulty, seed)
    console.print(_cost_table(figures["cost"], f"{place}, seed {seed}"))
    console.print(_vector_table(figures["vector"]))
    return figures


def measured(place: str, difficulty: float, seed: int) -> dict[str, Any]:
    """What a step of each task costs, and how fast many episodes are at once."""
    rows = [_cost(env_id, place, difficulty, seed) for env_id in ENTRY_POINTS]
    return {"cost": rows, "vector": _vector_rates(place, difficulty, seed)}


def _cost(env_id: str, place: str, difficulty: float, seed: int) -> dict[str, Any]:
    """Processor time of a step, and of the bare physics with the same scans; medians, and ratio."""
    env = gymnasium.make(env_id, place=place, difficulty=difficulty)
    task = env.unwrapped
    assert isinstance(task, KitasapEnv)
    steps_us, bare_us, ratios = [], [], []
    for number in range(_ROUNDS):
        _, info = env.reset(seed=seed * _ROUNDS + number)
        step_us = _step_us(env)
        bare = _bare_us(task, info["pose_true"])
        steps_us.append(step_us)
        bare_us.append(bare)
        ratios.append(step_us / bare)
    env.close()
    return {
        "env": env_id,
        "step_us": statistics.median(steps_us),
        "bare_us": statistics.median(bare_us),
        "ratio": statistics.median(ratios),
    }


def _step_us(env: gymnasium.Env[Any, Any]) -> float:
    """Of one `env.step`."""
    started_s = time.process_time()
    for number in range(_STEPS):
        env.step(_COMMANDS[number // 30 % 2])
    return 1e6 * (time.process_time() - started_s) / _STEPS


def _bare_us(task: KitasapEnv, pose: np.ndarray) -> float:
    """Of the same physics, beams among it, without a task: commands set and MuJoCo stepped."""
    simulation = task.simulation
    simulation.reset(pose)
    count = round(CONTROL_S / simulation.timestep_s)
    started_s = time.process_time()
    for number in range(_STEPS):
        v, w = _COMMANDS[number // 30 % 2] * [MAX_SPEED_MPS, MAX_TURN_RATE_RADPS]
        simulation.drive(v, w)
        mujoco.mj_step(simulation.model, simulation.data, nstep=count)
    return 1e6 * (time.process_time() - started_s) / _STEPS


def _vector_rates(place: str, difficulty: float, seed: int) -> dict[str, float]:
    """Steps per second of wall time, of the native vector env and of Gymnasium's of processes."""
    cores = os.cpu_count() or 1
    env_id = "Kitasap2/GoTo-v0"
    keywords: dict[str, Any] = {"place": place, "difficulty": difficulty}
    native = gymnasium.make_vec(env_id, _NATIVE, **keywords)
    others = gymnasium.make_vec(env_id, cores, "async", **keywords)
    rates: dict[str, list[float]] = {"native": [], "async": []}
    for env, count, name in ((native, 3, "native"), (others, 3 * _NATIVE, "async")):
        env.reset(seed=seed)
        _rate(env, count, name)
    for _ in range(5):
        rates["native"].append(_rate(native, 10, "native"))
        rates["async"].append(_rate(others, 10 * _NATIVE // cores, "async"))
    native.close()
    others.close()
    medians = {name: statistics.median(values) for name, values in rates.items()}
    ratios = [a / b for a, b in zip(rates["native"], rates["async"], strict=True)]
    return {
        "cores": cores,
        "native_envs": _NATIVE,
        "native_per_s": medians["native"],
        "async_per_s": medians["async"],
        "ratio": statistics.median(ratios),
    }


def _rate(env: gymnasium.vector.VectorEnv[Any, Any, Any], count: int, name: str) -> float:
    """Steps of single episodes per second."""
    rng = np.random.default_rng(len(name))
    actions = rng.uniform(-0.3, 0.5, (count, env.num_envs, 2)).astype(np.float32)
    started_s = time.perf_counter()
    for action in actions:
        env.step(action)
    return count * env.num_envs / (time.perf_counter() - started_s)


def _cost_table(rows: list[dict[str, Any]], what: str) -> Table:
    table = Table(
        title=f"One step of 50 ms, 60 beams, physics at 500 Hz ({what})",
        caption="Processor time, medians of rounds that take turns. Bare: MuJoCo stepped as often,"
        " with the same robot, place and beams.",
    )
    for column in ("environment", "env.step µs", "bare µs", "times bare", "steps per s"):
        table.add_column(column, justify="left" if column == "environment" else "right")
    for row in rows:
        table.add_row(
            row["env"], f"{row['step_us']:.0f}", f"{row['bare_us']:.0f}", f"{row['ratio']:.2f}",
            f"{1e6 / row['step_us']:.0f}",
        )  # fmt: skip
    return table


def _vector_table(rates: dict[str, float]) -> Table:
    cores = round(rates["cores"])
    table = Table(
        title=f"GoTo, many at once on {cores} cores",
        caption="Steps of single episodes per second of wall time, medians of five turns each; the"
        " ratio's median.",
    )
    for column in ("vector env", "episodes", "steps per s", "times"):
        table.add_column(column, justify="left" if column == "vector env" else "right")
    table.add_row("AsyncVectorEnv", str(cores), f"{rates['async_per_s']:.0f}", "1")
    table.add_row(
        "native (make_vec)", str(round(rates["native_envs"])), f"{rates['native_per_s']:.0f}",
        f"{rates['ratio']:.2f}",
    )  # fmt: skip
    return table

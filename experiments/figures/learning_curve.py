"""How often a policy in training succeeds and collides, decision by decision."""

from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np

from experiments.figures.canvas import saved


def learning_curve(stem: Path, rows: np.ndarray) -> Path:
    """Writes a PNG and an SVG of rows (K, 5): decisions, processor time [s], shares of success and of
    collision, reward, each over the last hundred episodes."""
    figure, axes = plt.subplots(2, 1, figsize=(9, 7), sharex=True, layout="constrained")
    thousands = rows[:, 0] / 1000.0
    axes[0].plot(thousands, 100.0 * rows[:, 2], color="#00913a", lw=2.2, label="success")
    axes[0].plot(thousands, 100.0 * rows[:, 3], color="#d62728", lw=2.2, label="collision")
    axes[0].set(ylabel="last 100 episodes [%]", ylim=(0.0, 100.0))
    axes[0].legend(loc="center right")
    axes[0].set_title("GoTo in training: random rooms, actions with the noise that explores")
    axes[1].plot(thousands, rows[:, 4], color="#1f77b4", lw=2.2)
    axes[1].set(ylabel="reward of an episode", xlabel="decisions, 0.2 s each [thousands]")
    for axis in axes:
        axis.grid(alpha=0.3)
    return saved(figure, stem)

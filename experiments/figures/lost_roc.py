"""How well a scan's evidence tells a kidnapped robot from one that is where it believes."""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import FixedLocator, FuncFormatter, NullFormatter, PercentFormatter

from experiments.figures.canvas import saved
from experiments.figures.kidnaps import Kidnaps
from experiments.statistics import wilson_interval


@dataclass(frozen=True)
class _Statistic:
    """One number that a scan gives for a pose. sign: 1 where more of it means more lost."""

    words: str
    sign: int
    style: dict[str, Any]


_STATISTICS = {
    "inlier_ratio": _Statistic("beams that fit the map", -1, {"color": "#1f77b4", "ls": "-"}),
    "log_likelihood": _Statistic("log-likelihood", -1, {"color": "#00913a", "ls": (0, (6, 1.5))}),
    "violation_ratio": _Statistic(
        "beams through walls", 1, {"color": "#ff8c1a", "ls": (0, (3, 1.2))}
    ),
    "error_m2": _Statistic("mean squared distance", 1, {"color": "#9467bd", "ls": (0, (1, 1))}),
}


def lost_roc(folder: Path) -> Path | None:
    """Detected kidnaps over false alarms, for every threshold on each statistic of a scan.

    The scan is judged at the pose that the robot predicts: before the kidnap an alarm is false,
    at the first scan after it right. A star is what the method says with all it knows. Reads
    `config.json` and `trials.jsonl` of the folder; writes `lost_roc.png` and `.svg`. None, and no
    file, where no method's record has `lost_scores`.
    """
    figure = lost_roc_drawn(folder)
    return None if figure is None else saved(figure, folder / "lost_roc")


def lost_roc_drawn(folder: Path) -> Figure | None:
    """The figure of `lost_roc`."""
    kidnaps = Kidnaps.read(folder)
    panels = _panels(kidnaps)
    if not panels:
        return None
    figure, axes = plt.subplots(
        1, len(panels), figsize=(max(5.6 * len(panels), 6.4), 5.4), squeeze=False, sharey=True,
        layout="constrained",
    )  # fmt: skip
    for axis, (names, outcomes) in zip(axes[0], panels, strict=True):
        _panel(axis, names, outcomes)
    axes[0][0].set_ylabel("kidnaps noticed at the first scan")
    figure.suptitle(
        f"Kidnapped in {kidnaps.place}: does the robot notice that it is lost?\n"
        "one curve for each thing a scan tells; top left is best"
    )
    return figure


def _panels(kidnaps: Kidnaps) -> list[tuple[str, list[dict[str, Any]]]]:
    """Names and outcomes with scores; methods of equal scores and verdicts share a panel."""
    panels: list[tuple[str, list[dict[str, Any]]]] = []
    seen: list[list[tuple[Any, ...]]] = []
    for method in kidnaps.methods:
        outcomes = [one for one in kidnaps.of(method) if one.get("lost_scores")]
        told = [(o["lost_scores"], o.get("detected"), o.get("false_alarm")) for o in outcomes]
        if not outcomes:
            continue
        if told in seen:
            number = seen.index(told)
            panels[number] = (f"{panels[number][0]}, {method}", outcomes)
        else:
            seen.append(told)
            panels.append((method, outcomes))
    return panels


def _panel(axis: Axes, names: str, outcomes: list[dict[str, Any]]) -> None:
    floor = 0.5 / len(outcomes)  # where no false alarm at all is drawn
    for key, statistic in _STATISTICS.items():
        negatives, positives = (_scores(outcomes, when, key) for when in ("before", "after"))
        if not (negatives.size and positives.size):
            continue
        alarms, noticed = roc(statistic.sign * negatives, statistic.sign * positives)
        area = area_under(statistic.sign * negatives, statistic.sign * positives)
        less = len(outcomes) - min(negatives.size, positives.size)
        axis.step(
            np.maximum(alarms, floor), noticed, where="post", lw=2.0, **statistic.style,
            label=f"{statistic.words}: area {area:.3f}" + f" ({less} without)" * (less > 0),
        )  # fmt: skip
    guess = np.geomspace(floor, 1.0, 100)
    axis.plot(guess, guess, color="#aaaaaa", lw=1.0, label="tossing a coin: area 0.5", zorder=1)
    _draw_verdict(axis, outcomes, floor)
    _dress(axis, floor)
    axis.set_title(f"{names}: {len(outcomes)} kidnaps", fontsize=10)
    handles, labels = axis.get_legend_handles_labels()
    axis.legend(handles, labels, loc="lower right", fontsize=8.5, handlelength=3.2)


def _scores(outcomes: list[dict[str, Any]], when: str, key: str) -> np.ndarray:
    """Those that are known."""
    values = [(one["lost_scores"].get(when) or {}).get(key) for one in outcomes]
    return np.array([value for value in values if value is not None], dtype=float)


def roc(negatives: np.ndarray, positives: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Rates (T,) of false and of right alarms as the threshold falls; higher scores alarm first."""
    thresholds = np.unique(np.concatenate([negatives, positives]))[::-1]
    shares = [
        np.concatenate([[0.0], 1.0 - np.searchsorted(np.sort(scores), thresholds) / scores.size])
        for scores in (negatives, positives)
    ]
    return shares[0], shares[1]


def area_under(negatives: np.ndarray, positives: np.ndarray) -> float:
    """The chance that a positive scores higher than a negative; a tie counts half."""
    ordered = np.sort(negatives)
    below = np.searchsorted(ordered, positives, side="left")
    upto = np.searchsorted(ordered, positives, side="right")
    return float((below + upto).mean() / (2 * negatives.size))


def _draw_verdict(axis: Axes, outcomes: list[dict[str, Any]], floor: float) -> None:
    """What the method says with all it knows, and the 95 % intervals of both rates."""
    judged = [one for one in outcomes if "detected" in one and "false_alarm" in one]
    if not judged:
        return
    total = len(judged)
    noticed, alarms = (sum(bool(one[key]) for one in judged) for key in ("detected", "false_alarm"))
    x, y = max(alarms / total, floor), noticed / total
    bars: dict[str, Any] = {"color": "#000000", "lw": 1.0, "zorder": 6}
    axis.plot([x, x], wilson_interval(noticed, total), **bars)
    axis.plot([max(w, floor) for w in wilson_interval(alarms, total)], [y, y], **bars)
    axis.plot(
        [x], [y], "*", ms=16, color="#000000", mec="#ffffff", zorder=7, clip_on=False,
        label=f"the verdict: {noticed} noticed, {alarms} false, of {total}",
    )  # fmt: skip


def _dress(axis: Axes, floor: float) -> None:
    axis.set(xscale="log", xlim=(0.85 * floor, 1.0), ylim=(-0.02, 1.02))
    decades = [rate for rate in (0.001, 0.01, 0.1, 1.0) if rate > 1.5 * floor]
    axis.xaxis.set_major_locator(FixedLocator([floor, *decades]))
    axis.xaxis.set_major_formatter(
        FuncFormatter(lambda rate, _: "none" if rate <= floor else f"{100 * rate:g}%")
    )
    axis.xaxis.set_minor_formatter(NullFormatter())
    axis.yaxis.set_major_formatter(PercentFormatter(1.0, decimals=0))
    axis.set_xlabel("false alarms before the kidnap")
    axis.grid(color="#e4e4e4", lw=0.7)
    axis.set_axisbelow(True)

"""How a kidnapped robot's guesses thin out, look by look, until one place is sure."""

import math
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch

from experiments.figures.canvas import saved
from experiments.figures.kidnaps import Kidnaps, true_heading
from slam.guard.hypotheses_config import HypothesesConfig
from slam.se2 import wrap_angle

_RIGHT, _RIVAL, _WRONG, _BAND = "#1f77b4", "#8c8c8c", "#d62728", "#fff0cc"
_MOST_PANELS = 6
_SAME_SPOT_M = 0.2
"""Chosen: turning on the spot moves the robot far less, what tells rivals apart is far more."""
_SAME_HEADING_RAD = math.radians(15.0)


@dataclass(eq=False)
class _Track:
    """One place over the looks (L,): its log-likelihood below the best, nan where not listed."""

    below: np.ndarray
    spot_m: np.ndarray
    is_right: bool

    def continues(self, spot_m: np.ndarray, is_right: bool) -> bool:
        """Whether a place of the next look is this one."""
        # the right one is one line, also where a look had lost sight of it
        is_same_spot = is_right or np.hypot(*(self.spot_m - spot_m)) < _SAME_SPOT_M
        return self.is_right == is_right and bool(is_same_spot)


@dataclass(frozen=True)
class _Search:
    """One trial. needed (L,): how far below the best a rival must be for the best to be sure."""

    index: int
    tracks: list[_Track]
    needed: np.ndarray
    is_sure: bool
    is_success: bool


def hypotheses_figure(folder: Path) -> Path | None:
    """Log-likelihood of the places at which the robot may be, at each look after the kidnap.

    Of the up to six trials that needed most looks; of equals, those with the closest rivals. Reads
    `config.json` and `trials.jsonl` of the folder; writes `hypotheses.png` and `.svg`. None, and no
    file, where no trial had a rival too close to be sure at once.
    """
    figure = hypotheses_drawn(folder)
    return None if figure is None else saved(figure, folder / "hypotheses")


def hypotheses_drawn(folder: Path) -> Figure | None:
    """The figure of `hypotheses_figure`."""
    kidnaps = Kidnaps.read(folder)
    method = _method(kidnaps)
    if method is None:
        return None
    searches = _searches(kidnaps, method)
    if not searches:
        return None
    columns = min(len(searches), 3)
    lines = math.ceil(len(searches) / columns)
    figure, axes = plt.subplots(
        lines, columns, figsize=(max(3.9 * columns, 7.0), 2.9 * lines + 1.3), squeeze=False,
        sharex=True, sharey=True, layout="constrained",
    )  # fmt: skip
    for axis, search in zip(axes.flat, searches, strict=False):
        _panel(axis, search)
    _dress(axes, searches)
    figure.suptitle(
        f"Kidnapped in {kidnaps.place}: how '{method}' tells apart the places that look alike\n"
        "the trials that needed most looks, turning on the spot in between"
    )
    _legend(figure, any(search.is_sure and not search.is_success for search in searches))
    return figure


def _method(kidnaps: Kidnaps) -> str | None:
    """`limit`, or else the first that looks more than once."""
    if not kidnaps.records:
        return None
    names = [n for n in kidnaps.methods if any(one.get("looks") for one in kidnaps.of(n))]
    return "limit" if "limit" in names else next(iter(names), None)


def _searches(kidnaps: Kidnaps, method: str) -> list[_Search]:
    found = []
    for record, outcome in zip(kidnaps.records, kidnaps.of(method), strict=True):
        looks = outcome.get("looks") or []
        if len(looks) > 1 and any(_margin(look) < _needed(look) for look in looks[:-1]):
            closest = min(_margin(look) for look in looks)
            found.append((-len(looks), closest, record["index"], record, outcome))
    found.sort(key=lambda one: one[:3])
    return [_search(record, outcome) for *_, record, outcome in found[:_MOST_PANELS]]


def _margin(look: dict[str, Any]) -> float:
    """By how much the best place is more likely than the next; inf where there is none."""
    values = sorted((place[3] for place in look["places"]), reverse=True)
    return values[0] - values[1] if len(values) > 1 else math.inf


def _needed(look: dict[str, Any]) -> float:
    """The margin from which on the best place is sure; see `Hypotheses.margin_needed`."""
    config = HypothesesConfig()  # a kidnap's map is exactly known
    best = max((place[3] for place in look["places"]), default=0.0)
    return config.min_margin - config.min_share * best


def _search(record: dict[str, Any], outcome: dict[str, Any]) -> _Search:
    looks = outcome["looks"]
    true_m = np.array(record["true_poses"][-1][:2])
    tracks: list[_Track] = []
    for number, look in enumerate(looks):
        right = _right(look, true_m, true_heading(outcome) if look is looks[-1] else None)
        best = max((place[3] for place in look["places"]), default=0.0)
        waiting = list(tracks)
        for rank, (x, y, _, log_likelihood) in enumerate(look["places"]):
            spot_m, is_right = np.array([x, y]), rank == right
            track = next((one for one in waiting if one.continues(spot_m, is_right)), None)
            if track is None:
                track = _Track(np.full(len(looks), np.nan), spot_m, is_right)
                tracks.append(track)
            else:
                waiting.remove(track)
            track.below[number] = log_likelihood - best
    return _Search(
        record["index"],
        tracks,
        np.array([_needed(look) for look in looks]),
        looks[-1]["verdict"] == "tracking",
        bool(outcome["success"]),
    )


def _right(look: dict[str, Any], true_m: np.ndarray, heading: float | None) -> int | None:
    """Which of a look's places is right; None where none is, or two at one spot may be.

    heading: the true one, where known: of the looks before the last no record tells it.
    """
    places = look["places"]
    near = [
        rank
        for rank, place in enumerate(places)
        if np.hypot(*(np.array(place[:2]) - true_m)) < _SAME_SPOT_M
    ]
    if look["is_near"] and 0 in near:
        return 0
    if heading is not None:
        near = [
            rank for rank in near if abs(wrap_angle(places[rank][2] - heading)) < _SAME_HEADING_RAD
        ]
    return near[0] if len(near) == 1 else None


def _panel(axis: Axes, search: _Search) -> None:
    count = len(search.needed)
    looks = np.arange(1, count + 1)
    # from one look's middle to the next: what is needed is of each look alone
    axis.fill_between(
        np.concatenate([looks - 0.5, [count + 0.5]]), 0.0,
        -np.append(search.needed, search.needed[-1]), step="post", color=_BAND, lw=0, zorder=0,
    )  # fmt: skip
    for track in sorted(search.tracks, key=lambda track: track.is_right):
        colour = _RIGHT if track.is_right else _RIVAL
        style: dict[str, Any] = {"color": colour, "zorder": 5 if track.is_right else 3}
        lw = 2.4 if track.is_right else 1.4
        axis.plot(looks, track.below, "-o", ms=5, lw=lw, **style)
        last = int(np.flatnonzero(np.isfinite(track.below))[-1])
        end = -float(search.needed[-1])
        if search.is_sure and last + 2 == count and track.below[last] > end:
            # not listed where the best is sure; all that this tells is how far below it must be
            axis.plot([count - 1, count], [track.below[last], end], ":", lw=1.4, **style)
            axis.plot([count], [end], "v", ms=7, mfc="#ffffff", **style)
    if search.is_sure:
        colour = _RIGHT if search.is_success else _WRONG
        axis.axvline(count, color=colour, lw=1.2, ls="--", zorder=1)
        axis.plot(
            [count], [0.0], "*" if search.is_success else "X", ms=17 if search.is_success else 12,
            color=colour, mec="#ffffff", zorder=8,
        )  # fmt: skip
    axis.set_title(_title(search), fontsize=10)


def _title(search: _Search) -> str:
    count = len(search.needed)
    if not search.is_sure:
        return f"trial {search.index}: not sure after {count} looks"
    return f"trial {search.index}: sure at look {count}" + ", and wrong" * (not search.is_success)


def _dress(axes: np.ndarray, searches: list[_Search]) -> None:
    most = max(len(search.needed) for search in searches)
    lowest = min(
        min(float(np.nanmin([np.nanmin(t.below) for t in search.tracks])) for search in searches),
        -1.3 * max(float(search.needed.max()) for search in searches),
    )
    for number, axis in enumerate(axes.flat):
        if number >= len(searches):
            axis.set_axis_off()
            continue
        axis.set(
            xlim=(0.5, most + 0.5), ylim=(1.08 * lowest, -0.12 * lowest),
            xticks=range(1, most + 1),
        )  # fmt: skip
        axis.grid(axis="y", color="#e4e4e4", lw=0.7)
        axis.set_axisbelow(True)
        if number + axes.shape[1] >= len(searches):
            axis.set_xlabel("look")
            axis.tick_params(labelbottom=True)
    for axis in axes[:, 0]:
        axis.set_ylabel("log-likelihood,\nbest place = 0")


def _legend(figure: Any, has_wrong: bool) -> None:
    handles: list[Any] = [
        Line2D([], [], color=_RIGHT, lw=2.4, marker="o", ms=5),
        Line2D([], [], color=_RIVAL, lw=1.4, marker="o", ms=5),
        Line2D([], [], color=_RIVAL, lw=1.4, ls=":", marker="v", mfc="#ffffff", ms=6),
        Patch(color=_BAND, lw=0),
        Line2D([], [], color=_RIGHT, ls="--", marker="*", mec="#ffffff", ms=15),
    ]
    labels = [
        "the right place",
        "a rival",
        "ruled out: so far below, or farther",
        "too close to be sure",
        "sure, and right",
    ]
    if has_wrong:
        handles.append(Line2D([], [], color=_WRONG, ls="--", marker="X", mec="#ffffff", ms=11))
        labels.append("sure, and wrong")
    figure.legend(handles, labels, loc="outside lower center", ncols=3, fontsize=9)

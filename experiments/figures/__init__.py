"""The figures of a run, drawn from its files alone, and the picture of one trial."""

import json
from pathlib import Path

from experiments.figures.against_bound import bound_figure
from experiments.figures.canvas import image_file
from experiments.figures.convergence import convergence_figure
from experiments.figures.hypotheses import hypotheses_figure
from experiments.figures.kidnap_map import kidnap_map
from experiments.figures.localized_log import localized_log_picture
from experiments.figures.lost_roc import lost_roc
from experiments.figures.made_maps import (
    made_maps_picture,
    map_quality_figure,
    worst_maps_picture,
)
from experiments.figures.mismatches import mismatch_figure
from experiments.figures.one_trial import trial_picture
from experiments.figures.over_time import over_time_figure
from experiments.figures.paper_scatter import scatter
from experiments.figures.recorded_log import real_log_picture
from experiments.figures.slam_map import slam_map_picture

__all__ = [
    "bound_figure",
    "convergence_figure",
    "hypotheses_figure",
    "image_file",
    "kidnap_map",
    "localized_log_picture",
    "lost_roc",
    "made_maps_picture",
    "map_quality_figure",
    "mismatch_figure",
    "over_time_figure",
    "real_log_picture",
    "run_figures",
    "scatter",
    "slam_map_picture",
    "trial_picture",
    "worst_maps_picture",
]


def run_figures(folder: Path) -> list[Path]:
    """All figures that the files of a run give, as PNG with an SVG beside each."""
    summary = json.loads((folder / "summary.json").read_text())
    if summary["experiment"] == "mapping":
        return [map_quality_figure(folder)]
    drawn = [bound_figure(folder)]
    if summary["paper_values"] is not None:
        drawn.append(scatter(folder))
    if summary["experiment"] == "tracking":
        return [*drawn, over_time_figure(folder)]
    more = [convergence_figure]
    if summary["experiment"] == "kidnap":
        more += [kidnap_map, lost_roc, hypotheses_figure]
    return drawn + [path for draw in more if (path := draw(folder)) is not None]

"""The figures of a run, drawn from its files alone, and the picture of one trial."""

import json
from pathlib import Path

from experiments.figures.against_bound import bound_figure
from experiments.figures.canvas import image_file
from experiments.figures.mismatches import mismatch_figure
from experiments.figures.one_trial import trial_picture
from experiments.figures.over_time import over_time_figure
from experiments.figures.paper_scatter import scatter
from experiments.figures.recorded_log import real_log_picture

__all__ = [
    "bound_figure",
    "image_file",
    "mismatch_figure",
    "over_time_figure",
    "real_log_picture",
    "run_figures",
    "scatter",
    "trial_picture",
]


def run_figures(folder: Path) -> list[Path]:
    """All figures that the files of a run give, as PNG with an SVG beside each."""
    summary = json.loads((folder / "summary.json").read_text())
    drawn = [bound_figure(folder)]
    if summary["paper_values"] is not None:
        drawn.append(scatter(folder))
    if summary["experiment"] == "tracking":
        drawn.append(over_time_figure(folder))
    return drawn

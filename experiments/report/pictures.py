"""The figures of a report: each drawn of a run's files, with what is to be seen in it."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

from experiments.figures.against_bound import bound_drawn
from experiments.figures.convergence import convergence_drawn
from experiments.figures.hypotheses import hypotheses_drawn
from experiments.figures.inline import inline_svg
from experiments.figures.kidnap_map import kidnap_map_drawn
from experiments.figures.lost_roc import lost_roc_drawn
from experiments.figures.made_maps import map_quality_drawn
from experiments.figures.map_difference import map_difference_drawn
from experiments.figures.over_time import over_time_drawn
from experiments.figures.paper_scatter import scatter_drawn
from experiments.kept_maps import KeptTrial, kept_maps
from experiments.report.commands import run_command
from experiments.report.run_folder import RunFolder


@dataclass(frozen=True)
class Picture:
    """A figure of the page. alt: what it is, for who cannot see it; caption: what to see in it; svg:
    the figure, or None and missing: why there is none; command: what would make it."""

    title: str
    alt: str
    caption: str
    svg: str | None = None
    missing: str = ""
    command: str | None = None


@dataclass(frozen=True)
class _Drawing:
    title: str
    alt: str
    caption: str
    # a figure of matplotlib, or None where the run gives none
    draw: Callable[[RunFolder], Any]
    missing: str = ""
    command: Callable[[RunFolder], str | None] = lambda run: None
    needs_place: bool = False


def pictures_of(run: RunFolder, key: str) -> Iterator[Picture]:
    """The figures of one run; key: of letters, digits and hyphens, another for each run of a page."""
    drawings = list(_DRAWINGS[run.experiment])
    if run.experiment == "mapping":
        drawings += _maps(run)
    for number, one in enumerate(drawings):
        figure, missing = None, one.missing
        if one.needs_place and run.place_problem is not None:
            missing = f"its place cannot be drawn: {run.place_problem}"
        else:
            figure = one.draw(run)
        if figure is not None:
            svg = inline_svg(figure, f"{key}-{number}", f"{one.title}. {one.alt}")
            yield Picture(one.title, one.alt, one.caption, svg)
        elif missing:
            yield Picture(one.title, one.alt, one.caption, None, missing, one.command(run))


def _with_other_poses(run: RunFolder) -> str | None:
    config = replace(run.config, poses="anywhere")
    return run_command("kidnap", config, run.seed, run.trials, run.folder.parent / "anywhere")


def _again(run: RunFolder) -> str | None:
    return run_command(run.experiment, run.config, run.seed, run.trials, run.folder.parent)


def _scatter(run: RunFolder) -> Any:
    assert run.summary is not None
    return scatter_drawn(run.folder) if run.summary.get("paper_values") is not None else None


def _difference_drawn(trial: KeptTrial, methods: tuple[str, ...], _: RunFolder) -> Any:
    """Of one trial, whatever the run."""
    return map_difference_drawn(trial, methods)


def _maps(run: RunFolder) -> list[_Drawing]:
    """Fig. 7 of each trial whose maps are kept: the first one, and the worst of the last method."""
    methods = run.config.methods
    kept = [trial for trial in kept_maps(run.folder, methods) if trial.index < run.trials]
    if not kept:
        return [
            _Drawing(
                "The paper's Fig. 7", "", "", lambda _: None,
                "this run kept no maps, as those of earlier versions, and those stopped before their"
                " figures were drawn; the same command again, which repeats no trial that is done,"
                " or one that writes to another folder, keeps them",
                _again,
            )
        ]  # fmt: skip
    first, *worst = kept
    drawn = [(first, "the first trial, as it came")]
    drawn += [(one, f"among the worst by {methods[-1]}") for one in worst]
    return [
        _Drawing(
            f"The paper's Fig. 7: trial {trial.index}, {words}",
            "For each method three plans beside each other: the true map with the track driven, the"
            " map built, and the difference of the two.",
            "(a) The true surfaces at the laser's height, and the track driven. (b) The map that the"
            " method built, and where it thinks it drove. Difference: each point of that map coloured"
            " by how far it lies from the nearest true surface; magenta squares are surfaces that the"
            " laser could see and the map lacks. The built map is laid where its path fits the true"
            " path best.",
            partial(_difference_drawn, trial, methods),
        )
        for trial, words in drawn
    ]


_SCATTER = _Drawing(
    "The paper's Fig. 5",
    "A panel for each method with a dot for each trial: its error in x over its error in y, in"
    " centimetres.",
    "Where each trial ended, relative to the truth. The dashed square is the ±3 cm that the paper"
    " claims; the ellipse, where there is one, the mean and two standard deviations of its table: its"
    " own figure is lost to us.",
    _scatter,
)
_SECOND_SCATTER = _Drawing(
    "The paper's Fig. 6 (printed there as a second Fig. 5)",
    _SCATTER.alt,
    _SCATTER.caption,
    _scatter,
)
_CONVERGENCE = _Drawing(
    "Convergence of expression (1)",
    "For each ICP method: expression (1) after each pass of the search, the distance from the true"
    " position, and how many passes it took.",
    "Left: the mean squared distance that ICP brings down, and the threshold at which the paper's"
    " Fig. 2 ends. Middle: whether that brings it nearer to the truth. A curve that falls on the left"
    " and not in the middle converges to a wrong place. open3d goes from coarse to fine: its jumps"
    " are where it relates nearer points only. Of a kidnap it is the search in the last scan.",
    lambda run: convergence_drawn(run.folder),
    "no method of this run goes down expression (1), or the run was made before its passes were kept",
)
_BOUND = _Drawing(
    "Error against the Cramér-Rao bound",
    "Curves of the share of all trials whose error stays below a value, for position and for heading,"
    " one for each method, and one for the bound.",
    "Further left is better, and higher: a curve ends at the method's success rate. Black: what an"
    " efficient estimator of one scan would do. NEES is 3 where a method knows how sure it is.",
    lambda run: bound_drawn(run.folder),
)

_DRAWINGS: dict[str, tuple[_Drawing, ...]] = {
    "localization": (_SCATTER, _CONVERGENCE, _BOUND),
    "kidnap": (
        _SECOND_SCATTER,
        _CONVERGENCE,
        _Drawing(
            "Where a kidnapped robot finds itself",
            "The place from above, for each method: where the robot was set down, and whether it was"
            " found; below it, where it was carried anywhere, the share found over way and turn.",
            "Up to 150 trials, a robot each, blue where found; of more, squares coloured by the share"
            " found. Red crosses are places that were wrong and believed.",
            lambda run: kidnap_map_drawn(run.folder),
            "one pair of poses was repeated here, and a map of places needs many",
            _with_other_poses,
            needs_place=True,
        ),
        _Drawing(
            "Does it notice that it is lost? ROC",
            "Curves of kidnaps noticed over false alarms, one for each statistic of a scan, and a star"
            " for the verdict.",
            "The nearer to the top left the better. A curve is one number of a scan with every"
            " threshold; the star is the verdict that the robot acts on.",
            lambda run: lost_roc_drawn(run.folder),
            "no method of this run says whether it is lost",
        ),
        _Drawing(
            "How places that look alike are told apart",
            "For the trials that needed most scans: log-likelihood of each place at which the robot may"
            " be, scan by scan.",
            "Blue is the right place; a robot is sure once all others have fallen below the band.",
            lambda run: hypotheses_drawn(run.folder),
        ),
        _BOUND,
    ),
    "tracking": (
        _Drawing(
            "Error along the drives",
            "Error of position and heading of each method over the time of the drive.",
            "RMS of all trials at each scan, lost or not; black: the bound of that one scan.",
            lambda run: over_time_drawn(run.folder),
        ),
        _BOUND,
    ),
    "mapping": (
        _Drawing(
            "How good the maps are",
            "Curves of the share of trials over trajectory error, precision and recall, one for each"
            " method.",
            "Dashed: what a map must reach to count as made.",
            lambda run: map_quality_drawn(run.folder),
        ),
    ),
}

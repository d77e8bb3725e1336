"""The page of a report: one HTML file with all that it shows, which asks no network for anything."""

import shlex
from collections.abc import Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

from jinja2 import Environment, FileSystemLoader, StrictUndefined
from markupsafe import Markup

from experiments.outputs import checked_file
from experiments.provenance import commit, versions
from experiments.report.commands import run_command, trial_command
from experiments.report.numbers import Cell
from experiments.report.pictures import Picture, pictures_of
from experiments.report.run_folder import RunFolder, found_runs
from experiments.report.tables import Table, figures_table, overview, paper_table
from experiments.report.worst import worst_of
from experiments.runs import experiment_module
from experiments.tables import title_of
from experiments.trial_log import write_atomically

GENERATOR = "kitasap report"
PAPER_EXPERIMENTS = ("localization", "kidnap", "mapping")
_MARK = f'<meta name="generator" content="{GENERATOR}">'


@dataclass(frozen=True)
class _Again:
    """A trial that is worth a look. command: what repeats it."""

    index: int
    words: list[str]
    command: str | None


@dataclass(frozen=True)
class _Section:
    """What the page says of one run."""

    key: str
    title: str
    where: str
    run: RunFolder
    summary: dict[str, Any]
    command: str
    differs: list[tuple[str, str]]
    tables: list[Table]
    overview: list[tuple[str, list[Cell]]]
    pictures: list[Picture]
    worst: list[_Again]
    repeats: str


@dataclass(frozen=True)
class Missing:
    """What of the paper is not there. command: what makes it."""

    what: str
    command: str | None


@dataclass(frozen=True)
class _Page:
    sections: list[_Section]
    missing: list[Missing]
    versions: dict[str, str] = field(default_factory=versions)
    commit: str | None = field(default_factory=commit)


def write_report(folders: Sequence[Path], out: Path) -> list[Missing]:
    """Writes the report of the runs in these folders; what of the paper's experiments it lacks.

    Raises ValueError where a folder holds no finished run or a damaged one, or out is a file that is
    not an earlier report; OSError where it cannot be written.
    """
    check_out(out)
    runs = found_runs(folders)
    finished = [run for run in runs if run.summary is not None]
    missing = _missing(runs)
    if not finished:
        goes_on = next(one.command for one in missing)
        raise ValueError(
            f"no run in {', '.join(map(str, folders))} is finished"
            + (f"; what goes on with it: {goes_on}" if goes_on else "")
        )
    sections = [_section(run, f"run-{number}") for number, run in enumerate(finished)]
    environment = Environment(
        loader=FileSystemLoader(Path(__file__).parent), autoescape=True, undefined=StrictUndefined,
        trim_blocks=True, lstrip_blocks=True,
    )  # fmt: skip
    # what matplotlib wrote is markup; all else is escaped
    environment.filters["svg"] = Markup
    text = environment.get_template("page.html").render(
        page=_Page(sections, missing), generator=Markup(_MARK)
    )
    out.parent.mkdir(parents=True, exist_ok=True)
    write_atomically(out, text)
    return missing


def check_out(out: Path) -> None:
    """Raises ValueError for a file that is there and is no report of ours, OSError where nothing can
    be written."""
    checked_file(out)
    if out.exists() and _MARK.encode() not in out.read_bytes()[:2000]:
        raise ValueError(f"{out} is there, and is no report of kitasap: name another file by --out")


def _section(run: RunFolder, key: str) -> _Section:
    summary = run.summary
    assert summary is not None
    poses = run.config.poses
    try:
        paper = paper_table(_of(run), poses)
        tables = [*([paper] if paper else []), figures_table(_of(run))]
        in_short = [(name, overview(summary, name)) for name in run.config.methods]
        worst = [
            _Again(
                one.index, one.words, trial_command(run.experiment, run.config, run.seed, one.index)
            )
            for one in worst_of(run)
        ]
        pictures = list(pictures_of(run, key))
    except (LookupError, TypeError, AttributeError, ValueError, ArithmeticError) as error:
        raise ValueError(
            f"{run.folder} is damaged, or of another version: {error or type(error).__name__}"
        ) from error
    return _Section(
        key,
        title_of(run.experiment, poses),
        f"{Path(run.config.place).stem}, {run.config.laser}, {run.config.odometry} odometry",
        run,
        summary,
        shlex.join(run.command),
        _differs(run),
        tables,
        in_short,
        pictures,
        worst,
        _repeats(run),
    )


def _of(run: RunFolder) -> dict[str, Any]:
    """The summary, its methods in the order of the configuration."""
    assert run.summary is not None
    methods = {name: run.summary["methods"][name] for name in run.config.methods}
    return run.summary | {"experiment": run.experiment, "methods": methods}


def _differs(run: RunFolder) -> list[tuple[str, str]]:
    own = asdict(experiment_module(run.experiment).DEFAULTS)
    return [(name, str(value)) for name, value in asdict(run.config).items() if value != own[name]]


def _repeats(run: RunFolder) -> str:
    """Whether the commands of the trials give them to the bit, in words."""
    if run.is_of_this_code:
        return "Each command repeats its trial to the bit, with the code that made this report."
    if run.place_problem is not None:
        return f"Before they can be repeated, the place is needed: {run.place_problem}"
    return (
        f"The run is of other code or libraries than made this report: commit"
        f" {run.commit or 'unknown'}, versions as above. With those each command repeats its trial."
    )


def _missing(runs: list[RunFolder]) -> list[Missing]:
    found = [
        Missing(
            f"{run.experiment}: {len(run.records)} of {run.trials} trials in {run.folder}, not finished",
            run_command(run.experiment, run.config, run.seed, run.trials, run.folder.parent),
        )
        for run in runs
        if run.summary is None
    ]
    for name in PAPER_EXPERIMENTS:
        if all(run.experiment != name for run in runs):
            command = run_command(
                name, experiment_module(name).DEFAULTS, runs[0].seed, 100, runs[0].folder.parent
            )
            found.append(Missing(f"{name}: no run of it in the folders named", command))
    return found

"""The commands `kitasap report` and `kitasap reproduce`."""

import sys
from pathlib import Path
from typing import Annotated

import typer

from experiments.commands.options import PAPER_TRIALS, RESULTS, Jobs, Out, Seed, Trials

_NAME = "report.html"
Open = Annotated[bool, typer.Option("--open", help="Shows it in the browser.")]


def report(
    folders: Annotated[
        list[Path],
        typer.Argument(
            metavar="DIR...", help="Folders that `kitasap run` wrote, or folders of such."
        ),
    ],
    out: Annotated[
        Path | None,
        typer.Option(help="The HTML file to write; default: report.html in the first DIR."),
    ] = None,
    show: Open = False,
) -> None:
    """Writes one page of HTML about finished runs: the paper's tables and figures beside ours."""
    _written(folders, folders[0] / _NAME if out is None else out, show)


def reproduce(
    out: Out = RESULTS / "paper",
    trials: Trials = PAPER_TRIALS,
    jobs: Jobs = None,
    seed: Seed = 0,
    show: Open = False,
) -> None:
    """Runs all of the paper's experiments as it did, and reports; the same command goes on."""
    from experiments.commands.execution import has_raised
    from experiments.outputs import checked_folder
    from experiments.processes import local_engine
    from experiments.report.page import PAPER_EXPERIMENTS, check_out
    from experiments.runs import Run, experiment_module

    runs = [
        Run(name, experiment_module(name).DEFAULTS, seed, trials, out / name)
        for name in PAPER_EXPERIMENTS
    ]
    for each in runs:
        checked_folder(each.folder)
        each.check()
    check_out(out / _NAME)
    is_hurt = has_raised(runs, local_engine(jobs))
    _written([each.folder for each in runs], out / _NAME, show)
    raise typer.Exit(1 if is_hurt else 0)


def _written(folders: list[Path], out: Path, show: bool) -> None:
    import webbrowser

    from experiments.report import write_report

    for one in write_report(folders, out):
        print(f"not in the report: {one.what}", file=sys.stderr)
        if one.command:
            print(f"  what makes it: {one.command}", file=sys.stderr)
    print(f"report: {out}")
    if show and not webbrowser.open(out.resolve().as_uri()):
        print("no browser was found to show it in", file=sys.stderr)

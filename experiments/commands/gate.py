"""The commands `kitasap baseline` and `kitasap check`."""

import os
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

if TYPE_CHECKING:
    from experiments.gate.baseline import RunValues

Folder = Annotated[
    Path,
    typer.Argument(metavar="DIR", help="What `kitasap run` wrote: a run, or a folder of runs."),
]


def baseline(
    folder: Folder,
    out: Annotated[
        Path | None, typer.Option(help="The file to write; default: baseline.json in DIR.")
    ] = None,
    force: Annotated[bool, typer.Option("--force", help="Write over a baseline.")] = False,
) -> None:
    """Keeps what finished runs measured, trial by trial, in a small file to check others against."""
    from experiments.gate.baseline import write_baseline
    from experiments.outputs import checked_file

    path = checked_file(folder / "baseline.json" if out is None else out)
    if path.exists() and not force:
        raise ValueError(f"{path} is there already: --force writes over it")
    runs = _runs(folder)
    path.parent.mkdir(parents=True, exist_ok=True)
    write_baseline(path, runs)
    told = ", ".join(f"{run.experiment} {run.trials} trials of seed {run.seed}" for run in runs)
    print(f"baseline: {path} ({told})")


def check(
    folder: Folder,
    baseline: Annotated[
        Path, typer.Argument(metavar="BASELINE", help="What `kitasap baseline` wrote.")
    ],
    alpha: Annotated[
        float, typer.Option(help="How often a run that is no worse may be called worse, at most.")
    ] = 0.01,
    margin: Annotated[
        float, typer.Option(help="By what share errors may grow before they count as worse.")
    ] = 0.05,
    method: Annotated[
        str | None, typer.Option(help="Compare these methods alone, by commas.")
    ] = None,
    allow: Annotated[
        str | None,
        typer.Option(help="Settings that may differ, by commas: laser, place, odometry ..."),
    ] = None,
    junit: Annotated[
        Path | None, typer.Option(help="Write the result as JUnit XML to this file.")
    ] = None,
) -> None:
    """Tests whether runs are worse than their baseline: exit status 1 if so, and only then."""
    from experiments.outputs import checked_file

    if junit is not None:
        checked_file(junit)
        if baseline.exists() and junit.exists() and junit.samefile(baseline):
            raise ValueError(f"--junit {junit} is the baseline: give another file")
    try:
        is_worse = _is_worse(folder, baseline, alpha, margin, method, allow, junit)
    except (ValueError, OSError, ImportError):
        raise
    except Exception as error:
        if os.environ.get("KITASAP_TRACEBACK"):
            raise
        # a traceback would end with status 1, which says that the robot got worse
        raise RuntimeError(f"the check itself failed: {type(error).__name__}: {error}") from error
    raise typer.Exit(1 if is_worse else 0)


def _is_worse(
    folder: Path,
    baseline: Path,
    alpha: float,
    margin: float,
    method: str | None,
    allow: str | None,
    junit: Path | None,
) -> bool:
    from experiments.gate.baseline import read_baseline
    from experiments.gate.check import checked, matched
    from experiments.gate.output import print_check, write_junit

    old, new = read_baseline(baseline), _runs(folder)
    if method is not None:
        old, new = ([run.of_methods(method.split(",")) for run in runs] for runs in (old, new))
    allowed = () if allow is None else tuple(allow.split(","))
    result = checked(matched(old, new, allowed), alpha, margin, allowed=allowed)
    print_check(result)
    if junit is not None:
        junit.parent.mkdir(parents=True, exist_ok=True)
        write_junit(junit, result)
    return bool(result.worse)


def _runs(folder: Path) -> list["RunValues"]:
    from experiments.gate.baseline import RunValues
    from experiments.report.run_folder import found_runs

    return [RunValues.of(run) for run in found_runs([folder])]

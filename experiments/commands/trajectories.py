"""The command on trajectories: `kitasap evaluate`."""

from pathlib import Path
from typing import Annotated

import typer

from experiments.outputs import checked_folder


def evaluate(
    trajectory: Annotated[Path, typer.Argument(metavar="TRAJECTORY", help="TUM or KITTI format.")],
    against: Annotated[
        Path | None, typer.Argument(metavar="REFERENCE", help="The same as --reference.")
    ] = None,
    reference: Annotated[
        Path | None, typer.Option(help="Reference poses, TUM or KITTI: ATE, RPE, built relations.")
    ] = None,
    relations: Annotated[
        Path | None, typer.Option(help="Official relations (Kuemmerle et al. 2009).")
    ] = None,
    odometry: Annotated[
        Path | None,
        typer.Option(
            help="The log: its odometry carries poses to stamps without one;"
            " else neighbours at most 2 s apart do."
        ),
    ] = None,
    out: Annotated[Path | None, typer.Option(help="Folder for evaluation.json.")] = None,
) -> None:
    """Errors of a trajectory: ATE, relative pose error, the relations metric with its coverage."""
    from experiments import evaluation

    if against is not None and reference is not None:
        raise ValueError("give one reference, behind the trajectory or by --reference")
    reference = reference or against
    if reference is None and relations is None:
        raise ValueError("nothing to evaluate against: give --reference, --relations or both")
    if out is not None:
        checked_folder(out)
    result = evaluation.evaluated_files(trajectory, reference, relations, odometry)
    print(evaluation.table(result.summary(), trajectory.name))
    if out is not None:
        evaluation.write_results(result, out)
        print(f"results: {out / evaluation.RESULT_FILE}")

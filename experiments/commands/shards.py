"""The command `kitasap merge`."""

from pathlib import Path
from typing import Annotated

import typer


def merge(
    folders: Annotated[
        list[Path],
        typer.Argument(metavar="DIR...", help="What `kitasap run --shard` wrote, all shards."),
    ],
    out: Annotated[Path, typer.Option(help="Folder of the results, as of one run of all.")],
) -> None:
    """Puts the shards of runs together: the files that a run of all trials would have written."""
    from experiments.commands.execution import draw, is_hurt, print_table, print_where
    from experiments.merging import merge, merged_runs
    from experiments.outputs import checked_folder

    runs = merged_runs(folders, out)
    for run, _ in runs:
        checked_folder(run.folder)
    has_raised = False
    for run, heads in runs:
        summary = merge(run, heads)
        print_table(run, summary)
        draw(run)
        print_where("results and figures", run.folder)
        has_raised |= is_hurt(summary)
    raise typer.Exit(1 if has_raised else 0)

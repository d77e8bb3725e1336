"""What commands that run trials share: progress, tables, figures."""

from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from experiments.engines import Engine
    from experiments.runs import Run


def has_raised(runs: list["Run"], engine: "Engine", *, figures: bool = True) -> bool:
    """Executes runs, one after the other: whether any trial of them raised an error."""
    summaries = [_executed(each, engine, figures) for each in runs]
    return any(is_hurt(summary) for summary in summaries)


def is_hurt(summary: dict[str, Any]) -> bool:
    """Whether a trial of a run raised an error."""
    return any(one["raised"] for one in summary["methods"].values())


def executed_alone(run: "Run", engine: "Engine", name: str) -> dict[str, Any]:
    """Executes a run under a progress line; the content of its summary.json."""
    from experiments.progress import TrialProgress

    asked = len(run.shard.indices(run.trials))
    with TrialProgress(name, asked, run.config.methods) as progress:
        return run.execute(engine, progress.update, progress.compiling, progress.tell)


def _executed(run: "Run", engine: "Engine", figures: bool) -> dict[str, Any]:
    """Executes a run; prints its table and where its files are. A shard gets no figures."""
    from experiments.shards import WHOLE

    if not run.shard.indices(run.trials):
        print(f"{run.experiment}: none of {run.trials} trials is of {run.shard.words}")
    summary = executed_alone(run, engine, run.experiment)
    print_table(run, summary)
    if run.shard != WHOLE:
        print_where(f"results of {run.shard.words}, for `kitasap merge`", run.folder)
    elif figures:
        draw(run)
        print_where("results and figures", run.folder)
    else:
        print_where("results", run.folder)
    return summary


def print_table(run: "Run", summary: dict[str, Any]) -> None:
    """What came out, beside the paper's."""
    from experiments.tables import summary_table, wide_console

    where = f"{Path(run.config.place).stem}, {run.config.laser}"
    if summary["trials"]:
        wide_console().print(summary_table(summary, run.config.poses, where))


def print_where(what: str, folder: Path) -> None:
    """Where files are."""
    from experiments.tables import wide_console

    wide_console().print(f"{what}: {folder}", markup=False, highlight=False, soft_wrap=True)


def draw(run: "Run") -> None:
    """The figures of a finished run, and pictures of a few of its trials, which are done again."""
    from experiments.figures import run_figures
    from experiments.tables import wide_console

    console, words = wide_console(), "drawing figures, for which a few trials are done again"
    if not console.is_terminal:
        console.print(words)
    with console.status(words):
        _draw_trials(run)
        run_figures(run.folder)


def _draw_trials(run: "Run") -> None:
    """The first trial that ran; of maps, the three worst of the last method too."""
    from experiments.figures import trial_picture, worst_maps_picture
    from experiments.kept_maps import keep_maps
    from experiments.map_statistics import worst_trials
    from experiments.runs import trial_result

    ran = (record for record in run.records() if record["status"] == "ok")
    first = next(ran, None)
    if first is None:
        return

    @cache
    def again(index: int) -> Any:
        return trial_result(run.experiment, run.config, run.seed, index)

    index = first["index"]
    trial_picture(run.folder, run.config, again(index), index)
    if run.experiment == "mapping":
        name = run.config.methods[-1]
        records = {index: first} | {record["index"]: record for record in ran}
        worst = [(index, again(index)) for index in worst_trials(records, name)]
        worst_maps_picture(run.folder, worst, name)
        keep_maps(run.folder, {index: again(index) for index in (first["index"], *dict(worst))})

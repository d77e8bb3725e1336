"""The shards of runs, put together: what one run of all trials would have written."""

from collections.abc import Iterable
from contextlib import ExitStack, closing
from dataclasses import replace
from pathlib import Path
from typing import Any

from experiments.report.run_folder import RunHead
from experiments.run_files import write_config, write_summary
from experiments.runs import EXPERIMENTS, Run
from experiments.shards import WHOLE, Shard
from experiments.trial_log import TrialLog, locked
from experiments.trials import config_hash


def merged_runs(folders: Iterable[Path], out: Path) -> list[tuple[Run, list[RunHead]]]:
    """The runs whose shards lie in folders, or in folders in them, and these; nothing is written.

    Raises ValueError, in one line, where they are not shards of one run, or lack a part of it.
    """
    found: dict[str, dict[Path, RunHead]] = {}
    for folder in folders:
        for head in _heads(folder):
            found.setdefault(head.experiment, {})[head.folder.resolve()] = head
    merged = []
    for name in sorted(found, key=EXPERIMENTS.index):
        heads = list(found[name].values())
        first = heads[0]
        run = Run(name, first.config, first.seed, first.trials, out / name)
        if run.folder.resolve() in found[name]:
            raise ValueError(f"--out {out} is where a shard lies: give another folder")
        for head in heads[1:]:
            _check_same(first, head)
        if config_hash(name, first.config, first.seed) != first.config_hash:
            raise ValueError(
                f"{first.folder} was run by another version of the code or its libraries, or its"
                " place has changed since: merge it where it was run"
            )
        with ExitStack() as stack:
            _check_whole(run, [(head, _log_of(head, stack)) for head in heads])
        merged.append((run, heads))
    return merged


def merge(run: Run, heads: list[RunHead]) -> dict[str, Any]:
    """Writes the files of a run from those of its shards; the content of `summary.json`.

    Raises ValueError where its folder holds other trials already.
    """
    with ExitStack() as stack:
        stack.enter_context(locked(run.folder))
        hashed = config_hash(run.experiment, run.config, run.seed)
        log = stack.enter_context(closing(TrialLog(run.folder, run.experiment, hashed)))
        for head in heads:
            shard = _log_of(head, stack)
            for index in (one for one in shard.trials.indices if one < run.trials):
                line = shard.trials.line(index)
                if index in log.trials:
                    if log.trials.line(index) != line:
                        raise ValueError(f"{run.folder} holds other trials: give another --out")
                    continue
                if index in shard.timings:
                    log.timings.append_line(index, shard.timings.line(index))
                log.trials.append_line(index, line)
        write_config(run, hashed, run.trials)
        log.finish(range(run.trials))
        wall_s = max(head.wall_s for head in heads)
        return write_summary(run, log, range(run.trials), wall_s)


def _heads(folder: Path) -> list[RunHead]:
    if not folder.is_dir():
        raise ValueError(f"{folder} is no folder: name those that `kitasap run --shard` wrote")
    places = [path.parent for path in [folder / "config.json", *folder.glob("*/config.json")]]
    places = [path for path in places if (path / "trials.jsonl").exists()]
    if not places:
        raise ValueError(f"{folder} holds no run, nor do the folders in it")
    return [RunHead.read(path) for path in sorted(places)]


def _check_same(first: RunHead, other: RunHead) -> None:
    """Raises ValueError where two are not shards of one run."""
    if replace(other, folder=first.folder, shard=first.shard, wall_s=first.wall_s) == first:
        return
    differing = [
        f"{name} is {theirs}, not {own}"
        for name, own, theirs in (
            ("seed", first.seed, other.seed),
            ("trials", first.trials, other.trials),
            *((n, v, getattr(other.config, n)) for n, v in vars(first.config).items()),
            ("the version of the code, its libraries or the place", "as there", "another"),
        )
        if theirs != own
    ]
    told = differing[0] if len(differing) == 1 else "; ".join(differing[:-1])
    raise ValueError(f"{other.folder} is no shard of the run in {first.folder}: {told}")


def _log_of(head: RunHead, stack: ExitStack) -> TrialLog:
    """Its trials, while no run can be at work in its folder."""
    stack.enter_context(locked(head.folder))
    return TrialLog(head.folder, head.experiment, head.config_hash, is_kept=True)


def _check_whole(run: Run, shards: list[tuple[RunHead, TrialLog]]) -> None:
    """Raises ValueError where a trial is nowhere, or twice, or where it should not be."""
    where: dict[int, RunHead] = {}
    for head, log in shards:
        own = head.shard.indices(run.trials)
        for index in (one for one in log.trials.indices if one < run.trials):
            if index not in own:
                raise ValueError(f"{head.folder} holds trial {index}, not of {head.shard.words}")
            if index in where:
                raise ValueError(
                    f"{where[index].folder} and {head.folder} both hold trial {index}:"
                    f" {where[index].shard.words} and {head.shard.words}"
                )
            where[index] = head
        lacking = [index for index in own if index not in log.trials]
        if lacking:
            raise ValueError(
                f"{head.folder} is not finished, {len(lacking)} of {len(own)} trials are missing:"
                " the same `kitasap run` goes on with it"
            )
    missing = [index for index in range(run.trials) if index not in where]
    if missing:
        raise ValueError(
            f"{len(missing)} of {run.trials} trials of {run.experiment} are in none of the folders:"
            f" {_named(missing, [head.shard for head, _ in shards])}"
        )


def _named(missing: list[int], shards: list[Shard]) -> str:
    """Which shards are missing, if all are of the same cut; else the first of the trials."""
    counts = {shard.count for shard in shards if shard != WHOLE}
    if len(counts) == 1:
        count = counts.pop()
        parts = [Shard(number, count) for number in sorted({1 + one % count for one in missing})]
        return "shard " + ", ".join(map(str, parts)) + " is missing"
    return "trial " + ", ".join(map(str, missing[:5])) + (" ..." if missing[5:] else "")

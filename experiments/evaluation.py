"""A trajectory judged against reference poses, relations, or both."""

from __future__ import annotations

import json
import math
from collections.abc import Callable
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np

from experiments.reference_files import read_poses, read_related
from experiments.trial_log import write_atomically
from slam.arrays import FloatArray, IntArray
from slam.metrics import (
    AbsoluteErrors,
    RelationErrors,
    Relations,
    RelativeErrors,
    Spread,
    absolute_errors,
    built_relations,
    index_pairs,
    relation_errors,
    relative_errors,
    way_pairs,
)
from slam.pose_lookup import PoseLookup
from slam.readers.log import Log
from slam.readers.recognition import read_log
from slam.trajectory import Trajectory

RESULT_FILE = "evaluation.json"
BUILT = "built of the reference"
"""In place of the name of a file of relations."""

_FEW_COVERED = 0.5
"""Chosen: poses at the scans of a log cover more of what is asked; those at each tenth do not."""

_DELTAS: dict[str, Callable[[FloatArray], IntArray]] = {
    "next pose": lambda poses: index_pairs(len(poses), 1),
    "1 m": lambda poses: way_pairs(poses, 1.0),
    "10 m": lambda poses: way_pairs(poses, 10.0),
}
"""Over what the relative pose error is told; chosen on the reference, pairs overlapping."""


@dataclass(frozen=True)
class Evaluation:
    """What came out; None where there was nothing to judge it by.

    reference_coverage: the share of the reference's poses at whose stamps the trajectory has one;
    absolute and relative errors are over these. relations_of: a file's name, or `BUILT`.
    """

    pose_count: int
    reference_coverage: float | None
    absolute: AbsoluteErrors | None
    relative: dict[str, RelativeErrors]
    relations_of: str | None
    relations: dict[str, RelationErrors]

    def summary(self) -> dict[str, Any]:
        """The content of `evaluation.json`: errors in m and degrees, null for what there is not."""
        ate = self.absolute
        return {
            "poses": self.pose_count,
            "reference_coverage": self.reference_coverage,
            "ate": None if ate is None else _motion(ate.position_m, ate.heading_rad),
            "rpe": {
                name: _motion(errors.translation_m, errors.rotation_rad)
                for name, errors in self.relative.items()
            },
            "relations_of": self.relations_of,
            "relations": {
                name: {
                    "count": score.count,
                    "covered": score.covered,
                    "coverage": _number(score.coverage),
                    **_motion(score.errors.translation_m, score.errors.rotation_rad),
                    "worst_times_s": score.worst,
                }
                for name, score in self.relations.items()
            },
        }


def evaluated(
    trajectory: Trajectory,
    reference: Trajectory | None = None,
    relations: Relations | None = None,
    odometry: Trajectory | None = None,
    relations_of: str | None = None,
) -> Evaluation:
    """A trajectory against reference poses, relations, or both; without relations, built ones.

    odometry: carries the poses to stamps without one, see `PoseLookup`. relations_of: their name.
    Raises ValueError if there is nothing to judge by, or nothing of it that is covered.
    """
    if reference is None and relations is None:
        raise ValueError("nothing to evaluate against: give a reference, relations or both")
    poses = PoseLookup(trajectory, odometry)
    scores = None
    if relations is not None:
        scores = relation_errors(relations, poses)
        is_any = scores["all"].covered > 0
        _check_covered(is_any, trajectory, relations.times_s.ravel(), "relations")
    coverage, absolute, relative = None, None, {}
    if reference is not None:
        reference = reference.in_order()
        found = poses.at(reference.times_s)
        is_covered = np.isfinite(found).all(axis=1)
        _check_covered(is_covered.any(), trajectory, reference.times_s, "reference")
        coverage = float(is_covered.mean())
        found, true = found[is_covered], reference.poses[is_covered]
        absolute = absolute_errors(found, true)
        relative = {
            name: relative_errors(found, true, pairs(true)) for name, pairs in _DELTAS.items()
        }
        scores = scores or relation_errors(built_relations(reference), poses)
    assert scores is not None
    name = BUILT if relations is None else relations_of
    return Evaluation(len(trajectory), coverage, absolute, relative, name, scores)


def evaluated_files(
    trajectory_path: Path,
    reference_path: Path | None = None,
    relations_path: Path | None = None,
    odometry_path: Path | None = None,
) -> Evaluation:
    """The same of files: TUM or KITTI both, relations, a log whose odometry carries the poses.

    Raises ValueError, in one line, for files that are not what they should be or do not belong
    together, OSError for unreadable ones.
    """
    trajectory, is_stamped = read_poses(trajectory_path, "TRAJECTORY")
    reference = None
    if reference_path is not None:
        reference, is_reference_stamped = read_poses(reference_path, "--reference")
        if is_stamped != is_reference_stamped or not (
            is_stamped or len(trajectory) == len(reference)
        ):
            raise ValueError(
                f"{trajectory_path} has {len(trajectory)} poses{_of_format(is_stamped)}, and"
                f" {reference_path} {len(reference)}{_of_format(is_reference_stamped)}; expected"
                " stamps in both, or in neither and as many poses: those of KITTI go line by line"
            )
    relations = None if relations_path is None else read_related(relations_path)
    odometry = None
    if odometry_path is not None:
        odometry = odometry_of(odometry_path)
        if not np.isfinite(PoseLookup(odometry).at(trajectory.times_s)).any():
            raise ValueError(
                f"{odometry_path} has odometry from {span(odometry.times_s)} s, and no pose of"
                f" {trajectory_path} is of that time: {span(trajectory.times_s)} s"
            )
    relations_of = None if relations_path is None else relations_path.name
    return evaluated(trajectory, reference, relations, odometry, relations_of)


def odometry_of(path: Path) -> Trajectory:
    """The poses of all records of a log by its wheels alone, in the order of its lines."""
    return odometry_of_log(read_log(path))


def odometry_of_log(log: Log) -> Trajectory:
    """The same of a log that was read. Raises ValueError where it has scans alone."""
    if not log.has_odometry:
        raise ValueError(f"{log.told_as}: no odometry in this log, only scans")
    rows = np.array([(record.time_s, *record.T_odom_base.as_array()) for record in log.records])
    return Trajectory(rows[:, 0], rows[:, 1:])


def write_results(evaluation: Evaluation, folder: Path) -> None:
    """Writes evaluation.json. Raises OSError when the folder cannot be written."""
    folder.mkdir(parents=True, exist_ok=True)
    write_atomically(folder / RESULT_FILE, json.dumps(evaluation.summary(), indent=2) + "\n")


def table(summary: dict[str, Any], name: str) -> str:
    """The summary for people to read."""
    lines = [f"{name}: {summary['poses']} poses"]
    if summary["reference_coverage"] is not None:
        lines[0] += f", {summary['reference_coverage']:.1%} of the reference covered"
        lines[0] += _hint_of(summary["reference_coverage"])
    lines.append(f"{'':26}{'count':>7}  " + "".join(f"{key:>9}" for key in _COLUMNS))
    if summary["ate"] is not None:
        lines += _rows("ATE, aligned", summary["ate"])
    for delta, errors in summary["rpe"].items():
        lines += _rows(f"RPE, {delta}", errors)
    for part, score in summary["relations"].items():
        covered = "" if score["coverage"] is None else f", {score['coverage']:.1%} covered"
        if part == "all":
            lines.append(
                f"relations {summary['relations_of']}{covered}{_hint_of(score['coverage'])}"
            )
        if score["count"]:
            lines += _rows(f"  {part}", score)
    return "\n".join(lines)


def _hint_of(coverage: float | None) -> str:
    """What may be the matter where few of the times have a pose."""
    if coverage is None or coverage >= _FEW_COVERED:
        return ""
    return (
        " (few: --odometry LOG carries poses to the times between them; or are the files swapped?)"
    )


_COLUMNS = ("mean", "std", "rmse", "median", "q95", "q99", "max")


def _rows(label: str, errors: dict[str, Any]) -> list[str]:
    rows = []
    for unit, key, digits in (("m", "translation_m", 4), ("deg", "rotation_deg", 3)):
        spread = errors[key]
        numbers = "".join(
            f"{'-' if spread[name] is None else format(spread[name], f'.{digits}f'):>9}"
            for name in _COLUMNS
        )
        rows.append(f"{label:20}{f'[{unit}]':>6}{spread['count']:>7}  {numbers}")
        label = ""
    return rows


def _motion(translation_m: Spread, rotation_rad: Spread) -> dict[str, Any]:
    return {
        "translation_m": _spread(translation_m),
        "rotation_deg": _spread(rotation_rad.scaled(math.degrees(1.0))),
    }


def _spread(spread: Spread) -> dict[str, Any]:
    return {key: _number(value) for key, value in asdict(spread).items()}


def _number(value: float) -> float | None:
    """The same, None for nan, which JSON has not."""
    return value if math.isfinite(value) else None


def _of_format(is_stamped: bool) -> str:
    return " with stamps" if is_stamped else " without, as KITTI has them"


def _check_covered(
    is_any: bool | np.bool_, trajectory: Trajectory, times_s: FloatArray, against: str
) -> None:
    if not is_any:
        raise ValueError(
            f"the trajectory has no pose at the times of the {against}: it is of"
            f" {span(trajectory.times_s)} s, the {against} of {span(times_s)} s; if the clocks are"
            " the same, give --odometry LOG to carry the poses"
        )


def span(times_s: FloatArray) -> str:
    """From when to when, in words."""
    return f"{times_s.min():.3f} to {times_s.max():.3f}"

"""The relations metric: a trajectory judged by motions between pairs of times, free of any frame.

Kuemmerle, Steder, Dornhege, Ruhnke, Grisetti, Stachniss and Kleiner, "On Measuring the Accuracy of
SLAM Algorithms", Autonomous Robots 27, 2009. Their relations were verified by hand; where a log has
none, `built_relations` makes some of reference poses, comparable with one another only.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.spatial import cKDTree

from slam.arrays import BoolArray, FloatArray, frozen_array
from slam.metrics.relative import RelativeErrors, errors_of_motions
from slam.pose_arrays import between
from slam.pose_lookup import PoseLookup
from slam.trajectory import Trajectory

LOOP_AFTER_S = 30.0
"""A relation between times farther apart is a loop: the robot came back. chosen: in the official
relations of intel, 1773 span less than 30 s and 0.5 m of way, 1211 more than both."""
LOOP_WITHIN_M = 1.0
"""How near a built loop ends to its start; chosen: 95 of 100 official ones of intel do."""


@dataclass(frozen=True, eq=False)
class Relations:
    """Motions between two times each: times_s (N, 2) [s], motions (N, 3) [m, m, rad].

    A motion is the robot's pose at the second time seen from that at the first one.
    Raises ValueError on other shapes or values that are not finite.
    """

    times_s: FloatArray
    motions: FloatArray

    def __post_init__(self) -> None:
        times_s = frozen_array(self.times_s, (None, 2), "times_s")
        motions = frozen_array(self.motions, (len(times_s), 3), "motions")
        if not (np.isfinite(times_s).all() and np.isfinite(motions).all()):
            raise ValueError("times_s and motions must be finite")
        object.__setattr__(self, "times_s", times_s)
        object.__setattr__(self, "motions", motions)

    def __len__(self) -> int:
        return len(self.times_s)

    @cached_property
    def is_loop(self) -> BoolArray:
        """(N,) True where the times are more than `LOOP_AFTER_S` apart; all others are sequential."""
        return np.asarray(np.abs(self.times_s[:, 1] - self.times_s[:, 0]) > LOOP_AFTER_S)


@dataclass(frozen=True)
class RelationErrors:
    """Of so many relations those that the trajectory covers, and how far it is off on these.

    worst: the times of the relation with the largest translation error, None without any.
    """

    count: int
    covered: int
    errors: RelativeErrors
    worst: tuple[float, float] | None

    @property
    def coverage(self) -> float:
        """The share that is covered; nan of none."""
        return self.covered / self.count if self.count else float("nan")


def relation_errors(relations: Relations, poses: PoseLookup) -> dict[str, RelationErrors]:
    """The errors on `all` relations, on the `loop` ones and on the `sequential` ones.

    A relation is covered where the lookup has a pose at both of its times; others count in the
    coverage alone.
    """
    estimated = between(poses.at(relations.times_s[:, 0]), poses.at(relations.times_s[:, 1]))
    everyone = np.ones(len(relations), dtype=bool)
    parts = {"all": everyone, "loop": relations.is_loop, "sequential": ~relations.is_loop}
    return {name: _errors(relations, estimated, part) for name, part in parts.items()}


def _errors(relations: Relations, estimated: FloatArray, part: BoolArray) -> RelationErrors:
    """Of some of the relations, by the motions of the estimate (N, 3), nan where it has none."""
    is_covered = part & np.isfinite(estimated).all(axis=1)
    found, true = estimated[is_covered], relations.motions[is_covered]
    worst = None
    if len(found):
        off = between(true, found)
        row = relations.times_s[is_covered][np.argmax(np.hypot(off[:, 0], off[:, 1]))]
        worst = (float(row[0]), float(row[1]))
    return RelationErrors(
        int(part.sum()), int(is_covered.sum()), errors_of_motions(found, true), worst
    )


def built_relations(reference: Trajectory) -> Relations:
    """Relations of reference poses, for logs that have no official ones.

    Sequential: each pose and the next by its stamp, where not more than `LOOP_AFTER_S` lie between.
    Loop: each pose and the nearest one that lies more than `LOOP_AFTER_S` before it, where that is
    within `LOOP_WITHIN_M`; of equally near ones the earliest. Of poses of one stamp the last counts.
    """
    ordered = reference.in_order()
    times_s, poses = ordered.times_s, ordered.poses
    firsts, seconds = np.arange(len(times_s) - 1), np.arange(1, len(times_s))
    is_near = np.diff(times_s) <= LOOP_AFTER_S
    pairs = np.column_stack([firsts, seconds])[is_near]
    loops = np.array(_loops(times_s, poses), dtype=np.int64).reshape(-1, 2)
    pairs = np.concatenate([pairs, loops])
    return Relations(times_s[pairs], between(poses[pairs[:, 0]], poses[pairs[:, 1]]))


def _loops(times_s: FloatArray, poses: FloatArray) -> list[tuple[int, int]]:
    """Pairs of rows, the earlier one first."""
    if len(times_s) == 0:
        return []
    found = []
    tree = cKDTree(poses[:, :2])
    for second, neighbours in enumerate(tree.query_ball_point(poses[:, :2], LOOP_WITHIN_M)):
        rows = np.sort(np.asarray(neighbours))
        rows = rows[times_s[rows] < times_s[second] - LOOP_AFTER_S]
        if len(rows):
            away_m = np.hypot(*(poses[rows, :2] - poses[second, :2]).T)
            found.append((int(rows[np.argmin(away_m)]), second))
    return found

"""What mapping keeps of a drive: keyframes, and where each scan was placed."""

from __future__ import annotations

import enum
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any, ClassVar, TypeVar

import numpy as np

from slam.arrays import FloatArray
from slam.beams import Beams
from slam.frontend.remaining import Remaining
from slam.frontend.told_steps import ToldStep
from slam.packed import PackedRows
from slam.pose_arrays import between, composed
from slam.records import record
from slam.se2 import SE2
from slam.surface.surface_map import faced
from slam.surface.views import Glance

_NO_POINTS: FloatArray = np.empty((0, 2))
_NO_BEAMS = Beams(np.empty((0, 2)), np.empty(0), np.empty(0))


class StepStatus(enum.Enum):
    """How a scan was placed."""

    MATCHED = "matched"
    SEARCHED = "searched"  # not where the wheels led, but found near by
    CARRIED = "carried"  # by the wheels alone: the scan tells nothing
    BROKEN = "broken"  # nothing near by explains the scan: a new submap begins


@dataclass(frozen=True, eq=False)
class Keyframe:
    """A scan that the map is made of.

    T_map_base: where the front end placed it. T_before: its pose as seen from the keyframe before
    (identity for the first), covariance: (3, 3) of that, by wheels and scans together; told: by the
    wheels alone. points: (N, 2) [m], base frame; beams: the
    scan itself. is_break: the scans broke off before it. session: in which it was taken, from 0;
    T_map_base is in the frame of that session, which its first scan is the origin of. glances: some
    of the scans between it and the next. is_after_gap: others between the one before and it were let
    go, see `Remaining`.
    """

    time_s: float
    T_map_base: SE2
    T_before: SE2
    covariance: FloatArray
    points: FloatArray
    beams: Beams
    is_break: bool
    session: int = 0
    glances: tuple[Glance, ...] = ()
    told: ToldStep = field(default_factory=ToldStep.unknown)
    is_after_gap: bool = False

    @cached_property
    def faced(self) -> FloatArray:
        """(N, 3) the points, and where their surfaces face: see `slam.surface.surface_map`."""
        return faced(self.points, self.beams.middle_m)

    @property
    def is_place_alone(self) -> bool:
        """Whether only its place is kept: others saw what it saw."""
        return len(self.beams) == 0

    @property
    def goes_on(self) -> bool:
        """Whether it was taken next to the one before, and scans did not break off in between."""
        return not (self.is_break or self.is_after_gap)

    def after_gap(self, way: ToldStep) -> Keyframe:
        """The same after others that were let go, with the way past these."""
        return replace(
            self, T_before=way.motion, covariance=way.covariance, told=ToldStep.unknown(),
            is_after_gap=True,
        )  # fmt: skip

    def place_alone(self) -> Keyframe:
        """The same without its scan and glances."""
        return replace(self, points=_NO_POINTS, beams=_NO_BEAMS, glances=())

    @staticmethod
    def of_place(
        time_s: float,
        T_map_base: SE2,
        T_before: SE2,
        covariance: FloatArray,
        *,
        is_break: bool,
        session: int,
        told: ToldStep,
        is_after_gap: bool,
    ) -> Keyframe:
        """One without a scan."""
        return Keyframe(
            time_s, T_map_base, T_before, covariance, _NO_POINTS, _NO_BEAMS, is_break, session,
            told=told, is_after_gap=is_after_gap,
        )  # fmt: skip


def as_sure_as_before(
    keyframes: Sequence[Keyframe], changed: Mapping[int, tuple[FloatArray, FloatArray]]
) -> list[Keyframe]:
    """Keyframes, those again as sure as they were before whose covariances were changed, but those of which
    something else is known by now. changed: of these, by their number, the covariance (3, 3) since, and before."""
    found = list(keyframes)
    for k, (since, before) in changed.items():
        if np.array_equal(found[k].covariance, since):
            found[k] = replace(found[k], covariance=before)
    return found


def said_of(
    changed: Mapping[int, tuple[FloatArray, FloatArray]], remaining: Remaining
) -> dict[int, tuple[FloatArray, FloatArray]]:
    """What was changed of keyframes that remain, see `as_sure_as_before`, by their numbers then."""
    return {remaining.number(k): said for k, said in changed.items() if remaining.is_kept[k]}


@record
class FrontEndStep:
    """Where a scan was placed: as seen from the keyframe of that index (-1: the origin of its
    session, if that has none); and how well it fits. T_map_base: as in `Keyframe`. is_open: the scan
    itself leaves a direction open, as between two walls. passed_ratio: share of what a keyframe shortly
    before shows in its view that its beams went through. is_tied: it moved the scans before it."""

    time_s: float
    keyframe: int
    T_keyframe_base: SE2
    T_map_base: SE2
    status: StepStatus
    inlier_ratio: float
    is_keyframe: bool
    session: int = 0
    is_open: bool = False
    passed_ratio: float = 0.0
    is_tied: bool = False

    @property
    def is_seen(self) -> bool:
        """Whether the scan itself told where it was taken."""
        return self.status in (StepStatus.MATCHED, StepStatus.SEARCHED)

    def placed(self, poses: FloatArray) -> SE2:
        """Where it was taken, with keyframes at poses (K, 3)."""
        if self.keyframe < 0:
            return self.T_keyframe_base
        return SE2.from_array(poses[self.keyframe]) @ self.T_keyframe_base


_WAY = "x_m", "y_m", "theta_rad"
STATUSES = tuple(StepStatus)
"""By the numbers that are kept of them."""


class FrontEndSteps(PackedRows[FrontEndStep]):
    """Where each scan of a drive was placed: 90 bytes a scan."""

    DTYPE: ClassVar[np.dtype[Any]] = np.dtype(
        [
            ("time_s", "f8"), ("keyframe", "i4"), ("x_m", "f8"), ("y_m", "f8"), ("theta_rad", "f8"),
            ("map_x_m", "f8"), ("map_y_m", "f8"), ("map_theta_rad", "f8"), ("status", "u1"),
            ("inlier_ratio", "f8"), ("is_keyframe", "?"), ("session", "i4"), ("is_open", "?"),
            ("passed_ratio", "f8"), ("is_tied", "?"),
        ]
    )  # fmt: skip

    @staticmethod
    def packed(thing: FrontEndStep) -> tuple[Any, ...]:
        """See `PackedRows`."""
        here, there = thing.T_keyframe_base, thing.T_map_base
        return (
            thing.time_s, thing.keyframe, here.x, here.y, here.theta, there.x, there.y, there.theta,
            STATUSES.index(thing.status), thing.inlier_ratio, thing.is_keyframe, thing.session,
            thing.is_open, thing.passed_ratio, thing.is_tied,
        )  # fmt: skip

    @staticmethod
    def unpacked(row: tuple[Any, ...]) -> FrontEndStep:
        """See `PackedRows`."""
        time_s, keyframe, x, y, theta, map_x, map_y, map_theta, status, *rest = row
        return FrontEndStep(
            time_s,
            keyframe,
            SE2(x, y, theta),
            SE2(map_x, map_y, map_theta),
            STATUSES[status],
            *rest,
        )

    def renumber(self, remaining: Remaining, poses: FloatArray) -> None:
        """Has scans that were seen from keyframes which are let go, at poses (K, 3), seen from those beside them."""
        first_gone = int(np.argmin(remaining.is_kept))
        for rows in self._filled():
            keyframes = rows["keyframe"]
            if keyframes.max(initial=-1) < first_gone:  # as most of a long drive
                continue
            is_gone = ~remaining.is_kept[keyframes] & (keyframes >= 0)
            if is_gone.any():
                gone = keyframes[is_gone]
                anchors = remaining.anchors[gone]
                ways = np.stack([rows[name][is_gone] for name in _WAY], axis=1)
                ways = composed(between(poses[anchors], poses[gone]), ways)
                for name, values in zip(_WAY, ways.T, strict=True):
                    rows[name][is_gone] = values
                rows["is_keyframe"][is_gone] = False
                keyframes[is_gone] = anchors
            keyframes[:] = np.where(keyframes < 0, keyframes, remaining.numbers[keyframes])


Steps = TypeVar("Steps", list[FrontEndStep], FrontEndSteps)
"""Of which `copy.copy` makes others, to be changed."""


def scan_poses(steps: Sequence[FrontEndStep], poses: FloatArray) -> tuple[FloatArray, FloatArray]:
    """When (N,) [s] and where (N, 3) scans were taken, with keyframes at poses (K, 3)."""
    told = ((step.time_s, *step.placed(poses).as_array().tolist()) for step in steps)
    rows: FloatArray = np.fromiter(told, np.dtype((np.float64, 4)), len(steps))
    return rows[:, 0], rows[:, 1:]


def keyframe_ways(steps: Sequence[FrontEndStep], first_step: int) -> list[tuple[int, int]]:
    """Of the scans from first_step on: each that is a keyframe's, and the next such one, where all in between are seen
    from the first."""
    ways, start, keyframe = list[tuple[int, int]](), -1, -1
    for at in range(first_step, len(steps)):
        step = steps[at]
        if step.is_keyframe:
            if start >= 0:
                ways.append((start, at))
            start, keyframe = at, step.keyframe
        elif step.keyframe != keyframe:  # those next to it were let go
            start = -1
    return ways

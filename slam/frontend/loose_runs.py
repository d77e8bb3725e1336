"""Scans that do not say where they were taken: placed once more when the next one does."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from copy import copy
from dataclasses import dataclass, replace
from typing import Any, ClassVar

import numpy as np

from slam.arrays import FloatArray
from slam.frontend.keyframes import FrontEndStep, FrontEndSteps, Keyframe, Steps
from slam.frontend.remaining import Remaining
from slam.kernels.normal_equations import inverse_of
from slam.packed import PackedRows
from slam.records import record
from slam.se2 import SE2


@record
class LooseScan:
    """A scan placed by the wheels, or by them along what it leaves open; covariance: (3, 3) of its
    pose. T_next, next_covariance: of the scan after it, by the wheels from there; trust: of its
    normalised error squared, up to which they led there; beyond, doubted: (3, 3) is what is known."""

    T_map_base: SE2
    covariance: FloatArray
    T_next: SE2
    next_covariance: FloatArray
    doubted: FloatArray
    trust: float

    def smoothed(self, T_next: SE2) -> SE2:
        """Its pose, where the scan after it shows to have been taken at another one than the wheels said.

        The smoother of Rauch, Tung and Striebel (1965), a step of it.
        """
        back = (self.T_next.inverse() @ self.T_map_base).adjoint()
        off, information = (self.T_next.inverse() @ T_next).log(), inverse_of(self.next_covariance)
        if off @ information @ off > self.trust:
            information = inverse_of(self.doubted)
        return self.T_map_base @ SE2.exp(self.covariance @ back.T @ information @ off)


class LooseScans(PackedRows[LooseScan]):
    """Loose scans one after the other: 270 bytes a scan."""

    DTYPE: ClassVar[np.dtype[Any]] = np.dtype([(f"of_{k}", "f8") for k in range(34)])

    @staticmethod
    def packed(thing: LooseScan) -> tuple[Any, ...]:
        """See `PackedRows`."""
        here, there = thing.T_map_base, thing.T_next
        matrices = thing.covariance, thing.next_covariance, thing.doubted
        numbers = np.concatenate([one.ravel() for one in matrices]).tolist()
        return here.x, here.y, here.theta, there.x, there.y, there.theta, thing.trust, *numbers

    @staticmethod
    def unpacked(row: tuple[Any, ...]) -> LooseScan:
        """See `PackedRows`."""
        covariance, next_covariance, doubted = np.array(row[7:]).reshape(3, 3, 3)
        here, there, trust = SE2(*row[:3]), SE2(*row[3:6]), row[6]
        return LooseScan(here, covariance, there, next_covariance, doubted, trust)


@dataclass(frozen=True, eq=False)
class LooseRun:
    """Loose scans one after the other, up to one that is not, or to a keyframe; first: number of the
    first of them in its session, from 0."""

    first: int
    scans: LooseScans

    def smoothed(self, T_seen: SE2) -> list[SE2]:
        """The poses, as the one of the scan after them shows."""
        return list(self._back_from(T_seen))[::-1]

    def _back_from(self, T_next: SE2) -> Iterator[SE2]:
        for scan in reversed(self.scans):
            T_next = scan.smoothed(T_next)
            yield T_next


class LooseRuns:
    """Collects the runs of a session while it is driven."""

    def __init__(self) -> None:
        self.ended: list[LooseRun] = []
        self._first = 0
        self._scans = LooseScans()
        self._last: tuple[SE2, FloatArray] | None = None

    def lead_to(
        self, T_next: SE2, covariance: FloatArray, doubted: FloatArray, trust: float
    ) -> None:
        """Where the wheels lead from the last scan, and the covariance (3, 3) of that; doubted: of it,
        if they were wrong there by more than trust; see `LooseScan`."""
        if self._last is not None:
            self._scans.append(LooseScan(*self._last, T_next, covariance, doubted, trust))
            self._last = None

    def add(self, number: int, T_map_base: SE2, covariance: FloatArray) -> None:
        """One more loose scan of the session."""
        if not self._scans:
            self._first = number
        self._last = T_map_base, covariance

    def end(self) -> None:
        """A scan says where it was taken, or is a keyframe."""
        if self._scans:
            self.ended.append(LooseRun(self._first, copy(self._scans)))  # no longer than it is
            self._scans = LooseScans()

    def settled(
        self, steps: Sequence[FrontEndStep], first_step: int, remaining: Remaining
    ) -> list[LooseRun]:
        """Takes out the runs that keyframes tell of which are let go; steps: all, those of the session from first_step
        on."""
        is_kept = remaining.is_kept

        def stays(run: LooseRun) -> bool:
            first = first_step + run.first
            ends = steps[first].keyframe, steps[first + len(run.scans)].keyframe
            return all(k < 0 or is_kept[k] for k in ends)

        gone = [run for run in self.ended if not stays(run)]
        self.ended = [run for run in self.ended if stays(run)] if gone else self.ended
        return gone


def smoothed(
    steps: Steps,
    runs: Sequence[LooseRun],
    first_step: int,
    keyframes: Sequence[Keyframe],
    poses: FloatArray,
) -> Steps:
    """All steps, those of the runs of the last session, which begins with first_step, as the poses
    (K, 3) of keyframes show them that saw before and after."""
    moved = copy(steps)
    smooth(moved, runs, first_step, keyframes, poses)
    return moved


def smooth(
    steps: list[FrontEndStep] | FrontEndSteps,
    runs: Sequence[LooseRun],
    first_step: int,
    keyframes: Sequence[Keyframe],
    poses: FloatArray,
) -> None:
    """The same, in place."""
    for run in runs:
        first = first_step + run.first
        k, seen = steps[first].keyframe, steps[first + len(run.scans)]
        if k < 0 or seen.keyframe < 0:
            continue
        T_seen = seen.placed(poses)
        # as seen from the keyframe before, which has a pose of its own in the front end
        T_before = keyframes[k].T_map_base
        T_before_seen = SE2.from_array(poses[k]).inverse() @ T_seen
        for at, T in enumerate(run.smoothed(T_before @ T_before_seen), start=first):
            steps[at] = replace(steps[at], T_map_base=T, T_keyframe_base=T_before.inverse() @ T)

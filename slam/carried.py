"""Scans that tell nothing, placed by the wheels: once more when it is known where these led."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

from slam.arrays import FloatArray
from slam.kernels.normal_equations import inverse_of
from slam.keyframes import FrontEndStep, Keyframe
from slam.se2 import SE2


@dataclass(frozen=True, eq=False)
class CarriedRun:
    """Scans placed by the wheels alone, one after the other, up to one that sees again.

    first: number of the first of them in its session, from 0. placed: pose of each, and the covariance
    (3, 3) that it has grown to since the last scan that saw. T_predicted, covariance: of the scan
    that sees again, by the wheels.
    """

    first: int
    placed: tuple[tuple[SE2, FloatArray], ...]
    T_predicted: SE2
    covariance: FloatArray

    def smoothed(self, T_seen: SE2) -> list[SE2]:
        """The poses, where the scan that sees again shows to have been taken at another one.

        The smoother of Rauch, Tung and Striebel (1965): nothing was measured in between, so that
        its way back is one step.
        """
        off = inverse_of(self.covariance) @ (self.T_predicted.inverse() @ T_seen).log()
        back = self.T_predicted.inverse()
        return [T @ SE2.exp(P @ (back @ T).adjoint().T @ off) for T, P in self.placed]


class Carried:
    """Collects the runs of a session while it is driven."""

    def __init__(self) -> None:
        self.runs: list[CarriedRun] = []
        self._first = 0
        self._placed: list[tuple[SE2, FloatArray]] = []

    def add(self, number: int, T_map_base: SE2, covariance: FloatArray) -> None:
        """One more scan of the session placed by the wheels."""
        if not self._placed:
            self._first = number
        self._placed.append((T_map_base, covariance))

    def end(self, T_predicted: SE2, covariance: FloatArray) -> None:
        """A scan sees again."""
        if self._placed:
            self.runs.append(CarriedRun(self._first, tuple(self._placed), T_predicted, covariance))
            self._placed = []


def smoothed(
    steps: Sequence[FrontEndStep],
    runs: Sequence[CarriedRun],
    first_step: int,
    keyframes: Sequence[Keyframe],
    poses: FloatArray,
) -> list[FrontEndStep]:
    """All steps, those of the runs of the last session, which begins with first_step, as the poses
    (K, 3) of keyframes show them that saw before and after."""
    moved = list(steps)
    for run in runs:
        first = first_step + run.first
        k, seen = steps[first].keyframe, steps[first + len(run.placed)]
        if k < 0 or seen.keyframe < 0:
            continue
        T_seen = SE2.from_array(poses[seen.keyframe]) @ seen.T_keyframe_base
        # as seen from the keyframe before, which has a pose of its own in the front end
        T_before = keyframes[k].T_map_base
        T_before_seen = SE2.from_array(poses[k]).inverse() @ T_seen
        for at, T in enumerate(run.smoothed(T_before @ T_before_seen), start=first):
            moved[at] = replace(steps[at], T_map_base=T, T_keyframe_base=T_before.inverse() @ T)
    return moved

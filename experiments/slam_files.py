"""The files that mapping a log leaves."""

from __future__ import annotations

import json
import shutil
from pathlib import Path
from typing import TextIO

import numpy as np

from experiments.slam_result import SlamLog
from experiments.trial_log import write_atomically
from slam.files.map_files import write_map
from slam.files.point_files import write_ply
from slam.files.slam_map_files import write_slam_map
from slam.mapping import MapperStep
from slam.occupancy_grid import OccupancyGrid
from slam.pose_graph import write_g2o
from slam.ray_counts import TooManyCellsError
from slam.slam_map import SlamMap
from slam.trajectory import TUM_HEADER, Trajectory, tum_lines, write_tum

SOMETIMES = ("sessions.tum", "map.yaml", "map.pgm")
"""Files of `write_results` that not every map has."""


class OnlinePoses:
    """online.tum in a folder: the pose of each scan as it was when the scan had arrived, a line each,
    there to be read (`tail -f`) before the next scan is looked at.

    Of a log that is mapped more than once, the first time; another pass has online-2.tum and so on
    until the end, and `keep` hands on that of the map that is used. Results that were finished before
    stay as they are until there are others: their online.tum is laid aside, an empty file if they had
    none, and comes back unless it was removed with all that is `outdated`. Raises OSError if it cannot
    write. Within `results_of_one`, which refuses folders in the places of files.
    """

    def __init__(self, folder: Path) -> None:
        self._folder, self._passes = folder, 0
        self._file: TextIO | None = None
        self._aside = folder / ".online.tum"

    def __enter__(self) -> OnlinePoses:
        self._bring_back()  # of a command that was killed
        return self

    def __exit__(self, *_: object) -> None:
        try:
            self._close()  # what a full disk did not take is written once more
        finally:
            if self._passes > 0:
                self._remove_later_passes()
            self._bring_back()

    @property
    def outdated(self) -> tuple[str, ...]:
        """Names of what goes as soon as there are results: see `results_together`."""
        return tuple(path.name for path in (self._aside, *self._later_passes()))

    def add(self, index: int, step: MapperStep) -> None:
        """One more scan is placed; index 0 begins anew."""
        if index == 0 or self._file is None:
            self._close()
            self._folder.mkdir(parents=True, exist_ok=True)
            if self._passes == 0:
                self._lay_aside()
            self._file = self._path(self._passes).open("w", encoding="utf-8")
            self._passes += 1
            self._file.write(TUM_HEADER + "\n")
        pose = Trajectory(np.array([step.time_s]), step.T_map_base.as_array()[np.newaxis])
        self._file.write(next(tum_lines(pose)) + "\n")
        self._file.flush()

    def keep(self, used_pass: int, unfinished: Path) -> None:
        """Puts the poses of one pass, from 0, among the results that are not finished, as online.tum."""
        self._close()
        shutil.copyfile(self._path(used_pass), unfinished / "online.tum")

    def _lay_aside(self) -> None:
        """What is left of results that are finished; of those that are not, it goes."""
        self._remove_later_passes()
        if not (self._folder / "summary.json").exists():
            return
        if self._path(0).exists():
            self._path(0).replace(self._aside)
        else:
            self._aside.touch()

    def _bring_back(self) -> None:
        if not self._aside.exists():
            return
        self._remove_later_passes()
        if self._aside.stat().st_size > 0:
            self._aside.replace(self._path(0))
        else:
            self._path(0).unlink(missing_ok=True)
            self._aside.unlink()

    def _later_passes(self) -> list[Path]:
        return sorted(self._folder.glob("online-[0-9]*.tum"))

    def _remove_later_passes(self) -> None:
        for path in self._later_passes():
            path.unlink()

    def _close(self) -> None:
        if self._file is not None:
            self._file.close()

    def _path(self, number: int) -> Path:
        """Of a pass, from 0."""
        return self._folder / ("online.tum" if number == 0 else f"online-{number + 1}.tum")


def write_results(result: SlamLog, folder: Path) -> str:
    """Writes summary.json, trajectory.tum, points.ply, pose_graph.g2o, map.kitasap, map.yaml, map.pgm
    into a folder that has none of them, or where they are written over: see `results_together`.

    points.ply: the point database, 2 cm apart on all surfaces, x y z [m] in the map frame, z = 0.
    Of a map of several sessions sessions.tum too: the scans of all, each session below its number.
    Returns in words what could not be written, "" otherwise: the grid of what spans too many cells.
    Raises OSError if it cannot; ValueError, with nothing written, for a map without any scan.
    """
    grid, said = grid_or_reason(result.slam_map)
    folder.mkdir(parents=True, exist_ok=True)
    write_tum(folder / "trajectory.tum", result.trajectory)
    if result.slam_map.session_count > 1:
        write_atomically(folder / "sessions.tum", _sessions_tum(result.slam_map))
    write_ply(folder / "points.ply", result.slam_map.points)
    write_g2o(folder / "pose_graph.g2o", result.slam_map.graph)
    write_slam_map(folder / "map.kitasap", result.slam_map)
    if grid is not None:
        write_map(folder / "map.yaml", grid)
    write_atomically(folder / "summary.json", json.dumps(result.summary(), indent=2) + "\n")
    return said


def grid_or_reason(slam_map: SlamMap) -> tuple[OccupancyGrid | None, str]:
    """The occupancy grid; or None, and why map.yaml and map.pgm cannot be written.

    Raises ValueError for a map without any scan.
    """
    try:
        return slam_map.grid(), ""
    except TooManyCellsError as error:
        return None, f"map.yaml and map.pgm could not be written: {error}"


def _sessions_tum(slam_map: SlamMap) -> str:
    lines = [TUM_HEADER]
    for number in range(slam_map.session_count):
        said = ", never joined with those before" if number in slam_map.unjoined else ""
        lines.append(f"# session {number + 1}{said}")
        lines += tum_lines(slam_map.trajectory_of(number))
    return "\n".join(lines) + "\n"

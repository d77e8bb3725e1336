"""A stream to Rerun: maps, robots, scans and verdicts, live in a viewer or kept in a file.

Everything lies flat in the map's frame, at z = 0.
"""

from __future__ import annotations

import math
import os
import re
import socket
import sys
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from importlib.util import find_spec
from pathlib import Path
from types import TracebackType
from typing import Any

import numpy as np

from experiments.outputs import checked_file
from slam.arrays import FloatArray
from slam.occupancy_grid import OccupancyGrid
from slam.se2 import SE2

VIEWER = ""
"""What is typed for a viewer, where a file could be named."""
_PORT = 9876
_TIME, _SCAN = "time", "scan"
_COLOURS = {"truth": (44, 160, 44), "odometry": (130, 130, 130)}
_OTHER_COLOURS = ((31, 119, 180), (255, 127, 14), (148, 103, 189), (23, 190, 207), (227, 119, 194))
_ROBOT_M = 0.15
"""Chosen: half of what is drawn of a robot, big enough to be seen in a building."""
_PIECE = 128
"""Chosen: poses of a path that are sent again with each new one, as one line."""
_LEVELS = {"tracking": "INFO", "matched": "INFO", "unsure": "WARN", "searched": "WARN"}


def checked_stream(wanted: str | None) -> str | None:
    """What was typed behind --rerun, None if nothing, where something can be streamed there.

    Raises ImportError without the library, ValueError for what is no new .rrd file, OSError where
    no file can be written or no viewer listens.
    """
    if wanted is None:
        return None
    if find_spec("rerun") is None:
        raise ImportError("--rerun needs the library rerun: pip install 'kitasap[rerun]'")
    if wanted == VIEWER:
        if not _has_display() and not _is_listening():
            raise ConnectionError(
                f"no display, and no Rerun viewer listens on 127.0.0.1:{_PORT}: start one with"
                " `rerun --serve-web --bind 127.0.0.1`, or name a file: --rerun FILE.rrd"
            )
        return wanted
    path = Path(wanted)
    if path.suffix != ".rrd":
        raise ValueError(f"--rerun takes a file named *.rrd, or nothing for a viewer: not {path}")
    if path.exists():
        raise ValueError(f"{path} is there already, and is not written over: move it away")
    checked_file(path)
    return wanted


def _has_display() -> bool:
    is_windowed = sys.platform in ("darwin", "win32")
    return is_windowed or bool(os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY"))


def _is_listening() -> bool:
    try:
        with socket.create_connection(("127.0.0.1", _PORT), timeout=1.0):
            return True
    except OSError:
        return False


@contextmanager
def shown(wanted: str | None, name: str) -> Iterator[RerunStream | None]:
    """The stream that was asked for by what was typed behind --rerun; None of none.

    name: of the recording. Raises as `checked_stream` does.
    """
    target = checked_stream(wanted)
    if target is None:
        yield None
        return
    with RerunStream(target, name) as stream:
        yield stream
    if target != VIEWER:
        print(f"Rerun recording: {target}", file=sys.stderr)


class RerunStream:
    """A recording under way. A file appears whole with the end of its context, or not at all.

    target: as `checked_stream` returns it. name: of the recording. What is shown is of the time last
    set by `at`; before the first, of all times.
    """

    def __init__(self, target: str, name: str) -> None:
        import rerun as rr

        self._rr: Any = rr
        self._target = Path(target) if target != VIEWER else None
        self._name = name
        self._paths: dict[str, list[FloatArray]] = {}
        self._said: dict[str, str] = {}
        self._colours: dict[str, tuple[int, int, int]] = {}
        self._time_s = -math.inf

    def __enter__(self) -> RerunStream:
        rr = self._rr
        rr.set_strict_mode(True)  # what cannot be shown is an error, not a warning
        self._recording = rr.RecordingStream("kitasap")
        # when the computer got to it says nothing of the drive
        self._recording.set_log_time_enabled(False)
        self._recording.set_log_tick_enabled(False)
        if self._target is not None:
            self._target.parent.mkdir(parents=True, exist_ok=True)
            self._unfinished = self._target.with_name(f".{self._target.name}.{os.getpid()}")
            self._recording.save(self._unfinished, default_blueprint=_blueprint())
        elif _has_display():
            self._recording.spawn(default_blueprint=_blueprint())
        else:
            self._recording.connect_grpc(default_blueprint=_blueprint())
        self._recording.send_recording_name(self._name)
        self._log("/", rr.ViewCoordinates.RIGHT_HAND_Z_UP)
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        self._recording.disconnect()
        if self._target is None:
            return
        if kind is None:
            os.replace(self._unfinished, self._target)
        else:
            self._unfinished.unlink(missing_ok=True)

    def at(self, time_s: float, scan: int) -> None:
        """What follows is of a time [s], and of a scan by its number."""
        self._time_s = max(time_s, self._time_s)  # stamps of recorded logs may go back
        self._recording.set_time(_TIME, duration=self._time_s)
        self._recording.set_time(_SCAN, sequence=scan)

    def grid(self, grid: OccupancyGrid) -> None:
        """The map as cells."""
        rr = self._rr
        rows, columns = grid.cells.shape
        # an image begins with its uppermost row, and the viewer lays it upwards of the corner
        pixels = np.ascontiguousarray(np.flipud(grid.cells))
        origin = grid.T_map_grid
        self._log(
            "map/grid",
            rr.GridMap(
                data=pixels.tobytes(),
                format=rr.components.ImageFormat(
                    width=columns, height=rows, color_model="L", channel_datatype="U8"
                ),
                cell_size=grid.resolution_m,
                translation=[origin.x, origin.y, -0.01],
                quaternion=_quaternion(origin.theta),
                colormap=rr.components.Colormap.RvizMap,
            ),
        )

    def walls(self, segments_m: FloatArray) -> None:
        """The map as straight walls (S, 2, 2) [m]."""
        self._log("map/walls", self._rr.LineStrips3D(_flat(segments_m), colors=[(60, 60, 60)]))

    def points(self, name: str, points_m: FloatArray) -> None:
        """Points (N, 2) [m] of the map that a method has made so far."""
        points = self._rr.Points3D(_flat(points_m), colors=[self._colour(name)], radii=[-1.0])
        self._log(f"map/{_part(name)}", points)

    def places(self, name: str, poses: Sequence[SE2]) -> None:
        """Where a method that is not sure may be."""
        outlines = [_flat(pose @ _OUTLINE_M) for pose in poses]
        strips = self._rr.LineStrips3D(outlines, colors=[self._colour(name)], radii=[-0.7])
        self._log(f"{_part(name)}/places", strips)

    def path(self, name: str, points_m: FloatArray) -> None:
        """A whole path (N, 2) [m] at once, in place of what `robot` drew of it."""
        self._log(f"{name}/path", self._rr.Clear(recursive=True))
        self._line(f"{name}/path", points_m, name)

    def robot(self, name: str, T_map_base: SE2 | None, scan_m: FloatArray | None = None) -> None:
        """Where one says that the robot is, None: nowhere; and its scan (N, 2) [m] seen from there."""
        rr = self._rr
        if T_map_base is None:
            self._log(f"{name}/base", rr.Clear(recursive=True))
            self._paths.pop(name, None)  # it goes on elsewhere
            return
        x, y, theta = T_map_base.as_array()
        self._log(
            f"{name}/base",
            rr.Transform3D(translation=[x, y, 0.0], quaternion=_quaternion(theta)),
        )
        self._log(
            f"{name}/base/robot",
            rr.LineStrips3D([_flat(_OUTLINE_M)], colors=[self._colour(name)], radii=[0.01]),
        )
        if scan_m is not None:
            colours = [self._colour(name)]
            scan = rr.Points3D(_flat(scan_m), colors=colours, radii=[-1.5])
            self._log(f"{name}/base/scan", scan)
        self._extend(name, T_map_base)

    def says(self, name: str, status: str, reasons: tuple[str, ...] = ()) -> None:
        """A verdict in words; one that is said again is not repeated."""
        text = f"{name}: {status}" + "".join(f"; {reason}" for reason in reasons)
        if self._said.get(name) != text:
            level = _LEVELS.get(status, "ERROR")
            self._log(f"verdict/{_part(name)}", self._rr.TextLog(text, level=level))
        self._said[name] = text

    def value(self, name: str, value: float) -> None:
        """A number to be drawn over time; one that is not finite is left out."""
        if math.isfinite(value):
            self._log(f"values/{name}", self._rr.Scalars(value))

    def clear(self) -> None:
        """Takes off all that was shown, as of a pass that is begun anew."""
        self._log("/", self._rr.Clear(recursive=True))
        self._paths.clear()
        self._said.clear()

    def _extend(self, name: str, T_map_base: SE2) -> None:
        """One more pose of a path, which is sent in pieces: the whole each time would be too much."""
        path = self._paths.setdefault(name, [])
        path.append(T_map_base.as_array()[:2])
        number = (len(path) - 1) // _PIECE
        piece = path[max(number * _PIECE - 1, 0) :]
        if len(piece) > 1:
            self._line(f"{name}/path/{number}", np.array(piece), name)

    def _line(self, entity: str, points_m: FloatArray, name: str) -> None:
        strip = self._rr.LineStrips3D([_flat(points_m)], colors=[self._colour(name)], radii=[-1.0])
        self._log(entity, strip)

    def _colour(self, name: str) -> tuple[int, int, int]:
        if name in _COLOURS:
            return _COLOURS[name]
        return self._colours.setdefault(
            name, _OTHER_COLOURS[len(self._colours) % len(_OTHER_COLOURS)]
        )

    def _log(self, entity: str, what: Any) -> None:
        self._recording.log(entity, what, static=math.isinf(self._time_s))


_OUTLINE_M = _ROBOT_M * np.array([[1.0, 0.0], [-0.7, 0.7], [-0.3, 0.0], [-0.7, -0.7], [1.0, 0.0]])


def _flat(points_m: FloatArray) -> FloatArray:
    """Points (..., 2) on the floor (..., 3)."""
    return np.concatenate([points_m, np.zeros((*points_m.shape[:-1], 1))], axis=-1)


def _quaternion(theta_rad: float) -> list[float]:
    return [0.0, 0.0, math.sin(theta_rad / 2.0), math.cos(theta_rad / 2.0)]


def _part(name: str) -> str:
    """A name as part of an entity's."""
    return re.sub(r"[^\w-]", "_", name)


def _blueprint() -> Any:
    """What a viewer shows first: the map, beside it verdicts and numbers."""
    import rerun.blueprint as rrb

    above = rrb.Spatial3DView(
        origin="/", name="map", background=[250, 250, 250],
        contents=["+ /**", "- /verdict/**", "- /values/**"],
    )  # fmt: skip
    beside = rrb.Vertical(
        rrb.TextLogView(origin="/verdict", name="verdicts"),
        rrb.TimeSeriesView(origin="/values", name="values"),
    )
    return rrb.Blueprint(
        rrb.Horizontal(above, beside, column_shares=[3, 2]),
        rrb.TimePanel(timeline=_TIME),
        collapse_panels=True,
    )

"""Maps kept in a file: keyframes, loops and every scan's place, to be localised in or continued."""

from __future__ import annotations

import io
import lzma
import tokenize
import zipfile
import zlib
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from slam.arrays import FloatArray
from slam.beams import Beams
from slam.files.slam_map_checks import MAY_BE_INFINITE, check_arrays
from slam.files.whole_files import read_at_most, write_whole
from slam.frontend.keyframes import STATUSES, FrontEndStep, FrontEndSteps, Keyframe
from slam.frontend.told_steps import ToldStep
from slam.loop_closing import Loop
from slam.map_checks.map_consistency import MapVerdict
from slam.se2 import SE2
from slam.slam_map import SlamMap, graph_of
from slam.surface.views import Glance

VERSION = 7
"""Of version 1 a map had one session, and did not say so; before 3, keyframes had no glances;
before 4, no loop was a tie; before 5, no scan left open how far along it was taken; before 6,
nobody kept what the wheels alone had told; before 7, no keyframe was let go."""
_KIND = "kitasap slam map"
_DATE = (1980, 1, 1, 0, 0, 0)
"""Of the members: equal maps make equal bytes."""
_GLANCES = (
    "glance_ways",
    "glance_origins_m",
    "glance_beam_counts",
    "glance_angles_rad",
    "glance_ranges_m",
)
_MOST_BYTES = 250_000_000
"""Chosen: of a drive of 5437 scans it is 20 MB; the arrays and the map made of them are as much each."""
_Arrays = dict[str, np.ndarray]
_DAMAGES = (
    *(zipfile.BadZipFile, zlib.error, lzma.LZMAError, OSError, EOFError),
    *(KeyError, ValueError, TypeError, NotImplementedError, RuntimeError, OverflowError),
    *(MemoryError, SyntaxError, tokenize.TokenError),
)
"""What zipfile and NumPy raise on files that are cut, changed, locked by a password or something else; OSError
on what says that bzip2 packed it, and is in memory by then."""


def write_slam_map(path: str | Path, slam_map: SlamMap) -> None:
    """Writes a map into one file, a zip of NumPy arrays. It is there whole or not at all.

    Raises OSError when the folder cannot be written.
    """
    content = io.BytesIO()
    with zipfile.ZipFile(content, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, array in _arrays_of(slam_map).items():
            member = io.BytesIO()
            np.lib.format.write_array(member, np.asarray(array), allow_pickle=False)
            info = zipfile.ZipInfo(f"{name}.npy", _DATE)
            info.compress_type = zipfile.ZIP_DEFLATED
            archive.writestr(info, member.getvalue())
    write_whole(Path(path), content.getvalue())


def read_slam_map(path: str | Path) -> SlamMap:
    """The map in a file of `write_slam_map`.

    Raises ValueError, one line that names the file, for one that is cut, damaged, of another kind
    or of a later version; OSError when it cannot be opened.
    """
    path = Path(path)
    content = read_at_most(path, _MOST_BYTES)
    try:
        # an array of more numbers than there are is refused, and no warning
        with zipfile.ZipFile(io.BytesIO(content)) as archive, np.errstate(all="ignore"):
            # no member gives more than it says
            if sum(member.file_size for member in archive.infolist()) > _MOST_BYTES:
                raise ValueError(f"more than the {_MOST_BYTES / 1e6:g} MB that are read of one")
            arrays = {
                name.removesuffix(".npy"): np.lib.format.read_array(
                    io.BytesIO(archive.read(name)), allow_pickle=False
                )
                for name in archive.namelist()
            }
        kind, version = str(arrays["kind"]), int(arrays["version"])
    except _DAMAGES as error:
        said = f"it has no {error}" if isinstance(error, KeyError) else str(error)
        raise ValueError(
            f"{path}: expected a map written by this library, and it is cut, damaged or"
            f" something else ({' '.join(said.split())[:200]})"
        ) from None
    if kind != _KIND:
        raise ValueError(f"{path}: expected a {_KIND}, not a {kind[:80]!r}")
    if not 1 <= version <= VERSION:
        raise ValueError(
            f"{path}: its version is {version}, and this library reads"
            f" 1 to {VERSION}: install the one that wrote it"
        )
    if version == 1:
        for name in ("keyframe", "step"):
            arrays[f"{name}_sessions"] = np.zeros(len(arrays[f"{name}_times_s"]), np.int64)
    if version < 3:
        arrays["glance_counts"] = np.zeros(len(arrays["keyframe_times_s"]), np.int64)
        arrays |= dict.fromkeys(_GLANCES, np.zeros(0, np.int64))
    if version < 4:
        arrays["loop_is_tie"] = np.zeros(len(arrays["loop_ends"]), np.bool_)
    if version < 5:
        arrays["step_is_open"] = np.zeros(len(arrays["step_times_s"]), np.bool_)
    if version < 6:
        told = [ToldStep.unknown()] * len(arrays["keyframe_times_s"])
        arrays |= _arrays_of_told(told)
    if version < 7:
        arrays["keyframe_is_after_gap"] = np.zeros(len(arrays["keyframe_times_s"]), np.bool_)
    try:
        check_arrays(arrays, len(STATUSES))
        for name in MAY_BE_INFINITE:  # one nan is as good as another, but some raise when converted
            arrays[name] = np.where(np.isnan(arrays[name]), np.nan, arrays[name])
        return _map_of(arrays)
    except (KeyError, IndexError, TypeError, ValueError) as error:
        raise ValueError(f"{path}: the arrays in it do not make a map ({error})") from None


def _arrays_of(slam_map: SlamMap) -> _Arrays:
    keyframes, verdict, steps = slam_map.keyframes, slam_map.verdict, slam_map.steps
    rows = steps if isinstance(steps, FrontEndSteps) else FrontEndSteps(steps)
    loops = (*slam_map.loops, *slam_map.rejected)
    glances = [glance for one in keyframes for glance in one.glances]
    return {
        "kind": np.array(_KIND),
        "version": np.array(VERSION),
        "poses": slam_map.poses,
        "keyframe_times_s": np.array([one.time_s for one in keyframes]),
        "keyframe_poses": _poses([one.T_map_base for one in keyframes]),
        "keyframe_ways": _poses([one.T_before for one in keyframes]),
        "keyframe_covariances": _stacked([one.covariance for one in keyframes], (0, 3, 3)),
        **_arrays_of_told([one.told for one in keyframes]),
        "keyframe_is_break": np.array([one.is_break for one in keyframes], dtype=np.bool_),
        "keyframe_is_after_gap": np.array([one.is_after_gap for one in keyframes], dtype=np.bool_),
        "keyframe_sessions": np.array([one.session for one in keyframes], dtype=np.int64),
        "point_counts": np.array([len(one.points) for one in keyframes], dtype=np.int64),
        "points": _joined([one.points for one in keyframes], (0, 2)),
        "beam_counts": np.array([len(one.beams) for one in keyframes], dtype=np.int64),
        "beam_origins_m": _joined([one.beams.origins_m for one in keyframes], (0, 2)),
        "beam_angles_rad": _joined([one.beams.angles_rad for one in keyframes], (0,)),
        "beam_ranges_m": _joined([one.beams.ranges_m for one in keyframes], (0,)),
        "glance_counts": np.array([len(one.glances) for one in keyframes], dtype=np.int64),
        "glance_ways": _poses([one.T_keyframe_base for one in glances]),
        "glance_origins_m": _stacked([one.origin_m for one in glances], (0, 2)),
        "glance_beam_counts": np.array([len(one.angles_rad) for one in glances], dtype=np.int64),
        "glance_angles_rad": _joined([one.angles_rad for one in glances], (0,)),
        "glance_ranges_m": _joined([one.ranges_m for one in glances], (0,)),
        "loop_ends": np.array([(o.earlier, o.later) for o in loops], np.int64).reshape(-1, 2),
        "loop_ways": _poses([one.T_earlier_later for one in loops]),
        "loop_information": _stacked([one.information for one in loops], (0, 3, 3)),
        "loop_ratios": np.array([(o.inlier_ratio, o.passed_ratio) for o in loops]).reshape(-1, 2),
        "loop_is_tie": np.array([one.is_tie for one in loops], dtype=np.bool_),
        "loops_kept": np.array(len(slam_map.loops)),
        "step_times_s": rows.column("time_s"),
        "step_keyframes": rows.column("keyframe").astype(np.int64),
        "step_ways": rows.columns("x_m", "y_m", "theta_rad"),
        "step_poses": rows.columns("map_x_m", "map_y_m", "map_theta_rad"),
        "step_statuses": rows.column("status").astype(np.int64),
        "step_inliers": rows.column("inlier_ratio"),
        "step_is_keyframe": rows.column("is_keyframe"),
        "step_sessions": rows.column("session").astype(np.int64),
        "step_is_open": rows.column("is_open"),
        "verdict": np.array(
            [verdict.is_good, verdict.passed_ratio, verdict.bad_pairs, verdict.pairs], dtype=float
        ),
        "verdict_reasons": np.array(verdict.reasons, dtype=np.str_),
    }


def _arrays_of_told(told: list[ToldStep]) -> _Arrays:
    return {
        "keyframe_told_ways": _poses([one.motion for one in told]),
        "keyframe_told_covariances": _stacked([one.covariance for one in told], (0, 3, 3)),
    }


def _map_of(arrays: _Arrays) -> SlamMap:
    points = _split(arrays["points"], arrays["point_counts"])
    beams = [
        Beams(*parts)
        for parts in zip(
            *(
                _split(arrays[name], arrays["beam_counts"])
                for name in ("beam_origins_m", "beam_angles_rad", "beam_ranges_m")
            ),
            strict=True,
        )
    ]
    keyframes = tuple(
        Keyframe(
            float(time_s), SE2.from_array(pose), SE2.from_array(way), covariance, cloud, fan,
            bool(is_break), int(session), glances, ToldStep(SE2.from_array(told), told_covariance),
            bool(is_after_gap),
        )
        for (
            time_s, pose, way, covariance, cloud, fan, is_break, session, glances, told, told_covariance, is_after_gap
        ) in zip(
            arrays["keyframe_times_s"], arrays["keyframe_poses"], arrays["keyframe_ways"],
            arrays["keyframe_covariances"], points, beams, arrays["keyframe_is_break"],
            arrays["keyframe_sessions"], _glances_of(arrays),
            arrays["keyframe_told_ways"], arrays["keyframe_told_covariances"],
            arrays["keyframe_is_after_gap"], strict=True,
        )
    )  # fmt: skip
    loops = tuple(
        Loop(
            int(ends[0]), int(ends[1]), SE2.from_array(way), information, float(ratios[0]),
            float(ratios[1]), bool(is_tie),
        )
        for ends, way, information, ratios, is_tie in zip(
            arrays["loop_ends"], arrays["loop_ways"], arrays["loop_information"],
            arrays["loop_ratios"], arrays["loop_is_tie"], strict=True,
        )
    )  # fmt: skip
    steps = FrontEndSteps(
        FrontEndStep(
            float(time_s), int(keyframe), SE2.from_array(way), SE2.from_array(pose),
            STATUSES[int(status)], float(inliers), bool(is_keyframe), int(session),
            bool(is_open),
        )
        for time_s, keyframe, way, pose, status, inliers, is_keyframe, session, is_open in zip(
            arrays["step_times_s"], arrays["step_keyframes"], arrays["step_ways"],
            arrays["step_poses"], arrays["step_statuses"], arrays["step_inliers"],
            arrays["step_is_keyframe"], arrays["step_sessions"],
            arrays["step_is_open"], strict=True,
        )
    ).close()  # fmt: skip
    kept, numbers = int(arrays["loops_kept"]), arrays["verdict"]
    verdict = MapVerdict(
        bool(numbers[0]), float(numbers[1]), float(numbers[2]), int(numbers[3]),
        tuple(str(reason) for reason in arrays["verdict_reasons"]),
    )  # fmt: skip
    poses = arrays["poses"]
    graph = graph_of(keyframes, loops, poses)
    return SlamMap(keyframes, poses, loops[:kept], loops[kept:], graph, steps, verdict)


def _glances_of(arrays: _Arrays) -> list[tuple[Glance, ...]]:
    """Of each keyframe."""
    ways, origins_m, counts, *_ = (arrays[name] for name in _GLANCES)
    angles_rad, ranges_m = (
        _split(np.asarray(arrays[name], dtype=np.float32), counts) for name in _GLANCES[3:]
    )
    glances = [
        Glance(SE2.from_array(way), origin_m, angles, ranges)
        for way, origin_m, angles, ranges in zip(ways, origins_m, angles_rad, ranges_m, strict=True)
    ]
    ends = np.cumsum(arrays["glance_counts"]).tolist()
    if (ends or [0])[-1] != len(glances):
        raise ValueError(f"{len(glances)} glances for {ends[-1:]} told")
    return [tuple(glances[first:last]) for first, last in zip([0, *ends], ends, strict=False)]


def _poses(poses: list[SE2]) -> FloatArray:
    return np.array([pose.as_array() for pose in poses], dtype=np.float64).reshape(-1, 3)


def _stacked(arrays: list[FloatArray], empty: tuple[int, ...]) -> FloatArray:
    return np.stack(arrays) if arrays else np.zeros(empty)


def _joined(arrays: Sequence[np.ndarray], empty: tuple[int, ...]) -> np.ndarray:
    return np.concatenate(arrays) if arrays else np.zeros(empty)


def _split(array: np.ndarray, counts: np.ndarray) -> list[np.ndarray]:
    if counts.sum() != len(array):
        raise ValueError(f"{len(array)} rows for {counts.sum()} told")
    return np.split(array, np.cumsum(counts)[:-1]) if len(counts) else []

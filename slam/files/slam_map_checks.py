"""What the arrays of a map's file must be, for the map made of them to be one."""

from __future__ import annotations

import numpy as np

_Arrays = dict[str, np.ndarray]

_FARTHEST_M = 1e8
"""Beyond any place on the ground."""
_MOST_RAD = 1e3
"""Beyond what any laser turns in a scan, and where a float32 still tells beams apart."""
_UNEVEN = 1e-6
"""Share of the largest number of a symmetric matrix, by which two across its diagonal may differ: they are rounded."""
_SHAPES: dict[str, tuple[str | int, ...]] = {
    **dict.fromkeys(("poses", "keyframe_poses", "keyframe_ways", "keyframe_told_ways"), ("keyframes", 3)),
    **dict.fromkeys(
        ("keyframe_covariances", "keyframe_told_covariances"), ("keyframes", 3, 3)
    ),
    **dict.fromkeys(
        ("keyframe_times_s", "keyframe_is_break", "keyframe_is_after_gap", "keyframe_sessions", "point_counts",
         "beam_counts", "glance_counts"),
        ("keyframes",),
    ),
    "points": ("points", 2),
    "beam_origins_m": ("beams", 2),
    **dict.fromkeys(("beam_angles_rad", "beam_ranges_m"), ("beams",)),
    "glance_ways": ("glances", 3),
    "glance_origins_m": ("glances", 2),
    "glance_beam_counts": ("glances",),
    **dict.fromkeys(("glance_angles_rad", "glance_ranges_m"), ("glanced beams",)),
    "loop_ends": ("loops", 2),
    "loop_ways": ("loops", 3),
    "loop_information": ("loops", 3, 3),
    "loop_ratios": ("loops", 2),
    "loop_is_tie": ("loops",),
    "loops_kept": (),
    **dict.fromkeys(
        ("step_times_s", "step_keyframes", "step_statuses", "step_inliers", "step_is_keyframe",
         "step_sessions", "step_is_open"),
        ("scans",),
    ),
    **dict.fromkeys(("step_ways", "step_poses"), ("scans", 3)),
    "verdict": (4,),
}  # fmt: skip
MAY_BE_INFINITE = ("beam_ranges_m", "glance_ranges_m")
"""Of beams that came back from nowhere, or not at all."""


def check_arrays(arrays: _Arrays, status_count: int) -> None:
    """Raises ValueError for arrays that no map has, so that they are not taken for one.

    status_count: how many ways of placing a scan there are.
    """
    sizes: dict[str, int] = {}
    for name, shape in _SHAPES.items():
        array = arrays[name]
        is_empty = array.size == 0 and 0 in array.shape[:1] and "keyframes" not in shape[:1]
        if array.ndim != len(shape) and not is_empty:
            raise ValueError(f"{name} have shape {array.shape}, not {shape}")
        for expected, found in zip(shape, array.shape, strict=False):
            size = expected if isinstance(expected, int) else sizes.setdefault(expected, found)
            if found != size and not is_empty:
                raise ValueError(f"{name} have shape {array.shape}: {size} expected of {expected}")
        _check_numbers(name, array)
    _check_counts(arrays, sizes, status_count)


def _check_numbers(name: str, array: np.ndarray) -> None:
    if array.dtype.kind not in "biuf":
        raise ValueError(f"{name} are no numbers but {array.dtype}")
    if not array.dtype.isnative:
        raise ValueError(f"{name} are {array.dtype}, not in this machine's order of bytes")
    if name not in MAY_BE_INFINITE and not np.isfinite(array).all():
        raise ValueError(f"{name} are not finite")
    is_place = name.endswith(("poses", "ways", "origins_m")) or name == "points"
    for is_such, most, unit in (
        (is_place, _FARTHEST_M, "m"),
        (name.endswith("angles_rad"), _MOST_RAD, "rad"),
    ):
        if is_such and float(np.abs(array).max(initial=0.0)) > most:
            raise ValueError(f"{name} reach beyond {most:g} {unit}")
    if name.endswith("ranges_m") and (array < 0.0).any():
        raise ValueError(f"{name} are below 0")
    is_squared = name.endswith("covariances") or name == "loop_information"
    if is_squared and (np.diagonal(array, axis1=1, axis2=2) < 0.0).any():
        raise ValueError(f"{name} are below 0")
    if is_squared:
        uneven = np.abs(array - array.transpose(0, 2, 1)).max(axis=(1, 2), initial=0.0)
        if (uneven > _UNEVEN * np.abs(array).max(axis=(1, 2), initial=0.0)).any():
            raise ValueError(f"{name} are not symmetric")


def _check_counts(arrays: _Arrays, sizes: dict[str, int], status_count: int) -> None:
    """Of indices and counts."""
    keyframes, loops, scans = (sizes.get(name, 0) for name in ("keyframes", "loops", "scans"))
    for name in ("point_counts", "beam_counts", "glance_counts", "glance_beam_counts"):
        if arrays[name].dtype.kind not in "iu" or (arrays[name] < 0).any():
            raise ValueError(f"{name} do not count")
    _check_range("scans are seen from keyframes", arrays["step_keyframes"], -1, keyframes)
    _check_range("ways of placing a scan", arrays["step_statuses"], 0, status_count)
    _check_range("loops kept", arrays["loops_kept"], 0, loops + 1)
    ends = arrays["loop_ends"].reshape(-1, 2)
    _check_range("loops end at keyframes", ends, 0, keyframes)
    if (ends[:, 0] >= ends[:, 1]).any():
        raise ValueError("loops end before they begin")
    for name in ("keyframe_sessions", "step_sessions"):
        sessions = arrays[name]
        if (np.diff(sessions, prepend=0) < 0).any() or sessions.max(initial=0) > scans:
            raise ValueError(f"{name} do not count up from 0")


def _check_range(what: str, values: np.ndarray, low: int, end: int) -> None:
    if not ((values >= low) & (values < end)).all():
        raise ValueError(f"{what} that are not among the {end}")

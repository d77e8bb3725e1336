"""The maps of a few trials of a run, kept beside its records: what Fig. 7 is drawn of."""

import zipfile
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from experiments.mapping import MappingResult, true_map
from slam.arrays import FloatArray

FILE = "maps.npz"
_LARGEST = 50_000_000
"""Bytes: chosen; a file of four trials has some hundred thousand."""


@dataclass(frozen=True, eq=False)
class KeptMap:
    """What one method made of a drive, in the true frame [m]: points (K, 2), how far each lies from
    a true surface (K,), the path (N, 2), and what could be seen of the true surfaces but is missing
    (M, 2)."""

    points_m: FloatArray
    off_m: FloatArray
    path_m: FloatArray
    missed_m: FloatArray


@dataclass(frozen=True, eq=False)
class KeptTrial:
    """One drive: its number, the true surfaces (S, 2, 2), the true path (N, 2) [m], the maps."""

    index: int
    segments_m: FloatArray
    true_path_m: FloatArray
    maps: dict[str, KeptMap]


def keep_maps(folder: Path, results: Mapping[int, MappingResult]) -> Path:
    """Writes the maps of these trials, by number, to `maps.npz` of a folder; it is whole or not."""
    arrays: dict[str, FloatArray] = {}
    for index, result in results.items():
        arrays["segments_m"] = true_map(result.config).place_map.segments_m
        arrays[f"{index}/true_path_m"] = result.true_poses[:, :2]
        for name, outcome in result.outcomes.items():
            off_m = true_map(result.config).off_m(outcome.points_m)
            arrays[f"{index}/{name}/points_m"] = outcome.points_m
            arrays[f"{index}/{name}/off_m"] = off_m
            arrays[f"{index}/{name}/path_m"] = outcome.path_m
            arrays[f"{index}/{name}/missed_m"] = outcome.missed_m
    path, partial = folder / FILE, folder / f"{FILE}.partial"
    # a hundredth of a millimetre is more than a picture shows
    small: dict[str, Any] = {key: array.astype(np.float32) for key, array in arrays.items()}
    with partial.open("wb") as file:
        np.savez_compressed(file, **small)
    partial.replace(path)
    return path


def kept_maps(folder: Path, methods: tuple[str, ...]) -> list[KeptTrial]:
    """The trials whose maps are kept in a folder, in the order in which they were; none of a run
    that has not kept any. Raises ValueError for a file that is damaged or of something else."""
    path = folder / FILE
    if not path.exists():
        return []
    try:
        with zipfile.ZipFile(path) as archive:
            size = sum(one.file_size for one in archive.infolist())
        if size > _LARGEST:
            raise ValueError(f"it unpacks to {size} bytes")
        with np.load(path, allow_pickle=False) as file:
            arrays = {key: _checked(key, file[key]) for key in file.files}
        return _trials(arrays, methods)
    except (ValueError, KeyError, OSError, EOFError, zipfile.BadZipFile) as error:
        raise ValueError(f"{path} does not hold the maps of this run: {error}") from error


def _trials(arrays: dict[str, FloatArray], methods: tuple[str, ...]) -> list[KeptTrial]:
    indices = [int(key.split("/")[0]) for key in arrays if key.endswith("/true_path_m")]
    return [
        KeptTrial(
            index,
            arrays["segments_m"],
            arrays[f"{index}/true_path_m"],
            {
                name: KeptMap(
                    *(
                        arrays[f"{index}/{name}/{part}"]
                        for part in ("points_m", "off_m", "path_m", "missed_m")
                    )
                )
                for name in methods
            },
        )
        for index in indices
    ]


def _checked(key: str, array: np.ndarray) -> FloatArray:
    """The array, if it has the shape that its name says, and numbers in it."""
    tail = {"segments_m": (2, 2), "off_m": ()}.get(key.split("/")[-1], (2,))
    if array.dtype.kind != "f" or array.shape[1:] != tail or array.ndim != 1 + len(tail):
        raise ValueError(f"{key} is of {array.dtype} {array.shape}")
    if not np.isfinite(array).all():
        raise ValueError(f"{key} is not all finite")
    return array.astype(np.float64)

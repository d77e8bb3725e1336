"""Points of a map as PLY and PCD in plain text, as viewers of point clouds read them."""

from __future__ import annotations

from pathlib import Path

from slam.arrays import FloatArray
from slam.files.whole_files import write_whole


def write_ply(path: str | Path, points: FloatArray) -> None:
    """Writes points (N, 2) [m] with z = 0, to 0.1 mm; whole or not at all.

    Raises OSError when the folder cannot be written.
    """
    axes = "".join(f"property double {axis}\n" for axis in "xyz")
    header = f"ply\nformat ascii 1.0\nelement vertex {len(points)}\n{axes}end_header\n"
    _write(Path(path), header, points)


def write_pcd(path: str | Path, points: FloatArray) -> None:
    """The same as PCD, as the Point Cloud Library has it."""
    header = (
        "# .PCD v0.7 - Point Cloud Data file format\nVERSION 0.7\nFIELDS x y z\nSIZE 4 4 4\n"
        f"TYPE F F F\nCOUNT 1 1 1\nWIDTH {len(points)}\nHEIGHT 1\nVIEWPOINT 0 0 0 1 0 0 0\n"
        f"POINTS {len(points)}\nDATA ascii\n"
    )
    _write(Path(path), header, points)


def _write(path: Path, header: str, points: FloatArray) -> None:
    lines = "".join(f"{x:.4f} {y:.4f} 0\n" for x, y in points)
    write_whole(path, (header + lines).encode("ascii"))

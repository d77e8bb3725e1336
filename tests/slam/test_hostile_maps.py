"""Maps of strangers: nothing of them is executed, nothing elsewhere read, no memory filled."""

import io
import os
import struct
import tracemalloc
import zipfile
import zlib
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from slam.files.map_files import read_map, write_map
from slam.files.slam_map_files import read_slam_map
from slam.known_map import KnownMap
from slam.occupancy_grid import OccupancyGrid
from slam.se2 import SE2

YAML = """\
image: {image}
resolution: {resolution}
origin: {origin}
negate: 0
occupied_thresh: 0.65
free_thresh: 0.196
"""
PGM = b"P5 3 1 255\n" + bytes([0, 205, 254])


def written(folder: Path, pgm: bytes | None = PGM, more: str = "", **changes: str) -> Path:
    header = {"image": "map.pgm", "resolution": "0.05", "origin": "[0, 0, 0]"} | changes
    (folder / "map.yaml").write_text(YAML.format(**header) + more)
    if pgm is not None:
        (folder / "map.pgm").write_bytes(pgm)
    return folder / "map.yaml"


def refusal(path: Path) -> str:
    with pytest.raises(ValueError, match=r"/map\.") as refused:
        read_map(path)
    (line,) = str(refused.value).splitlines()
    assert len(line) < 300
    return line


def png_bomb(columns: int, rows: int) -> bytes:
    """A valid png of black pixels, a thousandth of them in bytes."""

    def chunk(kind: bytes, content: bytes) -> bytes:
        checksum = zlib.crc32(kind + content)
        return struct.pack(">I", len(content)) + kind + content + struct.pack(">I", checksum)

    packer = zlib.compressobj(9)
    pixels = b"".join(packer.compress(bytes(columns + 1)) for _ in range(rows)) + packer.flush()
    header = struct.pack(">IIBBBBB", columns, rows, 8, 0, 0, 0, 0)
    return (
        b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", header) + chunk(b"IDAT", pixels) + chunk(b"IEND", b"")
    )


def test_tags_of_python_make_no_objects(tmp_path):
    made = tmp_path / "made"
    tag = f"!!python/object/apply:os.system ['touch {made}']"
    assert "resolution must be a number" in refusal(written(tmp_path, resolution=tag))
    assert "image must be the name of a file" in refusal(written(tmp_path, image=tag))
    # in a key that nobody reads as well
    read_map(written(tmp_path, more=f"more: {tag}\n"))
    assert not made.exists()


def test_aliases_are_refused(tmp_path):
    laughs = "a: &a [x, x]\n" + "".join(
        f"{chr(98 + i)}: &{chr(98 + i)} [*{chr(97 + i)}, *{chr(97 + i)}]\n" for i in range(20)
    )
    line = refusal(written(tmp_path, origin="*t", more=laughs))
    assert (
        line == f"{tmp_path}/map.yaml: not a YAML file (an alias in line 3, which is not read here)"
    )


@pytest.mark.parametrize("text", ["[" * 20_000, "a: " * 3, "\x00", "- 1", "{", "x" * 600_000])
def test_junk_is_refused(tmp_path, text):
    path = tmp_path / "map.yaml"
    path.write_text(text)
    refusal(path)


@pytest.mark.parametrize("number", ["nan", ".nan", "0", "-0.05", "inf", "1e999", "[1]", "five"])
def test_resolutions_that_are_none_are_refused(tmp_path, number):
    assert "resolution must be" in refusal(written(tmp_path, resolution=number))


@pytest.mark.parametrize("origin", ["[nan, 0, 0]", "[0, .inf, 0]", "[0, 0]", "[1e9, 0, 0]", "0"])
def test_origins_that_are_none_are_refused(tmp_path, origin):
    assert "origin must be" in refusal(written(tmp_path, origin=origin))


@pytest.mark.parametrize("image", ["../secret.pgm", "{absolute}", "below/../../secret.pgm", "link"])
def test_images_outside_of_the_folder_are_not_read(tmp_path, image):
    folder = tmp_path / "map"
    folder.mkdir()
    secret = tmp_path / "secret.pgm"
    secret.write_bytes(PGM)
    (folder / "link").symlink_to(secret)
    line = refusal(written(folder, image=image.format(absolute=secret)))
    assert "lies outside of its folder" in line
    assert "put it beside map.yaml, and write image: " in line


def test_a_map_may_be_reached_by_a_link(tmp_path):
    folder = tmp_path / "map"
    folder.mkdir()
    link = tmp_path / "linked.yaml"
    link.symlink_to(written(folder))
    (tmp_path / "map.pgm").symlink_to(folder / "map.pgm")
    assert read_map(link).cells.tolist() == [[100, -1, 0]]


def test_images_of_too_many_cells_are_refused_before_they_are_decoded(tmp_path):
    (tmp_path / "map.png").write_bytes(png_bomb(8000, 8000))
    assert (tmp_path / "map.png").stat().st_size < 100_000
    path = written(tmp_path, image="map.png")
    tracemalloc.start()
    assert refusal(path).startswith(
        f"{tmp_path}/map.png: 8000 x 8000 cells; a map may have 16 million"
    )
    (tmp_path / "map.png").write_bytes(
        png_bomb(60_000, 2)[:16] + struct.pack(">II", 60_000, 60_000)
    )
    refusal(path)
    for size in (b"20000 20000", b"999999 999999", b"2147483647 2"):
        assert "cells; a map may have 16 million" in refusal(
            written(tmp_path, b"P5 " + size + b" 255\n")
        )
    refusal(written(tmp_path, b"P5 99999999999 1 255\n"))
    # Pillow's own memory is not traced; what NumPy would have taken is
    assert tracemalloc.get_traced_memory()[1] < 5e6
    tracemalloc.stop()


def test_files_of_gigabytes_and_devices_are_refused(tmp_path):
    with (tmp_path / "map.yaml").open("wb") as file:
        file.truncate(10_000_000_000)
    with pytest.raises(ValueError, match=r"/map.yaml: longer than the 0\.5 MB"):
        read_map(tmp_path / "map.yaml")
    if Path("/dev/zero").exists():
        with pytest.raises(ValueError, match=r"/zero: a pipe or a device"):
            read_map("/dev/zero")


def test_formats_for_which_pillow_starts_programs_are_not_read(tmp_path):
    (tmp_path / "map.eps").write_bytes(
        b"%!PS-Adobe-3.0 EPSF-3.0\n%%BoundingBox: 0 0 9 9\n%%EndComments\n"
    )
    line = refusal(written(tmp_path, image="map.eps"))
    assert (
        line
        == f"{tmp_path}/map.eps: not an image of a known format (pgm, png, bmp, gif, jpeg, tiff)"
    )


def test_large_maps_are_read_in_parts(tmp_path, monkeypatch):
    cells = np.random.default_rng(0).choice([-1, 0, 100], (70, 40)).astype(np.int8)
    write_map(tmp_path / "map.yaml", OccupancyGrid(cells, 0.05, SE2.identity()))
    monkeypatch.setattr("slam.files.map_files._PIXELS_AT_ONCE", 130)
    np.testing.assert_array_equal(read_map(tmp_path / "map.yaml").cells, cells)


@pytest.mark.parametrize("suffix", ["bmp", "gif", "tiff", "png"])
def test_other_formats_are_read(tmp_path, suffix):
    Image.fromarray(np.array([[0, 205, 254]], dtype=np.uint8)).save(tmp_path / f"map.{suffix}")
    assert read_map(written(tmp_path, None, image=f"map.{suffix}")).cells.tolist() == [[100, -1, 0]]


def test_no_file_is_left_where_the_map_was_read(tmp_path):
    before = sorted(os.listdir(Path.cwd()))
    refusal(written(tmp_path, b"P5 9 9 255\n"))
    assert sorted(os.listdir(Path.cwd())) == before


def kitasap_map(path: Path, shape: tuple[int, ...], content_bytes: int) -> Path:
    """A file that says it is a map, whose only array has this shape, and so many bytes."""
    header = io.BytesIO()
    described = {"descr": "<f8", "fortran_order": False, "shape": shape}
    np.lib.format.write_array_header_1_0(header, described)
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED, compresslevel=1) as archive:
        archive.writestr("points.npy", header.getvalue() + bytes(content_bytes))
    return path


@pytest.mark.parametrize(
    ("shape", "content_bytes", "said"),
    [
        ((10**15,), 8, "cut, damaged or something else"),
        # arrays that another program saved
        ((3,), 24, r"something else \(it has no 'kind'\)"),
        pytest.param(
            (40_000_000,),
            320_000_000,
            "more than the 250 MB that are read of one",
            marks=pytest.mark.slow,
        ),
    ],
)
def test_maps_of_ours_that_claim_too_much_are_refused(tmp_path, shape, content_bytes, said):
    path = kitasap_map(tmp_path / "map.kitasap", shape, content_bytes)
    with pytest.raises(ValueError, match=rf"/map\.kitasap: .*{said}"):
        read_slam_map(path)


def test_a_map_of_noise_is_not_localised_on(monkeypatch):
    cells = np.where(np.random.default_rng(0).random((60, 60)) < 0.3, 100, 0).astype(np.int8)
    monkeypatch.setattr("slam.known_map._MOST_WALL_CELLS", 500)
    with pytest.raises(
        ValueError, match=r"^\d+ cells of the map are walls .* more than 500: noise"
    ):
        KnownMap.of_grid(OccupancyGrid(cells, 0.05, SE2.identity()))

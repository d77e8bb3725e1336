"""Maps of ROS: what their pixels mean, and files that are none."""

import math
from pathlib import Path

import numpy as np
import pytest
import yaml
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import array_shapes, arrays
from PIL import Image

from slam.files.map_files import read_map, write_map
from slam.occupancy_grid import OccupancyGrid
from slam.se2 import SE2

HEADER = {
    "image": "map.pgm",
    "resolution": 0.05,
    "origin": [1.0, 2.0, 0.5],
    "negate": 0,
    "occupied_thresh": 0.65,
    "free_thresh": 0.196,
}
PGM = b"P5\n# a comment\n3 2\n255\n" + bytes([0, 205, 254, 100, 200, 255])
SAME_FOLDER = settings(
    max_examples=40, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture]
)
KNOWN = st.sampled_from([-1, 0, 100])
POSES = st.builds(SE2, st.floats(-1e4, 1e4), st.floats(-1e4, 1e4), st.floats(-math.pi, math.pi))


def written(folder: Path, content: object = PGM, **changes: object) -> Path:
    """A map of this image whose YAML differs from the usual one so; None takes a key away."""
    header = {key: value for key, value in (HEADER | changes).items() if value is not None}
    (folder / "map.yaml").write_text(yaml.safe_dump(header))
    if isinstance(content, bytes):
        (folder / "map.pgm").write_bytes(content)
    else:
        picture = content if isinstance(content, Image.Image) else Image.fromarray(content)
        picture.save(folder / str(header["image"]))
    return folder / "map.yaml"


def values(folder: Path, content: np.ndarray | Image.Image, **changes: object) -> list[int]:
    """The cells of a png with one row."""
    path = written(folder, content, **{"image": "map.png", **changes})
    return read_map(path).cells[0].tolist()


def grey(*pixels: int) -> np.ndarray:
    return np.array([pixels], dtype=np.uint8)


def test_image_starts_at_the_top_and_the_grid_at_the_bottom(tmp_path):
    grid = read_map(written(tmp_path))
    assert grid.cells.tolist() == [[-1, -1, 0], [100, -1, 0]]
    assert grid.resolution_m == 0.05
    assert grid.T_map_grid == SE2(1.0, 2.0, 0.5)
    # the pixel at the upper left, seen from the corner below it, turned by the yaw
    expected = SE2(1.0, 2.0, 0.5) @ np.array([[0.025, 0.075]])
    np.testing.assert_allclose(grid.centres_of([[1, 0]]), expected)
    assert grid.value_at(expected) == 100


def test_plain_pgm_and_absolute_path_into_the_folder_are_read(tmp_path):
    (tmp_path / "below").mkdir()
    image = tmp_path / "below" / "a.pgm"
    image.write_bytes(b"P2\n3 1\n255\n0 205 254\n")
    assert read_map(written(tmp_path, image=str(image))).cells.tolist() == [[100, -1, 0]]


def test_pgm_of_fewer_levels_is_scaled(tmp_path):
    path = written(tmp_path, b"P5 3 1 100\n" + bytes([0, 80, 100]))
    assert read_map(path).cells.tolist() == [[100, -1, 0]]


def test_negate_makes_bright_pixels_occupied(tmp_path):
    assert values(tmp_path, grey(0, 50, 51, 255), negate=1) == [0, -1, -1, 100]
    assert values(tmp_path, grey(0, 49, 51, 255), negate=True) == [0, 0, -1, 100]


def test_pixel_at_a_threshold_is_neither(tmp_path):
    # (255 - 204) / 255 is 0.2, and (255 - 51) / 255 is 0.8
    found = values(tmp_path, grey(205, 204, 203, 52, 51, 50), occupied_thresh=0.8, free_thresh=0.2)
    assert found == [0, -1, -1, -1, -1, 100]


def test_grey_of_the_unknown_needs_the_threshold_of_ros_1(tmp_path):
    assert values(tmp_path, grey(205)) == [-1]
    # so wrote nav2 until 2025, and this is what it then read
    assert values(tmp_path, grey(205), free_thresh=0.25) == [0]


def test_scale_is_in_proportion_between_the_thresholds(tmp_path):
    pixels = grey(0, 51, 102, 127, 204, 255)
    found = values(tmp_path, pixels, mode="scale", occupied_thresh=0.8, free_thresh=0.2)
    # p = 1, 0.8, 0.6, 128 / 255, 0.2, 0
    assert found == [100, 100, 67, round((128 / 255 - 0.2) / 0.6 * 100), 0, 0]


def test_thresholds_may_be_next_to_each_other(tmp_path):
    thresholds = {"occupied_thresh": "5e-324", "free_thresh": "0.0"}
    with np.errstate(all="raise"):
        assert values(tmp_path, grey(0, 254, 255), mode="scale", **thresholds) == [100, 100, 0]


def test_raw_is_the_value_up_to_a_hundred(tmp_path):
    assert values(tmp_path, grey(0, 1, 99, 100, 101, 255), mode="raw") == [0, 1, 99, 100, -1, -1]


def test_raw_ignores_negate_as_nav2_does(tmp_path):
    assert values(tmp_path, grey(0, 100, 255), mode="raw", negate=1) == [0, 100, -1]


def test_colours_are_averaged(tmp_path):
    pixels = np.array([[[0, 0, 255], [255, 255, 105], [30, 90, 180]]], dtype=np.uint8)
    # means of 85, 205 and 100
    assert values(tmp_path, pixels) == [100, -1, -1]
    assert values(tmp_path, pixels, mode="raw") == [85, -1, 100]


def test_palette_is_looked_up(tmp_path):
    picture = Image.new("P", (3, 1))
    picture.putpalette([255, 255, 255, 205, 205, 205, 0, 0, 0])
    picture.putdata([0, 1, 2])
    assert values(tmp_path, picture) == [0, -1, 100]


def test_bits_are_free_and_occupied(tmp_path):
    picture = Image.fromarray(grey(0, 255)).convert("1")
    assert values(tmp_path, picture) == [100, 0]


def test_transparent_pixels_are_unknown_in_scale_mode(tmp_path):
    pixels = np.array([[[0, 0, 0, 255], [0, 0, 0, 254], [255, 255, 255, 0]]], dtype=np.uint8)
    assert values(tmp_path, pixels, mode="scale") == [100, -1, -1]
    # grey with alpha as well
    pixels = np.array([[[0, 255], [0, 0]]], dtype=np.uint8)
    assert values(tmp_path, pixels, mode="scale") == [100, -1]


def test_opacity_is_one_more_colour_in_trinary_mode(tmp_path):
    pixels = np.array([[[0, 0, 0, 255], [255, 255, 255, 255], [255, 255, 255, 0]]], dtype=np.uint8)
    # means of 64, 255 and 191: p of 0.75, 0 and 0.25
    assert values(tmp_path, pixels) == [100, 0, -1]
    # and none in raw mode
    assert values(tmp_path, np.full((1, 1, 4), 7, dtype=np.uint8), mode="raw") == [7]


def test_sixteen_bits_are_taken_in_full(tmp_path):
    pixels = np.array([[0, 52685, 52429, 52428, 65535]], dtype=np.uint16)
    assert values(tmp_path, pixels, free_thresh=0.2) == [100, 0, 0, -1, 0]
    # p = 13107 / 65535 is 0.2, so 52428 is at the threshold
    path = written(tmp_path, b"P5 2 1 65535\n\x00\x00\xff\xff")
    assert read_map(path).cells.tolist() == [[100, 0]]


def test_thirty_two_bits_are_refused(tmp_path):
    written(tmp_path, np.zeros((2, 2), dtype=np.float32), image="map.tiff")
    with pytest.raises(ValueError, match=r"/map.tiff: expected 8 or 16 bits a pixel, found 32$"):
        read_map(tmp_path / "map.yaml")


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"image": None}, "the key image is missing"),
        ({"resolution": None}, r"the key resolution is missing \(found: free_thresh, image"),
        ({"origin": None}, "the key origin is missing"),
        ({"negate": None}, "the key negate is missing"),
        ({"occupied_thresh": None}, "the key occupied_thresh is missing"),
        ({"free_thresh": None}, "the key free_thresh is missing"),
        ({"image": ""}, "image must be the name of a file, not ''"),
        ({"image": ["map.pgm"]}, "image must be the name of a file"),
        ({"resolution": 0.0}, "resolution must be above 0 m, not 0.0"),
        ({"resolution": -0.05}, "above 0 m, not -0.05"),
        ({"resolution": "fine"}, "resolution must be a number, not 'fine'"),
        ({"resolution": math.nan}, "resolution must be a number"),
        ({"resolution": [0.05]}, "resolution must be a number"),
        ({"origin": [0.0, 0.0]}, r"origin must be a list of x, y and yaw, not \['0.0', '0.0'\]"),
        ({"origin": 0.0}, "origin must be a list"),
        ({"origin": [0.0, "left", 0.0]}, "origin must be a number, not 'left'"),
        ({"origin": [0.0, math.inf, 0.0]}, "origin must be a number"),
        ({"origin": [1e300, 0.0, 0.0]}, r"origin must be x and y in metres .* beyond 1e\+08, not"),
        ({"negate": 2}, "negate must be 0 or 1, true or false, not '2'"),
        ({"negate": [0]}, "negate must be 0 or 1"),
        ({"mode": "grey"}, "mode must be trinary, scale or raw, not 'grey'"),
        ({"mode": ["raw"]}, "mode must be trinary, scale or raw"),
        ({"occupied_thresh": 0.1}, "free_thresh < occupied_thresh <= 1, found 0.196 and 0.1"),
        ({"occupied_thresh": 65}, "found 0.196 and 65.0"),
        ({"free_thresh": -0.1}, "expected 0 <= free_thresh"),
        ({"free_thresh": "low"}, "free_thresh must be a number, not 'low'"),
    ],
)
def test_wrong_header_is_told_in_one_line(tmp_path, changes, message):
    path = written(tmp_path, **changes)
    with pytest.raises(ValueError, match=message) as caught:
        read_map(path)
    assert str(caught.value).startswith(f"{path}: ")
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    "content",
    [b"", b"- a\n- b\n", b"just words", b"a: [1, 2", b"\x00\x01\x02", b"\xff\xfe\xfd", PGM, b"[" * 5000],
)  # fmt: skip
def test_other_files_than_yaml_with_keys_are_refused(tmp_path, content):
    path = tmp_path / "map.yaml"
    path.write_bytes(content)
    with pytest.raises(ValueError, match=r"/map\.yaml: (not a YAML file|expected keys)") as caught:
        read_map(path)
    assert "\n" not in str(caught.value)


@pytest.mark.slow
@SAME_FOLDER
@given(content=st.binary(max_size=80) | st.text(max_size=80).map(str.encode))
def test_no_garbage_raises_anything_else(tmp_path, content):
    (tmp_path / "map.yaml").write_bytes(content)
    with pytest.raises(ValueError, match=r"/map\.yaml: "):
        read_map(tmp_path / "map.yaml")
    path = written(tmp_path, content)
    with pytest.raises(ValueError, match=r"/map\.pgm: "):
        read_map(path)


def test_words_and_numbers_are_those_of_ros(tmp_path):
    path = written(tmp_path)
    text = "image: map.pgm\nresolution: 5e-2\norigin: [-1, .5, 1e-3]\nnegate: no\n"
    path.write_text(text + "occupied_thresh: 0.65\nfree_thresh: 0.196\nmode: trinary\n")
    grid = read_map(path)
    assert grid.resolution_m == 0.05
    assert grid.T_map_grid == SE2(-1.0, 0.5, 0.001)


def test_missing_files_are_os_errors_that_name_them(tmp_path):
    with pytest.raises(FileNotFoundError, match=r"none\.yaml"):
        read_map(tmp_path / "none.yaml")
    with pytest.raises(FileNotFoundError, match=r"none\.pgm"):
        read_map(written(tmp_path, image="none.pgm"))
    with pytest.raises(OSError, match=r"directory|denied"):
        read_map(written(tmp_path, image="."))


@pytest.mark.parametrize("suffix", ["pgm", "png"])
def test_image_that_is_cut_anywhere_is_refused(tmp_path, suffix):
    grid = OccupancyGrid(np.arange(-1, 99).reshape(10, 10), 0.05, SE2.identity())
    path = tmp_path / "map.yaml"
    write_map(path, grid, "raw", suffix)
    image = path.with_suffix(f".{suffix}")
    whole = image.read_bytes()
    # in the last bytes of a png there are only sums of what was read, and its end
    for length in range(0, len(whole) - (24 if suffix == "png" else 0), 7):
        image.write_bytes(whole[:length])
        with pytest.raises(ValueError, match=rf"/map\.{suffix}: (not an image|the image is cut)"):
            read_map(path)


def test_other_files_than_images_are_refused(tmp_path):
    with pytest.raises(ValueError, match=r"/map\.pgm: not an image of a known format \(pgm, png, "):
        read_map(written(tmp_path, b"these are words"))


@SAME_FOLDER
@given(
    cells=arrays(np.int8, array_shapes(min_dims=2, max_dims=2, max_side=9), elements=KNOWN),
    resolution_m=st.floats(1e-6, 1e3),
    pose=POSES,
    image=st.sampled_from(["pgm", "png"]),
)
def test_trinary_map_comes_back_as_it_was(tmp_path, cells, resolution_m, pose, image):
    write_map(tmp_path / "map.yaml", OccupancyGrid(cells, resolution_m, pose), "trinary", image)
    found = read_map(tmp_path / "map.yaml")
    np.testing.assert_array_equal(found.cells, cells)
    # all digits of the header are kept
    assert found.resolution_m == resolution_m
    assert found.T_map_grid == pose


@SAME_FOLDER
@given(
    cells=arrays(
        np.int8, array_shapes(min_dims=2, max_dims=2, max_side=9), elements=st.integers(-1, 100)
    ),
    mode_image=st.sampled_from([("scale", "png"), ("raw", "png"), ("raw", "pgm")]),
)
def test_all_values_come_back_in_scale_and_raw_mode(tmp_path, cells, mode_image):
    # scale: 255 greys for 101 values, so that rounding finds each again
    write_map(tmp_path / "map.yaml", OccupancyGrid(cells, 0.05, SE2.identity()), *mode_image)
    np.testing.assert_array_equal(read_map(tmp_path / "map.yaml").cells, cells)


def test_trinary_keeps_what_is_free_and_occupied(tmp_path):
    grid = OccupancyGrid(np.array([[-1, 0, 25, 26, 64, 65, 100]]), 0.05, SE2.identity())
    write_map(tmp_path / "map.yaml", grid)
    assert read_map(tmp_path / "map.yaml").cells.tolist() == [[-1, 0, 0, -1, -1, 100, 100]]


def test_written_files_are_those_of_map_saver(tmp_path):
    grid = OccupancyGrid(np.array([[0, -1], [100, 0]]), 0.05, SE2(-1.5, 2.0, 0.25))
    write_map(tmp_path / "house.yaml", grid)
    assert sorted(path.name for path in tmp_path.iterdir()) == ["house.pgm", "house.yaml"]
    assert (tmp_path / "house.pgm").read_bytes() == b"P5\n2 2\n255\n" + bytes([0, 254, 254, 205])
    assert yaml.safe_load((tmp_path / "house.yaml").read_text()) == {
        "image": "house.pgm",
        "mode": "trinary",
        "resolution": 0.05,
        "origin": [-1.5, 2.0, 0.25],
        "negate": 0,
        "occupied_thresh": 0.65,
        "free_thresh": 0.196,
    }


def test_map_is_replaced_whole_or_not_at_all(tmp_path, monkeypatch):
    old = OccupancyGrid(np.array([[100]]), 0.05, SE2.identity())
    write_map(tmp_path / "map.yaml", old)

    def refused(*_: object) -> None:
        raise OSError("no space left")

    monkeypatch.setattr("slam.files.whole_files.os.replace", refused)
    with pytest.raises(OSError, match="no space left"):
        write_map(tmp_path / "map.yaml", OccupancyGrid(np.array([[0]]), 0.1, SE2.identity()))
    np.testing.assert_array_equal(read_map(tmp_path / "map.yaml").cells, old.cells)
    assert sorted(path.name for path in tmp_path.iterdir()) == ["map.pgm", "map.yaml"]


def test_image_is_written_before_the_file_that_names_it(tmp_path, monkeypatch):
    names = []
    monkeypatch.setattr("slam.files.map_files.write_whole", lambda path, _: names.append(path.name))
    write_map(tmp_path / "map.yaml", OccupancyGrid(np.array([[0]]), 0.1, SE2.identity()), "scale")
    assert names == ["map.png", "map.yaml"]


def test_wrong_wishes_are_refused(tmp_path):
    grid = OccupancyGrid(np.array([[-1, 0]]), 0.05, SE2.identity())
    path = tmp_path / "map.yaml"
    with pytest.raises(ValueError, match=r"must end in \.yaml"):
        write_map(tmp_path / "map.pgm", grid)
    with pytest.raises(ValueError, match="mode must be trinary, scale or raw, not 'grey'"):
        write_map(path, grid, "grey")
    with pytest.raises(ValueError, match="image must be pgm or png, not 'jpg'"):
        write_map(path, grid, "trinary", "jpg")
    with pytest.raises(ValueError, match="in scale mode a pgm cannot say unknown"):
        write_map(path, grid, "scale", "pgm")
    assert list(tmp_path.iterdir()) == []
    known = OccupancyGrid(np.array([[0, 37, 100]]), 0.05, SE2.identity())
    write_map(path, known, "scale", "pgm")
    np.testing.assert_array_equal(read_map(path).cells, known.cells)
    with pytest.raises(FileNotFoundError, match="nowhere"):
        write_map(tmp_path / "nowhere" / "map.yaml", known)

"""ROS maps made solid: the beams in them end where the map's cells do."""

import math
from functools import cache
from pathlib import Path

import mujoco
import numpy as np
import pytest

from experiments.cli import main
from experiments.map_worlds import MapWorld, map_world
from kitasap_sim.places import Place
from slam.files.map_files import write_map
from slam.occupancy_grid import OccupancyGrid
from slam.se2 import SE2
from tests.experiments.cell_rays import free_length
from tests.experiments.refusals import refusal

CELL_M = 0.05
CORNER = SE2(-3.0, 12.5, 0.4)
START = SE2(0.75, 1.25, 0.3)
"""In the frame of the cells."""


def office() -> np.ndarray:
    """Two rooms and a closet of 6 x 4 m in all, half of it unknown, with what maps have: specks,
    ragged walls, glimpses through windows that end in the unknown, or where the map ends."""
    rng = np.random.default_rng(7)
    cells = np.full((80, 120), -1, dtype=np.int8)
    cells[4:50, 4:60] = cells[4:50, 63:100] = 0
    cells[20:40, 60:63] = 0  # a door
    cells[60:70, 4:20] = 0  # a closet without one
    cells[70, 20] = 0
    cells[30:34, 100:] = 0  # a window to where the map ends
    for _ in range(40):  # ragged edges
        row, column = rng.integers(2, 52), rng.choice([3, 60, 62, 100])
        cells[row, column] = rng.choice([0, -1])
    cells[30:33, 80:82] = 100  # a thing of six cells
    cells[10, 70] = -1
    cells[14:16, 90] = 100, -1
    cells[45, 40:43] = 100
    return cells


def written(folder: Path, cells: np.ndarray, pose: SE2 = CORNER) -> Path:
    write_map(folder / "office.yaml", OccupancyGrid(cells, CELL_M, pose))
    return folder / "office.yaml"


@pytest.fixture(scope="module")
def world(tmp_path_factory: pytest.TempPathFactory) -> MapWorld:
    return map_world(written(tmp_path_factory.mktemp("maps"), office()), 0.8)


@cache
def compiled(world: MapWorld) -> tuple[mujoco.MjModel, mujoco.MjData]:
    model = mujoco.MjModel.from_xml_string(world.mjcf)
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    return model, data


def beams(world: MapWorld, origin_cells: np.ndarray, angles: np.ndarray) -> np.ndarray:
    """(N,) ranges in MuJoCo, in cells; from one spot and by directions in the frame of the cells."""
    model, data = compiled(world)
    x, y = (world.T_map_grid @ (origin_cells[None] * world.resolution_m))[0]
    headings = angles + world.T_map_grid.theta
    ways = np.stack([np.cos(headings), np.sin(headings), 0.0 * headings], axis=1)
    count = len(angles)
    hit, ranges_m = np.zeros(count, dtype=np.int32), np.zeros(count)
    mujoco.mj_multiRay(
        model, data, np.array([x, y, 0.1]), ways.ravel(), None, 1, -1,
        hit, ranges_m, None, count, mujoco.mjMAXVAL,
    )  # fmt: skip
    assert (hit >= 0).all(), "a beam got out"
    return ranges_m / world.resolution_m


def test_beams_end_where_the_cells_do(world):
    rng = np.random.default_rng(1)
    free = np.argwhere(~world.solid)
    for row, column in rng.permutation(free)[:40].tolist():
        spot = np.array([column, row]) + rng.random(2)
        angles = rng.uniform(-math.pi, math.pi, 50)
        cast = [free_length(world.solid, *spot, angle) for angle in angles.tolist()]
        # the boxes reach 0.1 um beyond the cells
        np.testing.assert_allclose(beams(world, spot, angles), cast, atol=1e-3)


def test_no_beam_leaks(world):
    rng = np.random.default_rng(2)
    free = np.argwhere(~world.solid)
    farthest = math.hypot(*world.solid.shape)
    for row, column in rng.permutation(free)[:100].tolist():
        ranges = beams(world, np.array([column, row]) + rng.random(2), rng.uniform(-9, 9, 1000))
        assert (ranges < farthest).all()


@pytest.mark.parametrize("pose", [SE2.identity(), SE2(-3.1, 12.7, 0.0), CORNER])
def test_no_beam_slips_along_a_seam(tmp_path, pose):
    # from corners of cells, along their sides and diagonals: by rounding, one in a hundred did
    world = map_world(written(tmp_path, office(), pose), 0.8, speck_cells=0)
    is_free = ~world.solid
    is_inner = is_free[1:, 1:] & is_free[:-1, 1:] & is_free[1:, :-1] & is_free[:-1, :-1]
    angles = np.arange(8) * math.pi / 4
    for row, column in np.argwhere(is_inner)[::17].tolist():
        spot = np.array([column + 1.0, row + 1.0])
        for angle, length in zip(angles, beams(world, spot, angles), strict=True):
            # along a side of cells either side's walls may count, through a corner its neighbours'
            asides = ((1, 0.7), (1, -0.7), (-1, 0.7), (-1, -0.7), (0.7, 1), (-0.7, -1))
            cast = [free_length(world.solid, *(spot + 1e-5 * np.array(a)), angle) for a in asides]
            assert length <= max(cast) + 1e-3


def test_what_is_not_free_is_solid_and_specks_are_not(tmp_path, world):
    cells = office()
    # the rim, two cells wide, and the frame of the map are taken into account
    points = (np.indices(cells.shape).reshape(2, -1).T[:, ::-1] + 0.5) * CELL_M
    at = np.floor((world.T_map_grid.inverse() @ (CORNER @ points)) / CELL_M).astype(int)
    is_inside = ((at >= 0) & (at < world.solid.shape[::-1])).all(axis=1)
    found = np.ones(len(points), dtype=bool)
    found[is_inside] = world.solid[tuple(at[is_inside, ::-1].T)]
    found = found.reshape(cells.shape)
    expected = cells != 0
    expected[60:71, 4:21] = True  # the closet has no door
    expected[10, 70] = expected[14:16, 90] = False  # of one and two cells
    is_ragged = np.isin(np.arange(120), (3, 60, 62, 100))
    np.testing.assert_array_equal(found[:, ~is_ragged], expected[:, ~is_ragged])
    # three in a row are a thing
    assert found[45, 40:43].all()
    assert world.pockets >= 2


def test_specks_may_all_be_kept_or_things_lost(tmp_path):
    path = written(tmp_path, office())
    assert map_world(path, 0.8, speck_cells=0).specks == 0
    fewer, more = (map_world(path, 0.8, speck_cells=count).boxes for count in (6, 0))
    assert fewer < more


def test_the_place_is_closed_and_its_poses_lie_in_the_free_cells(tmp_path, world):
    path = tmp_path / "office.xml"
    path.write_text(world.mjcf)
    place = Place(str(path))
    assert place.has_floor
    at = (world.T_map_grid.inverse() @ place.free_centres_m) / CELL_M
    assert not world.solid[tuple(np.floor(at[:, ::-1]).astype(int).T)].any()
    # on both sides of the door
    assert at[:, 0].min() < 20
    assert at[:, 0].max() > 80
    segments_m = place.map_at(0.10).segments_m
    # all that is seen is a side of a cell
    grid = (world.T_map_grid.inverse() @ segments_m.reshape(-1, 2)).reshape(-1, 2, 2) / CELL_M
    off = np.abs(grid - np.round(grid)).min(axis=2)
    assert off.max() < 1e-4


def test_the_start_is_where_it_is_wanted(tmp_path):
    path = written(tmp_path, office())
    start = CORNER @ START
    place = Place.of_mjcf(
        mujoco.MjSpec.from_string(map_world(path, 0.8, start=start).mjcf), "office"
    )
    np.testing.assert_allclose(place.start, start.as_array(), atol=1e-8)


def test_the_closet_is_the_place_where_the_robot_starts_there(tmp_path):
    cells = office()
    cells[52:76, 4:30] = 0  # large enough for the robot
    cells[50:52] = -1
    path = written(tmp_path, cells)
    world = map_world(path, 0.8, start=CORNER @ SE2(0.8, 3.2, 0.0))
    assert world.free_m2 == pytest.approx(24 * 26 * CELL_M**2)


@pytest.mark.parametrize(
    ("cells", "start", "said"),
    [
        (np.full((50, 50), -1, np.int8), None, "nowhere in its free space are 0.3 m of room"),
        (np.zeros((8, 50), np.int8), None, "nowhere in its free space are 0.3 m of room"),
        (office(), SE2(100.0, 0.0, 0.0), r"its start \(100.00, 0.00\) has less than 0.3 m"),
        (office(), CORNER @ SE2(3.1, 1.0, 0.0), "has less than 0.3 m of known free space"),
    ],
)  # fmt: skip
def test_maps_without_room_are_refused(tmp_path, cells, start, said):
    with pytest.raises(ValueError, match=f"/office.yaml: .*{said}"):
        map_world(written(tmp_path, cells), 0.8, start=start)


def test_ragged_maps_are_refused(tmp_path, monkeypatch):
    monkeypatch.setattr("experiments.map_worlds._MOST_BOXES", 10)
    with pytest.raises(ValueError, match=r"/office.yaml: its walls are too ragged.* more than 10 "):
        map_world(written(tmp_path, office()), 0.8)


@pytest.mark.parametrize("resolution", ["1000", "1e7", "1e300"])
def test_maps_as_wide_as_a_town_are_refused(tmp_path, resolution):
    path = written(tmp_path, office())
    path.write_text(path.read_text().replace("resolution: 0.05", f"resolution: {resolution}"))
    with pytest.raises(ValueError, match=r"/office.yaml: 120 x 80 cells .* 600 m wide at most"):
        map_world(path, 0.8)


def test_the_command_writes_a_place_once(tmp_path, capsys):
    path, out = written(tmp_path, office()), tmp_path / "places" / "office.xml"
    assert main(["world", "from-map", str(path), "--out", str(out)]) == 0
    printed = capsys.readouterr().out
    assert "120 x 80" not in printed  # what is beyond the free space is left out
    assert f"place: {out}" in printed
    before = out.read_text()
    line = refusal(capsys, "world", "from-map", path, "--out", out, "--height", "1")
    assert line == f"--out {out} is there already: give another name, or --overwrite"
    assert out.read_text() == before
    assert main(["world", "from-map", str(path), "--out", str(out), "--height", "1", "--overwrite"]) == 0  # fmt: skip
    assert out.read_text() != before
    assert [file.name for file in out.parent.iterdir()] == ["office.xml"]


@pytest.mark.parametrize(
    ("options", "said"),
    [
        (["--out", "office.txt"], "--out takes an MJCF file, and office.txt does not end in .xml"),
        (["--out", "a.xml", "--height", "0.2"], "--height takes 0.5 m, above every laser, to 10 m"),
        (["--out", "a.xml", "--height", "nan"], "--height takes 0.5 m"),
        (["--out", "a.xml", "--start", "nan", "0", "0"], "--start takes three finite numbers"),
    ],
)
def test_the_command_refuses_what_it_cannot_do(tmp_path, monkeypatch, capsys, options, said):
    monkeypatch.chdir(tmp_path)
    path = written(tmp_path, office())
    assert refusal(capsys, "world", "from-map", path, *options).startswith(said)
    assert sorted(file.name for file in tmp_path.iterdir()) == ["office.pgm", "office.yaml"]

"""Floor plans in YAML and houses of HouseExpo, through the command."""

import json
import math
from pathlib import Path

import numpy as np
import pytest

from experiments.cli import main
from experiments.house_files import read_house
from experiments.plan_example import EXAMPLE
from experiments.plan_files import read_plan
from kitasap_sim.places import Place
from kitasap_sim.simulation import Simulation
from tests.experiments.refusals import refusal

SQUARE_PLAN = "walls:\n  - {line: [[0, 0], [3, 0], [3, 3], [0, 3]], closed: yes}\n"
HOUSE = {
    "verts": [
        *([0, 0], [5, 0], [5, 1.2], [5.12, 1.2], [5.12, 0], [9, 0], [9, 5], [5.12, 5]),
        *([5.12, 2.2], [5, 2.2], [5, 5], [0, 5]),
    ],
    "id": "two rooms, a wall of 12 cm with a door of a metre",
    "room_num": 2,
    "bbox": {"min": [0, 0], "max": [9, 5]},
    "room_category": {"indoor": [[0, 0, 9, 5]]},
}


def made(command: str, path: Path) -> Place:
    out = path.with_suffix(".xml")
    assert main(["world", command, str(path), "--out", str(out)]) == 0
    return Place(str(out))


def written(folder: Path, content: object, name: str = "house.json") -> Path:
    text = content if isinstance(content, str) else json.dumps(content)
    (folder / name).write_text(text)
    return folder / name


def test_the_plan_that_the_help_shows_is_a_place(tmp_path, capsys):
    assert main(["world", "from-plan", "--help"]) == 0
    # as somebody would copy it from the terminal
    printed = capsys.readouterr().out.splitlines()
    first = next(i for i, line in enumerate(printed) if "# two rooms" in line)
    last = next(i for i, line in enumerate(printed) if "start:" in line)
    copied = "\n".join(line.removeprefix("  ") for line in printed[first : last + 1])
    assert copied == EXAMPLE.rstrip()
    assert len(EXAMPLE.splitlines()) <= 20
    place = made("from-plan", written(tmp_path, copied, "plan.yaml"))
    np.testing.assert_allclose(place.start, [1.0, 1.0, math.pi / 2], atol=1e-8)
    assert place.is_free(np.array([[1.0, 2.6], [5.0, 1.0]])).all()  # both rooms, by the door
    assert not place.is_free(np.array([[1.8, 2.4], [5.0, 3.0], [0.5, 3.6], [3.5, 0.5]])).any()


def test_a_plan_without_a_start_gets_the_roomiest_spot(tmp_path):
    place = made("from-plan", written(tmp_path, SQUARE_PLAN, "plan.yaml"))
    np.testing.assert_allclose(place.start[:2], [1.5, 1.5], atol=0.1)
    assert "start" in place.path.read_text()


def test_the_robot_stands_and_sees_in_a_place_of_a_plan(tmp_path):
    place = made("from-plan", written(tmp_path, EXAMPLE, "plan.yaml"))
    simulation = Simulation(place, rng=np.random.default_rng(0))
    ranges_m = simulation.true_ranges_m()
    # the wall of 4 m, from the laser ahead of the axle, which looks along y
    ahead = int(np.abs(simulation.laser.angles_rad).argmin())
    assert ranges_m[ahead] == pytest.approx(4.0 - 0.05 - 1.0 - 0.19, abs=1e-4)
    assert np.isfinite(ranges_m).all()


@pytest.mark.parametrize(
    ("plan", "said"),
    [
        ("", "a floor plan is given by keys (walls, height,"),
        ("walls: 5", "walls must be a list of entries, not '5'"),
        ("rooms: []", "a floor plan: there is no key 'rooms'; there are: walls, height,"),
        ("height: 1", "a floor plan: the key walls is missing"),
        ("walls: []", "a place needs something that stands on its floor"),
        ("walls: []\nstart: {at: [0, 0]}", "a place needs something that stands on its floor"),
        ("walls: [{line: [[0, 0], [.nan, 1]]}]", "walls 1: line takes numbers from -300 to 300"),
        ("walls: [{line: [[0, 0], [1e9, 1]]}]", "walls 1: line takes numbers from -300 to 300"),
        (
            "walls: [{line: [[0, 0], [1]]}]",
            "walls 1: line takes two numbers in brackets, not ['1']",
        ),
        ("walls: [{line: [[0, 0]]}]", "walls 1: a wall needs points, at least two, not 1"),
        ("walls: [{line: 7}]", "walls 1: line must be a list of points [x, y], not '7'"),
        ("walls: [{line: [[0, 0], [1, 0]], doors: [[0, 2]]}]", "walls 1: a door goes from"),
        ("walls: [{line: [[0, 0], [1, 0]], closed: maybe}]", "walls 1: closed takes yes or no"),
        ("walls: [{line: [[0, 0], [1, 0]], thickness: 0}]", "walls 1: thickness takes numbers"),
        ("height: inf\nwalls: []", "height takes numbers from 0.5 to 10, not 'inf'"),
        ("height: !!python/object/apply:os.getcwd []\nwalls: []", "height takes numbers"),
        ("walls: &a [*a]", "not a YAML file (an alias in line 1, which is not read here)"),
        ("walls: [", "not a YAML file (while parsing"),
        (SQUARE_PLAN + "boxes: [{at: [1, 1]}]", "boxes 1: the key size is missing"),
        (SQUARE_PLAN + "boxes: [{at: [1, 1], size: [-1, 1]}]", "boxes 1: size takes numbers"),
        (SQUARE_PLAN + "boxes: [{at: [1, 1], size: [1, 1], name: start}]", "the name 'start' is"),
        (SQUARE_PLAN + "cylinders: [{at: [1, 1], radius: x}]", "cylinders 1: radius takes numbers"),
        (SQUARE_PLAN + "start: {at: [0, 1]}", "place plan: its start (0.00, 1.00) has less than"),
        (SQUARE_PLAN + "start: [1, 1]", "start is given by keys (at, heading), not by ['1', '1']"),
        (
            "walls: [{line: [[0, 0], [1, 0]]}]",
            "nowhere within its walls are 0.3 m of room around the robot: are they closed? Or tell"
            " where it starts, by an entry start in it",
        ),
        (
            SQUARE_PLAN + "start: {at: [50, 50]}",
            "its start (50.00, 50.00) lies outside of all walls, which are in x from -0.0",
        ),
        ("height: 0.05\n" + SQUARE_PLAN, "height takes numbers from 0.5 to 10"),
    ],
)
def test_plans_that_are_none_are_refused(tmp_path, capsys, plan, said):
    path = written(tmp_path, plan, "plan.yaml")
    line = refusal(capsys, "world", "from-plan", path, "--out", tmp_path / "plan.xml")
    assert line.startswith(f"{path}: {said}")
    assert [file.name for file in tmp_path.iterdir()] == ["plan.yaml"]


def test_heights_and_angles_are_read_as_meant(tmp_path):
    plan = read_plan(written(tmp_path, EXAMPLE, "plan.yaml"))
    cupboard, table, pillar = plan.things
    assert (cupboard.height_m, table.height_m, pillar.height_m) == (1.2, 0.7, 0.8)
    assert table.heading_rad == pytest.approx(math.radians(30))
    assert [wall.thickness_m for wall in plan.walls] == [0.1, 0.15]


def test_a_house_is_made_of_its_outline(tmp_path, capsys):
    place = made("from-houseexpo", written(tmp_path, HOUSE))
    assert "2 rooms" in capsys.readouterr().out
    assert place.is_free(np.array([[1.0, 1.0], [8.0, 4.0], [5.06, 1.7]])).all()
    segments_m = place.map_at(0.1).segments_m
    corners = np.array(HOUSE["verts"], dtype=float)
    # every wall seen is one of the outline's, to the micrometre: they all run along the axes
    middles = segments_m.mean(axis=1)
    off = np.abs(middles[:, None] - corners[None]).min(axis=1).min(axis=1)
    assert off.max() < 1e-6
    length_m = np.abs(np.diff(np.concatenate([corners, corners[:1]]), axis=0)).sum()
    assert np.hypot(*np.diff(segments_m, axis=1)[:, 0].T).sum() == pytest.approx(length_m, abs=0.05)


def test_the_start_is_in_the_house_though_its_walls_are_larger(tmp_path):
    # all around the corridors of a hook lies one wall, wider than they are
    verts = [[0, 0], [9, 0], [9, 1.2], [1.2, 1.2], [1.2, 9], [0, 9]]
    place = made("from-houseexpo", written(tmp_path, {"verts": verts}))
    x, y, _ = place.start
    assert (0 < x < 1.2 and 0 < y < 9) or (0 < y < 1.2 and 0 < x < 9)


@pytest.mark.slow
def test_slanted_walls_become_small_steps(tmp_path):
    turned = math.radians(20)
    rotation = np.array(
        [[math.cos(turned), math.sin(turned)], [-math.sin(turned), math.cos(turned)]]
    )
    verts = (np.array([[0, 0], [4, 0], [4, 3], [0, 3]]) @ rotation).tolist()
    place = made("from-houseexpo", written(tmp_path, {"verts": verts}))
    points = place.map_at(0.1).points_m(0.01) @ rotation.T
    off = np.minimum(np.abs(points - [0, 0]), np.abs(points - [4, 3])).min(axis=1)
    assert off.max() < 0.036  # a step's diagonal
    assert len(place.free_centres_m) * place.free_cell_m**2 == pytest.approx(3.4 * 2.4, rel=0.08)


@pytest.mark.parametrize(
    ("house", "said"),
    [
        ("[" * 100_000, "not a JSON file (nested too deep)"),
        ('{"verts": [' + "[" * 100_000, "not a JSON file (nested too deep)"),
        ('{"verts"', "not a JSON file (Expecting"),
        ("\x00\x01", "not a JSON file ("),
        ("7", "expected a house of HouseExpo, with the key verts (found: 7)"),
        ({"a": 1}, "expected a house of HouseExpo, with the key verts (found: a)"),
        ({"a\x85b": 1}, "expected a house of HouseExpo, with the key verts (found: a?b)"),
        ({"verts": "abc"}, "verts must be 3 to 5000 points [x, y], not 'abc'"),
        ({"verts": [[0, 0]] * 5001}, "verts must be 3 to 5000 points [x, y], not 5001"),
        ({"verts": [[0, 0], [1, 0], [1, math.nan]]}, "verts must be points [x, y] in metres"),
        ({"verts": [[0, 0], [1e9, 0], [1, 1]]}, "verts must be points [x, y] in metres"),
        ({"verts": [[0, 0], [1, 0], [1, "1"]]}, "verts must be points [x, y] in metres"),
        ({"verts": [[0, 0], [1, 0], [1, 1, 1]]}, "verts must be points [x, y] in metres"),
        ({"verts": [[0, 0], [1, 0], [1, 10**400]]}, "verts must be points [x, y] in metres"),
        ({"verts": [[0, 0], [1, 1], [2, 2], [0, 0]]}, "nowhere within its walls"),
        ({"verts": [[1, 1], [1, 1], [1, 1]]}, "verts enclose no floor"),
        ({"verts": [[0, 0], [250, 1], [1, 250]]}, "its walls are too long and too slanted"),
        (
            {"verts": [[0, 0], [0.5, 0], [0.5, 0.5], [0, 0.5]], "room_num": 2},
            "nowhere within its walls are 0.3 m of room around the robot: are they closed? Or tell"
            " where it starts, by --start X Y HEADING",
        ),
    ],
)
def test_houses_that_are_none_are_refused(tmp_path, capsys, house, said):
    path = written(tmp_path, house)
    line = refusal(capsys, "world", "from-houseexpo", path, "--out", tmp_path / "house.xml")
    assert line.startswith(f"{path}: {said}")
    assert [file.name for file in tmp_path.iterdir()] == ["house.json"]


def test_more_than_a_house_is_not_read(tmp_path):
    with pytest.raises(ValueError, match=r"/house.json: longer than the 2 MB"):
        read_house(written(tmp_path, " " * 2_000_001))

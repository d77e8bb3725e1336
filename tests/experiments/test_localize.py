"""`kitasap localize`: a recorded log on a ROS map; its files, its honesty, and what it refuses."""

import csv
import json
import math
from pathlib import Path

import numpy as np
import pytest

from experiments.cli import main
from experiments.figures import localized_log_picture
from experiments.known_maps import LogConfig
from experiments.localize import VERDICT_COLUMNS, run, write_results
from experiments.real_logs import referenced
from kitasap_sim.hand import kidnap
from kitasap_sim.laser import laser
from kitasap_sim.simulation import Simulation
from slam.beams import Beams
from slam.files.map_files import read_map, write_map
from slam.occupancy_grid import FREE, OCCUPIED, UNKNOWN, OccupancyGrid
from slam.readers.carmen import read_carmen
from slam.se2 import SE2, wrap_angle
from slam.trajectory import read_tum
from tests.experiments.recorder import Recorder, rasterised
from tests.experiments.refusals import refusal

pytestmark = pytest.mark.usefixtures("own_folder")

DATA = Path(__file__).parents[1] / "data"
LOG = DATA / "fr101-excerpt.clf.gz"
REFERENCE = DATA / "fr101-excerpt.reference.tum"
FILES = {"verdicts.csv", "trajectory.tum", "summary.json", "localized.png", "localized.svg"}
FIRST_POSE = ("0.142678", "-0.013428", "0.552197")
"""Of the reference."""

Row = dict[str, str]


@pytest.fixture(scope="module")
def office(tmp_path_factory) -> Path:
    """A ROS map, made of all scans of the excerpt at their reference poses."""
    log = read_carmen(LOG)
    scans = [
        (T_reference, Beams.of(measurement.scan, log.T_base_laser))
        for measurement, T_reference in referenced(log, read_tum(REFERENCE), 12.0)
    ]
    path = tmp_path_factory.mktemp("maps") / "office.yaml"
    write_map(path, OccupancyGrid.of_scans(scans, 0.05))
    return path


@pytest.fixture(scope="module")
def unknown_start(office, tmp_path_factory) -> Path:
    """The results of the excerpt on the office's map, the start unknown."""
    return localized(office, LOG, tmp_path_factory.mktemp("unknown"))


@pytest.fixture(scope="module")
def known_start(office, tmp_path_factory) -> Path:
    """The results from the reference's first pose."""
    return localized(office, LOG, tmp_path_factory.mktemp("known"), "--start", *FIRST_POSE)


def localized(known_map: Path, log: Path, out: Path, *options: str, status: int = 0) -> Path:
    assert main(["localize", str(known_map), str(log), "--out", str(out), *options]) == status
    return out


def verdicts(folder: Path) -> list[Row]:
    with (folder / "verdicts.csv").open(newline="") as file:
        return list(csv.DictReader(file))


def off(row: Row, true: np.ndarray) -> tuple[float, float]:
    """Distance [m] and turn [rad] of a row's pose from a true one (3,)."""
    x, y, theta = (float(row[key]) for key in ("x", "y", "theta"))
    return math.hypot(x - true[0], y - true[1]), abs(wrap_angle(theta - true[2]))


def check_tracked_rows(rows: list[Row], poses: np.ndarray, most_m: float, most_rad: float) -> None:
    """Asserts that poses believed are right."""
    for row, true in zip(rows, poses, strict=True):
        if row["status"] == "tracking":
            off_m, off_rad = off(row, true)
            assert off_m < most_m, row
            assert off_rad < most_rad, row


# --- the excerpt of a real log


@pytest.mark.slow
@pytest.mark.parametrize("run_of", ["unknown_start", "known_start"])
def test_files_agree_with_each_other(run_of, request):
    folder = request.getfixturevalue(run_of)
    assert {path.name for path in folder.iterdir()} == FILES
    rows, summary = verdicts(folder), json.loads((folder / "summary.json").read_text())
    assert (folder / "verdicts.csv").read_text().splitlines()[0] == ",".join(VERDICT_COLUMNS)
    assert len(rows) == summary["scans"] == 20
    for status in ("tracking", "unsure", "lost"):
        assert summary[status] == sum(row["status"] == status for row in rows)
    assert summary["tracking"] + summary["unsure"] + summary["lost"] == 20
    start = [float(number) for number in FIRST_POSE] if run_of == "known_start" else None
    assert summary["start"] == start
    assert (summary["log"], summary["map"]) == (LOG.name, "office.yaml")
    # written with six decimals and with nine
    placed = [row for row in rows if row["x"]]
    trajectory = read_tum(folder / "trajectory.tum")
    written = np.array([[float(row[key]) for key in ("time", "x", "y")] for row in placed])
    np.testing.assert_allclose(trajectory.times_s, written[:, 0], atol=1e-6)
    np.testing.assert_allclose(trajectory.poses[:, :2], written[:, 1:], atol=1e-6)
    assert (folder / "localized.png").read_bytes()[:4] == b"\x89PNG"


@pytest.mark.parametrize(
    "run_of", ["unknown_start", pytest.param("known_start", marks=pytest.mark.slow)]
)
def test_what_is_believed_is_near_the_reference(run_of, request):
    rows = verdicts(request.getfixturevalue(run_of))
    # the reference is good to 3 cm, the map's cells are 5 cm
    check_tracked_rows(rows, read_tum(REFERENCE).poses, 0.15, math.radians(3.0))
    assert rows[-1]["status"] == "tracking"
    stamps = [measurement.time_s for measurement in read_carmen(LOG).measurements()]
    np.testing.assert_allclose([float(row["time"]) for row in rows], stamps, atol=1e-6)


def test_warnings_stand_apart_from_the_reasons_of_a_verdict(unknown_start):
    rows, summary = (
        verdicts(unknown_start),
        json.loads((unknown_start / "summary.json").read_text()),
    )
    # the log has no times of beams, and its robot moves
    told = [row for row in rows if "scan not straightened" in row["warnings"]]
    assert told
    assert any(row["status"] == "tracking" and not row["reasons"] for row in told)
    warned = [row["warnings"] for row in rows if row["warnings"]]
    assert summary["warned"] == len(warned)
    assert "; ".join(summary["warnings"]) == warned[-1]


@pytest.mark.slow
def test_given_start_is_believed_at_the_first_scan(known_start, unknown_start):
    assert verdicts(known_start)[0]["status"] == "tracking"
    assert verdicts(unknown_start)[0]["status"] != "tracking"
    known, unknown = (
        json.loads((folder / "summary.json").read_text()) for folder in (known_start, unknown_start)
    )
    assert known["tracking"] >= unknown["tracking"]
    assert unknown["recoveries_s"]


def test_covariance_is_claimed_where_the_pose_is_believed_alone(unknown_start):
    rows = verdicts(unknown_start)
    for row in rows:
        variances = [row[key] for key in VERDICT_COLUMNS if key.startswith(("var", "cov"))]
        if row["status"] == "tracking":
            assert all(variances)
            x, xy, xt, y, yt, t = map(float, variances)
            covariance = np.array([[x, xy, xt], [xy, y, yt], [xt, yt, t]])
            assert np.linalg.eigvalsh(covariance).min() > 0.0
        else:
            assert row["reasons"]
            assert "scan not straightened" not in row["reasons"]
    # of one place among several it would only tell how well the scan fits there
    assert not rows[0]["var_x"]


@pytest.mark.slow
def test_wrong_start_is_noticed_and_put_right(office, tmp_path):
    # negative numbers are no options
    folder = localized(office, LOG, tmp_path / "out", "--start", "-1", "-2", "0.5")
    rows = verdicts(folder)
    assert json.loads((folder / "summary.json").read_text())["start"] == [-1.0, -2.0, 0.5]
    assert "tracking" not in {row["status"] for row in rows[:2]}
    check_tracked_rows(rows, read_tum(REFERENCE).poses, 0.15, math.radians(3.0))
    assert rows[-1]["status"] == "tracking"


@pytest.mark.slow
def test_same_log_gives_the_same_bytes(office, known_start, tmp_path):
    again = localized(office, LOG, tmp_path / "out", "--start", *FIRST_POSE)
    for name in FILES:
        assert (again / name).read_bytes() == (known_start / name).read_bytes(), name


# --- a simulated drive, whose truth is known


@pytest.mark.slow
def test_teleported_robot_notices_and_finds_itself(tmp_path):
    simulation = Simulation("room_fig4", laser("lms200"), rng=np.random.default_rng(0))
    write_map(tmp_path / "room.yaml", rasterised(simulation))
    recorder = Recorder(simulation)
    recorder.drive((4.2, 2.6))
    jump = len(recorder.truth)
    kidnap(simulation, np.array([2.3, 3.7, -2.0]))
    recorder.drive((2.6, 4.4))
    (tmp_path / "drive.clf").write_text("\n".join(recorder.lines) + "\n")
    assert len(recorder.truth) <= 40
    folder = localized(tmp_path / "room.yaml", tmp_path / "drive.clf", tmp_path / "out")
    rows = verdicts(folder)
    statuses = [row["status"] for row in rows]
    # a pose believed is right, to a cell of the map
    check_tracked_rows(rows, np.array(recorder.truth), 0.05, math.radians(2.0))
    assert statuses[jump - 1] == "tracking", "it had found itself before it was carried away"
    assert set(statuses[jump : jump + 2]) != {"tracking"}
    assert statuses[-1] == "tracking"
    assert len(json.loads((folder / "summary.json").read_text())["recoveries_s"]) == 2


# --- what cannot be localised


@pytest.mark.parametrize(
    ("text", "said"),
    [
        (None, "No such file or directory"),
        (b"\x89PNG\r\n\x1a\n\x00\x01", "not a YAML file"),
        (b"image: [", "not a YAML file"),
        (b"", "expected keys such as image and resolution, found nothing"),
        (b"resolution: 0.05\norigin: [0, 0, 0]\n", "the key image is missing"),
        (b'"resol\\Nution": 0.05\norigin: [0, 0, 0]\n', "(found: resol?ution, origin)"),
    ],
)
def test_map_that_is_none_is_refused(text, said, tmp_path, capsys):
    path = tmp_path / "map.yaml"
    if text is not None:
        path.write_bytes(text)
    line = refusal(capsys, "localize", path, LOG, "--out", tmp_path / "out")
    assert "map.yaml" in line
    assert said in line
    assert not (tmp_path / "out").exists()


def test_map_whose_image_is_cut_or_gone_is_refused(office, tmp_path, capsys):
    (tmp_path / "office.yaml").write_bytes(office.read_bytes())
    assert "office.pgm" in refusal(capsys, "localize", tmp_path / "office.yaml", LOG)
    content = office.with_suffix(".pgm").read_bytes()
    (tmp_path / "office.pgm").write_bytes(content[: len(content) // 2])
    assert "office.pgm" in refusal(capsys, "localize", tmp_path / "office.yaml", LOG)


@pytest.mark.parametrize(
    ("around", "wall", "said"),
    [
        (FREE, FREE, "no cell of the map is occupied"),
        # walls in nowhere: this once said that none of the cells is occupied
        (UNKNOWN, OCCUPIED, "no occupied cell of the map is beside a free one"),
    ],
)
def test_map_without_a_wall_to_see_is_refused(around, wall, said, tmp_path, capsys):
    cells = np.full((40, 40), around)
    cells[10, 5:20] = wall
    cells[30:, 30:] = FREE
    write_map(tmp_path / "map.yaml", OccupancyGrid(cells, 0.05, SE2.identity()))
    line = refusal(capsys, "localize", tmp_path / "map.yaml", LOG)
    assert line.startswith(f"{tmp_path}/map.yaml: {said}")


@pytest.mark.parametrize("resolution", ["1000", "1e9"])
def test_map_of_cells_as_large_as_a_country_is_refused_before_it_fills_the_memory(
    resolution, tmp_path, capsys
):
    cells = np.full((40, 40), FREE, dtype=np.int8)
    cells[10:30, 10:30] = OCCUPIED
    path = tmp_path / "map.yaml"
    write_map(path, OccupancyGrid(cells, 0.05, SE2.identity()))
    path.write_text(path.read_text().replace("0.05", resolution))
    line = refusal(capsys, "localize", path, LOG, "--out", tmp_path / "out")
    assert line.startswith(f"{path}: a map of ")
    assert "too large to search" in line
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize(
    ("text", "said"),
    [
        (None, "No such file or directory"),
        ("ODOM 0 0 0 0 0 0 1 host 1\n", "no FLASER, ROBOTLASER1 or RAWLASER line"),
        ("", "is empty; expected a CARMEN log"),
        ("FLASER 180 1.0 2.0\n", "log.clf line 1: FLASER announces 180 ranges, found 0"),
    ],
)
def test_log_without_scans_is_refused(text, said, office, tmp_path, capsys):
    path = tmp_path / "log.clf"
    if text is not None:
        path.write_text(text)
    line = refusal(capsys, "localize", office, path, "--out", tmp_path / "out")
    assert "log.clf" in line
    assert said in line
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize(
    ("start", "said"),
    [
        (["1", "2"], "--start"),
        (["1", "2", "here"], "Invalid value for '--start'"),
        (["nan", "2", "0"], "--start takes three finite numbers"),
        (["1", "-inf", "0"], "--start takes three finite numbers"),
        (["1", "2", "3", "4"], "unexpected extra argument"),
        (["1", "2", "90"], "--start takes radians, and 90 is more than a turn: is it degrees?"),
        (["900", "2", "0"], "m off the map, whose walls are seen from up to 12 m"),
    ],
)
def test_start_that_is_no_pose_is_refused(start, said, office, capsys):
    assert said in refusal(capsys, "localize", office, LOG, "--start", *start)


def test_unknown_method_is_refused_with_those_there_are(office, capsys):
    assert refusal(capsys, "localize", office, LOG, "--method", "paper") == (
        "no method called 'paper' here; there are: open3d, fast, limit"
    )


# --- a robot that never has a pose


@pytest.fixture
def blind_log(tmp_path) -> Path:
    """A metre by the wheels alone, then three scans without a single return."""
    lines = ["ODOM -1 0 0 0 0 0 0.1 host 0.1"]
    for n in range(3):
        ranges = " ".join(["81.91"] * 181)
        lines.append(f"FLASER 181 {ranges} {0.1 * n} 0 0 {0.1 * n} 0 0 {n}.5 host {n}.5")
    (tmp_path / "blind.clf").write_text("\n".join(lines) + "\n")
    return tmp_path / "blind.clf"


@pytest.mark.slow
def test_robot_that_sees_nothing_claims_nothing(office, blind_log, tmp_path):
    # its poses once were those of the wheels from (0, 0, 0), good to 10 cm
    folder = localized(office, blind_log, tmp_path / "out", status=1)
    for row in verdicts(folder):
        assert row["status"] == "unsure"
        assert {row[key] for key in VERDICT_COLUMNS[2:-2]} == {""}
        assert "0 of 181 beams came back" in row["reasons"]
    assert len(read_tum(folder / "trajectory.tum")) == 0
    assert {path.name for path in folder.iterdir()} == FILES


def test_folder_that_is_a_file_is_named(office, blind_log, tmp_path, capsys):
    (tmp_path / "out").touch()
    line = refusal(capsys, "localize", office, blind_log, "--out", tmp_path / "out")
    assert line == f"--out takes a folder, and {tmp_path}/out is a file"


def test_robot_that_sees_nothing_follows_its_wheels_from_a_start(office, blind_log, tmp_path):
    write_results(run(office, blind_log, SE2(1.0, 0.0, 0.0)), tmp_path)
    rows = verdicts(tmp_path)
    assert [float(row["x"]) for row in rows] == pytest.approx([1.0, 1.1, 1.2], abs=1e-6)
    assert {row["status"] for row in rows} == {"unsure"}
    spreads = [float(row["var_x"]) for row in rows]
    # the motion before the first scan is not the start's: it adds nothing to its spread
    assert spreads[0] == pytest.approx(0.1**2, rel=0.01)
    assert spreads == sorted(spreads)


@pytest.mark.slow
def test_picture_of_a_map_that_lies_askew_is_drawn(office, blind_log, tmp_path):
    grid = read_map(office)
    turned = OccupancyGrid(grid.cells, grid.resolution_m, SE2(3.0, -2.0, 0.7))
    write_map(tmp_path / "turned.yaml", turned)
    result = run(tmp_path / "turned.yaml", blind_log, SE2(3.0, 0.0, 0.0), LogConfig("fast"))
    assert result.known.grid is not None
    assert result.known.grid.T_map_grid.theta == pytest.approx(0.7)
    assert localized_log_picture(tmp_path, result).stat().st_size > 10_000

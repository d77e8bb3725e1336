"""A log given for a map, or the other way round: one line says what it seems to be."""

from pathlib import Path

import pytest

from tests.experiments.refusals import refusal

DATA = Path(__file__).parents[1] / "data"
LOG = DATA / "fr101-excerpt.clf.gz"
TICKS = " ".join(["0", "0", "5", "5", *["0"] * 20, *["1000"] * 180]) + "\n"


@pytest.fixture(params=["carmen", "ticks", "bag"])
def log(request, tmp_path) -> Path:
    """A log of each kind, as far as it begins."""
    path = tmp_path / f"robot.{request.param}"
    contents = {"carmen": LOG.read_bytes(), "ticks": TICKS.encode(), "bag": b"#ROSBAG V2.0\n"}
    path.write_bytes(contents[request.param])
    return path


def test_log_in_the_place_of_a_known_map_is_called_one(log, capsys, tmp_path):
    assert refusal(capsys, "localize", log, "map.yaml", "--out", tmp_path / "out") == (
        f"{log}: is a log and no map: the map (map.yaml or map.kitasap) comes first, then the log"
    )


def test_log_in_the_place_of_a_map_to_continue_is_called_one(log, capsys, tmp_path):
    given = ("slam", "map.kitasap", "--map", log, "--out", tmp_path / "out")
    assert refusal(capsys, *given) == (
        f"{log}: is a log and no map: --map takes the map.kitasap that slam wrote, and the log"
        " stands without an option"
    )


def test_ros_map_cannot_be_continued(capsys, tmp_path):
    (tmp_path / "map.yaml").write_text("image: map.pgm\nresolution: 0.05\norigin: [0, 0, 0]\n")
    given = ("slam", LOG, "--map", tmp_path / "map.yaml", "--out", tmp_path / "out")
    assert refusal(capsys, *given) == (
        f"{tmp_path}/map.yaml: is a ROS map, which cannot be continued: give the map.kitasap that slam wrote"
    )


def test_map_that_is_not_there_is_called_missing(capsys, tmp_path):
    for name in ("map.yaml", "map.kitasap", "map.bag"):
        path = tmp_path / name
        said = f"{path}: No such file or directory"
        assert refusal(capsys, "slam", LOG, "--map", path, "--out", tmp_path / "out") == said
        assert refusal(capsys, "localize", path, LOG, "--out", tmp_path / "out") == said

"""Poses, relations and logs given for each other: one line says what came, and where it belongs."""

from pathlib import Path

import numpy as np
import pytest

from experiments.reference_files import read_poses, read_reference, read_related
from slam.files.kitti_files import write_kitti
from slam.metrics import Relations, built_relations, write_relations
from slam.trajectory import Trajectory, read_tum, write_tum
from tests.experiments.refusals import refusal

DATA = Path(__file__).parents[1] / "data"
LOG, REFERENCE = DATA / "fr101-excerpt.clf.gz", DATA / "fr101-excerpt.reference.tum"
OF_A_LOG = (
    "kitasap slam makes poses of a log, and kitasap convert LOG odometry.tum those of its wheels"
)
BY_RELATIONS = "evaluate, slam and bench continued take relations by --relations"


@pytest.fixture
def relations(tmp_path) -> Path:
    write_relations(tmp_path / "true.relations", built_relations(read_tum(REFERENCE)))
    return tmp_path / "true.relations"


@pytest.fixture
def kitti(tmp_path) -> Path:
    write_kitti(tmp_path / "true.kitti", read_tum(REFERENCE))
    return tmp_path / "true.kitti"


def test_poses_in_the_place_of_relations_are_told(capsys, tmp_path):
    line = "lines of t1 t2 x y z roll pitch yaw"
    said = (
        f"{REFERENCE} holds TUM poses: --relations takes {line}, and TUM poses are given by"
        " --reference"
    )
    assert refusal(capsys, "evaluate", REFERENCE, "--relations", REFERENCE) == said
    given = ("slam", LOG, "--relations", REFERENCE, "--out", tmp_path / "out")
    assert refusal(capsys, *given) == said
    said = f"{LOG} holds a log: --relations takes {line}"
    assert refusal(capsys, "evaluate", REFERENCE, "--relations", LOG) == said


def test_relations_in_the_place_of_poses_are_told(capsys, tmp_path, relations):
    said = f"{relations} holds relations: %s; {BY_RELATIONS}"
    poses = "takes poses: a TUM or KITTI file"
    line = refusal(capsys, "evaluate", REFERENCE, "--reference", relations)
    assert line == said % f"--reference {poses}"
    assert refusal(capsys, "evaluate", relations, REFERENCE) == said % f"TRAJECTORY {poses}"
    for command in ("slam", "real-log", "bench continued", "bench damage"):
        out = () if command.startswith("bench") else ("--out", tmp_path / "out")
        line = refusal(capsys, *command.split(), LOG, "--reference", relations, *out)
        assert line == said % "--reference takes true poses: a TUM file"


def test_log_in_the_place_of_poses_is_told(capsys, tmp_path):
    said = f"{LOG} holds a log: %s; {OF_A_LOG}"
    poses = "takes poses: a TUM or KITTI file"
    line = refusal(capsys, "evaluate", REFERENCE, "--reference", LOG)
    assert line == said % f"--reference {poses}"
    assert refusal(capsys, "evaluate", LOG, REFERENCE) == said % f"TRAJECTORY {poses}"
    for command in ("slam", "real-log"):
        line = refusal(capsys, command, LOG, "--reference", LOG, "--out", tmp_path / "out")
        assert line == said % "--reference takes true poses: a TUM file"


def test_poses_without_stamps_are_none_of_a_log(capsys, tmp_path, kitti):
    line = refusal(capsys, "slam", LOG, "--reference", kitti, "--out", tmp_path / "out")
    assert line.startswith(f"{kitti} holds KITTI poses: --reference takes true poses: a TUM file; ")
    assert len(read_poses(kitti, "--reference")[0]) == len(read_reference(REFERENCE))


def test_what_might_be_either_is_read_as_what_it_was_given_for(tmp_path):
    """A single relation of 1 rad is a unit quaternion as well; a damaged trajectory is still one."""
    write_relations(tmp_path / "one", Relations([[0.0, 1.0]], np.array([[0.0, 0.0, 1.0]])))
    assert len(read_related(tmp_path / "one").motions) == 1
    write_tum(tmp_path / "damaged", Trajectory(np.arange(5.0), np.zeros((5, 3))))
    damaged = (tmp_path / "damaged").read_text().splitlines()
    damaged[-1] = damaged[-1].replace("1.000000000", "2.000000000")
    (tmp_path / "damaged").write_text("\n".join(damaged))
    with pytest.raises(ValueError, match="line 6: the quaternion"):
        read_reference(tmp_path / "damaged")

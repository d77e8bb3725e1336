"""`kitasap evaluate`: known errors, the excerpt of a real log, and what it refuses."""

import json
import math
import os
import subprocess
import sys
import zipfile
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from experiments.cli import main
from experiments.evaluation import BUILT, evaluated, odometry_of, table
from slam.metrics import Relations, built_relations, write_relations
from slam.pose_arrays import composed
from slam.trajectory import Trajectory, read_tum, write_tum
from tests.experiments.refusals import refusal

DATA = Path(__file__).parents[1] / "data"
LOG = DATA / "fr101-excerpt.clf.gz"
REFERENCE = DATA / "fr101-excerpt.reference.tum"
PROGRAMS = Path(sys.executable).parent


def evaluation(tmp_path: Path, *arguments: object) -> dict[str, Any]:
    """What the command writes."""
    out = tmp_path / "out"
    assert main(["evaluate", *map(str, arguments), "--out", str(out)]) == 0
    assert [path.name for path in out.iterdir()] == ["evaluation.json"]
    return json.loads((out / "evaluation.json").read_text())


@pytest.fixture
def straight(tmp_path) -> Path:
    """The true way, 100 m straight ahead at 1 m/s, a pose each second."""
    times_s = np.arange(101.0)
    poses = np.column_stack([times_s, np.zeros((101, 2))])
    write_tum(tmp_path / "true.tum", Trajectory(times_s, poses))
    return tmp_path / "true.tum"


def estimate(tmp_path: Path, true: Path, poses: np.ndarray) -> Path:
    write_tum(tmp_path / "estimate.tum", Trajectory(read_tum(true).times_s, poses))
    return tmp_path / "estimate.tum"


def test_scale_error_is_told_by_each_metric(tmp_path, straight, capsys):
    poses = read_tum(straight).poses * [1.01, 1.0, 1.0]
    found = evaluation(tmp_path, estimate(tmp_path, straight, poses), "--reference", straight)
    assert (found["poses"], found["reference_coverage"]) == (101, 1.0)
    # aligned at the middle: 1 cm per metre from there
    assert found["ate"]["translation_m"]["max"] == pytest.approx(0.5)
    assert found["ate"]["translation_m"]["median"] == pytest.approx(0.25)
    assert found["rpe"]["1 m"]["translation_m"]["mean"] == pytest.approx(0.01)
    assert found["rpe"]["10 m"]["translation_m"]["median"] == pytest.approx(0.1)
    # the last of these pairs is 9 m apart
    assert found["rpe"]["10 m"]["translation_m"]["count"] == 92
    assert found["relations_of"] == BUILT
    assert found["relations"]["all"]["translation_m"]["mean"] == pytest.approx(0.01)
    # nobody came back on a straight way: null, not NaN, which is no JSON
    assert (found["relations"]["loop"]["count"], found["relations"]["loop"]["coverage"]) == (
        0,
        None,
    )
    assert found["relations"]["loop"]["translation_m"]["mean"] is None
    printed = capsys.readouterr().out
    assert "estimate.tum: 101 poses, 100.0% of the reference covered" in printed
    assert "relations built of the reference, 100.0% covered" in printed


def test_turn_of_the_sensor_is_told_in_degrees(tmp_path, straight):
    poses = np.add(read_tum(straight).poses, [0.0, 0.0, math.radians(2.0)])
    found = evaluation(tmp_path, estimate(tmp_path, straight, poses), straight)
    assert found["ate"]["rotation_deg"]["mean"] == pytest.approx(2.0)
    assert found["rpe"]["next pose"]["rotation_deg"]["max"] == pytest.approx(0.0, abs=1e-6)
    # a motion of 1 m, seen 2 degrees turned
    chord = 2.0 * math.sin(math.radians(1.0))
    assert found["relations"]["all"]["translation_m"]["mean"] == pytest.approx(chord)


def test_relations_of_a_file_are_taken_and_their_coverage_told(tmp_path, straight):
    relations = Relations([[0.0, 10.0], [10.5, 11.5], [90.0, 140.0]], np.zeros((3, 3)))
    write_relations(tmp_path / "a.relations", relations)
    found = evaluation(tmp_path, straight, "--relations", tmp_path / "a.relations")
    assert (found["relations_of"], found["ate"], found["rpe"]) == ("a.relations", None, {})
    assert found["relations"]["all"]["coverage"] == pytest.approx(2.0 / 3.0)
    assert found["relations"]["sequential"]["translation_m"]["mean"] == pytest.approx(5.5)
    assert found["relations"]["all"]["worst_times_s"] == [0.0, 10.0]
    assert (found["relations"]["loop"]["count"], found["relations"]["loop"]["covered"]) == (1, 0)


def test_excerpt_of_fr101_by_its_wheels_is_judged_as_by_hand(tmp_path):
    # the odometry at the very stamps of the reference, aligned by a search instead of a formula
    reference, odometry = read_tum(REFERENCE), odometry_of(LOG)
    write_tum(tmp_path / "wheels.tum", odometry)
    found = evaluation(tmp_path, tmp_path / "wheels.tum", "--reference", REFERENCE)
    rows = np.abs(odometry.times_s[:, np.newaxis] - reference.times_s).argmin(axis=0)
    poses = odometry.poses[rows]

    def rmse(turn_rad: float) -> float:
        turned = composed(np.array([0.0, 0.0, turn_rad]), poses)[:, :2]
        off = turned - turned.mean(0) - reference.poses[:, :2] + reference.poses[:, :2].mean(0)
        return float(np.sqrt(np.mean(np.sum(off**2, axis=1))))

    best = min(rmse(turn_rad) for turn_rad in np.linspace(-math.pi, math.pi, 20001))
    assert found["ate"]["translation_m"]["rmse"] == pytest.approx(best, rel=1e-4)
    assert found["reference_coverage"] == 1.0
    assert found["relations"]["sequential"]["count"] == 19


def test_log_carries_sparse_poses_and_without_it_they_cover_little(tmp_path):
    reference = read_tum(REFERENCE)
    sparse = Trajectory(reference.times_s[::5], reference.poses[::5])
    write_tum(tmp_path / "sparse.tum", sparse)
    write_relations(tmp_path / "a.relations", built_relations(reference))
    asked = (tmp_path / "sparse.tum", "--relations", tmp_path / "a.relations")
    carried = evaluation(tmp_path, *asked, "--odometry", LOG)["relations"]["all"]
    # four poses lie behind the last of every fifth
    assert carried["covered"] >= 15
    # wheels over at most five key scans
    assert carried["translation_m"]["mean"] < 0.1
    poses = evaluated(sparse, reference)
    assert poses.reference_coverage is not None
    assert poses.reference_coverage < 0.5
    assert "covered (few: --odometry LOG carries poses" in table(poses.summary(), "sparse.tum")
    assert "few:" not in table(evaluated(reference, reference).summary(), "reference.tum")


def test_file_in_place_of_a_folder_is_refused_before_anything_is_read(tmp_path, capsys):
    (tmp_path / "file").touch()
    line = refusal(capsys, "evaluate", "none.tum", REFERENCE, "--out", tmp_path / "file")
    assert line == f"--out takes a folder, and {tmp_path}/file is a file"


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        ([], "Missing argument 'TRAJECTORY'"),
        ([REFERENCE], "nothing to evaluate against: give --reference, --relations or both"),
        ([REFERENCE, REFERENCE, "--reference", REFERENCE], "give one reference"),
        (["none.tum", REFERENCE], "none.tum: No such file or directory"),
        ([DATA, REFERENCE], f"{DATA}: Is a directory"),
        (
            [REFERENCE, REFERENCE, "--odometry", REFERENCE],
            f"{REFERENCE}: line 2 begins",
        ),
    ],
)
def test_what_does_not_serve_is_refused_in_one_line(arguments, said, capsys):
    assert refusal(capsys, "evaluate", *arguments).startswith(said)


def test_trajectory_of_another_time_or_without_a_pose_is_refused(tmp_path, straight, capsys):
    assert "no pose at the times of the reference" in refusal(
        capsys, "evaluate", straight, REFERENCE
    )
    assert f"no pose of {straight} is of that time" in refusal(
        capsys, "evaluate", straight, straight, "--odometry", LOG
    )
    (tmp_path / "empty.tum").write_text("# time_s x y z qx qy qz qw\n")
    line = refusal(capsys, "evaluate", tmp_path / "empty.tum", straight)
    assert line == f"{tmp_path}/empty.tum: no pose in it, lines of time_s x y z qx qy qz qw"


def statistics_by(program: str, folder: Path, *arguments: str) -> dict[str, float]:
    """What a program of evo says of estimate.tum."""
    files = ["tum", str(folder / "true.tum"), str(folder / "estimate.tum")]
    result = folder / f"{program}.zip"
    command = [str(PROGRAMS / program), *files, *arguments, "--save_results", str(result)]
    subprocess.run(command, check=True, capture_output=True, env=os.environ | {"HOME": str(folder)})
    with zipfile.ZipFile(result) as archive:
        told = json.loads(archive.read("stats.json"))
    result.unlink()  # over which the next would ask whether to write
    return told


@pytest.mark.slow
@pytest.mark.skipif(not (PROGRAMS / "evo_ape").exists(), reason="evo is not installed")
def test_evo_says_the_same(tmp_path):
    rng = np.random.default_rng(0)
    steps = np.column_stack([np.full(300, 0.31), np.zeros(300), rng.normal(0.0, 0.2, 300)])
    poses = [np.zeros(3)]
    for step in steps:
        poses.append(composed(poses[-1][np.newaxis], step[np.newaxis])[0])
    true = Trajectory(np.arange(301.0), np.array(poses))
    write_tum(tmp_path / "true.tum", true)
    wrong = np.array(poses) + rng.normal(0.0, [0.05, 0.05, 0.02], (301, 3)) + [3.0, -2.0, 0.0]
    ours = evaluation(
        tmp_path, estimate(tmp_path, tmp_path / "true.tum", wrong), tmp_path / "true.tum"
    )
    ape = statistics_by("evo_ape", tmp_path, "--align")
    rpe = statistics_by("evo_rpe", tmp_path, "--delta", "1", "--delta_unit", "f", "--all_pairs")
    by_way = {
        name: statistics_by(
            "evo_rpe", tmp_path, "--delta", name.split()[0], "--delta_unit", "m", "--all_pairs",
            "--pairs_from_reference",
        )
        for name in ("1 m", "10 m")
    }  # fmt: skip
    for found, theirs in (
        (ours["ate"]["translation_m"], ape),
        (ours["rpe"]["next pose"]["translation_m"], rpe),
        *((ours["rpe"][name]["translation_m"], theirs) for name, theirs in by_way.items()),
    ):
        for key in ("rmse", "mean", "median", "max"):
            assert found[key] == pytest.approx(theirs[key], rel=1e-6)

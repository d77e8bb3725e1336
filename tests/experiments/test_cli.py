"""The command: whatever is wrong, one line says so and the status is 2."""

import os
import subprocess
import sys
from importlib.metadata import version
from pathlib import Path

import pytest

import models
from experiments.cli import main
from kitasap_sim.laser import LASERS
from tests.experiments.refusals import refusal

WALL_BELOW_THE_START = """
<mujoco>
  <worldbody>
    <geom type="box" size="2.1 0.05 0.5" pos="2 -0.05 0.5"/>
    <geom type="box" size="0.05 1.6 0.5" pos="4.05 1.5 0.5"/>
    <site name="start" pos="1.5 0.7 0"/>
  </worldbody>
</mujoco>
"""


@pytest.mark.parametrize(
    ("options", "said"),
    [
        (
            "flying",
            "no experiment called 'flying'; there are: localization, kidnap, tracking, mapping",
        ),
        (
            "kidnap --place moon",
            "no place called 'moon', nor a file; "
            "there are: place_fig6, room_fig4, round_room, symmetric_room",
        ),
        ("kidnap --laser x", "no laser called 'x'; there are: urg_04lx, utm_30lx, ust_10lx, "),
        (
            "localization --odometry x",
            "no odometry preset called 'x'; there are: ideal, as_built, rough_floor",
        ),
        (
            "localization --method x",
            "no method called 'x'; there are: odometry, line, paper, open3d",
        ),
        (
            "localization --method paper,paper",
            "name each method once, at least one: odometry, line, paper, open3d",
        ),
        ("kidnap --poses x", "no poses called 'x'; there are: paper, random"),
        ("localization --trials 0", "Invalid value for '--trials': "),
        ("localization --trials 1.5", "Invalid value for '--trials': "),
        ("localization --jobs 0", "Invalid value for '--jobs': "),
        ("localization --seed -1", "Invalid value for '--seed': "),
        ("localization --nonsense", "No such option: --nonsense"),
        ("", "Missing argument"),
    ],
)
def test_unknown_name_or_number_is_refused_with_what_exists(options, said, capsys, tmp_path):
    line = refusal(capsys, "run", *options.split(), "--out", tmp_path / "out")
    assert line.startswith(said)
    assert not (tmp_path / "out").exists()


def test_every_experiment_is_checked_before_the_first_one_runs(capsys, tmp_path):
    line = refusal(capsys, "run", "localization", "flying", "--out", tmp_path / "out")
    assert line.startswith("no experiment called 'flying'")
    assert not (tmp_path / "out").exists()


def test_unknown_command_is_refused(capsys):
    assert refusal(capsys, "fly") == "No such command 'fly'. See kitasap --help."
    assert refusal(capsys) == "Missing command. See kitasap --help."


def test_version_is_that_of_the_package(capsys):
    assert main(["--version"]) == 0
    assert capsys.readouterr().out.startswith(version("kitasap"))


@pytest.mark.parametrize(
    ("text", "said"),
    [
        (b"<mujoco><worldbody><geom", "is not a valid MJCF file: "),
        (b"\xff\xfe\x00", "is not a valid MJCF file: "),
        (b"", "is not a valid MJCF file: "),
        (b"<mujoco><worldbody/></mujoco>", "has nothing between 0.01 and 0.45 m "),
    ],
)
def test_broken_place_file_is_named(text, said, tmp_path, capsys):
    path = tmp_path / "zimmer ü.xml"
    path.write_bytes(text)
    line = refusal(capsys, "run", "localization", "--place", path, "--out", tmp_path)
    assert line.startswith(f"place {path} {said}")


def test_folder_is_no_place(tmp_path, capsys):
    line = refusal(capsys, "run", "kidnap", "--place", tmp_path)
    assert line.startswith(f"no place called '{tmp_path}', nor a file; there are: ")


def test_kidnap_needs_a_free_place_to_set_down(tmp_path, capsys):
    path = tmp_path / "wall.xml"
    path.write_text(WALL_BELOW_THE_START)
    line = refusal(capsys, "run", "kidnap", "--place", path, "--out", tmp_path / "out")
    assert line == (
        f"place {path}: nothing is free 1 m lower in y than its start; "
        "the robot cannot be kidnapped as in the paper there, but --poses anywhere works"
    )
    assert not (tmp_path / "out").exists()


def test_folder_that_cannot_be_written_is_named(tmp_path, box_room, capsys):
    # below a file: not even root can make that folder
    (tmp_path / "file").touch()
    out = tmp_path / "file/out"
    line = refusal(capsys, "run", "localization", "--place", box_room, "--out", out)
    assert line == f"{out}/localization: Not a directory"


def test_one_trial_refuses_what_a_run_refuses(capsys):
    assert refusal(capsys, "trial", "fly") == (
        "no experiment called 'fly'; there are: localization, kidnap, tracking, mapping"
    )
    assert refusal(capsys, "trial", "kidnap", "--index", "-1").startswith("Invalid value for '--i")


@pytest.mark.usefixtures("own_folder")
def test_log_that_is_not_there_is_named(capsys):
    line = refusal(capsys, "real-log", "none.clf", "--reference", "none.tum")
    assert line == "none.clf: No such file or directory"


@pytest.mark.slow
def test_more_jobs_than_trials_are_no_mistake(tmp_path, run_trials):
    assert run_trials(tmp_path, 1, ["--jobs", "99"]) == 0
    assert len((tmp_path / "localization/trials.jsonl").read_text().splitlines()) == 1


@pytest.mark.slow
def test_table_and_folder_are_printed(tmp_path, run_trials, capsys):
    assert run_trials(tmp_path, 2) == 0
    printed = capsys.readouterr()
    assert "box_room, urg_04lx, 2 trials, random poses" in printed.out
    assert printed.out.splitlines()[-1] == f"results and figures: {tmp_path}/localization"
    assert "localization 2 of 2: succeeded: odometry " in printed.err


def test_missing_system_library_is_said_before_the_first_trial(monkeypatch, capsys, tmp_path):
    import experiments.trials as trials

    def missing():
        raise ImportError("Open3D needs the system library libGL.so: apt-get install libgl1")

    monkeypatch.setattr(trials, "load_open3d", missing)
    line = refusal(capsys, "run", "localization", "--out", tmp_path / "out")
    assert line == "Open3D needs the system library libGL.so: apt-get install libgl1"
    assert not (tmp_path / "out").exists()


def test_opengl_that_cannot_be_loaded_is_told_as_that(monkeypatch, capsys, tmp_path):
    import experiments.trials as trials

    # MuJoCo loads what the variable asks for when it is imported, and lets through what that raises
    code = "raise AttributeError(\"'NoneType' object has no attribute 'glGetError'\")"
    file = "site-packages/mujoco/rendering/classic/gl_context.py"
    monkeypatch.setattr(trials, "load_open3d", lambda: exec(compile(code, file, "exec")))
    run = ("run", "localization", "--out", tmp_path / "out")
    monkeypatch.setenv("MUJOCO_GL", "osmesa")
    line = refusal(capsys, *run)
    assert line.startswith(
        "MuJoCo cannot load the OpenGL that MUJOCO_GL=osmesa asks for ('NoneType'"
    )
    assert line.endswith("unset MUJOCO_GL, or see kitasap doctor")
    # a fault of ours is not laid on it
    monkeypatch.setattr(trials, "load_open3d", lambda: exec(compile(code, "ours.py", "exec")))
    with pytest.raises(AttributeError, match="glGetError"):
        main([str(word) for word in run])


@pytest.mark.slow
def test_opengl_of_no_name_is_refused_in_one_line():
    done = subprocess.run(
        [sys.executable, "-m", "experiments.cli", "trial", "localization"],
        env=os.environ | {"MUJOCO_GL": "nonsense"}, capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert done.returncode == 2
    assert done.stderr.startswith("kitasap: MuJoCo cannot load the OpenGL")
    assert done.stderr.count("\n") == 1
    assert "unset MUJOCO_GL" in done.stderr


def test_help_names_every_laser_and_place(capsys):
    assert main(["run", "--help"]) == 0
    said = capsys.readouterr().out
    assert all(name in said for name in LASERS)
    assert all(path.stem in said for path in Path(models.__file__).parent.glob("places/*.xml"))

"""Sweeps: a run for each combination, and a table, of which the intervals hold."""

import csv
import json

import pytest

from experiments.assumptions import assumed_laser
from experiments.cli import main
from experiments.report.run_folder import RunFolder
from experiments.sequential import rate_interval
from experiments.statistics import wilson_interval
from experiments.sweeps import Varied, cells
from experiments.trials import TrialConfig
from tests.experiments.refusals import refusal


@pytest.fixture
def command(box_room, tmp_path) -> list[str]:
    options = ["--place", box_room, "--poses", "random", "--method", "odometry,line", "--jobs", "1"]
    return ["sweep", "localization", *options, "--out", str(tmp_path)]


def test_cells_are_all_combinations_whatever_the_order():
    varied = [Varied.parsed("laser.beams=60,181"), Varied.parsed("laser=ld06,lms200")]
    made = cells(TrialConfig(), varied)
    assert [cell.config.laser for cell in made] == [
        "ld06:beams=60", "lms200:beams=60", "ld06:beams=181", "lms200:beams=181",
    ]  # fmt: skip
    assert made[1].folder_name == "laser.beams=60,laser=lms200"
    (cell,) = cells(TrialConfig(), [Varied.parsed("turn-rate=1")])
    assert cell.config == TrialConfig(turn_rate_radps=1.0)
    (cell,) = cells(TrialConfig(), [Varied.parsed("place=a/b/office.xml")])
    assert cell.folder_name == "place=office"


@pytest.mark.parametrize(
    ("vary", "said"),
    [
        ("foo=1", "nothing called 'foo' can be varied; there are: duration, laser, map, "),
        ("laser.foo=1", "nothing called 'laser.foo' can be varied; there are: "),
        ("method=limit", "nothing called 'method' can be varied"),
        ("people", "--vary takes NAME=VALUE,VALUE,..., not 'people'"),
        ("people=1,,2", "--vary takes NAME=VALUE,VALUE,..., not 'people=1,,2'"),
        ("people=1,1", "--vary people has a value twice"),
        ("people=a", "--vary people takes numbers, not 'a'"),
        ("people=-1", "people are 0 or more, not -1"),
        ("success_m=nan", "success_m is above 0 and at most 1000, not nan"),
        ("start_error_rad=-1", "start_error_rad is 0 or more and at most 3.14159, not -1"),
        ("map_spacing_m=0", "map_spacing_m is above 0 and at most 1, not 0"),
        ("laser.beams=x", "laser urg_04lx:beams=x: beams is a whole number"),
        ("duration=5", "--duration changes nothing of localization: it is of tracking"),
    ],
)
def test_what_cannot_be_varied_is_refused_in_one_line(command, capsys, tmp_path, vary, said):
    assert refusal(capsys, *command, "--vary", vary).startswith(said)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.slow
def test_sweep_is_a_run_for_each_combination_a_table_and_a_figure(command, capsys, tmp_path):
    command += ["--vary", "laser.range_noise=1,3", "--vary", "start_error_m=0.02,0.1"]
    assert main([*command, "--trials", "3"]) == 0
    printed = capsys.readouterr()
    assert "laser.range_noise" in printed.out
    assert "4/4 laser.range_noise=3,start_error_m=0.1 3 of 3" in printed.err
    with (tmp_path / "sweep.csv").open(newline="") as file:
        rows = list(csv.DictReader(file))
    assert [(one["laser.range_noise"], one["start_error_m"], one["method"]) for one in rows] == [
        (noise, off, name) for noise in "13" for off in ("0.02", "0.1") for name in ("odometry", "line")
    ]  # fmt: skip
    for one in rows:
        run = RunFolder.read(tmp_path / one["folder"])
        told = run.summary["methods"][one["method"]]
        assert float(one["success_rate"]) == told["success_rate"]
        won = 3 - told["failures"]
        assert [float(one[f"success_{end}"]) for end in ("low", "high")] == pytest.approx(
            wilson_interval(won, 3)
        )
    assert run.config.laser == "urg_04lx:range_noise=3"
    assert (tmp_path / "sweep.png").read_bytes()[:4] == b"\x89PNG"
    # again: nothing is done but the table, which is the same
    before = (tmp_path / "sweep.json").read_bytes()
    assert main([*command, "--trials", "3"]) == 0
    assert (tmp_path / "sweep.json").read_bytes() == before


def test_combination_ends_when_it_is_known_and_is_a_whole_run(command, tmp_path, monkeypatch):
    monkeypatch.setattr("experiments.figures.sweep.sweep_figure", lambda _: None)
    # every trial a success: it is known to 0.12 after 20
    command += ["--vary", "success_m=9", "--vary", "success_rad=9", "--method", "odometry"]
    assert main([*command, "--trials", "90", "--until-ci", "0.12"]) == 0
    (cell,) = json.loads((tmp_path / "sweep.json").read_text())["cells"]
    figures = cell["methods"]["odometry"]
    assert (figures["trials"], figures["success_rate"]) == (20, 1.0)
    assert (figures["success_low"], figures["success_high"]) == rate_interval(20, 20)
    run = RunFolder.read(tmp_path / cell["folder"])
    assert (run.trials, len(run.records), run.summary["trials"]) == (20, 20, 20)
    log = (tmp_path / cell["folder"] / "trials.jsonl").read_bytes()
    assert main([*command, "--trials", "90", "--until-ci", "0.12"]) == 0
    assert (tmp_path / cell["folder"] / "trials.jsonl").read_bytes() == log


def test_samples_of_a_drive_end_no_sweep(capsys, tmp_path):
    command = ["sweep", "tracking", "--vary", "people=0", "--until-ci", "0.1", "--out", tmp_path]
    assert refusal(capsys, *command).startswith("--until-ci counts independent trials")


def test_laser_that_differs_is_assumed_to_differ():
    sold, changed = assumed_laser("urg_04lx"), assumed_laser("urg_04lx:range_noise=2:range_max_m=3")
    assert changed.noise.sigma_m([2.0]) == pytest.approx(2 * sold.noise.sigma_m([2.0]))
    assert (changed.range_min_m, changed.range_max_m) == (sold.range_min_m, 3.0)
    assert assumed_laser("urg_04lx:beams=60") == sold

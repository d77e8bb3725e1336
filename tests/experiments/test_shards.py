"""Shards: what they make of a run, put together, is what one run of all makes."""

import json
import shutil
from dataclasses import replace
from pathlib import Path

import pytest

from experiments.cli import main
from experiments.runs import Run
from experiments.shards import WHOLE, Shard
from experiments.trials import TrialConfig
from tests.experiments.refusals import refusal

TRIALS = 7
MEASURED = ("wall_s", "cpu_s")
"""Times: the only figures that differ from one repetition to the next."""


@pytest.fixture(scope="module")
def config(box_room) -> TrialConfig:
    return TrialConfig(poses="random", place=box_room, methods=("odometry", "line"))


@pytest.fixture(scope="module")
def folders(config, tmp_path_factory) -> Path:
    """`whole`, and `1` to `3`: its shards."""
    folder = tmp_path_factory.mktemp("shards")
    run = Run("localization", config, 4, TRIALS, folder / "whole/localization")
    run.execute(1, lambda *_: None)
    for number in (1, 2, 3):
        out = folder / f"{number}/localization"
        replace(run, folder=out, shard=Shard(number, 3)).execute(1, lambda *_: None)
    return folder


@pytest.fixture
def shards(folders, tmp_path) -> Path:
    """The same, to be damaged."""
    return Path(shutil.copytree(folders, tmp_path / "shards"))


@pytest.fixture(autouse=True)
def no_pictures(monkeypatch):
    monkeypatch.setattr("experiments.commands.execution.draw", lambda _: None)


def test_every_trial_is_of_one_shard():
    for count in (1, 2, 3, 10):
        of_all = [i for number in range(count) for i in Shard(number + 1, count).indices(TRIALS)]
        assert sorted(of_all) == list(range(TRIALS))
    assert Shard.parsed("2/4") == Shard(2, 4)
    assert Shard.parsed("1/1") == WHOLE


@pytest.mark.parametrize("text", ["", "2", "2/", "/4", "a/4", "0/4", "5/4", "-1/4", "1/4/4", "²/4"])
def test_shard_that_is_none_is_refused(text):
    with pytest.raises(ValueError, match="shard"):
        Shard.parsed(text)


def test_merged_shards_are_the_run_to_the_byte(folders, tmp_path):
    command = ["merge", *(str(folders / name) for name in "312"), "--out", str(tmp_path)]
    assert main(command) == 0
    whole, merged = folders / "whole/localization", tmp_path / "localization"
    for name in ("trials.jsonl", "trials.csv"):
        assert (merged / name).read_bytes() == (whole / name).read_bytes()
    summaries = [json.loads((one / "summary.json").read_text()) for one in (whole, merged)]
    for summary in summaries:
        for name in MEASURED:
            assert summary.pop(name) > 0.0
    assert summaries[0] == summaries[1]
    configs = [json.loads((one / "config.json").read_text()) for one in (whole, merged)]
    for one in configs:
        one.pop("command")
    assert configs[0] == configs[1]
    # once more: as if the first had been killed in the middle
    (merged / "summary.json").unlink()
    assert main(command) == 0
    assert (merged / "summary.json").exists()


def test_shard_tells_whose_it_is_and_is_no_other(shards, config):
    folder = shards / "2/localization"
    assert json.loads((folder / "config.json").read_text())["shard"] == "2/3"
    assert json.loads((folder / "summary.json").read_text())["trials"] == 2
    run = Run("localization", config, 4, TRIALS, folder)
    with pytest.raises(ValueError, match="holds shard 2/3 of this run, not shard 1/3: give each"):
        replace(run, shard=Shard(1, 3)).check()
    # a run of all does what is missing
    run.execute(1, lambda *_: None)
    log = (folder / "trials.jsonl").read_bytes()
    assert log == (shards / "whole/localization/trials.jsonl").read_bytes()
    with pytest.raises(ValueError, match="holds all trials of this run, not shard 2/3"):
        replace(run, shard=Shard(2, 3)).check()


def merged(shards: Path, *names: str) -> list[str]:
    return ["merge", *(str(shards / name) for name in names), "--out", str(shards / "out")]


def test_shards_that_do_not_make_a_run_are_refused(shards, config, capsys):
    def said(*names: str) -> str:
        line = refusal(capsys, *merged(shards, *names))
        assert not (shards / "out").exists()
        return line.replace(f"{shards}/", "")

    assert said("1", "3") == (
        "2 of 7 trials of localization are in none of the folders: shard 2/3 is missing"
    )
    shutil.copytree(shards / "2", shards / "copy")
    assert said("1", "2", "3", "copy") == (
        "2/localization and copy/localization both hold trial 1: shard 2/3 and shard 2/3"
    )
    assert said("1", "2", "2", "3", "whole").startswith(
        "1/localization and whole/localization both"
    )
    for name, other in (
        ("seed is 5, not 4", replace(Run("localization", config, 5, TRIALS, Path()))),
        ("trials is 8, not 7", Run("localization", config, 4, 8, Path())),
    ):
        folder = shards / name.split()[0]
        replace(other, folder=folder / "localization", shard=Shard(2, 3)).execute(
            1, lambda *_: None
        )
        assert said("1", folder.name, "3") == (
            f"{folder.name}/localization is no shard of the run in 1/localization: {name}"
        )
    assert said("1", "2", "nothing") == "nothing is no folder: name those that" + (
        " `kitasap run --shard` wrote"
    )
    (shards / "empty").mkdir()
    assert said("1", "empty") == "empty holds no run, nor do the folders in it"


def test_shard_that_is_not_finished_is_refused(shards, capsys):
    log = shards / "2/localization/trials.jsonl"
    whole = log.read_bytes()
    log.write_bytes(whole[:-30])
    line = refusal(capsys, *merged(shards, "1", "2", "3"))
    assert line == (
        f"{log.parent} is not finished, 1 of 2 trials are missing: the same `kitasap run` goes on"
        " with it"
    )
    assert log.read_bytes() == whole[:-30]


def test_trial_of_another_shard_and_other_results_are_refused(shards, capsys):
    log = shards / "2/localization/trials.jsonl"
    whole = log.read_bytes()
    log.write_bytes(whole + (shards / "1/localization/trials.jsonl").read_bytes())
    line = refusal(capsys, *merged(shards, "1", "2", "3"))
    assert line == f"{log.parent} holds trial 0, not of shard 2/3"
    log.write_bytes(whole)
    (shards / "out").mkdir()
    shutil.copytree(shards / "1/localization", shards / "out/localization")
    held = shards / "out/localization/trials.jsonl"
    held.write_text(held.read_text().replace('"status": "ok"', '"status":  "ok"', 1))
    line = refusal(capsys, *merged(shards, "1", "2", "3"))
    assert f"{held} line 1 is not a trial: ValueError('its checksum is another')" in line
    held.with_name("timings.jsonl").unlink()
    line = refusal(capsys, *merged(shards, "1", "2", "3"))
    assert line == f"{held.parent} holds other trials: give another --out"
    line = refusal(capsys, "merge", shards / "1", shards / "2", shards / "3", "--out", shards / "1")
    assert line == f"--out {shards / '1'} is where a shard lies: give another folder"


def test_shard_without_a_trial_is_no_mistake(shards, config, tmp_path, capsys):
    command = ["run", "localization", "--shard", "3/3", "--trials", "2", "--seed", "4"]
    command += ["--place", config.place, "--poses", "random", "--method", "odometry,line"]
    assert main([*command, "--jobs", "1", "--out", str(tmp_path / "c")]) == 0
    assert "none of 2 trials is of shard 3/3" in capsys.readouterr().out
    run = Run("localization", config, 4, 2, tmp_path)
    for number, name in ((1, "a"), (2, "b")):
        out = tmp_path / name / "localization"
        replace(run, folder=out, shard=Shard(number, 3)).execute(1, lambda *_: None)
    merged = ["merge", *(str(tmp_path / name) for name in "abc"), "--out", str(tmp_path / "out")]
    assert main(merged) == 0
    assert (tmp_path / "out/localization/trials.jsonl").read_bytes().count(b"\n") == 2


@pytest.mark.slow
def test_processes_four_shards_and_ray_give_equal_bytes(config, tmp_path):
    pytest.importorskip("ray")
    command = ["run", "localization", "--trials", "9", "--place", config.place, "--poses", "random"]
    command += ["--method", "odometry,limit", "--out"]
    assert main([*command, str(tmp_path / "pool"), "--jobs", "2"]) == 0
    assert main([*command, str(tmp_path / "ray"), "--engine", "ray", "--jobs", "2"]) == 0
    for number in "1234":
        out = [str(tmp_path / number), "--jobs", "1", "--shard", f"{number}/4"]
        assert main([*command, *out]) == 0
    shards = [str(tmp_path / number) for number in "1234"]
    assert main(["merge", *shards, "--out", str(tmp_path / "merged")]) == 0
    for name in ("trials.jsonl", "trials.csv"):
        pool, ray, merged = (
            (tmp_path / way / "localization" / name).read_bytes()
            for way in ("pool", "ray", "merged")
        )
        assert pool == ray == merged

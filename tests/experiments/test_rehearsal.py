"""No trial is timed with the compiling of what it needs: that was done before the first one."""

import subprocess
import sys
import time
from dataclasses import replace
from pathlib import Path

import pytest

from experiments import rehearsal, runs
from experiments.rehearsal import rehearse, told_if_long
from experiments.runs import Run, TrialTask
from experiments.trials import config_hash

CODE = """
import sys
from dataclasses import replace
from experiments.rehearsal import rehearse
from experiments.runs import trial_result
from experiments.trials import TrialConfig
from tests.slam.compiled import loaded

experiment, place, methods = sys.argv[1:]
config = TrialConfig(poses="random", place=place, methods=tuple(methods.split(",")), people=1)
config = replace(config, duration_s=2.0)
rehearse(experiment, config)
before = loaded()
trial_result(experiment, config, 0, 1)
print(sorted(name for name, _ in loaded() - before))
"""


@pytest.fixture
def noted(monkeypatch) -> list[str]:
    """What is done, in order; nothing of it really."""
    done: list[str] = []
    monkeypatch.setattr(runs, "rehearse", lambda *_: done.append("rehearsed"))

    def trial(experiment, config, seed, index):
        done.append(f"trial {index}")
        return index, {"status": "error", "error": "-"}, {"cpu_s": 0.0}

    monkeypatch.setattr(runs, "recorded_trial", trial)
    return done


def test_run_rehearses_once_before_its_first_trial_and_not_when_all_are_done(
    tmp_path, quick_config, noted
):
    run = Run("localization", quick_config, 0, 2, tmp_path)
    run.execute(1, lambda *_: None)
    assert noted == ["rehearsed", "trial 0", "trial 1"]
    run.execute(1, lambda *_: None)
    assert noted == ["rehearsed", "trial 0", "trial 1"]


def test_each_worker_rehearses_before_its_first_trial(monkeypatch, quick_config):
    done: list[tuple] = []
    monkeypatch.setattr(runs, "rehearse", lambda *what: done.append(what))
    identity = TrialTask("kidnap", quick_config, 3).prepare()
    assert done == [("kidnap", quick_config)]
    # what the parent compares with its own
    assert identity == config_hash("kidnap", quick_config, 3)


@pytest.mark.parametrize(
    ("experiment", "methods", "rehearsed"),
    [
        ("localization", ("odometry", "limit"), ("localization", ("limit",), "random")),
        ("localization", ("line", "paper"), ("localization", ("odometry",), "random")),
        ("kidnap", ("paper", "open3d"), ("kidnap", ("open3d",), "random")),
        ("tracking", ("odometry", "fast"), ("kidnap", ("fast",), "random")),
        ("tracking", ("odometry",), ("localization", ("odometry",), "random")),
        ("mapping", ("paper",), ("localization", ("odometry",), "random")),
    ],
)
def test_only_what_needs_kernels_is_rehearsed(
    experiment, methods, rehearsed, quick_config, monkeypatch
):
    done = []
    for name in ("localization", "kidnap"):
        module = getattr(rehearsal, name)
        monkeypatch.setattr(
            module, "run_trial",
            lambda config, _, name=name: done.append((name, config.methods, config.poses)),
        )  # fmt: skip
    rehearse(experiment, replace(quick_config, methods=methods))
    assert done == [rehearsed]


def test_what_a_rehearsal_raises_is_left_to_the_trials(quick_config, monkeypatch):
    def broken(*_):
        raise FloatingPointError("the floor is gone")

    monkeypatch.setattr(rehearsal.localization, "run_trial", broken)
    rehearse("localization", quick_config)


def test_long_rehearsal_is_told_and_a_short_one_is_not(monkeypatch):
    monkeypatch.setattr(rehearsal, "_LONG_S", 0.02)
    told: list[str] = []
    with told_if_long(lambda: told.append("long")):
        time.sleep(0.2)
    assert told == ["long"]
    monkeypatch.setattr(rehearsal, "_LONG_S", 5.0)
    with told_if_long(lambda: told.append("short")):
        pass
    assert told == ["long"]


@pytest.mark.slow
@pytest.mark.parametrize(
    ("experiment", "methods"),
    [
        ("localization", "odometry,fast,limit"),
        ("kidnap", "open3d,fast,limit"),
        ("tracking", "limit"),
        ("mapping", "limit"),
    ],
)
def test_no_trial_waits_for_compiled_code(experiment, methods, box_room):
    done = subprocess.run(
        [sys.executable, "-c", CODE, experiment, box_room, methods],
        cwd=Path(__file__).parents[2], capture_output=True, text=True, check=True,
    )  # fmt: skip
    assert done.stdout.split("\n")[-2] == "[]"

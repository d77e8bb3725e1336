"""The runner measured: its own time for each trial, and what two processes make of two cores."""

import pytest

from experiments.bench import runner
from experiments.cli import main
from experiments.trials import TrialConfig


@pytest.fixture(autouse=True)
def quick(monkeypatch, box_room):
    config = TrialConfig(poses="anywhere", place=box_room, methods=("odometry",))
    monkeypatch.setattr(runner, "_KIDNAP", config)
    runner._one_kidnap.cache_clear()
    yield
    runner._one_kidnap.cache_clear()


@pytest.mark.slow
def test_runner_adds_less_than_two_milliseconds_to_a_trial(tmp_path):
    assert runner.overhead_ms(tmp_path, 1, 400) < 2.0
    assert list(tmp_path.iterdir()) == []


@pytest.mark.slow
def test_benchmark_prints_overhead_efficiency_and_memory(capsys):
    assert main(["bench", "runner", "--trials", "20", "--empty", "100"]) == 0
    printed = capsys.readouterr().out
    for said in ("CPU for each trial [ms]", "two runs, one process each", "efficiency", "MB held"):
        assert said in printed

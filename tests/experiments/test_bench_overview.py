"""All benchmarks in one table: each is there, and the table can be written."""

from pathlib import Path

import numpy as np
import pytest

from experiments.bench import env, registration_run, relocalization, simulation
from experiments.bench.registration_run import BenchmarkResult, RowResult
from experiments.bench.simulation import SpeedResult
from experiments.cli import main
from tests.experiments.refusals import refusal


def row(name, cpu_us):
    return RowResult(name, "", cpu_us, 0.0, 0.0, 1.5, 0.5, 0, 0.0)


@pytest.fixture
def quick(monkeypatch):
    """What takes long has been measured already."""
    result = BenchmarkResult(
        [row("peer | p2p", 300.0), row("ours", 30.0)], None, {"gone": ["a", "b"]}
    )
    cost = [{"env": "Kitasap2/GoTo-v0", "step_us": 500.0, "ratio": 1.1}]
    vector = {"cores": 2, "native_envs": 64, "native_per_s": 2000.0, "ratio": 1.7}
    monkeypatch.setattr(simulation, "simulation_speed", lambda *_: SpeedResult(60.0, 120.0))
    monkeypatch.setattr(registration_run, "measured", lambda *_: result)
    monkeypatch.setattr(
        relocalization, "measured", lambda *_: (np.array([1.0]), np.array([2.0]), 1)
    )
    monkeypatch.setattr(env, "measured", lambda *_: {"cost": cost, "vector": vector})


def test_each_benchmark_is_in_the_table(quick, tmp_path, capsys):
    out = tmp_path / "table.md"
    assert main(["bench", "all", "--out", str(out)]) == 0
    printed, lines = capsys.readouterr().out, out.read_text().splitlines()
    assert "mapping is left out" in printed
    assert {line.count("|") - line.count("\\|") for line in lines} == {5}
    benchmarks = [line.split(" | ")[0][2:] for line in lines[2:]]
    assert list(dict.fromkeys(benchmarks)) == ["sim", "registration", "relocalization", "env"]
    assert "| registration | ours | 30 µs, RMSE 1.50 mm | 10 times as fast as" in "\n".join(lines)
    assert "gone is not installed" in printed


@pytest.mark.slow
def test_a_log_is_mapped_beside_them(quick, tmp_path):
    out = tmp_path / "table.md"
    log = Path(__file__).parents[1] / "data" / "fr101-excerpt.clf.gz"
    assert main(["bench", "all", str(log), "--out", str(out)]) == 0
    assert "| mapping | fr101-excerpt.clf.gz, slowest update |" in out.read_text()


def test_a_log_that_is_not_there_is_refused_before_anything_is_measured(capsys, tmp_path):
    assert "nowhere.clf" in refusal(capsys, "bench", "all", str(tmp_path / "nowhere.clf"))

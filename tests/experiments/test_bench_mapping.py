"""`kitasap bench mapping`: each stage costs at least what the one before it did."""

import json
from pathlib import Path

from experiments.cli import main
from tests.experiments.refusals import refusal

LOG = Path(__file__).parents[1] / "data" / "fr101-excerpt.clf.gz"


def test_cost_of_mapping_a_log_is_told_stage_by_stage(tmp_path, capsys):
    out = tmp_path / "cost.json"
    assert main(["bench", "mapping", str(LOG), "--out", str(out)]) == 0
    cost = json.loads(out.read_text())
    assert cost["scans"] == 20
    assert 0.0 < cost["slowest_update_s"] < cost["with_loops_s"] < cost["with_finishing_s"]
    # another run, and its time is that of some milliseconds a scan
    assert 0.0 < cost["front_end_s"] < 2.0 * cost["with_loops_s"]
    # twenty scans may find room in what the process holds already
    assert cost["memory_mb"] is None or 0.0 <= cost["memory_mb"] < 150.0
    assert "front end alone" in capsys.readouterr().out


def test_log_that_is_not_there_is_refused(capsys, tmp_path):
    assert "nowhere.clf" in refusal(capsys, "bench", "mapping", str(tmp_path / "nowhere.clf"))

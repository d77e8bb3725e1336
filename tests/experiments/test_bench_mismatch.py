"""`kitasap bench mismatch`: a table row for each assumption that does not hold, and the figure."""

import json

import pytest

from experiments.cli import main
from experiments.worlds import MISMATCHES

SOME = {"chair": MISMATCHES["chair"]}


@pytest.mark.slow
def test_each_mismatch_has_its_figures(tmp_path, capsys, monkeypatch):
    # six take a quarter of a minute
    monkeypatch.setattr("experiments.bench.mismatch.MISMATCHES", SOME)
    monkeypatch.setattr("experiments.bench.mismatch._DRIVE_S", 4.5)
    options = ["--trials", "2", "--drives", "1", "--out", str(tmp_path)]
    assert main(["bench", "mismatch", *options]) == 0
    rows = json.loads((tmp_path / "mismatch.json").read_text())
    assert [row["mismatch"] for row in rows] == list(SOME)
    for row in rows:
        assert row["still"]["samples"] == 2
        assert row["moving"]["samples"] > 0
        assert row["still"]["failures"] == row["moving"]["failures"] == 0
        assert row["moving"]["nees"] > 0.0
    assert (tmp_path / "mismatch.png").stat().st_size > 10_000
    said = capsys.readouterr().out
    # 80 columns once cut headings and numbers to dots
    assert "…" not in said
    for name in ("what is not as assumed", "/ bound", "warned", "0 of 2", "since the map was made"):
        assert name in said

"""`kitasap bench continued`: a log in halves is the log, and is judged as a whole."""

import json
from pathlib import Path

import pytest

from experiments.bench import continued
from experiments.bench.continued import Continued, halves, measured
from experiments.cli import main
from slam.readers.recognition import read_log
from slam.trajectory import read_tum
from tests.experiments.refusals import refusal

DATA = Path(__file__).parents[1] / "data"
LOG, REFERENCE = DATA / "fr101-excerpt.clf.gz", DATA / "fr101-excerpt.reference.tum"


@pytest.fixture(scope="module")
def found() -> Continued:
    return measured(read_log(LOG), read_tum(REFERENCE))


def test_halves_are_the_log_cut_before_a_scan():
    log = read_log(LOG)
    first, second = halves(log)
    records = [*first.records, *second.records]
    assert [one.time_s for one in records] == [one.time_s for one in log.records]
    assert next(iter(second.records)).scan is not None
    for half in (first, second):
        assert len(half.records) == len(list(half.records))
        assert half.scan_count == sum(one.scan is not None for one in half.records)
    assert abs(first.scan_count - second.scan_count) <= 1


def test_both_ways_are_judged_by_all_scans_and_the_map_is_the_same_when_read(found):
    log = read_log(LOG)
    assert found.is_same_again
    assert found.whole.pose_count == found.halves.pose_count == log.scan_count
    assert found.whole.absolute is not None
    assert found.whole.absolute.position_m.rmse < 0.05
    assert found.scans == log.scan_count - log.scan_count // 2


def test_table_is_written_as_json_where_asked(found, tmp_path, monkeypatch, capsys):
    monkeypatch.setattr(continued, "measured", lambda *_: found)
    out = tmp_path / "new" / "halves.json"
    asked = ["bench", "continued", str(LOG), "--reference", str(REFERENCE), "--out", str(out)]
    status = main(asked)
    assert LOG.name in capsys.readouterr().out
    record = json.loads(out.read_text())
    assert (record["log"], record["scans"]) == (LOG.name, found.scans)
    assert (record["joined_at"] is not None and record["verdict"] == "good") == (status == 0)
    assert record["in_one_go"]["ate"]["translation_m"]["rmse"] < 0.05
    assert record["in_one_go"]["poses"] == record["in_two_sessions"]["poses"]


@pytest.mark.slow
def test_session_that_never_sees_the_map_is_not_joined_and_ends_with_status_1(capsys):
    # the excerpt drives on and on
    assert main(["bench", "continued", str(LOG), "--reference", str(REFERENCE)]) == 1
    assert "never joined" in capsys.readouterr().out
    refusal(capsys, "bench", "continued", str(LOG), "--reference", str(DATA / "none.tum"))

"""`kitasap bench continued`: a log in halves is the log, and is judged as a whole."""

from pathlib import Path

import pytest

from experiments.bench.continued import halves, measured
from experiments.cli import main
from slam.readers.recognition import read_log
from slam.trajectory import read_tum
from tests.experiments.refusals import refusal

DATA = Path(__file__).parents[1] / "data"
LOG, REFERENCE = DATA / "fr101-excerpt.clf.gz", DATA / "fr101-excerpt.reference.tum"


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


def test_both_ways_are_judged_by_all_scans_and_the_map_is_the_same_when_read():
    log = read_log(LOG)
    found = measured(log, read_tum(REFERENCE))
    assert found.is_same_again
    assert found.whole.pose_count == found.halves.pose_count == log.scan_count
    assert found.whole.absolute is not None
    assert found.whole.absolute.position_m.rmse < 0.05
    assert found.scans == log.scan_count - log.scan_count // 2


@pytest.mark.slow
def test_session_that_never_sees_the_map_is_not_joined_and_ends_with_status_1(capsys):
    # the excerpt drives on and on
    assert main(["bench", "continued", str(LOG), "--reference", str(REFERENCE)]) == 1
    assert "never joined" in capsys.readouterr().out
    refusal(capsys, "bench", "continued", str(LOG), "--reference", str(DATA / "none.tum"))

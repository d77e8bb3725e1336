"""`kitasap bench combined`: pairs of a sensor and a damage, drawn, either done to the log."""

import numpy as np
import pytest

from experiments.bench import changed_logs
from experiments.bench.combined import cases
from experiments.bench.damage import DAMAGES
from experiments.bench.log_changes import keeping
from experiments.bench.map_end import MapEnd
from experiments.bench.sensors import BACKWARDS, SENSORS
from experiments.cli import main
from slam.readers.recognition import read_log
from slam.trajectory import read_tum
from tests.experiments.excerpt import LOG, REFERENCE, read_twice, scans
from tests.experiments.refusals import refusal

BENCH = ["bench", "combined", str(LOG), "--reference", str(REFERENCE)]
EVERY = len(SENSORS | BACKWARDS) * len(DAMAGES)


def drawn(pairs, seed):
    return cases(read_tum(REFERENCE), pairs, seed)


def test_each_pair_comes_at_most_once_and_by_the_seed():
    assert len({case.of for case in drawn(EVERY, seed=1)}) == EVERY
    few, others = ([case.of for case in drawn(9, seed)] for seed in (1, 2))
    assert few == [case.of for case in drawn(9, seed=1)]
    assert few != others


def test_a_pair_is_both_and_is_judged_where_the_sensor_was():
    log = read_log(LOG)
    by_name = {case.of: case for case in drawn(EVERY, seed=1)}
    pair = by_name["driven backwards; a third of the beams lost"]
    changed = read_twice(pair.change(log, np.random.default_rng(3)))
    stamps = [scan.time_s for scan in scans(changed)]
    assert stamps == [-scan.time_s for scan in reversed(scans(log))]
    share_lost = np.mean([np.isnan(scan.ranges_m).mean() for scan in scans(changed)])
    assert share_lost == pytest.approx(1.0 / 3.0, abs=0.05)
    assert set(stamps) <= set(pair.against.times_s.tolist())


def test_more_pairs_than_there_are_and_logs_too_short_are_refused(capsys, monkeypatch):
    said = refusal(capsys, *BENCH, "--pairs", "999")
    assert said.endswith(f"expected at most {EVERY}, which is all, got 999")
    log = read_log(LOG)
    short = keeping(log, np.arange(log.scan_count) >= log.scan_count - 6)
    monkeypatch.setattr(changed_logs, "read_log", lambda _: short)
    said = refusal(capsys, *BENCH)
    assert said.endswith("1 scans are too few to damage some of them")


def test_a_wrong_map_called_good_counts(monkeypatch, capsys):
    end = MapEnd("blind", 20, True, (), 2.0, 9.0, 0.1, 0.15, 0.5)
    monkeypatch.setattr(changed_logs, "measured", lambda *_: [end])
    assert main(BENCH) == 1
    assert "GOOD" in capsys.readouterr().out


@pytest.mark.slow
def test_the_excerpt_by_other_sensors_and_damaged_is_right_or_called_failed(capsys):
    assert main([*BENCH, "--pairs", "12", "--seed", "4"]) == 0
    assert "right" in capsys.readouterr().out

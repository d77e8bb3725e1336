"""`kitasap bench rounds`: the same way over and over, and what is told of it."""

import numpy as np

from experiments.bench.rounds import measured, simulated
from experiments.cli import main


def test_rounds_of_one_way_end_in_a_right_map_and_are_told_of(capsys):
    assert main(["bench", "rounds", "--rounds", "2", "--seed", "3"]) == 0
    said = capsys.readouterr().out
    assert "The map is called good" in said
    assert "scans kept" in said


def test_rows_are_of_the_first_round_and_of_twice_as_many_each_and_of_all():
    found = measured(3, 4)
    assert found.is_right
    assert [one.rounds for one in found.rounds] == [1, 2, 3]
    assert found.rounds[-1].scans == len(found.slam_map.steps)
    assert found.rounds[-1].keyframes == len(found.slam_map.keyframes)
    assert all(one.kept <= one.keyframes for one in found.rounds)


def test_log_is_the_same_whenever_it_is_read():
    log, true = simulated(1, np.random.default_rng(5))
    first, again = ([record.scan.ranges_m for record in log.records] for _ in range(2))
    assert len(first) == len(true) == log.scan_count
    assert all(np.array_equal(one, other) for one, other in zip(first, again, strict=True))

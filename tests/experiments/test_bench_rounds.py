"""`kitasap bench rounds`: the same way over and over, and what is told of it."""

import numpy as np
import pytest

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


@pytest.mark.slow
def test_rounds_more_take_little_more_than_their_poses():
    found = measured(32, 6)
    assert found.is_right
    before, after = found.rounds[-2:]
    assert after.kept <= 1.02 * before.kept
    assert after.keyframes <= 1.1 * before.keyframes
    if after.memory_mb is not None and before.memory_mb is not None:
        # 2000 where keyframes that others made needless stayed in the graph, and 100 MB more at the end
        grown_mb = after.memory_mb - before.memory_mb
        assert grown_mb * 1e6 < 1000.0 * (after.scans - before.scans)
        assert found.most_mb is not None
        assert found.most_mb < after.memory_mb + 50.0

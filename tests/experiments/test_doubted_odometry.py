"""A log whose map does not hold together is mapped once more, its odometry no more than a guess."""

from dataclasses import replace
from pathlib import Path

import pytest

from experiments import slam_log
from experiments.slam_log import SlamLog, default_mapped, table
from slam.readers.log import Log
from slam.readers.log_odometry import unknown_motion
from slam.readers.recognition import read_log

LOG = Path(__file__).parents[1] / "data" / "fr101-excerpt.clf.gz"


@pytest.fixture(scope="module")
def log() -> Log:
    return read_log(LOG)


@pytest.fixture(scope="module")
def mapped(log) -> SlamLog:
    return default_mapped(log)


def judged(mapped: SlamLog, is_good: bool, by: str) -> SlamLog:
    verdict = replace(mapped.slam_map.verdict, is_good=is_good, reasons=() if is_good else (by,))
    return replace(mapped, name=by, slam_map=replace(mapped.slam_map, verdict=verdict))


@pytest.mark.parametrize(
    ("told_is_good", "guess_is_good", "used"),
    [(True, False, "told"), (False, True, "guess"), (False, False, "told")],
)
def test_guess_is_taken_where_it_alone_holds_together(
    log, mapped, told_is_good, guess_is_good, used
):
    passes = []

    def drive(log: Log) -> SlamLog:
        is_guess = log.noise is unknown_motion
        passes.append(is_guess)
        is_good = guess_is_good if is_guess else told_is_good
        return judged(mapped, is_good, "guess" if is_guess else "told")

    result = slam_log._best_mapped(log, drive)
    assert result.name == used
    assert passes == ([False] if told_is_good else [False, True])
    assert result.summary()["odometry_doubted"] is (used == "guess")
    assert ("a guess alone" in table(result.summary())) is (used == "guess")


def test_log_without_odometry_has_none_to_doubt(log, mapped):
    alone = replace(log, has_odometry=False)
    assert not slam_log._best_mapped(
        alone, lambda _: judged(mapped, False, "told")
    ).is_odometry_doubted


def test_drive_is_mapped_with_odometry_as_a_guess(log, mapped):
    guessed = default_mapped(replace(log, noise=unknown_motion))
    assert guessed.slam_map.verdict.is_good
    assert len(guessed.trajectory) == len(mapped.trajectory)
    off_m = guessed.trajectory.poses[:, :2] - mapped.trajectory.poses[:, :2]
    assert abs(off_m).max() < 0.05

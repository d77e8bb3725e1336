"""A log whose ranges are all too long, as its map shows, is mapped once more with ranges put right."""

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from experiments.bench.log_changes import with_scans
from experiments.observer import LogObserver
from experiments.slam_log import default_mapped
from experiments.slam_passes import best_mapped, mapped_once
from experiments.slam_result import SlamLog, table
from slam.map_checks import range_offset
from slam.mapper_config import MapperConfig
from slam.mapping import Mapper, MapperStep
from slam.measurements import Measurement
from slam.readers.log import Log
from slam.readers.recognition import read_log

LOG = Path(__file__).parents[1] / "data" / "fr101-excerpt.clf.gz"
OFFSET_M = 0.1


@pytest.fixture(scope="module", autouse=True)
def asked_of_few_scans() -> Iterator[None]:
    """The excerpt has 20 scans, of which nothing would be said: here what comes of it is asked."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(range_offset, "_LEAST_SCANS", 15)
        yield


@pytest.fixture(scope="module")
def log() -> Log:
    return with_scans(read_log(LOG), lambda _, scan: scan.shortened(-OFFSET_M))


@pytest.fixture(scope="module")
def told(log) -> SlamLog:
    return mapped_once(log, known=None)


@pytest.fixture(scope="module")
def put_right(log) -> SlamLog:
    return default_mapped(log)


def test_ranges_are_put_right_by_what_scans_of_the_same_surfaces_show(told, put_right):
    assert "all ranges are" in told.slam_map.verdict.reasons[-1]
    assert put_right.slam_map.verdict.is_good
    # the excerpt's own laser may have an offset, of 0.01 m at most
    assert put_right.range_offset_m == pytest.approx(OFFSET_M, abs=0.02)
    assert put_right.used_pass == 1
    summary = put_right.summary()
    assert summary["range_offset_m"] == put_right.range_offset_m
    # known to less than a fifth of it, or nothing would have been put right
    assert 0.0 < summary["range_offset_sigma_m"] < OFFSET_M / 5.0
    told_m = put_right.range_offset_m, put_right.range_offset_sigma_m
    words = "ranges: {:.3f} m too long in the log (standard deviation {:.3f} m), and put right"
    assert words.format(*told_m) in table(summary)
    assert "another pass over the log" in table(summary)


def test_ranges_as_they_are_need_no_second_pass():
    result = default_mapped(read_log(LOG))
    assert result.slam_map.verdict.is_good
    assert result.other_passes_cpu_s == 0.0
    assert result.summary()["range_offset_m"] == 0.0
    assert "ranges" not in table(result.summary())


def test_who_watches_sees_the_ranges_that_are_mapped(log):
    nearest_m = list[float]()

    class Watching(LogObserver):
        def mapped(self, measurement: Measurement, step: MapperStep, mapper: Mapper) -> None:
            nearest_m.append(float(measurement.scan.ranges_m.min()))

    config = MapperConfig(range_offset_m=OFFSET_M)
    mapped_once(log, config, known=None, observer=Watching())
    told_m = [float(one.scan.ranges_m.min()) for one in log.records if one.scan is not None]
    assert nearest_m == pytest.approx(np.array(told_m) - OFFSET_M)


def test_map_that_fails_for_its_ranges_still_is_the_first(log, told):
    given = []

    def drive(_: Log, config: MapperConfig) -> SlamLog:
        given.append(config)
        return told

    result = best_mapped(log, drive)
    assert result.range_offset_m == 0.0
    assert not result.slam_map.verdict.is_good
    # and odometry is doubted with ranges as they are told
    assert [one.range_offset_m != 0.0 for one in given] == [False, True, False]
    assert [one.is_odometry_doubted for one in given] == [False, False, True]


def test_odometry_is_doubted_with_ranges_that_are_put_right(log, told, put_right):
    def drive(_: Log, config: MapperConfig) -> SlamLog:
        if config.range_offset_m == 0.0:
            return told
        if config.is_odometry_doubted:
            return put_right
        return replace(put_right, slam_map=put_right.slam_map.objected(["torn"]))

    result = best_mapped(log, drive)
    assert result.slam_map.verdict.is_good
    assert result.is_odometry_doubted
    assert result.used_pass == 2
    assert result.range_offset_m == pytest.approx(OFFSET_M, abs=0.02)
    assert result.range_offset_sigma_m == put_right.range_offset_sigma_m


def test_interrupt_leaves_the_last_map_that_was_made(log, told, put_right):
    torn = replace(put_right, slam_map=put_right.slam_map.objected(["torn"]))

    def drive(_: Log, config: MapperConfig) -> SlamLog:
        if config.is_odometry_doubted:
            raise KeyboardInterrupt
        return told if config.range_offset_m == 0.0 else torn

    result = best_mapped(log, drive)
    assert result.slam_map is torn.slam_map
    assert result.range_offset_m == pytest.approx(OFFSET_M, abs=0.02)
    assert "interrupted" in result.notes[0]

"""Logs of raw encoder ticks."""

import gzip
import math
from pathlib import Path

import numpy as np
import pytest

from slam.odometry import DifferentialDrive, OdometryNoise
from slam.readers.sweep_clock import rhythm
from slam.readers.ticks import TicksConfig, read_ticks
from slam.se2 import SE2
from tests.slam.logs import shared_log

RANGES_MM = (1000, 0, 7, 5600, 5599, 20)
AT_ONCE = TicksConfig(late_s=0.0)
"""A laser that is read as its last beam returns."""


def line(time_us: int, left: int, right: int, ranges_mm: tuple[int, ...] = RANGES_MM) -> str:
    """A line as the rover wrote it; fields between are of its other sensors."""
    others = ["0"] * 20
    return " ".join(map(str, [time_us, 14554, left, right, *others, *ranges_mm]))


def written(tmp_path: Path, *lines: str, name: str = "a.dat") -> Path:
    path = tmp_path / name
    path.write_text("\n\n".join(lines) + "\n\n")
    return path


def test_ticks_of_both_wheels_become_the_exact_arc(tmp_path):
    # a turn of the left wheel, half a turn of the right one
    path = written(tmp_path, line(1_000_000, 500, -70), line(1_100_000, 2500, 930))
    first, second = read_ticks(path, AT_ONCE).measurements()
    assert first.motion == SE2.identity()
    assert (first.time_s, second.time_s) == (1.0, 1.1)
    left_m, right_m = 2.0 * math.pi * 0.077, math.pi * 0.077
    arc = SE2.exp([(left_m + right_m) / 2.0, 0.0, (right_m - left_m) / 0.33])
    np.testing.assert_allclose(second.motion.as_array(), arc.as_array(), atol=1e-12)


@pytest.mark.parametrize("ticks", [(2000, 1000), (-300, -320), (400, -400), (0, 0)])
def test_covariance_is_that_of_the_ticks(tmp_path, ticks):
    path = written(tmp_path, line(0, 0, 0), line(100_000, *ticks))
    _, second = read_ticks(path, AT_ONCE).measurements()
    expected = OdometryNoise().covariance(AT_ONCE.drive, ticks)
    np.testing.assert_allclose(second.motion_covariance, expected, atol=1e-15)


def test_beams_go_from_right_to_left_and_their_codes_are_told_apart(tmp_path):
    seen = (1000,) * 6  # so that no beam counts as blind
    log = read_ticks(written(tmp_path, line(0, 0, 0), line(1, 0, 0, seen)))
    scan = next(log.measurements()).scan
    np.testing.assert_array_equal(scan.ranges_m, [1.0, np.inf, np.nan, np.inf, 5.599, 0.02])
    # step 44 of 1024, where 384 is ahead
    expected_deg = 360.0 / 1024 * np.array([-340.0, -339.0])
    np.testing.assert_allclose(np.degrees(scan.angles_rad[:2]), expected_deg)
    assert log.T_base_laser == SE2(0.145, 0.0, 0.0)


def test_beam_that_never_returns_is_blind_and_not_free(tmp_path):
    log = read_ticks(written(tmp_path, line(0, 0, 0), line(1, 0, 0)))
    assert [np.isnan(m.scan.ranges_m[1]) for m in log.measurements()] == [True, True]


def test_another_robot_is_told_by_its_config(tmp_path):
    drive = DifferentialDrive((0.1, 0.1), 0.5, 1000)
    config = TicksConfig(drive=drive, late_s=0.0, range_max_m=0.9)
    path = written(tmp_path, line(0, 0, 0), line(1, 1000, 1000))
    second = list(read_ticks(path, config).measurements())[1]
    np.testing.assert_allclose(second.motion.as_array(), [0.2 * math.pi, 0, 0], atol=1e-12)
    assert not np.isfinite(second.scan.ranges_m[0])


@pytest.mark.parametrize(
    ("last", "message"),
    [
        (line(1, 0, 0)[:-9], "line 3: a line of ticks and ranges has 30 fields, found 28"),
        ("1 2 3", "line 3: a line of ticks and ranges has 30 fields, found 3"),
        (line(1, 0, 0).replace("5599", "x"), "line 3: expected a number, found 'x'"),
        (line(1, 0, 0).replace("5599", "nan"), "line 3: a stamp, ticks or a range are not finite"),
        (line(1, 0, 10**13), r"line 3: 1 us, and ticks 0 and 10000000000000; expected no stamp .*"),
        (line(10**300, 0, 0), r"line 3: 10+ us, and ticks 0 and 0; expected no stamp beyond .*"),
    ],
)
def test_broken_line_is_named(tmp_path, last, message):
    with pytest.raises(ValueError, match=rf"/a\.dat {message}$"):
        read_ticks(written(tmp_path, line(0, 0, 0), last))


def test_file_without_a_line_or_with_short_ones_is_refused(tmp_path):
    with pytest.raises(ValueError, match="no line of ticks and ranges, so no scan to work with"):
        read_ticks(written(tmp_path, "# nothing"))
    with pytest.raises(ValueError, match=r"line 1: .* has more than 24 fields, found 8"):
        read_ticks(written(tmp_path, "1 2 3 0 0 0 0 1"))


def test_cut_gzip_is_refused(tmp_path):
    whole = gzip.compress("\n".join(line(i, i, i) for i in range(500)).encode())
    path = tmp_path / "a.gz"
    path.write_bytes(whole)
    assert read_ticks(path).scan_count == 500
    path.write_bytes(whole[: len(whole) // 2])
    with pytest.raises(ValueError, match=r"/a\.gz: the gzip file is cut or damaged"):
        read_ticks(path)


def test_beams_fire_one_after_the_other_up_to_the_stamp(tmp_path):
    log = read_ticks(written(tmp_path, line(0, 0, 0), line(100_000, 0, 0)), AT_ONCE)
    for measurement in log.measurements():
        times_s = measurement.scan.beam_times_s
        assert times_s[-1] == measurement.time_s
        # 600 turns per minute, 1024 steps per turn
        np.testing.assert_allclose(np.diff(times_s), 0.1 / 1024)


def test_sweeps_are_even_where_the_stamps_jitter_and_the_ticks_are_those_of_the_stamps(tmp_path):
    # a laser of 98.7 ms, read up to 60 ms late by a computer that notes the ticks as it reads
    rng, turn_s, late_s = np.random.default_rng(0), 0.0987, 0.112
    ends_s = 1.0 + turn_s * np.arange(200)
    stamps_s = ends_s + late_s + rng.uniform(-0.03, 0.03, 200)
    ticks = 2000.0 * stamps_s**2  # ever faster
    rows = zip((1e6 * stamps_s).round().astype(int), ticks.round().astype(int), strict=True)
    path = written(tmp_path, *(line(time_us, tick, tick) for time_us, tick in rows))
    told = list(read_ticks(path).measurements())[2:]
    # 17 ms of jitter, averaged over 200
    np.testing.assert_allclose([m.time_s for m in told], ends_s[2:], atol=0.005)
    way_m = np.cumsum([m.motion.x for m in told])
    true_m = 2.0 * np.pi * 0.077 * (ends_s[2:] ** 2 - ends_s[1] ** 2)
    # 5 ms at up to 20 m/s; by the stamps it would be 0.6 m
    assert np.abs(way_m - way_m[0] - true_m + true_m[0]).max() < 0.1


def test_sweep_that_is_read_twice_or_missed_leaves_the_others_in_time():
    rng = np.random.default_rng(1)
    sweeps = np.sort(np.r_[np.delete(np.arange(300), [50, 51, 120]), [80, 200]])
    due_s = 5.0 + 0.1013 * sweeps
    late_s = rng.uniform(-0.025, 0.025, len(sweeps))
    late_s[1:][np.diff(sweeps) == 0] += 0.02  # once more, a little later
    turn_s, times_s = rhythm(due_s + late_s, 0.1)
    assert turn_s == pytest.approx(0.1013, abs=2e-5)
    assert np.abs(times_s - due_s).max() < 0.006


@pytest.mark.parametrize("period_s", [0.3, 0.098])
def test_stamps_without_rhythm_are_left_as_they_are(period_s):
    rng = np.random.default_rng(2)
    stamps_s = np.cumsum(rng.uniform(0.2, 1.8, 200) * period_s)
    assert rhythm(stamps_s, 0.1) == (0.1, stamps_s)


def test_rover_drives_as_far_as_is_known():
    # data/README.md: 641 scans, 63 s, 45 m; 44 % of the beams return, error codes among them
    log = read_ticks(shared_log("mines-exp2.dat.gz"))
    measurements = list(log.measurements())
    assert len(measurements) == log.scan_count == 641
    assert measurements[-1].time_s - measurements[0].time_s == pytest.approx(63.0, abs=1.0)
    way_m = sum(math.hypot(m.motion.x, m.motion.y) for m in measurements)
    assert way_m == pytest.approx(45.0, abs=1.0)
    assert np.mean([m.scan.is_hit.mean() for m in measurements]) == pytest.approx(0.42, abs=0.01)

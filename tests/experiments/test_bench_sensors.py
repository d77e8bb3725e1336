"""`kitasap bench sensors`: what is made of a log is what is said, and is the same in each reading."""

import numpy as np
import pytest

from experiments.bench import changed_logs, sensors
from experiments.bench.map_end import MapEnd
from experiments.bench.sensors import BACKWARDS, SENSORS
from experiments.cli import main
from slam.readers.recognition import read_log
from slam.trajectory import read_tum
from tests.experiments.excerpt import LOG, REFERENCE, read_twice, scans, steps


@pytest.fixture(scope="module")
def log():
    return read_log(LOG)


def changed(log, words, seed=3):
    """By the one change of this name, read twice."""
    change = (SENSORS | BACKWARDS)[words]
    return read_twice(change(log, np.random.default_rng(seed)))


def test_other_lasers_have_fewer_beams_a_narrower_fan_or_see_less_far(log):
    true = scans(log)[0]
    half, narrow, short = (
        scans(changed(log, words))[0]
        for words in ("every second beam", "a fan of 120 degrees", "ranges up to 4 m")
    )
    np.testing.assert_array_equal(half.ranges_m, true.ranges_m[::2])
    assert np.ptp(np.degrees(narrow.angles_rad)) == pytest.approx(120.0, abs=1.1)
    is_far = true.ranges_m > 4.0
    assert 0 < is_far.sum() < len(is_far)
    assert np.isposinf(short.ranges_m[is_far]).all()
    np.testing.assert_array_equal(short.ranges_m[~is_far], true.ranges_m[~is_far])


def test_noise_differs_from_scan_to_scan_and_is_as_large_as_said(log):
    noise_m = []
    for one, two in zip(scans(changed(log, "ranges 3 cm noisier")), scans(log), strict=True):
        is_far = two.is_hit & (two.ranges_m > 0.2)
        noise_m.append(one.ranges_m[is_far] - two.ranges_m[is_far])
    assert np.concatenate(noise_m).std() == pytest.approx(0.03, rel=0.05)
    assert not np.array_equal(noise_m[0][:20], noise_m[1][:20])


def test_one_scan_of_three_keeps_the_odometry(log):
    rare = changed(log, "one scan of three")
    assert [scan.time_s for scan in scans(rare)] == [scan.time_s for scan in scans(log)[::3]]
    np.testing.assert_allclose(steps(rare), steps(log), atol=1e-9)


def test_wheels_drift_by_as_much_in_each_metre(log):
    by_wheels, true = steps(changed(log, "wheels 5 % off, and drifting")), steps(log)
    way_m = np.hypot(*true[:, :2].T)
    is_far = way_m > 0.05
    longer = np.hypot(*by_wheels[:, :2].T)[is_far] / way_m[is_far]
    per_m = (by_wheels - true)[is_far, 2] / way_m[is_far]
    for found in (longer - 1.0, per_m):
        assert np.ptp(found) < 1e-6
        assert 0.001 < abs(found[0]) < 0.2


def test_a_laser_ahead_swings_aside_in_turns(log):
    ahead, true = steps(changed(log, "a laser 0.3 m ahead, untold")), steps(log)
    turns = true[:, 2]
    np.testing.assert_allclose(ahead[:, 2], turns, atol=1e-9)
    np.testing.assert_allclose((ahead - true)[:, 0], 0.3 * (1.0 - np.cos(turns)), atol=1e-9)
    np.testing.assert_allclose((ahead - true)[:, 1], -0.3 * np.sin(turns), atol=1e-9)


def test_backwards_the_last_scan_is_the_first_and_time_goes_on(log):
    back = changed(log, "driven backwards")
    true, turned = list(log.records), list(back.records)
    assert (np.diff([record.time_s for record in turned]) >= 0.0).all()
    for one, two in zip(turned, reversed(true), strict=True):
        assert one.T_odom_base == two.T_odom_base
        assert one.time_s == -two.time_s
    against = read_tum(REFERENCE)
    case = next(case for case in sensors.cases(against) if case.of == "driven backwards")
    assert set(case.against.times_s.tolist()) == {-time_s for time_s in against.times_s.tolist()}
    assert not changed(log, "driven backwards, no wheels").has_odometry


def test_a_wrong_map_called_good_counts(monkeypatch, capsys):
    ends = [MapEnd("none", 20, True, (), 0.02, 0.1, 0.1, 0.15, 0.5)]
    bench = ["bench", "sensors", str(LOG), "--reference", str(REFERENCE)]
    monkeypatch.setattr(changed_logs, "measured", lambda *_: ends)
    assert main(bench) == 0
    ends.append(MapEnd("blind", 20, True, (), 2.0, 9.0, 0.1, 0.15, 0.5))
    assert main(bench) == 1
    assert "GOOD" in capsys.readouterr().out


@pytest.mark.slow
def test_the_excerpt_by_other_sensors_is_right_or_called_failed(capsys):
    assert main(["bench", "sensors", str(LOG), "--reference", str(REFERENCE)]) == 0
    assert capsys.readouterr().out.count("right") > 3

"""Tracking: one drive for all methods, the same whenever it is repeated."""

from dataclasses import replace

import numpy as np
import pytest

from experiments.sources import DRIVE, FLOOR_NOISE
from experiments.tracking import NAME, checked, run_trial
from experiments.trials import TrialConfig, generator
from kitasap_sim.robot import ODOMETRY_PRESETS
from tests.experiments.refusals import refusal

METHODS = ("odometry", "fast", "limit")


@pytest.fixture(scope="module")
def config(box_room: str) -> TrialConfig:
    return TrialConfig(
        poses="random", place=box_room, methods=METHODS, turn_rate_radps=1.0, duration_s=4.5
    )


@pytest.fixture(scope="module")
def record(config: TrialConfig) -> dict:
    return run_trial(config, generator(NAME, 0, 0)).record()


@pytest.mark.slow
def test_drive_is_the_same_whenever_it_is_repeated(config, record):
    short = replace(config, duration_s=3.0)
    first, again = (run_trial(short, generator(NAME, 1, 2)).record() for _ in range(2))
    assert first == again
    other = run_trial(short, generator(NAME, 1, 3)).record()
    assert other["true_poses"] != first["true_poses"]


def test_samples_come_every_two_seconds_and_series_with_every_scan(record):
    # with the first frame from then on; ten come a second
    times_s = [sample["time_s"] for sample in record["samples"]]
    assert 0.0 <= times_s[0] - 2.0 < 0.1
    assert 0.0 <= times_s[1] - 4.0 < 0.1
    assert len(times_s) == 2
    series = record["series"]
    # ten scans a second, the first after its sweep, the last when 4.5 s are over
    count = len(series["time_s"])
    assert count == 46
    assert np.diff(series["time_s"]) == pytest.approx(0.1, abs=0.003)
    assert set(series["methods"]) == set(METHODS)
    lengths = {len(series[key]) for key in ("time_s", "crlb_position_m", "crlb_heading_rad")}
    for of_method in series["methods"].values():
        lengths |= {len(values) for values in of_method.values()}
    assert lengths == {count}
    for sample in record["samples"]:
        assert set(sample["methods"]) == set(METHODS)


def test_samples_tell_the_nees_of_every_scan_from_the_first_on(record):
    for name in METHODS:
        told = [nees for sample in record["samples"] for nees in sample["scans_nees"][name]]
        series = record["series"]["methods"][name]["nees"]
        # the last sample is of 4 s, the series goes on to 4.5 s
        assert 40 <= len(told) <= 42
        assert told == series[: len(told)]


def test_end_of_the_series_is_the_record_s_own(record):
    for name in METHODS:
        outcome, series = record["methods"][name], record["series"]["methods"][name]
        error_m = np.hypot(outcome["x_error_m"], outcome["y_error_m"])
        # series are rounded to a tenth of a micrometre
        assert series["position_error_m"][-1] == pytest.approx(error_m, abs=1e-7)
        assert series["heading_error_rad"][-1] == pytest.approx(
            outcome["theta_error_rad"], abs=1e-7
        )


def test_limit_follows_to_millimetres_where_odometry_keeps_its_error(record):
    series = record["series"]["methods"]
    # half a second to get there from 10 cm; the bound of one scan is about 1 mm
    assert max(series["limit"]["position_error_m"][5:]) < 0.01
    assert max(series["fast"]["position_error_m"][5:]) < 0.02
    assert min(series["odometry"]["position_error_m"]) > 0.01
    assert record["methods"]["limit"]["success"]
    assert 0.0002 < np.median(record["series"]["crlb_position_m"]) < 0.004


def test_odometry_claims_nothing_and_limit_says_how_sure_it_is(record):
    nees = record["series"]["methods"]["limit"]["nees"]
    assert all(value is not None for value in nees)
    # 46 values of one drive hang together: 3 on average, a bad drive 8; more at
    # the start, where the robot comes to its speed within one sweep
    assert np.mean(nees) < 8.0
    assert np.mean(nees[:10]) < 15.0
    assert record["methods"]["odometry"]["status"] == "not attempted"


def test_robot_drives_the_circle_asked_for(config):
    result = run_trial(replace(config, methods=("odometry",)), generator(NAME, 0, 5))
    radius_m = 0.2 / 1.0
    drive = [sample["true_poses"][0] for sample in result.record()["samples"]]
    (x, y, _), (x2, y2, _) = drive
    # two seconds at 1 rad/s: a chord of 2 r sin 1; wheels as built are 2 % off
    assert np.hypot(x2 - x, y2 - y) == pytest.approx(2.0 * radius_m * np.sin(1.0), rel=0.05)


def test_track_without_sites_goes_round_in_the_free_space(config):
    on_track = replace(config, poses="paper", methods=("odometry",), duration_s=3.0)
    record = run_trial(on_track, generator(NAME, 0, 0)).record()
    start = on_track.known_place.place.start
    x, y, _ = record["true_poses"][-1]
    # it has turned, or driven at 0.2 m/s for 3 s at most
    assert np.hypot(x - start[0], y - start[1]) < 0.65
    assert on_track.known_place.place.is_free(np.array([[x, y]])).all()


def test_anywhere_is_a_circle_anywhere_as_for_random_poses(config):
    # beside a kidnap in one command; it once followed the track from where no track is
    short = replace(config, methods=("odometry",), duration_s=3.0)
    anywhere, drawn = (
        run_trial(replace(short, poses=poses), generator(NAME, 0, 0)).record()
        for poses in ("anywhere", "random")
    )
    assert anywhere == drawn


def test_circle_that_fits_nowhere_is_refused_before_the_first_trial(config):
    # 0.2 m/s at 0.1 rad/s: 2 m, in a room of 4 x 3 m
    wide = replace(config, turn_rate_radps=0.1)
    with pytest.raises(ValueError, match=r"no circle of 2\.00 m radius"):
        checked(wide)
    assert checked(config) == config


@pytest.mark.parametrize("wrong", [{"turn_rate_radps": 0.0}, {"duration_s": 0.5}])
def test_drive_that_cannot_be_is_refused(config, wrong):
    with pytest.raises(ValueError, match="a track needs"):
        checked(replace(config, **wrong))


@pytest.mark.parametrize("duration", ["inf", "nan", "0", "-1", "1e300"])
@pytest.mark.parametrize("command", ["run", "trial"])
def test_drive_that_would_not_end_or_begin_is_refused_in_one_line(
    command, duration, box_room, tmp_path, capsys
):
    options = ["--place", box_room, "--method", "odometry", "--out", tmp_path / "out"]
    line = refusal(capsys, command, "tracking", "--duration", duration, *options)
    assert line.startswith("a track needs turns above 0 and up to 1.5 rad/s, and a second up to a")
    assert not (tmp_path / "out").exists()


def test_each_floor_has_wheels_assumed_for_it_and_rough_ones_err_more():
    assert FLOOR_NOISE.keys() == ODOMETRY_PRESETS.keys()
    ticks = np.array([7000, 9000])
    smooth, rough = (
        FLOOR_NOISE[name].covariance(DRIVE, ticks) for name in ("as_built", "rough_floor")
    )
    # nearly twice as wide, and more: bumps of 1.5 mm
    assert (np.diag(rough) > 3.0 * np.diag(smooth)).all()

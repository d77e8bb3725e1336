"""The worked examples run, and come to what they say."""

import math
import subprocess
import sys

import numpy as np
import pytest

from experiments.examples import localise_own_log, own_matcher, own_place
from experiments.methods import METHODS
from slam import SE2, Beams, Mapper, PointMap, Status, read_log, write_slam_map


def test_own_log_is_mapped_and_followed_from_an_unknown_start(capsys):
    localizer = localise_own_log.main()
    assert localizer.guard is not None
    assert not localizer.guard.is_lost
    said = capsys.readouterr().out
    assert "the map is good" in said
    assert "tracking" in said


@pytest.mark.slow
def test_own_log_that_is_none_is_told_in_one_line(tmp_path):
    junk = tmp_path / "robot.clf"
    junk.write_text("no log")
    command = [sys.executable, "-m", "experiments.examples.localise_own_log", str(junk)]
    done = subprocess.run(command, capture_output=True, encoding="utf-8", check=False)
    assert (done.returncode, done.stdout) == (2, "")
    (line,) = done.stderr.splitlines()
    assert line.startswith("localise_own_log: robot.clf: ")


@pytest.mark.slow
def test_own_log_is_followed_on_a_map_that_is_there_already(tmp_path, capsys):
    log = read_log(localise_own_log.EXCERPT)
    mapper = Mapper(log.T_base_laser)
    for measurement in log.measurements():
        mapper.update(measurement)
    write_slam_map(tmp_path / "map.kitasap", mapper.finish())
    localise_own_log.main(localise_own_log.EXCERPT, tmp_path / "map.kitasap")
    assert "mapped" not in capsys.readouterr().out


@pytest.mark.slow
def test_robot_in_an_own_place_is_carried_away_and_finds_itself(capsys):
    estimate = own_place.main()
    assert estimate.verdict.status is Status.TRACKING
    there = SE2.from_array(own_place.CARRIED_TO)
    assert estimate.T_map_base.is_near(there, 0.01, 0.01)  # the hand is exact here
    looks = [line for line in capsys.readouterr().out.splitlines() if "look" in line]
    assert "lost" in looks[0]
    assert "tracking" in looks[-1]


def test_own_matcher_is_compared_with_limit_on_the_same_trials(monkeypatch, capsys):
    monkeypatch.setitem(METHODS, "mine", METHODS["odometry"])  # what it adds is taken out again
    rmse_mm = own_matcher.main(trials=4)
    assert rmse_mm["limit"] < rmse_mm["mine"] < 30.0
    assert [line.split()[0] for line in capsys.readouterr().out.splitlines()] == ["mine", "limit"]


def test_own_matcher_calls_a_scan_without_pairs_lost():
    matcher = own_matcher.MyMatcher(PointMap(np.zeros((0, 2)), 0.01))
    scan = Beams(np.zeros((3, 2)), np.arange(3.0), np.ones(3))
    assert not matcher(scan, SE2.identity()).is_matched


def test_best_pose_is_the_one_that_moved_the_points():
    moved = SE2(0.3, -0.2, math.radians(20))
    points = np.array([[0.0, 0.0], [2.0, 0.0], [0.0, 1.0]])
    found = own_matcher.best_pose(points, moved @ points)
    assert found.as_array() == pytest.approx(moved.as_array(), abs=1e-12)

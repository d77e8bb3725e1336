"""Experiment 2: what the robot can and cannot know after it was carried."""

import math
from dataclasses import replace

import numpy as np
import pytest

from experiments.kidnap import checked, run_trial
from experiments.trials import TrialConfig, generator
from slam.se2 import wrap_angle

# the operator's inaccuracy, five standard deviations of 1 cm and 0.02 rad
HAND = np.array([0.05, 0.05, 0.1])
# the belief at random poses
START = np.array([0.10, 0.10, math.radians(5)])


@pytest.mark.slow
def test_encoders_tell_nothing_of_the_way_from_pose_1():
    config = TrialConfig(methods=("odometry",))
    start = config.known_place.place.start
    for index in range(3):
        result = run_trial(config, generator("kidnap", 0, index))
        outcome = result.outcomes["odometry"]
        assert (np.abs(outcome.error - [0.0, 1.0, -math.pi / 2]) < HAND).all()
        assert not outcome.is_success
        # the wheels were held, within 20 counts of 4 micrometres each: 0.08 mm, 0.5 mrad
        believed = outcome.T_map_base.as_array()
        assert (np.abs(believed - start) < [1e-4, 1e-4, 1e-3]).all()


def test_random_kidnap_is_the_papers_motion(quick_config):
    for index in range(3):
        result = run_trial(quick_config, generator("kidnap", 0, index))
        before, after = result.true_poses
        moved = after - before
        moved[2] = wrap_angle(moved[2])
        assert (np.abs(moved - [0.0, -1.0, math.pi / 2]) < HAND).all()
        error = result.outcomes["odometry"].error
        assert (np.abs(error - [0.0, 1.0, -math.pi / 2]) < HAND + START).all()
        assert not result.outcomes["odometry"].is_success


def test_both_scans_and_poses_are_kept_for_the_picture(quick_config):
    result = run_trial(quick_config, generator("kidnap", 0, 0))
    assert len(result.scans) == len(result.true_poses) == 2
    assert result.scans[0].ranges_m.tobytes() != result.scans[1].ranges_m.tobytes()
    # gripping, lifting, carrying and setting down takes the hand 5.9 s; two scans less than 0.2 s
    assert 5.9 < result.sim_s < 6.2


@pytest.mark.slow
def test_random_kidnaps_end_where_the_robot_can_stand(quick_config):
    place = quick_config.known_place.place
    for index in range(5):
        result = run_trial(quick_config, generator("kidnap", 1, index))
        assert place.is_free(np.array(result.true_poses)[:, :2]).all()


def test_place_without_a_metre_of_free_floor_is_refused(quick_config, box_room):
    assert checked(quick_config) == quick_config
    with pytest.raises(ValueError, match="nothing is free 1 m lower in y than its start"):
        checked(TrialConfig(poses="paper", place=box_room))


def test_robot_carried_anywhere_notices_it_and_finds_itself():
    config = TrialConfig(
        poses="anywhere", place="symmetric_room", methods=("paper", "limit"), people=2
    )
    record = run_trial(config, generator("kidnap", 3, 0)).record()
    found = record["methods"]["limit"]
    assert found["success"]
    assert found["detected"]
    assert not found["false_alarm"]
    assert found["looks"][0]["verdict"] == "lost"
    assert found["looks"][-1]["verdict"] == found["verdict"] == "tracking"
    assert 2 <= len(found["looks"]) <= 6
    scores = found["lost_scores"]
    assert scores["before"]["inlier_ratio"] > scores["after"]["inlier_ratio"]
    assert "looks" not in record["methods"]["paper"]  # plain ICP has its one scan


@pytest.mark.slow
def test_carried_anywhere_ends_anywhere(quick_config):
    config = replace(quick_config, poses="anywhere")
    ends = np.array([run_trial(config, generator("kidnap", 0, i)).true_poses[-1] for i in range(4)])
    assert np.ptp(ends[:, :2], axis=0).min() > 0.3
    assert np.ptp(ends[:, 2]) > 0.5

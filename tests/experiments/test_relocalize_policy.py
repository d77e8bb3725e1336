"""The policy that turns to be certain, where turning does not suffice: it drives, and hits nothing."""

import math

import gymnasium
import numpy as np
import pytest

import kitasap_sim  # noqa: F401, registers the tasks
from experiments.beliefs import BeliefReward
from experiments.policies.relocalize import TurnToDisambiguate
from kitasap_sim.laser import laser
from kitasap_sim.robot import KITASAP2


@pytest.mark.slow
def test_bare_rectangle_leaves_the_robot_unsure_and_the_policy_hits_nothing():
    # two opposite poses fit for ever; the policy turns a round, drives, and turns again
    env = BeliefReward(
        gymnasium.make(
            "Kitasap2/Relocalize-v0", place="random", difficulty=0.0, max_episode_steps=250
        )
    )
    policy = TurnToDisambiguate(env.unwrapped.laser)
    observation, info = env.reset(seed=7)
    start = info["pose_true"]
    for _ in range(250):
        observation, _, is_over, _, info = env.step(policy(observation))
        assert not is_over
        assert not info["is_certain"]
        assert observation["belief"][0] == 0.0
    assert math.hypot(*(info["pose_true"] - start)[:2]) > 0.3


def test_policy_sees_how_far_it_can_drive():
    policy = TurnToDisambiguate(laser("urg_04lx"))
    scan, width_m = np.full(682, 0.9, dtype=np.float32), KITASAP2.radius_m + 0.1
    # the corners of the way end on the circle of 0.9 m round the laser
    room_m = 0.19 + math.sqrt(0.81 - width_m**2) - width_m
    assert policy._room_m({"scan": scan}, 0.0) == pytest.approx(room_m, abs=0.01)
    assert policy._room_m({"scan": np.full(682, 0.2, dtype=np.float32)}, 0.0) == 0.0


def test_policy_without_a_belief_says_what_gives_it_one():
    with pytest.raises(ValueError, match="BeliefReward"):
        TurnToDisambiguate(laser("urg_04lx"))({"odometry": np.zeros(3), "scan": np.zeros(682)})


def test_policy_stops_before_what_comes_into_its_way():
    policy = TurnToDisambiguate(laser("urg_04lx"))
    heading_rad, belief = 0.0, np.zeros(8, dtype=np.float32)

    def act(range_m):
        odometry = np.array([0.0, 0.0, math.remainder(heading_rad, math.tau)], dtype=np.float32)
        scan = np.full(682, range_m, dtype=np.float32)
        return policy({"belief": belief, "scan": scan, "odometry": odometry})

    for _ in range(200):
        action = act(3.0)
        heading_rad += 0.05 * 1.5 * float(action[1])
        if action[0] > 0.0:
            break
    assert abs(heading_rad) > math.tau - 0.6  # after a round, less the turn to face the way
    assert act(3.0)[0] > 0.0
    assert act(0.3)[0] == 0.0


def test_policy_begins_anew_where_it_was_sure_for_a_moment():
    policy = TurnToDisambiguate(laser("urg_04lx"))
    heading_rad, scan = 0.0, np.full(682, 3.0, dtype=np.float32)

    def act(is_tracking):
        odometry = np.array([0.0, 0.0, math.remainder(heading_rad, math.tau)], dtype=np.float32)
        belief = np.array([is_tracking, *[0.0] * 7], dtype=np.float32)
        return policy({"belief": belief, "scan": scan, "odometry": odometry})

    while policy._from_m is None:
        heading_rad += 0.05 * 1.5 * float(act(False)[1])
    # on its way to face where it will drive
    assert act(True).tolist() == [0.0, 0.0]
    action = act(False)
    assert action[0] == 0.0
    assert action[1] > 0.0

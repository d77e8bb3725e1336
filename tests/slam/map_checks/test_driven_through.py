"""What a robot drove through: a wall, or somebody who stood on the way then."""

from dataclasses import replace

import numpy as np
import pytest

from slam import SE2, Beams
from slam.frontend.keyframes import Keyframe
from slam.map_checks.driven_through import driven_through
from slam.map_checks.map_consistency import ConsistencyConfig

NOTHING = Beams(np.zeros((3, 2)), np.array([-0.1, 0.0, 0.1]), np.full(3, np.inf))


def keyframe(x_m: float, points: np.ndarray) -> Keyframe:
    pose = SE2(x_m, 0.0, 0.0)
    seen = pose.inverse() @ points
    return Keyframe(0.0, pose, pose, np.eye(3), seen, NOTHING, is_break=False)


@pytest.mark.parametrize(
    ("reaches_m", "walls"), [((-0.4, 0.3), 0), ((-0.9, 0.3), 1), ((-0.9, 0.9), 1)]
)
def test_what_reaches_no_farther_than_a_door_is_no_wall(reaches_m, walls):
    # somebody beside an open door, where the robot drove later: two of ten maps with people were right and failed
    across = np.column_stack([np.full(200, 2.6), np.linspace(*reaches_m, 200)])
    nothing = np.zeros((0, 2))
    keyframes = [keyframe(x, nothing) for x in np.arange(0.0, 5.0, 0.25)]
    keyframes += [keyframe(5.0, nothing)] * 11 + [keyframe(5.0, across)]
    poses = np.array([one.T_map_base.as_array() for one in keyframes])
    (found,) = driven_through(keyframes, poses, ConsistencyConfig().margins)
    assert (found.scans, found.walls) == (1, walls)


def test_from_before_a_gap_to_after_it_nobody_drove_straight():
    across = np.column_stack([np.full(200, 2.6), np.linspace(-0.9, 0.9, 200)])
    nothing = np.zeros((0, 2))
    keyframes = [keyframe(x, nothing) for x in np.arange(0.0, 5.0, 0.25)]
    keyframes += [keyframe(5.0, nothing)] * 11 + [keyframe(5.0, across)]
    poses = np.array([one.T_map_base.as_array() for one in keyframes])
    keyframes[11] = replace(keyframes[11], is_after_gap=True)
    assert driven_through(keyframes, poses, ConsistencyConfig().margins) == []

"""Loops are told by what was seen before, and not by the scan that closes them."""

import numpy as np
import pytest

from slam import SE2
from slam.keyframes import Keyframe
from slam.loop_closing import LoopCloser
from tests.slam.synthetic import box, room
from tests.slam.test_open_runs import kept

# a corridor with a box here and there, seen from either side
WALLS = np.concatenate(
    [room(-30.0, -1.0, 30.0, 1.0)]
    + [box(x, 0.6, x + 0.4, 1.0) for x in (-1.7, 2.3, 4.4, 10.5)]
    + [box(x, -1.0, x + 0.7, -0.7) for x in (0.3, 3.5)]
)


def seen_each_metre(off_m: float) -> tuple[list[Keyframe], np.ndarray]:
    """Keyframes along the corridor, and poses of which those from the ninth on are off."""
    rng = np.random.default_rng(3)
    places = [SE2(x, 0.0, 0.0) for x in np.arange(0.0, 12.0)]
    poses = np.array([place.as_array() for place in places])
    poses[8:, 0] += off_m
    return [kept(WALLS, one, rng) for one in places], poses


@pytest.mark.parametrize("later", [8, 9])
def test_a_scan_that_is_off_is_not_borne_out_by_itself(later):
    # where a drive has a scan each metre, eight keyframes reach as far as a loop must
    keyframes, poses = seen_each_metre(0.5)
    loop = LoopCloser().verified(keyframes, poses, 2, later, (0.3, 0.0))
    assert loop is not None
    assert loop.T_earlier_later.is_near(SE2(later - 2.0, 0.0, 0.0), 0.05, 0.01)

"""Loops are told by what was seen before, and not by the scan that closes them."""

import math
from dataclasses import replace

import numpy as np
import pytest

from slam import SE2
from slam.frontend.keyframes import Keyframe
from slam.loop_closing import Loop, LoopCloser, LoopConfig
from tests.slam.frontend.test_open_runs import kept
from tests.slam.synthetic import box, room

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


@pytest.mark.parametrize(("doubted", "off_m"), [(set(), 0.5), ({8}, 0.0)])
def test_what_is_seen_beyond_a_doubted_step_says_nothing_of_a_loop(doubted, off_m):
    # the two keyframes after it that see most of what the later one sees: half a metre off, and all of it fits
    keyframes, poses = seen_each_metre(0.5)
    keyframes.append(kept(WALLS, SE2(7.4, 0.0, 0.0), np.random.default_rng(4)))
    poses = np.vstack([poses, [7.4, 0.0, 0.0]])
    closer = LoopCloser()
    closer.doubted = doubted
    loop = closer.verified(keyframes, poses, 7, len(keyframes) - 1, (0.3, 0.0))
    assert loop is not None
    assert loop.T_earlier_later.is_near(SE2(0.4 + off_m, 0.0, 0.0), 0.05, 0.01)


@pytest.mark.parametrize(("gap", "around"), [(25, range(8, 25)), (0, range(8, 33))])
def test_what_is_seen_beyond_a_gap_is_not_held_against_a_scan(gap, around):
    keyframe = kept(WALLS, SE2.identity(), np.random.default_rng(5))
    keyframes = [replace(keyframe, is_after_gap=k == gap) for k in range(100)]
    closer = LoopCloser(LoopConfig(half=12))
    assert closer._around(keyframes, 20, 99, set()) == around


def test_loops_do_not_span_a_doubted_step_but_ties_do():
    rng = np.random.default_rng(5)
    keyframes = [kept(WALLS, SE2(0.1 * k, 0.0, 0.0), rng) for k in range(60)]
    keyframes[25] = replace(keyframes[25], is_break=True)
    way = SE2.identity(), np.eye(3), 1.0, 0.0
    loops = [Loop(earlier, 59, *way) for earlier in (11, 12, 20, 24, 25)]
    tie = Loop(18, 21, *way, is_tie=True)
    kept_ones = LoopCloser().undoubted(keyframes, [*loops, tie], {20})
    assert kept_ones == [loops[0], loops[4], tie]


def test_those_proposed_are_the_nearest_with_a_scan_each_from_another_time():
    # five rounds of one place, 30 keyframes each, and of the nearest ones some keep no more than their place
    rounds = [
        [math.cos(a), math.sin(a), 0.0] for a in np.linspace(0.0, math.tau, 30, endpoint=False)
    ]
    poses = np.array(
        [[(1.0 + 0.1 * k) * x, (1.0 + 0.1 * k) * y, a] for k in range(5) for x, y, a in rounds]
    )
    keyframe = kept(WALLS, SE2.identity(), np.random.default_rng(6))
    keyframes = [keyframe] * 149 + [replace(keyframe, time_s=1.0)]
    for k in (90, 91, 119, 60):
        keyframes[k] = keyframe.place_alone()
    closer, later = LoopCloser(), 149
    pairs = closer.proposed(keyframes, poses, [later], np.zeros(150))
    way_m = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(poses[:, :2], axis=0).T))])
    expected: list[int] = []
    for k in np.argsort(
        np.hypot(*(poses[:later, :2] - poses[later, :2]).T), kind="stable"
    ).tolist():
        is_far_back = way_m[later] - way_m[k] > closer.config.least_way_m
        is_apart = all(abs(k - other) > closer.config.apart for other in expected)
        if is_far_back and is_apart and not keyframes[k].is_place_alone:
            expected.append(k)
    assert len(expected) > closer.config.most
    assert pairs == [(k, later) for k in expected[: closer.config.most]]
    keyframes[later] = keyframe.place_alone()
    assert closer.proposed(keyframes, poses, [later], np.zeros(150)) == []

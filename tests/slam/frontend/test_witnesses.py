"""What scans of a map say of one another's points: walls stand, people go, and a hair says nothing."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from slam.beams import Beams
from slam.frontend.keyframes import Keyframe
from slam.frontend.witnesses import Witnesses
from slam.kernels.visibility import NOT_THROUGH, THROUGH, UNSEEN, contradictions, statements_into
from slam.se2 import SE2
from tests.slam.synthetic import ANGLES_RAD, ROOM_SEGMENTS, FloatArray, legs, scan_of

MARGINS, ASIDE_M = (0.25, 0.03), 0.1
POSES = [SE2(1.5 + 0.2 * k, 1.8, 0.1) for k in range(8)]
"""Side by side, and the last of them as if on a later visit."""


def of_beams(T_map_base: SE2, beams: Beams, is_break: bool = False) -> Keyframe:
    nothing = np.zeros((3, 3))
    return Keyframe(0.0, T_map_base, SE2.identity(), nothing, beams.points, beams, is_break)


def keyframe(T_map_base: SE2, walls: FloatArray, is_break: bool = False) -> Keyframe:
    beams = Beams.of(scan_of(walls, T_map_base), SE2.identity())
    return of_beams(T_map_base, beams, is_break)


def witnesses(keyframes: list[Keyframe], poses: list[SE2]) -> Witnesses:
    return Witnesses(keyframes, np.array([pose.as_array() for pose in poses]), MARGINS, ASIDE_M)


def with_somebody(at: int, bearings: tuple[float, ...] = (0.0, 0.3)) -> list[Keyframe]:
    """Legs before the robot at one of its poses, gone at the others."""
    somebody = np.concatenate([ROOM_SEGMENTS, legs(POSES[at], bearings, away_m=1.2)])
    return [keyframe(T, somebody if k == at else ROOM_SEGMENTS) for k, T in enumerate(POSES)]


def test_whom_those_before_and_after_do_not_see_contradicts_nobody():
    seen, through = witnesses(with_somebody(3), POSES).passed(3, 7)
    assert seen > 300
    assert through == 0


def test_who_stands_before_the_last_scan_of_a_piece_is_seen_through_by_those_before():
    keyframes = with_somebody(4)
    assert witnesses(keyframes[:5], POSES[:5]).passed(4, 0)[1] == 0


def test_what_those_before_and_after_saw_as_well_is_a_contradiction():
    somebody = np.concatenate([ROOM_SEGMENTS, legs(POSES[3], (0.0, 0.3), away_m=1.2)])
    keyframes = [keyframe(T, somebody if k < 7 else ROOM_SEGMENTS) for k, T in enumerate(POSES)]
    assert witnesses(keyframes, POSES).passed(3, 7)[1] > 20


def test_scan_that_lies_wrong_is_contradicted_by_those_beside_it_too():
    keyframes = [keyframe(T, ROOM_SEGMENTS) for T in POSES]
    wrong = POSES.copy()
    wrong[3] = POSES[3] @ SE2(0.0, 0.0, 0.7)
    seen, through = witnesses(keyframes, wrong).passed(3, 7)
    assert through > 0.25 * seen


def test_nobody_beyond_a_break_says_what_stands():
    keyframes = with_somebody(3)
    torn = [of_beams(one.T_map_base, one.beams, k in (3, 4)) for k, one in enumerate(keyframes)]
    assert witnesses(torn, POSES).stands(3).all()
    assert not witnesses(keyframes, POSES).stands(3).all()


def test_nobody_beyond_a_gap_says_what_stands():
    keyframes = with_somebody(3)
    torn = [replace(one, is_after_gap=k in (3, 4)) for k, one in enumerate(keyframes)]
    assert witnesses(torn, POSES).stands(3).all()


def test_wall_along_which_a_scan_looks_says_nothing():
    # a board 0.5 m to the left, from 2 to 5 m ahead, and a scan that believes to be 15 cm nearer to it
    board = np.array([[[2.0, 0.5], [5.0, 0.5]], [[9.0, -5.0], [9.0, 5.0]]])
    one, other = (keyframe(SE2.identity(), board, is_break) for is_break in (False, True))
    off = SE2(0.0, -0.15, 0.0)
    beams = other.beams
    plain = contradictions(
        one.points, off.x, off.y, off.theta, beams.middle_m, beams.angles_rad, beams.ranges_m,
        *MARGINS, 0.0,
    )  # fmt: skip
    assert plain[1] > 10
    poses = np.array([off.as_array(), SE2.identity().as_array()])
    # the board's far end, where points are too far apart to tell a direction: 22 without
    assert Witnesses([one, other], poses, MARGINS, 0.0).passed(0, 1)[1] < 10


def test_scan_of_a_moving_laser_is_asked_from_the_middle_of_where_its_beams_start():
    still = keyframe(SE2.identity(), ROOM_SEGMENTS - [2.6, 1.9])
    ends, count = still.beams.points, len(ANGLES_RAD)
    origins = np.column_stack([np.linspace(-0.8, 0.8, count), np.zeros(count)])
    off = ends - origins
    beams = Beams(origins, np.unwrap(np.arctan2(off[:, 1], off[:, 0])), np.hypot(*off.T))
    moving = of_beams(SE2.identity(), beams, is_break=True)
    seen, through = witnesses([still, moving], [SE2.identity()] * 2).passed(0, 1)
    assert seen > 800
    assert through == 0


@pytest.mark.parametrize("aside_m", [0.0, 0.1])
def test_statements_are_those_of_a_slow_look_at_each_beam(aside_m):
    rng = np.random.default_rng(8)
    one, other = (keyframe(SE2(x, 1.7, t), ROOM_SEGMENTS) for x, t in ((2.0, 0.3), (3.0, 1.4)))
    there = other.T_map_base.inverse() @ one.T_map_base @ SE2(0.2, -0.3, 0.15)
    ranges_m = other.beams.ranges_m + rng.normal(0.0, 0.3, len(ANGLES_RAD))
    ranges_m[rng.random(len(ranges_m)) < 0.05] = np.nan
    ranges_m[rng.random(len(ranges_m)) < 0.05] = np.inf
    faced = one.faced.copy()
    faced[::17, 2] = np.nan
    said = np.empty(len(faced), dtype=np.int8)
    statements_into(
        faced, there.as_array(), np.zeros(2), ANGLES_RAD, ranges_m, *MARGINS, aside_m, 0.3, said
    )
    slow = [_said(point, there, ranges_m, aside_m) for point in faced]
    assert set(slow) == {UNSEEN, NOT_THROUGH, THROUGH}
    assert said.tolist() == slow


def _said(faced: FloatArray, there: SE2, ranges_m: FloatArray, aside_m: float) -> int:
    x, y = (there @ faced[np.newaxis, :2])[0]
    distance, bearing = math.hypot(x, y), math.atan2(y, x)
    facing = faced[2] + there.theta
    if not abs(math.cos(facing - bearing)) >= 0.3:
        return UNSEEN
    before = int(np.searchsorted(ANGLES_RAD, bearing, side="right")) - 1
    about = np.arange(before - 1, before + 3)
    if about[0] < 0 or about[-1] >= len(ANGLES_RAD) or not (ranges_m[about] > 0.0).all():
        return UNSEEN
    if math.isinf(ranges_m[about].min()):
        return UNSEEN
    aside_rad = math.asin(min(aside_m / max(distance, aside_m), 1.0))
    near = ranges_m[(np.abs(ANGLES_RAD - bearing) < aside_rad) & (ranges_m > 0.0)]
    nearest = min(ranges_m[about].min(), near.min(initial=math.inf))
    return THROUGH if nearest > distance + MARGINS[0] + MARGINS[1] * distance else NOT_THROUGH

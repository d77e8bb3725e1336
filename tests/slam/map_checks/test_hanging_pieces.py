"""What is come to blind lies where loops tie it: from far away, nobody knows where that is."""

from dataclasses import replace

import numpy as np
import pytest

from slam import SE2
from slam.backend.objections import objections_of_drives
from slam.beams import Beams
from slam.frontend.front_end_config import FrontEndConfig
from slam.frontend.keyframes import FrontEndStep, Keyframe, StepStatus
from slam.loop_closing import Loop
from slam.map_checks.hanging_pieces import hanging_pieces
from slam.map_checks.map_consistency import MapVerdict
from slam.mapper_config import MapperConfig
from slam.slam_map import SlamMap, graph_of

COUNT, BREAK = 60, 20
NEAR, FAR = ((17, 42), (19, 40), (22, 37), (25, 34)), ((0, 59), (1, 58), (2, 57), (3, 56))
SURE, BLIND = np.diag([1e-4, 1e-4, 2.5e-5]), np.diag([1.0, 1.0, 0.3])
BREAK_SIGMA = FrontEndConfig.break_sigma
BROKEN = np.diag(np.square(BREAK_SIGMA))


def driven(ends: tuple[tuple[int, int], ...], told: np.ndarray = BLIND) -> SlamMap:
    """There and back, half a metre aside, a keyframe each metre; one of them was come to blind."""
    places = [SE2(float(k), 0.0, 0.0) for k in range(COUNT // 2)]
    places += [SE2(float(COUNT - 1 - k), 0.5, np.pi) for k in range(COUNT // 2, COUNT)]
    empty = Beams(np.empty((0, 2)), np.empty(0), np.empty(0))
    keyframes, steps = [], []
    for k, pose in enumerate(places):
        T_before = places[max(k - 1, 0)].inverse() @ pose
        covariance = told if k == BREAK else SURE
        keyframes.append(
            Keyframe(float(k), pose, T_before, covariance, np.empty((0, 2)), empty, k == BREAK)
        )
        if k == BREAK:
            steps.append(step_of(k - 1, k - 0.5, StepStatus.CARRIED, is_keyframe=False))
        status = StepStatus.BROKEN if k == BREAK else StepStatus.MATCHED
        steps.append(step_of(k, float(k), status, is_keyframe=True))
    loops = tuple(
        Loop(i, j, places[i].inverse() @ places[j], np.linalg.inv(SURE), 1.0, 0.0) for i, j in ends
    )
    poses = np.array([pose.as_array() for pose in places])
    graph, verdict = graph_of(keyframes, loops, poses), MapVerdict(True, 0.0, 0.0, 0)
    return SlamMap(tuple(keyframes), poses, loops, (), graph, tuple(steps), verdict)


def step_of(keyframe: int, time_s: float, status: StepStatus, is_keyframe: bool) -> FrontEndStep:
    T = SE2.identity()
    return FrontEndStep(time_s, keyframe, T, T, status, 1.0, is_keyframe)


@pytest.mark.parametrize(("ends", "hangs"), [(NEAR, False), (FAR, True), (NEAR + FAR, False)])
def test_piece_hangs_by_loops_that_are_far_from_where_it_begins(ends, hangs):
    said = hanging_pieces(driven(ends), BREAK_SIGMA)
    assert bool(said) is hangs
    if hangs:
        assert "until 20.00 s no scan told" in said[0]


@pytest.mark.parametrize(("looser", "hangs"), [(3.0, False), (8.0, True)])
def test_piece_that_no_wheels_led_to_hangs_where_much_more_is_open(looser, hangs):
    """Odometry stuck for 10 s, and a scan that fitted nothing: aces 0.8 m off before it, and good."""
    slam_map = driven(FAR, 9.0 * BLIND)
    keyframes = [
        one if one.is_break else replace(one, covariance=looser * one.covariance)
        for one in slam_map.keyframes
    ]
    steps = [step for step in slam_map.steps if step.status is not StepStatus.CARRIED]
    told = replace(slam_map, keyframes=tuple(keyframes), steps=tuple(steps))
    said = hanging_pieces(told, BREAK_SIGMA)
    assert bool(said) is hangs
    if hangs:
        assert "until 20.00 s nothing told how far" in said[0]
    # one that was come to blind hangs by less
    assert hanging_pieces(replace(told, steps=slam_map.steps), BREAK_SIGMA)


@pytest.mark.parametrize("kind", ["seen", "another session", "no break"])
def test_only_what_was_come_to_blind_hangs(kind):
    slam_map = driven(FAR)
    steps, keyframes = list(slam_map.steps), list(slam_map.keyframes)
    if kind == "seen":
        steps[BREAK] = replace(steps[BREAK], status=StepStatus.MATCHED)
    elif kind == "another session":
        steps = [replace(one, session=int(k >= BREAK)) for k, one in enumerate(steps)]
        keyframes = [replace(one, session=int(k >= BREAK)) for k, one in enumerate(keyframes)]
    else:
        keyframes[BREAK] = replace(keyframes[BREAK], is_break=False)
    assert (
        hanging_pieces(
            replace(slam_map, steps=tuple(steps), keyframes=tuple(keyframes)), BREAK_SIGMA
        )
        == []
    )


def test_map_that_knows_no_place_better_is_no_measure():
    slam_map = driven(FAR)
    loose = [replace(one, covariance=BLIND) for one in slam_map.keyframes]
    graph = graph_of(loose, slam_map.loops, slam_map.poses)
    assert hanging_pieces(replace(slam_map, keyframes=tuple(loose), graph=graph), BREAK_SIGMA) == []


def test_wheels_count_for_what_they_say_of_the_way():
    assert hanging_pieces(driven(FAR, BROKEN + SURE), BREAK_SIGMA) == []
    assert hanging_pieces(driven(FAR, 0.0 * SURE + 1e-9 * np.eye(3)), BREAK_SIGMA) == []
    assert hanging_pieces(driven(FAR, BROKEN + BLIND), BREAK_SIGMA)
    # over a break that they are believed over, nothing was added
    assert hanging_pieces(driven(FAR[:1], 0.95 * BROKEN), BREAK_SIGMA)
    turned = BLIND.copy()
    turned[1, 2] = turned[2, 1] = 0.8 * np.sqrt(turned[1, 1] * turned[2, 2])
    assert (
        hanging_pieces(driven(FAR, turned), BREAK_SIGMA) == []
    )  # errors that go together leave less open


def test_piece_that_hung_is_judged_anew_once_the_map_goes_on():
    slam_map = driven(FAR)
    told = ("another thing", *hanging_pieces(slam_map, BREAK_SIGMA))
    failed = replace(slam_map, verdict=slam_map.verdict.with_reasons(told))
    assert objections_of_drives(failed, MapperConfig()) == ["another thing"]

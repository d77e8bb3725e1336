"""Odometry that is doubted, over keyframes whose scans leave the way open: believed where loops show it."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from slam import SE2
from slam.backend.keyframe_graph import KeyframeGraph
from slam.beams import Beams
from slam.frontend.keyframes import FrontEndStep, Keyframe, StepStatus
from slam.frontend.told_steps import ToldStep
from slam.frontend.wheel_scale import ScaledStep
from slam.loop_closing import Loop
from slam.map_checks.wheels_borne_out import (
    believe_where_borne_out,
    borne_out,
    showing,
    shown_noise,
    told_to_keyframes,
)
from slam.mapper_config import MapperConfig

COUNT, LOOSE = 40, range(16, 20)
STEP = SE2(0.4, 0.0, 0.02)
BY_SCANS, OPEN, BY_WHEELS = 1e-4 * np.eye(3), np.diag([1.0, 1e-4, 1e-4]), 1e-3 * np.eye(3)


def drive(slid: dict[int, float] | None = None) -> tuple[list[Keyframe], list[SE2]]:
    """Keyframes and where they were taken; some slid ahead [m], of the loose ones nobody knows."""
    true = [SE2.identity()]
    for _ in range(COUNT - 1):
        true.append(true[-1] @ STEP)
    seen = [pose @ SE2((slid or {}).get(k, 0.0), 0.0, 0.0) for k, pose in enumerate(true)]
    empty = Beams(np.empty((0, 2)), np.empty(0), np.empty(0))
    keyframes = [
        Keyframe(
            float(k), pose, seen[max(k - 1, 0)].inverse() @ pose,
            OPEN if k in LOOSE else BY_SCANS, np.empty((0, 2)), empty, is_break=False,
        )
        for k, pose in enumerate(seen)
    ]  # fmt: skip
    return keyframes, true


def solved(keyframes: list[Keyframe], true: list[SE2], *ends: tuple[int, int]):
    graph, sharp = KeyframeGraph(MapperConfig().step_sigma), 1e4 * np.eye(3)
    for keyframe in keyframes:
        graph.add(keyframe)
    graph.take([Loop(i, j, true[i].inverse() @ true[j], sharp, 1.0, 0.0) for i, j in ends])
    return graph.solve()


def told(in_between: SE2 = STEP, covariance: np.ndarray = BY_WHEELS) -> list[ToldStep]:
    motions = [in_between if k in LOOSE else STEP for k in range(1, COUNT)]
    return [ToldStep.none(), *(ToldStep(motion, covariance) for motion in motions)]


def scan_of_keyframe(k: int, is_new: bool = True) -> FrontEndStep:
    T = SE2.identity()
    return FrontEndStep(float(k), k, T, T, StepStatus.MATCHED, 1.0, is_new)


GUESSED = ToldStep(STEP, np.eye(3))
SLID = dict.fromkeys((16, 17, 18), 0.9)
ROUND = (2, 36), (5, 30), (8, 25), (12, 24)


def test_keyframes_that_slid_lie_where_wheels_led():
    keyframes, true = drive(SLID)
    found = borne_out(keyframes, solved(keyframes, true, *ROUND), told())
    assert set(found) == set(LOOSE)
    for step in found.values():
        assert step.motion.is_near(STEP, 0.03, 0.01)
        assert step.covariance[0, 0] >= BY_WHEELS[0, 0]


@pytest.mark.parametrize(("beside", "within"), [(15, {15}), (19, {20})])
def test_sure_scan_beside_them_may_have_slid_too(beside, within):
    keyframes, true = drive({**SLID, beside: 0.9})
    found = borne_out(keyframes, solved(keyframes, true, *ROUND), told())
    assert set(found) == set(LOOSE) | within
    assert all(step.motion.is_near(STEP, 0.03, 0.01) for step in found.values())


@pytest.mark.parametrize(
    ("wheels", "ends"),
    [
        (told(SE2(0.9, 0.0, 0.02)), ROUND),  # led elsewhere
        (told(), ()),  # nothing shows where it ends but they themselves
        (told(covariance=np.eye(3)), ROUND),  # told of nothing
    ],
)
def test_wheels_that_nothing_bears_out_stay_doubted(wheels, ends):
    keyframes, true = drive(SLID)
    assert borne_out(keyframes, solved(keyframes, true, *ends), wheels) == {}


def test_nobody_knows_the_way_over_a_break():
    keyframes, true = drive(SLID)
    keyframes[17] = replace(keyframes[17], is_break=True)
    assert borne_out(keyframes, solved(keyframes, true, *ROUND), told()) == {}


@pytest.mark.parametrize("apart", [{"is_break": True}, {"is_after_gap": True}])
def test_where_loops_show_what_was_before_it_that_is_another_matter(apart):
    keyframes, true = drive(SLID)
    keyframes[20] = replace(keyframes[20], covariance=OPEN, **apart)
    found = borne_out(keyframes, solved(keyframes, true, *ROUND, (3, 19), (4, 18)), told())
    assert set(found) == set(LOOSE)


def test_past_keyframes_that_were_let_go_many_scans_tell_the_way_and_not_the_wheels():
    keyframes, true = drive({**SLID, 19: 0.9})
    assert 20 in borne_out(keyframes, solved(keyframes, true, *ROUND), told())
    keyframes[20] = replace(keyframes[20], is_after_gap=True)
    assert borne_out(keyframes, solved(keyframes, true, *ROUND), told()) == {}
    # nor does such a way show what wheels are like
    keyframes[5] = replace(keyframes[5], is_after_gap=True)
    assert set(showing(keyframes, told())) == set(range(1, COUNT)) - {*LOOSE, 20, 5}


def test_steps_of_an_earlier_session_stay():
    keyframes, true = drive(SLID)
    graph = KeyframeGraph(MapperConfig().step_sigma)
    for keyframe in keyframes:
        graph.add(keyframe)
    sharp = 1e4 * np.eye(3)
    graph.take([Loop(i, j, true[i].inverse() @ true[j], sharp, 1.0, 0.0) for i, j in ROUND])
    first, own = 10, COUNT - 10
    scaled = [ScaledStep(1.0, np.ones(3))] * own
    front_end = SimpleNamespace(scaled_steps=scaled)
    steps = [scan_of_keyframe(k) for k in range(first, COUNT)]
    by_scan = [ToldStep(STEP, BY_WHEELS)] * own
    believe_where_borne_out(graph, front_end, steps, by_scan)
    changed = {k for k, one in enumerate(graph.keyframes) if one is not keyframes[k]}
    assert changed == set(LOOSE)
    for k in range(first + 1, COUNT):
        is_told = not graph.keyframes[k].told.is_guess
        assert is_told == (k in LOOSE) == (not front_end.scaled_steps[k - first].slope.any())
    poses = graph.solve().poses
    off_m = [np.hypot(*(poses[k, :2] - (true[k].x, true[k].y))) for k in LOOSE]
    assert max(off_m) < 0.05


def test_noise_that_the_wheels_show_elsewhere_counts():
    keyframes, true = drive({k: 0.04 * (-1.0) ** k for k in range(COUNT) if k not in LOOSE})
    found = borne_out(keyframes, solved(keyframes, true, *ROUND), told(covariance=1e-5 * np.eye(3)))
    assert set(found) >= set(LOOSE)
    assert min(step.covariance[0, 0] for step in found.values()) > 1e-4


def test_noise_may_be_less_than_told_where_that_is_asked():
    keyframes, true = drive({})
    poses = np.array([pose.as_array() for pose in true])
    assert shown_noise(keyframes, poses, told()) == 1.0
    assert shown_noise(keyframes, poses, told(), least=0.0) < 0.01
    assert shown_noise(keyframes[:5], poses[:5], told()[:5]) is None


def test_steps_that_nobody_measured_show_no_noise():
    keyframes, true = drive({k: 0.04 * (-1.0) ** k for k in range(COUNT) if k not in LOOSE})
    by_wheels = told(covariance=1e-5 * np.eye(3))
    for k in (*range(1, 13), *range(22, 30)):
        by_wheels[k] = GUESSED
    found = borne_out(keyframes, solved(keyframes, true, *ROUND), by_wheels)
    assert min(step.covariance[0, 0] for step in found.values()) > 1e-4


def test_motions_of_all_scans_make_the_step_to_a_keyframe():
    own = [scan_of_keyframe(0, is_new) for is_new in (False, True, False, False, True)]
    turn = SE2(0.1, 0.0, 0.5)
    first, step = told_to_keyframes(own, [ToldStep(turn, BY_WHEELS)] * 5)
    assert first.motion == SE2.identity()
    assert step.motion.is_near(turn @ turn @ turn, 1e-9, 1e-9)
    assert step.covariance[1, 1] > 3.0 * BY_WHEELS[1, 1]  # turned, an unsure heading leads aside

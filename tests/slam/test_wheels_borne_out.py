"""Odometry that is doubted, over keyframes whose scans leave the way open: believed where loops show it."""

from dataclasses import replace

import numpy as np
import pytest

from slam import SE2
from slam.beams import Beams
from slam.keyframe_graph import KeyframeGraph
from slam.keyframes import FrontEndStep, Keyframe, StepStatus
from slam.loop_closing import Loop
from slam.mapper_config import MapperConfig
from slam.strays import ToldStep
from slam.wheels_borne_out import borne_out, told_to_keyframes

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


SLID = dict.fromkeys((16, 17, 18), 0.9)
ROUND = (2, 36), (5, 30), (8, 25), (12, 24)


def test_keyframes_that_slid_lie_where_wheels_led():
    keyframes, true = drive(SLID)
    found = borne_out(keyframes, solved(keyframes, true, *ROUND), told())
    assert set(found) == set(LOOSE)
    for step in found.values():
        assert step.motion.is_near(STEP, 0.03, 0.01)
        assert step.covariance[0, 0] >= BY_WHEELS[0, 0]


@pytest.mark.parametrize(("beside", "within"), [(15, {15}), (19, {20}), (20, set())])
def test_sure_scan_beside_them_may_have_slid_too(beside, within):
    slid = {**SLID, beside: 0.9} if beside != 20 else SLID
    keyframes, true = drive(slid)
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
    found = borne_out(keyframes, solved(keyframes, true, *ROUND), told())
    assert 17 not in found


def test_noise_that_the_wheels_show_elsewhere_counts():
    keyframes, true = drive({k: 0.04 * (-1.0) ** k for k in range(COUNT) if k not in LOOSE})
    found = borne_out(keyframes, solved(keyframes, true, *ROUND), told(covariance=1e-5 * np.eye(3)))
    assert set(found) >= set(LOOSE)
    assert min(step.covariance[0, 0] for step in found.values()) > 1e-4


def test_motions_of_all_scans_make_the_step_to_a_keyframe():
    own = [
        FrontEndStep(0.0, 0, SE2.identity(), SE2.identity(), StepStatus.MATCHED, 1.0, is_new)
        for is_new in (False, True, False, False, True)
    ]
    turn = SE2(0.1, 0.0, 0.5)
    first, step = told_to_keyframes(own, [ToldStep(turn, BY_WHEELS)] * 5)
    assert first.motion == SE2.identity()
    assert step.motion.is_near(turn @ turn @ turn, 1e-9, 1e-9)
    assert step.covariance[1, 1] > 3.0 * BY_WHEELS[1, 1]  # turned, an unsure heading leads aside

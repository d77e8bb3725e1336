"""Keyframes aside for a moment are put where wheels lead that agree before and after; no others are."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from slam.beams import Beams
from slam.frontend.keyframes import Keyframe
from slam.frontend.strays import StrayConfig
from slam.frontend.told_steps import ToldStep
from slam.loop_closing import Loop
from slam.map_checks.there_and_back import put_on_the_way, put_strays_back
from slam.se2 import SE2
from slam.surface.surface_map import SurfaceMapConfig

COUNT, AT, STEP = 30, 12, SE2(0.4, 0.0, 0.02)
BEAMS = Beams(np.zeros((20, 2)), np.linspace(-1.0, 1.0, 20), np.full(20, 3.0))
SURE = np.diag([0.02**2, 0.02**2, 0.02**2])
BY_SCANS = 0.01 * SURE


def keyframe(index: int) -> Keyframe:
    points = np.ones((20, 2))
    return Keyframe(
        float(index), SE2.identity(), STEP, BY_SCANS, points, BEAMS, is_break=False
    )  # fmt: skip


KEYFRAMES = [keyframe(index) for index in range(COUNT)]


def way() -> np.ndarray:
    """(COUNT, 3) along a wide curve."""
    poses = [SE2.identity()]
    for _ in range(COUNT - 1):
        poses.append(poses[-1] @ STEP)
    return np.array([pose.as_array() for pose in poses])


def aside(strays, off: SE2) -> np.ndarray:
    poses = way()
    for k in strays:
        poses[k] = (SE2.from_array(poses[k]) @ off).as_array()
    return poses


def told(covariance: np.ndarray = SURE) -> list[ToldStep]:
    return [ToldStep(STEP, covariance) for _ in range(COUNT)]


def loop(earlier: int, later: int) -> Loop:
    return Loop(earlier, later, SE2.identity(), np.eye(3), 0.9, 0.0)


@pytest.mark.parametrize("off", [SE2(0.0, 0.5, 0.0), SE2(-0.5, 0.0, 0.1)])
@pytest.mark.parametrize("run", [1, 2, 3])
@pytest.mark.parametrize("is_last", [False, True])
def test_whoever_lies_aside_for_a_moment_is_put_where_wheels_lead(run, off, is_last):
    first = COUNT - 1 - run if is_last else AT
    strays = list(range(first, first + run))
    loops = [loop(2, first), loop(first, COUNT - 1), loop(3, 20)]
    found, kept, poses, put_back = put_on_the_way(KEYFRAMES, loops, aside(strays, off), told())
    assert put_back == strays
    assert poses == pytest.approx(way(), abs=1e-6)
    assert [one.is_place_alone for one in found] == [k in strays for k in range(COUNT)]
    assert kept == loops[2:]
    for k in (*strays, strays[-1] + 1):
        assert found[k].T_before.is_near(STEP, 1e-6, 1e-6)
        assert (np.diag(found[k].covariance) >= 0.1 * np.diag(SURE)).all()  # wheels tell it now


def test_keyframes_each_after_another_time_are_of_a_drive_as_even():
    """Trees among which somebody walked: 0.56 m aside, and failed, since the next keyframe was twice as far."""
    far = range(AT - 6, AT + 9, 3)  # steps to these are three times as long
    lengths = [3.0 if k in far else 1.0 for k in range(COUNT)]
    steps = [ToldStep(SE2.exp(length * STEP.log()), SURE) for length in lengths]
    times_s = np.cumsum(lengths).tolist()
    keyframes = [
        replace(one, time_s=time_s) for one, time_s in zip(KEYFRAMES, times_s, strict=True)
    ]
    poses = [SE2.identity()]
    for step in steps[1:]:
        poses.append(poses[-1] @ step.motion)
    poses[AT] = poses[AT] @ SE2(0.6, 0.0, 0.0)
    drawn = np.array([pose.as_array() for pose in poses])
    assert put_on_the_way(keyframes, [], drawn, steps)[-1] == [AT]
    # stamps that stand say nothing of how long a step took
    stands = [replace(one, time_s=0.0) for one in keyframes]
    assert put_on_the_way(stands, [], drawn, steps)[-1] == []


def test_a_robot_that_paused_before_drove_as_evenly():
    keyframes = [
        replace(one, time_s=one.time_s + 60.0 * (k >= AT)) for k, one in enumerate(KEYFRAMES)
    ]
    drawn = aside([AT], SE2(0.6, 0.0, 0.0))
    assert put_on_the_way(keyframes, [], drawn, told())[-1] == [AT]


def test_those_that_fit_elsewhere_and_those_aside_are_put_back_on_the_solved_graph(monkeypatch):
    class Graph:
        keyframes, loops, poses, renewed = KEYFRAMES, [loop(3, 20)], way(), None

        def solve(self):
            self.poses = aside([AT], SE2(0.0, 0.5, 0.0))

        def renew(self, *told):
            self.renewed = told

    def fitting(keyframes, loops, poses, *_):
        return keyframes, loops, poses, [3]

    monkeypatch.setattr("slam.map_checks.there_and_back.without_strays", fitting)
    graph = Graph()
    put_back = put_strays_back(graph, told(), told(), StrayConfig(), SurfaceMapConfig())
    assert list(put_back) == [3, AT]
    assert put_back[3].is_near(SE2.identity(), 1e-6, 1e-6)
    assert put_back[AT].is_near(SE2(0.0, 0.5, 0.0), 1e-6, 1e-6)
    assert graph.renewed is not None
    assert graph.renewed[2] == pytest.approx(way(), abs=1e-6)


def test_wheels_that_are_hardly_smoother_put_nobody_back():
    poses, uneven = aside([AT], SE2(0.0, 0.5, 0.0)), told()
    uneven[AT] = ToldStep(STEP @ SE2(0.3, 0.0, 0.0), SURE)
    uneven[AT + 1] = ToldStep(STEP @ SE2(-0.3, 0.0, 0.0), SURE)
    assert put_on_the_way(KEYFRAMES, [], poses, uneven)[3] == []


def test_the_keyframes_of_sessions_before_are_left():
    poses = aside([AT], SE2(0.0, 0.5, 0.0))
    assert put_on_the_way(KEYFRAMES, [], poses, told()[AT - 1 :])[3] == []
    assert put_on_the_way(KEYFRAMES, [], poses, told()[AT - 2 :])[3] == [AT]


@pytest.mark.parametrize(
    ("strays", "off"),
    [
        (range(AT, AT + 4), SE2(0.0, 0.5, 0.0)),  # for long
        ([AT], SE2(0.0, 0.2, 0.0)),  # near by
        (range(AT, COUNT), SE2(0.0, 0.5, 0.0)),  # and stays there: wheels slipped
        (range(AT, COUNT), SE2(0.0, 2.0, 0.0)),
    ],
)
def test_whoever_is_not_aside_for_a_moment_stays(strays, off):
    poses = aside(strays, off)
    _, _, found, put_back = put_on_the_way(KEYFRAMES, [], poses, told())
    assert put_back == []
    assert (found == poses).all()


def test_wheels_that_tell_of_a_way_late_put_nobody_back():
    late = told()
    late[AT] = late[AT + 1] = ToldStep(SE2.identity(), SURE)
    late[AT + 2] = ToldStep(STEP @ STEP @ STEP, SURE)
    assert put_on_the_way(KEYFRAMES, [], way(), late)[3] == []


def test_a_detour_that_wheels_tell_of_is_one():
    poses, detour = aside([AT], SE2(0.0, 0.5, 0.0)), told()
    for k in (AT, AT + 1):
        start, end = (SE2.from_array(pose) for pose in poses[k - 1 : k + 1])
        detour[k] = ToldStep(start.inverse() @ end, SURE)
    assert put_on_the_way(KEYFRAMES, [], poses, detour)[3] == []


@pytest.mark.parametrize("covariance", [np.eye(3), np.diag([0.25**2, 0.25**2, 0.1])])
def test_wheels_that_hardly_know_put_nobody_back(covariance):
    for off_m in (0.5, 6.0):
        poses = aside([AT], SE2(0.0, off_m, 0.0))
        some = told(covariance) if covariance[0, 0] < 1.0 else told()
        for k in (AT, AT + 1):
            some[k] = ToldStep(STEP, covariance)
        is_known = covariance[0, 0] < 1.0 and off_m > 1.0
        assert put_on_the_way(KEYFRAMES, [], poses, some)[3] == ([AT] if is_known else [])


def test_wheels_are_as_noisy_as_they_show():
    rng = np.random.default_rng(3)
    noisy = [ToldStep(STEP @ SE2(*rng.normal(0.0, 0.2, 2), 0.0), SURE) for _ in range(COUNT)]
    noisy[AT] = noisy[AT + 1] = ToldStep(STEP, SURE)
    poses = aside([AT], SE2(0.0, 0.4, 0.0))
    assert put_on_the_way(KEYFRAMES, [], poses, told())[3] == [AT]
    assert put_on_the_way(KEYFRAMES, [], poses, noisy)[3] == []


def test_too_few_steps_show_nothing_of_the_wheels():
    few = KEYFRAMES[AT - 4 : AT + 4]
    poses = aside([AT], SE2(0.0, 0.5, 0.0))[AT - 4 : AT + 4]
    assert put_on_the_way(few, [], poses, told()[:8])[3] == []


def test_scans_that_broke_off_may_be_anywhere_but_where_they_come_back_to_the_way():
    poses, torn = aside([AT, AT + 1], SE2(0.0, 0.5, 0.0)), list(KEYFRAMES)
    torn[AT] = replace(torn[AT], is_break=True)
    assert put_on_the_way(torn, [], poses, told())[3] == []
    torn[AT] = replace(KEYFRAMES[AT], is_after_gap=True)
    assert put_on_the_way(torn, [], poses, told())[3] == []
    torn = list(KEYFRAMES)
    torn[AT + 2] = replace(torn[AT + 2], is_break=True, covariance=0.25 * np.eye(3))
    found, _, _, put_back = put_on_the_way(torn, [], poses, told())
    assert put_back == [AT, AT + 1]
    assert (found[AT + 2].covariance == 0.25 * np.eye(3)).all()


def test_silent_wheels_put_nobody_back():
    # turned on the spot, went half a metre there and back of which wheels told nothing
    silent = told()
    for k in range(AT - 1, AT + 2):
        silent[k] = ToldStep(SE2.identity(), SURE)
    still = way()
    still[AT - 1 :] = poses_from(still[AT - 2], COUNT - AT + 1, still=3)
    still[AT] = (SE2.from_array(still[AT]) @ SE2(0.5, 0.0, 0.0)).as_array()
    assert put_on_the_way(KEYFRAMES, [], still, silent)[3] == []


def poses_from(start: np.ndarray, count: int, still: int) -> np.ndarray:
    """(count, 3) poses after one: some at the same place, then on."""
    poses = [SE2.from_array(start)]
    for k in range(count):
        poses.append(poses[-1] @ (SE2.identity() if k < still else STEP))
    return np.array([pose.as_array() for pose in poses[1:]])


@pytest.mark.parametrize("late", [2, 3, 4])
def test_wheels_that_tell_of_a_detour_late_put_nobody_back(late):
    poses, steps = aside([AT], SE2(0.0, 0.6, 0.0)), told()
    for k in (AT, AT + 1):
        start, end = (SE2.from_array(pose) for pose in poses[k - 1 : k + 1])
        steps[k + late] = ToldStep(start.inverse() @ end, SURE)
    assert put_on_the_way(KEYFRAMES, [], poses, steps)[3] == []


LATE = np.diag([0.13**2, 0.13**2, 0.05**2])
"""Of a way that was told late: of all of it wheels are sure, and not of each step."""


def late(strays) -> list[ToldStep]:
    steps = told()
    for k in (*strays, strays[-1] + 1):
        steps[k] = ToldStep(STEP, LATE)
    return steps


@pytest.mark.parametrize(("ahead_m", "is_put_back"), [(0.7, True), (0.31, False)])
def test_scans_that_went_back_where_wheels_go_on_are_off_together(ahead_m, is_put_back):
    """None of them alone: as of somebody who drew three of them along a corridor, the last one back."""
    strays = (AT, AT + 1, AT + 2)
    poses = aside(strays, SE2(ahead_m, 0.0, 0.0))
    _, _, moved, found = put_on_the_way(KEYFRAMES, [], poses, late(strays))
    assert found == (list(strays) if is_put_back else [])
    np.testing.assert_allclose(moved, way() if is_put_back else poses, atol=0.02)


def test_scans_that_hardly_move_where_wheels_tell_evenly_stay():
    """Off together as well, but nobody went back: the robot nearly stood, and made up for it."""
    strays = (AT, AT + 1, AT + 2)
    poses, slowly = way(), SE2(0.12, 0.0, 0.02)
    for k in strays:
        poses[k] = (SE2.from_array(poses[k - 1]) @ slowly).as_array()
    _, _, _, found = put_on_the_way(KEYFRAMES, [], poses, late(strays))
    assert found == []

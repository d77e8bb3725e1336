"""Keyframes that are let go: what is known of the others, under their numbers then."""

import copy
import math
from dataclasses import replace

import numpy as np
import pytest

from slam.backend.looseness import Looseness
from slam.frontend.kept_keyframes import Keyframes
from slam.frontend.keyframes import (
    FrontEndStep,
    FrontEndSteps,
    StepStatus,
    keyframe_ways,
    said_of,
)
from slam.frontend.loose_runs import LooseRun, LooseRuns, LooseScan, LooseScans
from slam.frontend.remaining import Remaining
from slam.frontend.told_steps import ToldStep
from slam.loop_closing import Loop, LoopCloser, renumbered
from slam.map_checks.breaks_borne_out import BreaksBorneOut
from slam.map_checks.drive_monitor import DriveMonitor
from slam.map_checks.weak_steps import WeakSteps
from slam.mapping import Mapper
from slam.measurements import LaserScan, Measurement
from slam.se2 import SE2
from tests.slam import ring
from tests.slam.frontend.test_kept_keyframes import keyframe, told

GONE = 2, 3, 5
WAY = ToldStep(SE2(1.0, 2.0, 0.5), np.diag([0.1, 0.2, 0.3]))
REMAINING = Remaining(
    ~np.isin(np.arange(8), GONE), np.array([0, 1, 1, 1, 4, 4, 6, 7]), {4: WAY, 6: WAY}
)
POSES = np.random.default_rng(5).uniform(-3.0, 3.0, (8, 3))


def test_who_remains_has_the_number_of_how_many_do_before_it():
    assert [REMAINING.number(k) for k in (0, 1, 4, 6, 7)] == [0, 1, 2, 3, 4]
    # those yet to come
    assert [REMAINING.number(k) for k in (8, 11)] == [5, 8]
    own = REMAINING.after(1)
    assert own.kept.tolist() == [0, 3, 5, 6]
    assert own.anchors.tolist() == [0, 0, 0, 3, 3, 5, 6]
    assert own.ways.keys() == {3, 5}
    assert REMAINING.after(5).ways.keys() == {1}


@pytest.mark.parametrize("alone", [(), (1, 3, 5, 6), range(8)])
def test_keyframes_that_remain_are_what_they_were_but_after_a_gap(alone):
    keyframes = Keyframes(keyframe(k) for k in range(8))
    for k in alone:
        keyframes.keep_place_alone(k)
    before = list(keyframes)
    keyframes.renumber(REMAINING)
    assert len(keyframes) == 5
    for at, k in enumerate((0, 1, 4, 6, 7)):
        expected = before[k].after_gap(WAY) if k in REMAINING.ways else before[k]
        assert told(keyframes[at]) == told(expected)
        assert keyframes[at].is_after_gap is (k in REMAINING.ways)
        assert keyframes.has_scan(at) is (k not in alone)
    gap = keyframes[2]
    assert (gap.T_before, gap.told.is_guess, gap.goes_on) == (WAY.motion, True, False)
    assert np.array_equal(gap.covariance, WAY.covariance)
    keyframes.append(keyframe(9))
    keyframes.keep_place_alone(5)
    assert told(keyframes[5]) == told(keyframe(9).place_alone())
    assert told(keyframes[4]) == told(before[7])


def step(k: int, *, is_keyframe: bool = False) -> FrontEndStep:
    way = SE2.identity() if is_keyframe else SE2(0.1 * k, -0.2, 0.3)
    return FrontEndStep(0.1 * k, k, way, way, StepStatus.MATCHED, 0.9, is_keyframe)


def test_scans_stay_where_they_are_as_seen_from_others():
    steps = FrontEndSteps(
        [step(-1), *(step(k, is_keyframe=first) for k in range(8) for first in (True, False))]
    )
    before = [one.placed(POSES) for one in steps]
    kept = copy.copy(steps)
    steps.renumber(REMAINING, POSES)
    for one, was, pose in zip(steps, kept, before, strict=True):
        assert one.placed(POSES[REMAINING.kept]).is_near(pose, 1e-12, 1e-12)
        assert one.is_keyframe is (was.is_keyframe and was.keyframe not in GONE)
        assert one.T_map_base == was.T_map_base
        if was.keyframe >= 0 and was.keyframe not in GONE:
            assert one.T_keyframe_base == was.T_keyframe_base
    assert [one.keyframe for one in steps][::2] == [-1, 0, 1, 1, 1, 2, 2, 3, 4]


def test_ways_between_keyframes_are_those_that_scans_are_seen_along():
    steps = FrontEndSteps(
        step(k, is_keyframe=first) for k in range(8) for first in (True, False, False)
    )
    assert keyframe_ways(steps, 3) == [(at, at + 3) for at in range(3, 19, 3)]
    # the scans of 5 are seen from 4, and those of 2 and 3 from 1, as if it was one way; not if from elsewhere
    steps.renumber(replace(REMAINING, anchors=np.array([0, 1, 0, 1, 4, 6, 6, 7])), POSES)
    assert keyframe_ways(steps, 0) == [(0, 3), (18, 21)]


def test_loops_and_what_was_said_are_of_those_that_remain():
    loops = [Loop(*ends, SE2.identity(), np.eye(3), 1.0, 0.0) for ends in ((0, 6), (1, 5), (4, 7))]
    found = renumbered(loops, REMAINING)
    assert [(one.earlier, one.later) for one in found] == [(0, 3), (2, 4)]
    said = np.eye(3), np.zeros((3, 3))
    assert said_of(dict.fromkeys((1, 3, 7), said), REMAINING) == {1: said, 4: said}


def test_loose_scans_of_keyframes_that_are_let_go_are_settled():
    steps = FrontEndSteps(step(k, is_keyframe=at == 0) for k in range(8) for at in range(3))
    runs = LooseRuns()
    # beside 0 up to 1, beside 1 up to 2, beside 6 up to 7
    runs.ended = [LooseRun(first, LooseScans([loose(), loose()])) for first in (1, 4, 19)]
    one, other, last = runs.ended
    assert runs.settled(steps, 0, REMAINING) == [other]
    assert runs.ended == [one, last]
    assert runs.settled(steps, 0, REMAINING) == []


def loose() -> LooseScan:
    return LooseScan(SE2.identity(), np.eye(3), SE2.identity(), np.eye(3), np.eye(3), 20.0)


def test_stretches_that_nobody_measured_go_with_the_keyframes_at_their_ends():
    monitor, asked = DriveMonitor(0.5), list[tuple[int, int]]()
    scan = LaserScan(0.0, np.radians([-1.0, 0.0, 1.0]), np.ones(3))
    steps = [
        FrontEndStep(float(k), k, SE2.identity(), SE2(0.3 * k, 0.0, 0.0), StepStatus.MATCHED, 0.9, True,
                     is_open=k in (5, 6))
        for k in range(8)
    ]  # fmt: skip
    for k, one in enumerate(steps):
        measurement = Measurement(float(k), SE2(0.3, 0.0, 0.0), scan, np.eye(3))
        monitor.take(measurement, SE2(0.3 * (k - 1), 0.0, 0.0), one, 1.0)
    assert monitor.keyframes >= {4, 6, 7}
    monitor.renumber(REMAINING)
    monitor.objections(steps, lambda *ends: asked.append(ends) or 1.0)
    assert asked == [(2, 3)]
    assert monitor.keyframes >= {2, 3, 4}


def test_front_end_goes_on_as_if_those_that_are_gone_had_never_been():
    mapper = Mapper(ring.T_BASE_LASER)
    measurements = ring.drive(ring.way(0.3), np.random.default_rng(0))
    for one in measurements[:60]:
        mapper.update(one)
    front_end = mapper._drive.front_end
    count = len(front_end.keyframes)
    is_kept = ~np.isin(np.arange(count), [3, 4])
    remaining = Remaining(is_kept, np.where(is_kept, np.arange(count), 2), {5: WAY})
    times_s = [one.time_s for one in front_end.keyframes]
    slopes = front_end.scaled_steps.columns("slope_x", "slope_y", "slope_rad")
    glances = list(front_end.glances)
    assert np.abs(slopes[5]).max() > 0.01
    front_end._open_run._first = 8
    front_end.ties = [Loop(2, count - 3, SE2.identity(), np.eye(3), 1.0, 0.0, is_tie=True)]
    front_end.renumber(remaining)
    kept = remaining.kept
    assert [one.time_s for one in front_end.keyframes] == [times_s[k] for k in kept]
    assert front_end.glances == [glances[k] for k in kept]
    found = front_end.scaled_steps.columns("slope_x", "slope_y", "slope_rad")
    # the way past others is no longer by the wheels' scale
    slopes[5] = 0.0
    assert np.array_equal(found, slopes[kept])
    assert front_end._open_run.before == 5
    # a tie of the keyframe that has the number of the last one now is none of that
    assert front_end.ties == []


def test_run_of_loose_keyframes_does_not_go_on_past_a_gap():
    keyframes = [replace(keyframe(k), covariance=0.01 * np.eye(3)) for k in range(8)]
    looseness = Looseness(keyframes, (1, 4, 6))
    sigmas_m = looseness.sigmas_m
    looseness.renumber(REMAINING)
    assert np.array_equal(looseness.sigmas_m, sigmas_m[REMAINING.kept])
    assert looseness.open_count == 0
    for k in range(20):
        looseness.take(keyframes[7], is_open=k > 17)
    assert looseness.open_count == 2
    assert np.array_equal(looseness.sigmas_m[:5], sigmas_m[REMAINING.kept])
    # read from a map, where the end of a run is gone
    torn = [replace(one, is_after_gap=k == 3) for k, one in enumerate(keyframes)]
    found = Looseness(torn, (1, 2, 3, 4)).sigmas_m
    assert found[3:5] == pytest.approx(Looseness(keyframes[2:], (1, 2)).sigmas_m[1:3])
    assert found[1:3] == pytest.approx([0.1, 0.1 * math.sqrt(2.0)])


def test_keyframes_whose_steps_were_loosened_are_the_same_ones():
    weak, breaks, closer = WeakSteps(), BreaksBorneOut((0.5, 0.5, 0.2)), LoopCloser()
    said = np.eye(3), np.zeros((3, 3))
    weak._said.update(dict.fromkeys((2, 4, 6), said))
    closer.doubted = weak._said.keys()
    breaks._said = dict.fromkeys((1, 5), said)
    breaks.let_go = [Loop(*ends, SE2.identity(), np.eye(3), 1.0, 0.0) for ends in ((0, 6), (1, 5))]
    weak.renumber(REMAINING)
    breaks.renumber(REMAINING)
    assert weak._said.keys() == {2, 3}
    # whoever closes loops knows of them as well
    assert closer.doubted == {2, 3}
    assert breaks._said.keys() == {1}
    assert [(one.earlier, one.later) for one in breaks.let_go] == [(0, 3)]

"""A robot that is plainly elsewhere is searched for before it is matched where it was."""

import math

import numpy as np
import pytest

from slam import SE2
from slam.relocalization import Relocalizer
from slam.verdict import Status
from tests.slam.guarded import START, STILL, Robot, made
from tests.slam.synthetic import ROOM_SEGMENTS, box


@pytest.fixture(scope="module")
def room():
    return made(ROOM_SEGMENTS)


def started_from(robot):
    """The poses from which its matcher is asked from now on."""
    matcher, starts = robot.localizer.matcher, []

    def noting(beams, T_predicted):
        starts.append(T_predicted)
        return matcher(beams, T_predicted)

    robot.localizer.matcher = noting
    return starts


@pytest.mark.parametrize("target", [SE2(1.5, 1.0, 2.0), SE2(3.4, 3.2, -1.0), SE2(2.6, 1.9, 2.5)])
def test_carried_off_no_match_is_tried_where_the_robot_was(target, room):
    robot = Robot(room, START)
    robot.look()
    starts = started_from(robot)
    robot.at = target
    estimate = robot.look(told=STILL)
    assert estimate.verdict.status is Status.LOST
    assert "fits another place far better" in estimate.verdict.reasons[0]
    assert robot.is_right(estimate)
    # one match, of the place that the search found
    assert len(starts) == 1
    assert starts[0].is_near(target, 0.1, 0.05)


@pytest.mark.parametrize("off", [SE2(0.3, 0.0, 0.0), SE2(0.0, -0.3, 0.1), SE2(0.0, 0.0, 0.45)])
def test_beside_where_the_wheels_lead_the_match_is_asked_as_ever(off, room):
    # too far for the beams to fit, so near that a match may find its way there
    robot = Robot(room, START)
    robot.look()
    starts = started_from(robot)
    robot.at = robot.at @ off
    robot.look(told=STILL)
    assert starts[0].is_near(START, 0.01, 0.01)


def test_wheels_that_may_be_so_wrong_are_asked_as_well(room):
    # a metre in the dark, which the wheels may have told wrong by half of it
    robot = Robot(room, START)
    robot.look()
    starts = started_from(robot)
    noise = np.diag([0.5**2, 0.5**2, 0.5**2])
    robot.localizer.move(0.15, STILL, noise)
    robot.at = START @ SE2(-1.0, 0.3, 0.8)
    robot.look(told=STILL)
    assert starts[0].is_near(START, 0.05, 0.05)


def calls_of(method, patch):
    """Grows by one with each call of a relocalizer's method."""
    calls, whole = [], getattr(Relocalizer, method)

    def counting(self, *arguments):
        calls.append(arguments)
        return whole(self, *arguments)

    patch.setattr(Relocalizer, method, counting)
    return calls


def test_one_scan_is_searched_for_once(room, monkeypatch):
    robot = Robot(room, START)
    robot.look()
    searches = calls_of("in_steps", monkeypatch)
    robot.at = robot.at @ SE2(0.4, 0.0, math.radians(20.0))
    robot.look(told=STILL)
    assert len(searches) == 1


def test_ordinary_scan_is_weighed_once(room, monkeypatch):
    # half of the time of tracking, on a map of a building
    monkeypatch.setattr(room[2].segment_map, "is_exact", False)
    robot = Robot(room, START)
    robot.look()
    weighed = calls_of("at", monkeypatch)
    robot.look(SE2(0.02, 0.0, 0.01))
    assert len(weighed) == 1


@pytest.fixture(scope="module")
def nearly_twin_room():
    """Looks the same from either end, but for a box on its upper wall."""
    corners = np.array([[0.0, 0.0], [6.0, 0.0], [6.0, 4.0], [0.0, 4.0], [0.0, 0.0]])
    walls = np.stack([corners[:-1], corners[1:]], axis=1)
    return made(np.concatenate([walls, box(2.8, 3.6, 3.2, 3.9)]))


OTHER_END = SE2(6.0, 4.0, math.pi)


@pytest.mark.parametrize("told", [STILL, SE2(0.02, 0.0, 0.0)])
def test_put_down_where_the_map_looks_the_same_it_is_lost_until_it_looks_around(
    told, nearly_twin_room
):
    # the other end of the room, so near to where it was as seen from here that no match jumps
    at = SE2(1.0, 2.1, 3.1)  # the box behind it
    robot = Robot(nearly_twin_room, at, at=at)
    for _ in range(3):
        assert robot.look().verdict.status is Status.TRACKING
    robot.at = OTHER_END @ robot.at @ SE2(-0.07, 0.04, math.radians(4.0))
    first = robot.look(told=told)
    assert first.verdict.status is Status.LOST
    assert "moved by no wheel" in first.verdict.reasons[0]
    for _ in range(12):
        # standing still tells no more: once it was sure of the wrong end after ten scans
        assert robot.look().verdict.status is Status.UNSURE
    assert robot.localizer.telling_turn_rad() != 0.0
    for _ in range(2):
        turn = SE2(0.0, 0.0, robot.localizer.telling_turn_rad())
        estimate = robot.look(turn)
        if estimate.verdict.status is Status.TRACKING:
            break
    assert estimate.verdict.status is Status.TRACKING
    assert robot.is_right(estimate)


@pytest.mark.parametrize("aside", [STILL, SE2(0.03, 0.0, 0.02)])
def test_put_down_where_all_looks_the_same_but_what_it_sees_it_is_lost_at_once(
    aside, nearly_twin_room
):
    # nothing jumps and nearly all beams fit: it once followed the wrong end as long as it drove
    at = SE2(4.5, 2.4, 0.3)  # a corner of the box in view
    robot = Robot(nearly_twin_room, at, at=at)
    for _ in range(3):
        assert robot.look().verdict.status is Status.TRACKING
    robot.at = OTHER_END @ robot.at @ aside
    step = SE2(0.02, 0.0, 0.0)
    first = robot.look(step)
    assert first.verdict.status is Status.LOST
    for _ in range(12):
        estimate = robot.look(step)
        assert estimate.verdict.status is not Status.TRACKING or robot.is_right(estimate)


def test_pushed_aside_where_the_map_looks_like_nothing_else_it_is_unsure_alone(room):
    robot = Robot(room, START)
    for _ in range(3):
        robot.look()
    estimate = robot.look(SE2(0.04, 0.06, 0.03), told=STILL)
    assert estimate.verdict.status is Status.UNSURE
    assert "wheels slip or spin" in estimate.verdict.reasons[0]
    assert robot.is_right(estimate)

"""A robot that is plainly elsewhere is searched for before it is matched where it was."""

import math

import numpy as np
import pytest

from slam import SE2
from slam.relocalization import Relocalizer
from slam.verdict import Status
from tests.slam.guarded import START, STILL, Robot, made
from tests.slam.synthetic import ROOM_SEGMENTS


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
    searches = calls_of("__call__", monkeypatch)
    robot.at = robot.at @ SE2(0.4, 0.0, math.radians(20.0))
    robot.look(told=STILL)
    assert len(searches) == 1


def test_ordinary_scan_is_weighed_once(room, monkeypatch):
    # half of the time of tracking, on a map of a building
    robot = Robot(room, START)
    robot.look()
    weighed = calls_of("at", monkeypatch)
    robot.look(SE2(0.02, 0.0, 0.01))
    assert len(weighed) == 1

"""Two rooms furnished alike, on a map of cells: what tells them apart is how the cells were rounded."""

import math

import numpy as np
import pytest

from slam import SE2, Measurement, Status
from tests.slam.guarded import mapped_in_cells
from tests.slam.synthetic import box, room, scan_of

CIRCLE = SE2(0.02, 0.0, 0.06)
HALF_TURN = np.radians(np.arange(-90.0, 90.5, 1.0))
FURNITURE = [
    (0.0, 1.0, 0.6, 2.4), (2.7, 3.4, 3.7, 4.0), (0.9, 3.6, 1.3, 4.0), (3.2, 0.3, 3.4, 0.5),
    (1.0, 0.0, 1.7, 0.3), (3.7, 2.6, 4.0, 2.9),
]  # fmt: skip
CUPBOARD = (3.5, 1.4, 4.0, 2.0)
"""Boxes in the frame of a room [m]: left, lower, right and upper side."""


class Twins:
    """Two closed rooms of 4 by 4 m, their frames so far apart along x, and their map."""

    def __init__(self, pitch_m, *, cupboard_in=None, corner_m=(-0.115, -0.141)):
        self.pitch_m = pitch_m
        walls = []
        for number in range(2):
            x = pitch_m * number
            boxes = [*FURNITURE, *([CUPBOARD] if cupboard_in == number else [])]
            walls.append(room(x, 0.0, x + 4.0, 4.0))
            walls += [box(x + left, low, x + right, high) for left, low, right, high in boxes]
        self.segments = np.concatenate(walls)
        inside = [(x, 0.0, x + 4.0, 4.0) for x in (0.0, pitch_m)]
        self.map = mapped_in_cells(self.segments, inside, corner_m)

    def drive(self, number, start=None, scans=100, seed=0):
        """A circle in a room: for each scan the status, and whether it is at the true place.

        start: the room whose frame the robot is told that it starts in; None: none.
        """
        rng = np.random.default_rng(seed)
        at = SE2(2.0 + self.pitch_m * number, 1.5, 1.0)
        told = None if start is None else SE2(2.0 + self.pitch_m * start, 1.5, 1.0)
        localizer = self.map.localizer("limit", told, SE2.identity())
        said = []
        for count in range(scans):
            step = CIRCLE if count else SE2.identity()
            at = at @ step
            scan = scan_of(self.segments, at, rng, 0.01, HALF_TURN, 12.0)
            wheels = SE2.exp(step.log() * (1.0 + rng.normal(0.0, 0.01, 3)))
            noise = np.diag([1e-5, 1e-5, 1e-5])
            estimate = localizer.update(Measurement(0.2 * count, wheels, scan, noise))
            off = at.inverse() @ estimate.T_map_base
            said.append((estimate.verdict.status, math.hypot(off.x, off.y) < 0.15))
        return said


@pytest.fixture(scope="module")
def alike():
    # the shelf at the left wall is a cell narrower in the second room
    return Twins(4.135)


@pytest.fixture(scope="module")
def unlike():
    return Twins(4.135, cupboard_in=1)


@pytest.mark.parametrize("number", [pytest.param(0, marks=pytest.mark.slow), 1])
def test_rooms_that_only_rounding_tells_apart_stay_unsure(alike, number):
    assert {status for status, _ in alike.drive(number, scans=40)} == {Status.UNSURE}


@pytest.mark.parametrize("start", [None, 0])
def test_cupboard_tells_the_room_even_from_a_wrong_start(unlike, start):
    said = unlike.drive(1, start, scans=40)
    assert (Status.TRACKING, False) not in said
    assert (Status.TRACKING, True) in said
    # out of sight, it goes on telling for a while
    first = said.index((Status.TRACKING, True))
    assert said[first : first + 10] == [(Status.TRACKING, True)] * 10


def test_place_once_doubted_is_doubted_until_it_fits_better_again(unlike):
    # told of the room with the cupboard, it sees none; turned away from there, nothing refutes that
    statuses = [status for status, _ in unlike.drive(0, start=1)]
    first = statuses.index(Status.UNSURE)
    assert first < 40
    assert Status.TRACKING not in statuses[first:]

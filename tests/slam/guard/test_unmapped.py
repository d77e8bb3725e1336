"""A row of furniture that the map lacks, as straight as the wall behind it."""

import math

import numpy as np
import pytest

from slam import SE2, Localizer, Measurement, Status
from slam.lost import Guard
from tests.slam.guarded import made, mapped_in_cells
from tests.slam.synthetic import box, room, scan_of

HALF_TURN = np.radians(np.arange(-90.0, 90.5, 1.0))
ROOM = np.concatenate(
    [
        room(0.0, 0.0, 8.0, 6.0),
        box(6.5, 4.0, 7.2, 5.0),
        box(0.3, 4.6, 1.2, 5.4),
        box(3.0, 4.8, 3.8, 5.6),
    ]
)


@pytest.fixture(scope="module")
def exactly_known():
    _, matcher, relocalizer = made(ROOM)
    return lambda start: Localizer(matcher, start, SE2.identity(), None, Guard(relocalizer))


@pytest.fixture(scope="module")
def of_cells():
    known = mapped_in_cells(ROOM, [(0.0, 0.0, 8.0, 6.0)], (-0.115, -0.141))
    return lambda start: known.localizer("limit", start, SE2.identity())


def driven(localizer_at, depth_m, *, scans=66, carried=None, seed=0):
    """Along a row of a depth before the lower wall: for each scan the status, and how far off [m].

    carried: by which somebody moves the robot once, instead of the row, at the tenth scan.
    """
    rng = np.random.default_rng(seed)
    row = box(1.0, 0.0, 5.0, depth_m)
    walls = ROOM if carried is not None else np.concatenate([ROOM, row])
    at = SE2(7.2, depth_m + 0.37, math.pi)
    localizer, said = localizer_at(at), []
    for count in range(scans):
        step = SE2(0.1, 0.0, 0.0) if count else SE2.identity()
        at = at @ step
        if carried is not None and count == 10:
            at = at @ carried
        wheels = SE2.exp(step.log() * (1.0 + rng.normal(0.0, 0.01, 3)))
        scan = scan_of(walls, at, rng, 0.01, HALF_TURN, 12.0)
        estimate = localizer.update(Measurement(0.2 * count, wheels, scan, np.diag([1e-5] * 3)))
        off = at.inverse() @ estimate.T_map_base
        said.append((estimate.verdict.status, math.hypot(off.x, off.y)))
    return said


@pytest.mark.parametrize(
    "depth_m",
    [pytest.param(0.1, marks=pytest.mark.slow), 0.3, pytest.param(0.5, marks=pytest.mark.slow)],
)
def test_row_before_a_wall_is_not_taken_for_the_wall(exactly_known, depth_m):
    said = driven(exactly_known, depth_m)
    assert all(off_m < 0.05 for _, off_m in said)
    # the row may as well be the wall, and the robot moved
    assert [status for status, _ in said].count(Status.UNSURE) > 20
    assert said[-1][0] is Status.TRACKING


@pytest.mark.slow
@pytest.mark.parametrize("depth_m", [0.3, 0.5])
def test_row_before_a_wall_of_cells_is_not_taken_for_the_wall(of_cells, depth_m):
    said = driven(of_cells, depth_m)
    assert all(off_m < 0.08 for _, off_m in said)
    assert said[-1][0] is Status.TRACKING


@pytest.mark.parametrize("carried", [SE2(0.0, -0.4, 0.0), SE2(0.4, 0.0, 0.0), SE2(0.3, -0.3, 0.1)])
def test_robot_carried_as_far_is_lost_and_found(exactly_known, carried):
    said = driven(exactly_known, 0.5, scans=14, carried=carried)
    assert said[10][0] is Status.LOST
    assert said[-1][0] is Status.TRACKING
    assert said[-1][1] < 0.05

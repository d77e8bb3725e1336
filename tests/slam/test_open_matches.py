"""Between bare walls, wheels off by half a metre lead past what little tells how far the robot went."""

import math
from dataclasses import replace

import numpy as np
import pytest

from slam.front_end_config import FrontEndConfig
from slam.open_matches import closed_match
from slam.se2 import SE2
from slam.surface_map import SurfaceMap, faced
from tests.slam.synthetic import box, room, scan_of

BARE = room(-30.0, -1.0, 30.0, 1.0)
CONFIG = FrontEndConfig()
ODOMETRY = np.diag([1.0 / 0.05**2, 1.0 / 0.05**2, 1.0 / 0.02**2])


def matched(walls, true: SE2, told: SE2):
    """Where the front end's first match lies, and the one slid along what that leaves open."""
    rng, surfaces = np.random.default_rng(2), SurfaceMap()

    def seen_at(pose: SE2) -> np.ndarray:
        points = scan_of(walls, pose, rng, 0.01, range_max_m=8.0).points(SE2.identity())
        return faced(points, np.zeros(2))

    for x in (-0.5, 0.0):
        at = SE2(x, 0.0, 0.0)
        points = seen_at(at)
        points[:, :2] += [x, 0.0]
        surfaces.add(points)
    match = surfaces.match(seen_at(true), told, told, ODOMETRY)
    return match, closed_match(surfaces, seen_at(true), told, ODOMETRY, match, CONFIG)


@pytest.mark.parametrize("off_m", [-0.5, -0.35, 0.35, 0.5])
def test_scan_is_slid_to_the_few_surfaces_across_the_way(off_m):
    walls = np.concatenate([BARE, box(5.0, 0.7, 5.3, 1.0), box(4.0, -1.0, 4.3, -0.7)])
    true, told = SE2(0.5, 0.0, 0.0), SE2(0.5 + off_m, 0.02, 0.01)
    match, closed = matched(walls, true, told)
    assert match.least_facing < CONFIG.least_facing
    assert abs(match.T_map_base.x - true.x) > 0.07
    assert closed.T_map_base.is_near(true, 0.03, 0.01)
    assert closed.least_facing >= CONFIG.least_facing


@pytest.mark.parametrize("off_m", [-0.4, 0.4])
def test_scan_between_bare_walls_stays_where_the_wheels_lead(off_m):
    match, closed = matched(BARE, SE2(0.5, 0.0, 0.0), SE2(0.5 + off_m, 0.0, math.radians(1.0)))
    assert closed is match


@pytest.mark.parametrize("every_m", [0.3, 0.45, 0.6])
def test_scan_among_pillars_that_look_the_same_stays_at_those_it_saw(every_m):
    pillars = [
        box(x, side * 0.98, x + 0.1, side * 1.0)
        for side in (-1.0, 1.0)
        for x in np.arange(-9.0, 9.0, every_m)
    ]
    true = SE2(0.5, 0.0, 0.0)
    _, closed = matched(np.concatenate([BARE, *pillars]), true, SE2(0.53, 0.0, 0.0))
    assert closed.T_map_base.is_near(true, 0.06, 0.02)


@pytest.mark.parametrize(("off_m", "is_taken"), [(0.3, True), (4.0, False)])
def test_what_lies_far_from_where_the_wheels_lead_is_not_slid_to(off_m, is_taken):
    # odometry of mit-csail told a turn of 86 degrees that scans had shown already: 4 m off, the other
    # end of a corridor fitted
    match, _ = matched(BARE, SE2(0.5, 0.0, 0.0), SE2(0.5, 0.0, 0.0))
    there = match.T_map_base @ SE2(off_m, 0.0, 0.0)
    found = replace(match, T_map_base=there, information=np.eye(3), cost=match.cost - 0.02)
    closed = closed_match(
        Finding(found), np.zeros((50, 3)), SE2.identity(), ODOMETRY, match, CONFIG
    )
    assert (closed is found) is is_taken


class Finding:
    """Surfaces on which a scan is found at one place, wherever it is looked for."""

    def __init__(self, found):
        self._found = found

    def match(self, *_):
        return self._found

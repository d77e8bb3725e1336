"""Wheels that spun while the robot stood where scans tell its place: the map is right, and good."""

from dataclasses import replace

import numpy as np
import pytest

from slam.compared_ways import ComparedWays
from slam.keyframes import FrontEndStep, StepStatus
from slam.mapping import Mapper
from slam.measurements import Measurement
from slam.se2 import SE2
from slam.spun_wheels import SpunWheels
from slam.surface_map import SurfaceMap, SurfaceMatch
from tests.slam.corridors import ANGLES_RAD, PILLARS, ROOM, mapped, spun
from tests.slam.synthetic import box, scan_of

STEP = SE2(0.2, 0.0, 0.0)
# a thing ahead, and another beside it
ACROSS = np.array([[2.0, 0.0, np.pi], [2.0, 0.1, np.pi], [3.0, 2.0, np.pi], [3.0, 2.1, np.pi]])


@pytest.mark.parametrize("step_m", [0.1, 0.25])
@pytest.mark.parametrize("at_m", [5.0, 9.0])
@pytest.mark.parametrize("seed", range(2))
def test_map_of_a_room_in_which_wheels_spun_is_good(step_m, at_m, seed):
    # it was right, and failed for what scans had left out
    true_m, told_m = spun(np.arange(0.0, 14.0, step_m), round(at_m / step_m), 3.0)
    slam_map, off_m = mapped(true_m, told_m, 0.01, lambda _: ROOM, seed=seed)
    assert off_m < 0.05
    assert slam_map.verdict.is_good, slam_map.verdict.reasons


def test_where_pillars_look_the_same_wheels_that_spun_fail_the_map_still():
    true_m, told_m = spun(np.arange(0.0, 14.0, 0.25), 24, 3.0)
    slam_map, off_m = mapped(true_m, told_m, 0.01, lambda _: PILLARS)
    assert off_m < 0.3 or not slam_map.verdict.is_good


@pytest.mark.parametrize("noise_m", [0.0, 0.01])
def test_laser_that_froze_is_no_robot_that_stands(noise_m):
    rng, mapper, held = np.random.default_rng(0), Mapper(SE2.identity()), None
    for k, x in enumerate(np.arange(0.0, 14.0, 0.2)):
        scan = scan_of(ROOM, SE2(x, 0.0, 0.0), rng, 0.01, ANGLES_RAD, 8.0)
        if 25 <= k < 40:  # three metres
            held = held or scan
            ranges_m = held.ranges_m + rng.normal(0.0, noise_m, len(held.ranges_m))
            scan = replace(scan, ranges_m=ranges_m)
        told = STEP if k else SE2.identity()
        mapper.update(Measurement(0.4 * k, told, scan, np.diag([0.02, 0.01, 0.01]) ** 2))
    slam_map = mapper.finish()
    off_m = np.abs(slam_map.trajectory.poses[:, 0] - np.arange(0.0, 14.0, 0.2)).max()
    assert off_m < 0.3 or not slam_map.verdict.is_good


@pytest.mark.parametrize("ahead_m", [0.8, 1.5])
@pytest.mark.parametrize("wide_m", [0.4, 0.8])
def test_cart_pushed_through_a_room_is_no_robot_that_stands(ahead_m, wide_m):
    def with_cart(x: float) -> np.ndarray:
        return np.concatenate(
            [ROOM, box(x + ahead_m, -wide_m / 2.0, x + ahead_m + 0.3, wide_m / 2.0)]
        )

    true_m = np.arange(0.0, 14.0, 0.25)
    told_m = np.append(0.0, np.diff(true_m))
    slam_map, off_m = mapped(true_m, told_m, 0.01, with_cart, range_m=4.0)
    assert off_m < 0.3 or not slam_map.verdict.is_good


def at(x_m: float, fits: float = 1.0) -> SurfaceMatch:
    nothing = np.zeros((3, 3))
    return SurfaceMatch(SE2(x_m, 0.0, 0.0), nothing, nothing, 1.0, fits, 0.04, 1.0)


class Surfaces(SurfaceMap):
    """Where a scan matches as if it had been taken where it is said to, from wherever it is looked for."""

    def __init__(self, there: SurfaceMatch, *, leads_back: bool = True) -> None:
        super().__init__()
        self.there, self.leads_back, self.asked = there, leads_back, list[int]()

    def match_alone(self, points_base, T_start):
        self.asked.append(len(points_base))
        return self.there if self.leads_back else replace(self.there, T_map_base=T_start)


def stood_since(
    surfaces: Surfaces, spins: int = 10, points: np.ndarray = ACROSS, leaves_at: float = 0.2
) -> float | None:
    """Of a robot that stands from 1 s on, a scan each second, and then goes on."""
    wheels = SpunWheels(surfaces)
    wheels.take(0.0, points, at(-0.2), STEP)
    said = [wheels.take(1.0 + k, points, at(0.0), STEP) for k in range(spins)]
    assert said == [None] * spins
    return wheels.take(60.0, points, at(leaves_at), STEP)


def test_it_stood_where_the_scan_leads_back_from_where_the_wheels_led():
    surfaces = Surfaces(at(0.0))
    assert stood_since(surfaces) == 1.0
    assert surfaces.asked == [2, 2]  # without the thing ahead, here and there, once


@pytest.mark.parametrize(
    ("surfaces", "kinds"),
    [
        (Surfaces(at(0.0), leads_back=False), {}),  # somebody walks ahead between bare walls
        (Surfaces(at(0.3)), {}),  # it fits elsewhere
        (Surfaces(at(0.0, fits=0.9)), {}),  # or nowhere well
        (Surfaces(at(0.0)), {"spins": 5}),  # for less than a metre
        (Surfaces(at(0.0)), {"leaves_at": 1.5}),  # it jumps: the laser froze
        (Surfaces(at(0.0)), {"points": ACROSS[:2]}),  # nothing but one thing tells
        (Surfaces(at(0.0)), {"points": ACROSS[:0]}),
    ],
)
def test_nobody_knows_that_it_stood(surfaces, kinds):
    if len(kinds.get("points", ACROSS)) == 2:
        surfaces.there = at(0.0, fits=0.0)  # of no points
    assert stood_since(surfaces, **kinds) is None


def test_scans_that_tell_nothing_meanwhile_leave_open_where_it_was():
    wheels = SpunWheels(Surfaces(at(0.0)))
    for k in range(10):
        wheels.take(float(k), ACROSS, at(0.0), STEP)
    wheels.interrupt()
    assert wheels.take(60.0, ACROSS, at(0.2), STEP) is None


@pytest.mark.parametrize(("is_open", "is_good"), [(False, True), (True, False)])
def test_wheels_that_spun_once_are_asked_of_the_way_that_scans_leave_open(is_open, is_good):
    ways = ComparedWays()
    for k in range(60):
        stands, T = 20 <= k < 40, SE2.identity()
        step = FrontEndStep(
            float(k), 0, T, T, StepStatus.MATCHED, 0.9, True, is_open=is_open and k == 50,
            stood_since_s=19.0 if k == 40 else None,
        )  # fmt: skip
        ways.take(STEP, 1e-3, SE2.identity() if stands else STEP, step)
    assert not ways.objections() if is_good else ways.objections()

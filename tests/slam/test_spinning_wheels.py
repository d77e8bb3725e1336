"""Wheels that spin while the robot stands: a scan looks as one shortly before did."""

import math
import tracemalloc
from dataclasses import replace

import numpy as np
import pytest

from slam.beams import Beams
from slam.frontend.front_end import FrontEnd
from slam.frontend.front_end_config import FrontEndConfig
from slam.frontend.keyframes import Keyframe, StepStatus
from slam.frontend.prediction import Prediction
from slam.frontend.seen_before import LastSeen, SeenBefore
from slam.frontend.slipped_wheels import SlippedWheels
from slam.measurements import Measurement
from slam.se2 import SE2
from slam.surface.surface_map import SurfaceMap, faced
from slam.surface.surface_match import SurfaceMatch
from tests.slam.corridors import ANGLES_RAD, DOORS, PILLARS, ROOM, WALLS, mapped, spun
from tests.slam.frontend.test_open_runs import kept
from tests.slam.synthetic import box, scan_of

POINTS = np.zeros((0, 3))


@pytest.mark.parametrize(
    ("step_m", "far_m", "beams"), [(0.5, 1.0, 361), (0.25, 2.0, 181), (0.1, 1.0, 361)]
)
@pytest.mark.parametrize("at_m", [4.5, 6.3, 8.0])
def test_wheels_that_spin_between_doors_are_told_by_scans_that_look_the_same(
    step_m, far_m, beams, at_m
):
    # edges of a hand's breadth were outliers where the wheels led: 0.6 to 1.9 m off and good
    angles_rad = np.radians(np.linspace(-135.0, 135.0, beams))
    true_m, told_m = spun(np.arange(0.0, 14.0, step_m), round(at_m / step_m), far_m)
    slam_map, off_m = mapped(true_m, told_m, 0.01, lambda _: DOORS, angles_rad=angles_rad)
    assert off_m < 0.3, slam_map.verdict


@pytest.mark.parametrize(
    ("step_m", "factor", "beams", "range_m"),
    [
        (0.25, 2.0, 361, 8.0),
        (0.5, 2.0, 361, 8.0),
        (0.1, 2.0, 361, 8.0),
        (0.25, 2.0, 181, 8.0),
        (0.25, 2.0, 361, 4.0),
        (0.25, 0.4, 361, 8.0),
    ],
)
@pytest.mark.parametrize("at_m", [3.5, 8.0])
def test_wheels_that_slip_on_part_of_the_way_are_told_by_edges_that_fit_in_one_place(
    step_m, factor, beams, range_m, at_m
):
    # a metre of it, told as sure to 1 %, held edges of a hand's breadth to be outliers: 0.4 to 1 m off and good
    true_m = np.arange(0.0, 14.0, step_m)
    told_m = np.full(len(true_m), step_m)
    told_m[0] = 0.0
    slips = round(at_m / step_m)
    told_m[slips : slips + round(1.0 / step_m)] *= factor
    angles_rad = np.radians(np.linspace(-135.0, 135.0, beams))
    slam_map, off_m = mapped(
        true_m, told_m, 0.01, lambda _: DOORS, angles_rad=angles_rad, range_m=range_m
    )
    assert off_m < 0.3, slam_map.verdict


@pytest.mark.parametrize("sigma_m", [0.01, 0.03])
def test_walls_that_tell_nothing_of_the_way_do_not_put_a_robot_back(sigma_m):
    # with wheels that are right, where the laser sees 4 m: back to where they were known better, by 2 m
    true_m = np.arange(0.0, 14.0)
    told_m = np.append(0.0, np.diff(true_m))
    angles_rad = np.radians(np.linspace(-135.0, 135.0, 181))
    _, off_m = mapped(true_m, told_m, sigma_m, lambda _: WALLS, angles_rad=angles_rad, range_m=4.0)
    assert off_m < 0.3


def test_one_thing_that_begins_to_move_does_not_take_the_robot_along():
    # a cart in a room that had stood until then: 3 m off
    true_m = np.arange(0.0, 14.0, 0.3)
    told_m = np.append(0.0, np.diff(true_m))

    def with_cart(x: float) -> np.ndarray:
        cart_m = 5.0 + 1.15 * max(0.0, x - 4.0)
        return np.concatenate([ROOM, box(cart_m - 0.3, -0.2, cart_m + 0.3, 0.4)])

    angles_rad = np.radians(np.linspace(-135.0, 135.0, 181))
    _, off_m = mapped(true_m, told_m, 0.01, with_cart, angles_rad=angles_rad, range_m=4.0)
    assert off_m < 0.3


@pytest.mark.parametrize(("step_m", "beams"), [(0.25, 361), (0.25, 181), (0.5, 361)])
@pytest.mark.parametrize("seed", range(4))
def test_pillars_that_look_the_same_do_not_hold_a_robot_back(step_m, beams, seed):
    # with wheels that are right: put back by half a metre, one of three, and good
    true_m = np.arange(0.0, 14.0, step_m)
    told_m = np.full(len(true_m), step_m)
    told_m[0] = 0.0
    angles_rad = np.radians(np.linspace(-135.0, 135.0, beams))
    slam_map, off_m = mapped(
        true_m, told_m, 0.01, lambda _: PILLARS, angles_rad=angles_rad, seed=seed
    )
    assert off_m < 0.3
    assert slam_map.verdict.is_good


def at(
    x_m: float, inlier_ratio: float = 1.0, cost: float = 0.04, seen: float = 1.0
) -> SurfaceMatch:
    pose, nothing = SE2(x_m, 0.0, 0.0), np.zeros((3, 3))
    return SurfaceMatch(pose, nothing, nothing, seen, inlier_ratio, cost, 1.0)


STANDS, LED = at(0.0), at(0.5, 0.9, 0.2)


class Surfaces(SurfaceMap):
    """Of which a scan matches where it is said to, and nowhere else; with the wheels pulling a little, a centimetre on."""

    def __init__(self, alone: SurfaceMatch) -> None:
        super().__init__()
        self.alone = alone

    def match(self, points_base, T_start, T_predicted, odometry, *_):
        if T_start != self.alone.T_map_base and T_start != SE2.identity():
            return at(T_start.x, 0.5, 1.0)
        return self.alone if not odometry.any() else at(0.01)


def stood(
    alone: SurfaceMatch = STANDS,
    led: SurfaceMatch = LED,
    wheels_m: float = 0.5,
    sigma_m: float = 0.05,
    keyframes: list[Keyframe] | None = None,
) -> SurfaceMatch | None:
    """Of a robot that was at the origin when a scan looked the same."""
    return against(Surfaces(alone), led, wheels_m, 0.0, sigma_m, keyframes)


def against(
    surfaces: SurfaceMap,
    led: SurfaceMatch,
    wheels_m: float,
    true_m: float,
    sigma_m: float,
    keyframes: list[Keyframe] | None,
    points: np.ndarray | None = None,
    noise: float = 1.0,
    before_m: float = 0.1,
) -> SurfaceMatch | None:
    """Of a robot at the origin, known from keyframes, that wheels lead ahead from there; the scan before
    they told of so much."""
    rng = np.random.default_rng(1)
    known = [kept(DOORS, SE2(-0.25 * k, 0.0, 0.0), rng) for k in (3, 2, 1, 0)]
    keyframes = known if keyframes is None else keyframes
    wheels = SlippedWheels(LastSeen(surfaces, keyframes, FrontEndConfig()))
    last, beams = (
        Beams.of(scan_of(DOORS, SE2(x, 0.0, 0.0), rng, 0.0, ANGLES_RAD, 8.0), SE2.identity())
        for x in (0.0, true_m)
    )
    wheels.still.take(last, SE2.identity())
    P = sigma_m**2 * np.eye(3)
    before, told = (
        Prediction(SE2.identity(), SE2(m, 0.0, 0.0), P, np.linalg.inv(P), noise, is_coasting=False)
        for m in (before_m, wheels_m)
    )
    wheels.against(POINTS, beams, before, at(before_m, cost=0.0))
    points = faced(beams.points, np.zeros(2)) if points is None else points
    return wheels.against(points, beams, told, led)


def broken(last: int) -> list[Keyframe]:
    """Keyframes of which one, from the last on, begins a piece."""
    rng = np.random.default_rng(2)
    found = [kept(DOORS, SE2(-0.25 * k, 0.0, 0.0), rng) for k in (5, 4, 3, 2, 1, 0)]
    found[-last] = replace(found[-last], is_break=True)
    return found


def test_where_the_robot_stood_it_is_if_a_scan_fits_there_and_far_worse_where_its_wheels_lead():
    found = stood()
    assert found is not None
    assert found.T_map_base == SE2(0.01, 0.0, 0.0)


@pytest.mark.parametrize(
    "said",
    [
        {"sigma_m": 0.4},  # nobody knows the way
        {"led": at(0.1, 0.9, 0.2)},  # hardly off, whatever the wheels say
        {"alone": at(0.0, 0.94)},
        {"alone": at(0.0, seen=0.94)},
        {"alone": at(0.06)},
        {"alone": at(0.0, cost=0.16)},
        {"keyframes": []},
        {"keyframes": broken(1)},
        {"keyframes": broken(4)},
    ],
)
def test_else_it_is_where_the_wheels_lead(said):
    assert stood(**said) is None


class Ways(SurfaceMap):
    """Of which a scan without wheels matches elsewhere from where these lead and from where it was, and a
    part of it elsewhere again."""

    def __init__(
        self, by_wheels: SurfaceMatch, by_last: SurfaceMatch, by_rest: SurfaceMatch
    ) -> None:
        super().__init__()
        self.by_wheels, self.by_last, self.by_rest = by_wheels, by_last, by_rest
        self.all = 0

    def match(self, points_base, T_start, T_predicted, odometry, *_):
        self.all = max(self.all, len(points_base))
        if not odometry.any() and len(points_base) < self.all:
            return self.by_rest
        if not odometry.any():
            return self.by_last if T_start == SE2.identity() else self.by_wheels
        assert T_start == self.by_wheels.T_map_base
        return at(T_start.x + 0.01)


def telling(x_m: float, across: float = 0.1, theta: float = 0.0, **said: float) -> SurfaceMatch:
    """A match of which so much of a scan tells how far ahead it lies."""
    found = replace(at(x_m, **said), information=np.diag([across, 1.0, 1.0]))
    return replace(found, T_map_base=SE2(x_m, 0.0, theta))


HALF_WAY, HELD = telling(0.25), replace(LED, T_map_base=SE2(0.48, 0.0, 0.0))
WALL = np.array([[1.0, 1.0, -math.pi / 2.0]])


def slipped(
    by_wheels: SurfaceMatch = HALF_WAY,
    by_last: SurfaceMatch = HALF_WAY,
    by_rest: SurfaceMatch = HALF_WAY,
    points: np.ndarray | None = None,
    **said,
) -> SurfaceMatch | None:
    """Of a robot whose wheels led half a metre ahead, twice as far as it went."""
    said = {
        "led": HELD,
        "wheels_m": 0.5,
        "sigma_m": 0.01,
        "keyframes": None,
        "true_m": 0.25,
        **said,
    }
    return against(Ways(by_wheels, by_last, by_rest), points=points, **said)


@pytest.mark.parametrize("held", [HELD, replace(HELD, T_map_base=SE2(0.27, 0.0, 0.12))])
def test_wheels_slipped_if_a_scan_fits_far_better_in_one_place_between(held):
    found = slipped(led=held)
    assert found is not None
    assert found.T_map_base == SE2(0.26, 0.0, 0.0)


@pytest.mark.parametrize(
    "said",
    [
        {"by_last": telling(0.19)},  # as pillars alike: here from there, and there from here
        {"by_last": telling(0.25, theta=0.03)},
        {"by_wheels": telling(0.25, inlier_ratio=0.94)},
        {"by_wheels": telling(0.25, seen=0.94)},
        {"by_wheels": telling(0.25, cost=0.081)},
        {"by_wheels": telling(0.25, across=0.002)},  # bare walls tell nothing of the way
        {"by_rest": telling(0.19)},  # one thing, that had stood until now
        {"by_rest": telling(0.25, across=0.002)},
        {"points": WALL},
        {"led": at(0.48, 1.0, 0.069)},
        {"led": at(0.48, 1.0, 0.049), "by_wheels": telling(0.25, cost=0.01)},
        {"led": at(0.34, 0.9, 0.2)},  # hardly held aside
        {"led": replace(HELD, T_map_base=SE2(0.34, 0.0, 0.08))},
        {"led": replace(HELD, information=np.diag([1.0, 1.0, 1.0]))},  # that sees what is ahead
        {"sigma_m": 0.04},  # wheels that may be so far off
        {"noise": 12.0},  # and that show it
        {"wheels_m": 0.015},  # that will tell of it at the next scan
        {"keyframes": []},
        {"keyframes": broken(4)},
    ],
)
def test_else_wheels_did_not_slip(said):
    assert slipped(**said) is None


@pytest.mark.parametrize(("before_m", "wheels_m"), [(0.015, 0.5), (0.015, 0.015)])
def test_wheels_that_stood_may_slip_and_those_that_tell_late_of_a_start_are_not_waited_for(
    before_m, wheels_m
):
    assert slipped(before_m=before_m, wheels_m=wheels_m) is not None


def test_a_scan_of_thousands_of_points_is_asked_for_one_thing_in_little_room(monkeypatch):
    # all of 7200 beside one another: 1.4 GB, and 3.6 s for one scan
    monkeypatch.setattr(SeenBefore, "are_people", lambda *_: False)
    wall = np.column_stack(
        [np.full(7200, 2.0), np.linspace(-1.0, 1.0, 7200), np.full(7200, math.pi)]
    )
    tracemalloc.start()
    try:
        found = slipped(points=wall)
        _, most_bytes = tracemalloc.get_traced_memory()
    finally:
        tracemalloc.stop()
    assert found is not None
    assert most_bytes < 50e6


def test_people_who_walk_along_are_no_slip(monkeypatch):
    monkeypatch.setattr(SeenBefore, "are_people", lambda *_: True)
    assert slipped() is None


def test_pieces_begun_before_the_last_keyframes_say_nothing_of_it():
    assert stood(keyframes=broken(5)) is not None


def test_people_who_walk_along_are_no_reason_to_stand(monkeypatch):
    monkeypatch.setattr(SeenBefore, "are_people", lambda *_: True)
    assert stood() is None


def test_the_wheels_of_a_robot_that_stood_do_not_tell_the_way_to_the_next_keyframe(monkeypatch):
    front_end, rng = FrontEnd(SE2.identity()), np.random.default_rng(0)
    for k, x in enumerate((0.0, 0.25, 0.5, 0.75, 1.0, 1.0)):
        scan = scan_of(DOORS, SE2(x, 0.0, 0.0), rng, 0.01, ANGLES_RAD, 8.0)
        told = SE2(0.25 if k else 0.0, 0.0, 0.0)
        step = front_end.update(Measurement(0.2 * k, told, scan, np.diag([1e-4] * 3)))
    assert step.status is StepStatus.SEARCHED
    assert abs(step.T_map_base.x - 1.0) < 0.05


def test_poses_are_noted_where_scans_were_placed_and_forgotten_where_none_was():
    front_end, rng = FrontEnd(SE2.identity()), np.random.default_rng(0)
    for k, x in enumerate((0.0, 0.25, 0.5)):
        scan = scan_of(DOORS, SE2(x, 0.0, 0.0), rng, 0.01, ANGLES_RAD, 8.0)
        told = SE2(0.27 if k else 0.0, 0.0, 0.0)  # too far
        front_end.update(Measurement(0.2 * k, told, scan, np.diag([1e-3] * 3)))
    still, beams = front_end._placing.slipped_wheels.still, Beams.of(scan, SE2.identity())
    assert still.place(beams, front_end.T_map_base, 0.0) == front_end.T_map_base
    nothing = replace(scan, ranges_m=np.full_like(scan.ranges_m, np.inf))
    front_end.update(Measurement(0.6, SE2.identity(), nothing, np.diag([1e-3] * 3)))
    assert still.place(beams, front_end.T_map_base, 0.0) is None

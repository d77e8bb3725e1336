"""Between bare walls, wheels off by half a metre lead past what little tells how far the robot went; and
what little tells it where there are no wheels."""

import math
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest

from slam.frontend.constant_velocity import ConstantVelocity
from slam.frontend.front_end import FrontEnd
from slam.frontend.front_end_config import FrontEndConfig
from slam.frontend.keyframes import StepStatus
from slam.frontend.open_matches import closed_match, is_one_place
from slam.frontend.prediction import Prediction
from slam.mapping import Mapper
from slam.measurements import Measurement
from slam.se2 import SE2
from slam.surface.surface_map import SurfaceMap, faced
from slam.surface.surface_match import SurfaceMatch
from tests.slam.synthetic import box, room, scan_of

BARE = room(-30.0, -1.0, 30.0, 1.0)
CONFIG = FrontEndConfig()
ODOMETRY = np.diag([1.0 / 0.05**2, 1.0 / 0.05**2, 1.0 / 0.02**2])


def matched(walls, true: SE2, told: SE2, noise: float = 8.0):
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
    return match, closed_match(surfaces, seen_at(true), told, ODOMETRY, match, CONFIG, noise)


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


def pillared(every_m: float, depth_m: float = 0.02, half_m: float = 9.0) -> np.ndarray:
    """A corridor with shallow pillars to both sides."""
    pillars = [
        box(x, side * (1.0 - depth_m), x + 0.1, side * 1.0)
        for side in (-1.0, 1.0)
        for x in np.arange(-half_m, half_m, every_m)
    ]
    return np.concatenate([BARE, *pillars])


@pytest.mark.parametrize("every_m", [0.3, 0.45, 0.6])
def test_scan_among_pillars_that_look_the_same_stays_at_those_it_saw(every_m):
    true = SE2(0.5, 0.0, 0.0)
    _, closed = matched(pillared(every_m), true, SE2(0.53, 0.0, 0.0))
    assert closed.T_map_base.is_near(true, 0.06, 0.02)


@pytest.mark.parametrize(("off_m", "is_taken"), [(0.3, True), (4.0, False)])
def test_what_lies_far_from_where_the_wheels_lead_is_not_slid_to(off_m, is_taken):
    # odometry of mit-csail told a turn of 86 degrees that scans had shown already: 4 m off, the other
    # end of a corridor fitted
    match, _ = matched(BARE, SE2(0.5, 0.0, 0.0), SE2(0.5, 0.0, 0.0))
    there = match.T_map_base @ SE2(off_m, 0.0, 0.0)
    found = replace(match, T_map_base=there, information=np.eye(3), cost=match.cost - 0.02)
    closed = closed_match(
        Finding(found), np.zeros((50, 3)), SE2.identity(), ODOMETRY, match, CONFIG, math.inf
    )
    assert (closed is found) is is_taken


class Finding:
    """Surfaces on which a scan is found at one place, wherever it is looked for."""

    def __init__(self, found):
        self._found = found

    def match(self, *_):
        return self._found


def recessed(*starts_m: float) -> np.ndarray:
    """Walls of a corridor with doors, a hand's breadth deep."""
    walls = [
        [[-30.0, 1.0], [30.0, 1.0]],
        [[-30.0, -1.0], [-30.0, 1.0]],
        [[30.0, -1.0], [30.0, 1.0]],
    ]
    x = -30.0
    for start in starts_m:
        corners = [
            [x, -1.0],
            [start, -1.0],
            [start, -1.1],
            [start + 0.9, -1.1],
            [start + 0.9, -1.0],
        ]
        walls += [[a, b] for a, b in pairwise(corners)]
        x = start + 0.9
    return np.array([*walls, [[x, -1.0], [30.0, -1.0]]])


DOORS = recessed(*np.arange(-29.0, 28.0, 4.3))


def match_of(walls, seed: int, T_start: SE2 | None = None, sigma_m: float = 0.05):
    """A map of two scans, another one's points and its match, along a corridor."""
    rng, surfaces = np.random.default_rng(seed), SurfaceMap()
    seen = []
    for x in (-0.3, 0.0, 0.15):
        beams = scan_of(walls, SE2(x, 0.0, 0.0), rng, 0.01, range_max_m=8.0)
        seen.append(faced(beams.points(SE2.identity()), np.zeros(2)))
    for x, points in zip((-0.3, 0.0), seen[:2], strict=True):
        surfaces.add(points + np.array([x, 0.0, 0.0]))
    start = T_start or SE2(0.15, 0.0, 0.0)
    told = np.diag([1.0 / sigma_m**2, 1.0 / sigma_m**2, 1.0 / 0.02**2])
    return surfaces, seen[2], surfaces.match(seen[2], start, start, told)


def test_shallow_recesses_tell_the_one_place_where_a_scan_was_taken():
    for seed in range(10):
        surfaces, points, match = match_of(DOORS, seed)
        assert match.least_facing < CONFIG.least_facing
        assert is_one_place(surfaces, points, match, 0.15)


def test_between_bare_walls_a_scan_has_no_one_place():
    # but where noise makes one
    told = [is_one_place(*match_of(BARE, seed), 0.15) for seed in range(60)]
    assert np.mean(told) < 0.05


@pytest.mark.parametrize("every_m", [0.3, 0.45, 0.7])
def test_among_pillars_that_look_the_same_a_scan_has_no_one_place(every_m):
    told = [is_one_place(*match_of(pillared(every_m), seed), 0.15) for seed in range(20)]
    assert np.mean(told) < 0.2


def test_a_scan_that_is_held_elsewhere_is_not_told_by_recesses():
    surfaces, points, match = match_of(DOORS, 0, SE2(0.35, 0.0, 0.0), sigma_m=1e-4)
    assert abs(match.T_map_base.x - 0.35) < 0.01
    assert not is_one_place(surfaces, points, match, 0.15)


@pytest.mark.parametrize(("walls", "is_told"), [(DOORS, True), (BARE, False)])
def test_a_robot_without_wheels_that_brakes_between_doors_knows_how_far_it_went(walls, is_told):
    front_end, rng, pose = FrontEnd(SE2.identity()), np.random.default_rng(1), SE2.identity()
    steps, x = [], np.cumsum([0.0, *[0.15] * 20, *[0.05] * 30])
    for index, at_m in enumerate(x):
        pose = SE2(float(at_m), 0.0, 0.0)
        scan = scan_of(walls, pose, rng, 0.01, range_max_m=8.0)
        told = Measurement(0.4 * index, SE2.identity(), scan, np.eye(3))
        steps.append(front_end.update(told))
    assert np.mean([step.is_open for step in steps[1:]]) < 0.2 if is_told else steps[-1].is_open
    assert front_end.T_map_base.is_near(pose, 0.05, 0.02) is is_told


@pytest.mark.parametrize("way_m", [0.6, 1.2])
def test_after_a_long_way_a_scan_may_be_at_the_next_of_recesses_alike(way_m):
    doors = recessed(*np.arange(-29.0, 28.0, 1.5))
    told = [is_one_place(*match_of(doors, seed), way_m) for seed in range(10)]
    assert np.mean(told) > 0.5 if way_m < 1.0 else not any(told)


def test_a_scan_that_does_not_find_back_from_afar_is_in_one_place_if_it_fits_far_worse_there():
    # doors 4.3 m apart, slid by 1.2 m: a fifth of the scan lies on nothing where it ends
    assert all(is_one_place(*match_of(DOORS, seed), 1.2) for seed in range(10))


@pytest.mark.parametrize(
    ("is_coasting", "other", "is_asked"),
    [(True, None, True), (False, None, True), (False, SE2(0.1, 0.0, 0.0), False)],
)
@pytest.mark.parametrize("is_one", [False, True])
def test_only_where_next_to_nothing_tells_of_the_way_few_surfaces_must_fit_in_one_place(
    monkeypatch, is_coasting, other, is_asked, is_one
):
    # in a second look, which doubts all odometry, scans that fit by chance were 0.97 m off and good; where
    # it jumped, the place that was right was one of two within reach
    monkeypatch.setattr("slam.frontend.front_end.is_one_place", lambda *_: is_one)
    here, nothing = SE2(2.0, 1.0, 0.3), np.zeros((3, 3))
    told = Prediction(here, here, np.eye(3), np.eye(3), 1.0, is_coasting, other)
    weak = SurfaceMatch(here, np.diag([1.0, 0.01, 1.0]), nothing, 1.0, 1.0, 0.1, 1.0)
    assert CONFIG.least_facing < weak.least_facing < CONFIG.ample_facing
    assert FrontEnd(SE2.identity())._is_open(weak, np.zeros((0, 3)), told) is (
        is_asked and not is_one
    )
    sure = replace(told, covariance=0.01 * np.eye(3), is_coasting=False)
    assert not FrontEnd(SE2.identity())._is_open(weak, np.zeros((0, 3)), sure)


@pytest.mark.parametrize(("led_m", "matched_m"), [(0.5, 1.3), (1.3, 0.5)])
@pytest.mark.parametrize("is_one", [False, True])
def test_how_far_a_scan_is_slid_is_as_far_as_the_robot_may_have_gone(
    monkeypatch, led_m, matched_m, is_one
):
    ways_m = list[float]()
    monkeypatch.setattr(
        "slam.frontend.front_end.is_one_place", lambda *args: ways_m.append(args[3]) or is_one
    )
    last, nothing = SE2(2.0, 1.0, 0.3), np.zeros((3, 3))
    led, there = (last @ SE2(one, 0.0, 0.0) for one in (led_m, matched_m))
    told = Prediction(last, led, np.eye(3), np.eye(3), 1.0, is_coasting=True)
    match = SurfaceMatch(there, nothing, nothing, 1.0, 1.0, 0.1, 1.0)
    assert FrontEnd(SE2.identity())._is_open(match, np.zeros((0, 3)), told) is not is_one
    assert ways_m == pytest.approx([1.3])


@pytest.mark.parametrize(
    ("led_m", "turn_rad", "is_open"), [(0.0, -0.2, True), (0.0, 0.02, False), (0.01, -0.2, False)]
)
def test_wheels_that_stand_while_scans_turn_say_nothing_of_how_far_the_robot_went(
    monkeypatch, led_m, turn_rad, is_open
):
    # encoders of aces that dropped out as the robot turned slowly, and then drove on down a corridor: 2.8 m off, and good
    ways_m = list[float]()
    monkeypatch.setattr(
        "slam.frontend.front_end.is_one_place", lambda *args: ways_m.append(args[3]) or False
    )
    last, sure = SE2(2.0, 1.0, math.pi - 0.1), 1e-4 * np.eye(3)
    led = last @ SE2(led_m, 0.0, 0.0)
    velocity = ConstantVelocity()
    velocity.take(SE2.identity(), SE2(0.9, 0.0, 0.3), 2.0)
    told = Prediction(
        last,
        led,
        sure,
        np.linalg.inv(sure),
        1.0,
        is_coasting=False,
        elapsed_s=3.0,
        goes_on=velocity,
    )
    there = last @ SE2(0.1, 0.0, turn_rad)
    weak = SurfaceMatch(there, np.diag([1.0, 0.01, 1.0]), np.zeros((3, 3)), 1.0, 1.0, 0.1, 1.0)
    front_end = FrontEnd(SE2.identity())
    assert front_end._is_open(weak, np.zeros((0, 3)), told) is is_open
    # by as far as it went before
    assert ways_m == pytest.approx(
        [math.hypot(*(SE2.exp(1.5 * SE2(0.9, 0.0, 0.3).log()).as_array()[:2]))] * is_open
    )


def test_after_scans_that_left_the_way_open_the_robot_may_be_as_far_off_as_it_went_meanwhile(
    monkeypatch,
):
    ways_m, answers = list[float](), iter([False, False, True, False, False, False])
    monkeypatch.setattr(
        "slam.frontend.front_end.is_one_place",
        lambda *args: ways_m.append(args[3]) or next(answers),
    )
    nothing = np.zeros((3, 3))
    front_end, rng = FrontEnd(SE2.identity()), np.random.default_rng(0)
    weak = SurfaceMatch(SE2(0.4, 0.0, 0.0), nothing, nothing, 1.0, 1.0, 0.1, 1.0)
    open_, blind = (weak, StepStatus.MATCHED, 0.0), (None, StepStatus.CARRIED, 0.0)
    broken = None, StepStatus.BROKEN, 0.0
    placed = iter([open_, open_, open_, open_, blind, open_, broken, open_])
    monkeypatch.setattr(front_end._placing, "believed", lambda *_: next(placed))
    for k in range(8):
        scan = scan_of(BARE, SE2.identity(), rng, 0.01, range_max_m=8.0)
        front_end.T_map_base = SE2.identity()
        front_end.update(Measurement(float(k), SE2.identity(), scan, np.eye(3)))
    # the third told its place; a scan that tells nothing does not, and after a break all is new
    assert ways_m == pytest.approx([0.4, 0.8, 1.2, 0.4, 1.2, 0.4])


@pytest.mark.parametrize(
    ("walls", "beams", "fastest_m", "seed"),
    [
        # 2 to 22 m off and good: their few sides made scans fit half-way between two of them
        (pillared(1.2, 0.05, 29.0), 481, 0.6, 1),
        (pillared(1.2, 0.05, 29.0), 481, 0.8, 1),
        (pillared(1.5, 0.05, 29.0), 481, 0.8, 1),
        # 16 m off and good: one scan of many fits in one place by chance
        (BARE, 1081, 0.6, 1),
        # the same: who has gone open for a while may be at the second pillar as well
        (pillared(1.0, 0.05, 29.0), 181, 0.6, 3),
        (pillared(1.2, 0.02, 29.0), 361, 0.6, 5),
    ],
)
def test_among_walls_alike_a_robot_without_wheels_is_right_or_knows_nothing(
    walls, beams, fastest_m, seed
):
    speeds_up = np.arange(0.1, fastest_m, 0.1)
    goes = [*speeds_up, *[fastest_m] * 6, *speeds_up[::-1], 0.0, 0.0]
    true_m = np.cumsum([-20.0, *goes, *goes, *speeds_up, *[fastest_m] * 3])
    mapper, rng = Mapper(SE2.identity()), np.random.default_rng(seed)
    angles_rad = np.radians(np.linspace(-135.0, 135.0, beams))
    for index, at_m in enumerate(true_m):
        pose = SE2(float(at_m), 0.0, 0.0)
        scan = scan_of(walls, pose, rng, 0.01, angles_rad, range_max_m=8.0)
        mapper.update(Measurement(float(index), SE2.identity(), scan, np.eye(3)))
    slam_map = mapper.finish()
    off_m = slam_map.trajectory.poses[-1, 0] - np.ptp(true_m)
    assert not slam_map.verdict.is_good or abs(off_m) < 0.5


@pytest.mark.parametrize("walls", [DOORS, recessed(-9.0, -4.0, 1.9, 6.0)])
@pytest.mark.parametrize("off_m", [-0.5, -0.35, 0.5])
def test_more_points_on_surfaces_in_one_place_tell_however_little_they_face_the_way(walls, off_m):
    # of 1 m by wheels off by 12 % of each, those 0.3 to 0.5 m short were taken as they were
    true = SE2(0.5, 0.0, 0.0)
    match, told = matched(walls, true, SE2(0.5 + off_m, 0.0, 0.0))
    assert max(match.least_facing, told.least_facing) < CONFIG.least_facing
    assert abs(match.T_map_base.x - true.x) > 0.15
    assert told.is_told_by_few
    assert told.T_map_base.is_near(true, 0.03, 0.01)
    at = Prediction(SE2.identity(), true, np.eye(3), np.eye(3), 1.0, is_coasting=False)
    front_end = FrontEnd(SE2.identity())
    assert not front_end._is_open(told, np.zeros((0, 3)), at)
    assert front_end._is_open(match, np.zeros((0, 3)), at)
    # people may stand across the way where wheels are good: 0.55 m off and good
    match, told = matched(walls, true, SE2(0.5 + off_m, 0.0, 0.0), noise=1.0)
    assert told is match


@pytest.mark.parametrize("is_led", [False, True])
@pytest.mark.parametrize("are_people", [False, True])
def test_people_across_the_way_are_not_taken_for_it(is_led, are_people):
    """Of odometry that is held loosely, or slid along the way that a scan leaves open: of both."""
    match, _ = matched(BARE, SE2(0.5, 0.0, 0.0), SE2(0.5, 0.0, 0.0))
    there = match.T_map_base @ SE2(0.25, 0.0, 0.0)
    found = replace(match, T_map_base=there, information=np.eye(3), cost=match.cost - 0.1)

    class OneWay(Finding):
        def match(self, _points, start, T_predicted, *_):
            return self._found if (start is T_predicted) is is_led else match

    told = OneWay(found), np.zeros((50, 3)), match.T_map_base, ODOMETRY, match, CONFIG, 1.0
    asked = list[SurfaceMatch]()
    closed = closed_match(*told, lambda one: asked.append(one) or are_people)
    assert (closed is match) is are_people
    assert (closed is found) is not are_people
    assert set(map(id, asked)) == {id(found)}


@pytest.mark.parametrize("every_m", [0.3, 0.45])
@pytest.mark.parametrize("off_m", [-0.5, -0.25, 0.25, 0.5])
def test_pillars_that_look_the_same_are_not_few_that_tell(every_m, off_m):
    match, told = matched(pillared(every_m), SE2(0.5, 0.0, 0.0), SE2(0.5 + off_m, 0.0, 0.0))
    assert told is match


def test_a_few_points_that_fit_by_chance_do_not_tell(monkeypatch):
    monkeypatch.setattr("slam.frontend.open_matches.is_one_place", lambda *_: True)
    match, _ = matched(BARE, SE2(0.5, 0.0, 0.0), SE2(0.5, 0.0, 0.0))
    match = replace(match, inlier_ratio=0.9, cost=0.1)
    for points_more, is_told in ((5, False), (7, True)):
        there = match.T_map_base @ SE2(0.3, 0.0, 0.0)
        ratio = match.inlier_ratio + points_more / 100.0
        found = Finding(replace(match, T_map_base=there, inlier_ratio=ratio, cost=0.05))
        told = closed_match(
            found, np.zeros((100, 3)), there, ODOMETRY, match, CONFIG, 1.0
        )  # fmt: skip
        assert told.is_told_by_few is is_told
    monkeypatch.setattr("slam.frontend.open_matches.is_one_place", lambda *_: False)
    args = np.zeros((100, 3)), there, ODOMETRY, match, CONFIG, 1.0
    assert closed_match(found, *args) is match


@pytest.mark.parametrize(
    ("is_closed", "costs", "kept"),
    [
        ((False, False), (0.05, 0.04), 1),
        ((False, False), (0.04, 0.05), 0),
        ((True, False), (0.06, 0.04), 0),
        ((False, True), (0.04, 0.06), 1),
    ],
)
def test_of_slid_matches_one_that_faces_the_way_is_taken_and_else_the_best(
    monkeypatch, is_closed, costs, kept
):
    slid_m = list[float]()
    monkeypatch.setattr(
        "slam.frontend.open_matches.is_one_place", lambda *args: slid_m.append(args[3]) or True
    )
    match, _ = matched(BARE, SE2(0.5, 0.0, 0.0), SE2(0.5, 0.0, 0.0))
    match = replace(match, inlier_ratio=0.9, cost=0.1)
    found = [
        replace(
            match,
            T_map_base=match.T_map_base @ SE2(0.3, 0.0, 0.0),
            information=np.eye(3) if closed else match.information,
            inlier_ratio=1.0,
            cost=cost,
        )
        for closed, cost in zip(is_closed, costs, strict=True)
    ]

    class OneAhead(Finding):
        def match(self, _points, start, *_):
            return found[start.x > match.T_map_base.x]

    taken = closed_match(
        OneAhead(match), np.zeros((100, 3)), found[0].T_map_base, ODOMETRY, match, CONFIG, math.inf
    )
    assert taken.cost == costs[kept]
    assert taken.is_told_by_few is not any(is_closed)
    assert slid_m == ([] if any(is_closed) else pytest.approx([0.5]))

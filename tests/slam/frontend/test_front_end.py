"""The front end of mapping: which of several poses of a scan is believed."""

import math
from dataclasses import replace

import numpy as np
import pytest

from slam.beams import Beams
from slam.frontend.front_end import FrontEnd
from slam.frontend.keyframes import StepStatus
from slam.frontend.prediction import Prediction
from slam.measurements import Measurement
from slam.se2 import SE2
from slam.surface.surface_map import SurfaceMap, faced
from tests.slam import ring
from tests.slam.synthetic import box, room, scan_of

NEXT_DOOR = SE2(-1.2, 0.0, 0.0)


@pytest.mark.parametrize(
    ("sigma_m", "gain", "status"),
    [
        # wheels known to 5 cm, and a pose 1.2 m from where they lead: as aces had it, thinned
        (0.05, 0.15, StepStatus.MATCHED),
        # odometry that jumped
        (0.05, 0.30, StepStatus.SEARCHED),
        # no odometry
        (1.0, 0.15, StepStatus.SEARCHED),
    ],
)
def test_pose_that_the_wheels_contradict_must_fit_much_better(monkeypatch, sigma_m, gain, status):
    front_end, second = after_one_scan()
    two_poses(monkeypatch, front_end, gain)
    monkeypatch.setattr(front_end._placing.candidates, "denied", lambda *_: (100, 0))
    covariance = np.diag([sigma_m**2, sigma_m**2, 0.05**2])
    step = front_end.update(replace(second, motion_covariance=covariance))
    assert step.status is status
    T_wheels = front_end.keyframes[0].T_map_base @ second.motion
    expected = T_wheels if status is StepStatus.MATCHED else T_wheels @ NEXT_DOOR
    assert step.T_map_base.is_near(expected, 0.1, 0.05)


@pytest.mark.parametrize(
    ("off_m", "status"), [(1.2, StepStatus.SEARCHED), (2.5, StepStatus.MATCHED)]
)
def test_no_pose_is_found_metres_from_where_wheels_lead_that_know_the_way(
    monkeypatch, off_m, status
):
    # a third of the scans of aces lost: one lay where the robot had stood, 2.5 m back (good)
    front_end, measurement = after_one_scan()
    two_poses(monkeypatch, front_end, 0.4)
    around = front_end._placing.candidates.around

    def far(points, told, usual):
        found = around(points, told, usual)
        return replace(found, T_map_base=told.T_map_base @ SE2(off_m, 0.0, 0.0), inlier_ratio=0.9)

    monkeypatch.setattr(front_end._placing.candidates, "around", far)
    monkeypatch.setattr(front_end._placing.candidates, "denied", lambda *_: (100, 0))
    step = front_end.update(
        replace(measurement, motion_covariance=np.diag([0.05, 0.05, 0.02]) ** 2)
    )
    assert step.status is status


def test_pose_that_the_wheels_contradict_must_not_be_denied_by_the_last_keyframes(monkeypatch):
    # of aces with a third of its scans lost, 14 such poses were metres off, and fitted better by 0.24
    front_end, second = after_one_scan()
    two_poses(monkeypatch, front_end, gain=0.3)
    covariance = np.diag([0.05**2, 0.05**2, 0.05**2])
    step = front_end.update(replace(second, motion_covariance=covariance))
    assert step.status is StepStatus.MATCHED
    assert step.T_map_base.is_near(front_end.keyframes[0].T_map_base @ second.motion, 0.1, 0.05)


def test_where_the_last_keyframes_deny_what_the_wheels_say_a_little_better_is_enough(monkeypatch):
    # odometry that lags: five records that tell of nothing, then a turn of 86 degrees at once
    front_end, second = after_one_scan()
    two_poses(monkeypatch, front_end, gain=0.15)
    T_wheels = front_end.keyframes[0].T_map_base @ second.motion

    def denied(T_map_base, points, beams):
        return 100, 22 if T_map_base.is_near(T_wheels, 0.1, 0.05) else 0

    monkeypatch.setattr(front_end._placing.candidates, "denied", denied)
    covariance = np.diag([0.05**2, 0.05**2, 0.05**2])
    step = front_end.update(replace(second, motion_covariance=covariance))
    assert step.status is StepStatus.SEARCHED
    assert step.T_map_base.is_near(T_wheels @ NEXT_DOOR, 0.1, 0.05)


@pytest.mark.parametrize(
    ("inlier_ratio", "sigma_m", "is_elsewhere", "status"),
    [
        (0.5, 0.05, False, StepStatus.MATCHED),
        # fits nothing
        (0.3, 0.05, False, StepStatus.BROKEN),
        # nobody knows where it may be
        (0.5, 1.0, False, StepStatus.BROKEN),
        # taken around the corner: it looks through what stood there, and is looked through
        (0.5, 0.05, True, StepStatus.BROKEN),
    ],
)
def test_scan_that_fits_badly_is_where_wheels_lead_if_they_are_sure_and_nothing_denies_it(
    monkeypatch, inlier_ratio, sigma_m, is_elsewhere, status
):
    front_end, second = after_one_scan()
    match = front_end._window.surfaces.match

    def badly(*args, **kwargs):
        return replace(match(*args, **kwargs), inlier_ratio=inlier_ratio)

    monkeypatch.setattr(front_end._window.surfaces, "match", badly)

    def around(points, told, usual):
        return badly(points, told.T_map_base, told.T_map_base, told.odometry)

    monkeypatch.setattr(front_end._placing.candidates, "around", around)
    if is_elsewhere:
        pose = SE2(12.8, 3.0, math.pi / 2.0) @ ring.T_BASE_LASER
        scan = scan_of(ring.RING, pose, np.random.default_rng(3), 0.01, range_max_m=8.0)
        second = replace(second, scan=scan)
    covariance = np.diag([sigma_m**2, sigma_m**2, 0.05**2])
    step = front_end.update(replace(second, motion_covariance=covariance))
    assert step.status is status
    if status is StepStatus.MATCHED:
        assert step.T_map_base.is_near(front_end.keyframes[0].T_map_base @ second.motion, 0.1, 0.05)


@pytest.mark.parametrize(("blind", "status"), [(42, StepStatus.MATCHED), (60, StepStatus.BROKEN)])
def test_scan_after_some_metres_blind_is_believed_where_the_wheels_lead(blind, status):
    # 6.5 and 9 m
    drive = ring.drive(ring.way(0.7), np.random.default_rng(2), turn_scale=1.0, way_scale=1.0)
    front_end = FrontEnd(ring.T_BASE_LASER)
    steps = []
    for k, one in enumerate(drive[: 50 + blind + 1]):
        if 50 <= k < 50 + blind:
            one = replace(one, scan=replace(one.scan, ranges_m=np.full(481, np.nan)))
        steps.append(front_end.update(one))
    assert {step.status for step in steps[50:-1]} == {StepStatus.CARRIED}
    assert steps[-1].status is status


def test_match_that_was_searched_for_along_a_wall_is_not_sure_how_far_along(monkeypatch):
    # odometry that turned by 90 degrees at once, in a corridor: the way after that is anybody's guess
    front_end, second = after_one_scan()
    two_poses(monkeypatch, front_end, gain=0.3)
    monkeypatch.setattr(front_end._placing.candidates, "denied", lambda *_: (100, 0))
    monkeypatch.setattr(front_end, "_is_open", lambda *_: True)
    covariance = np.diag([0.05**2, 0.05**2, 0.05**2])
    assert (
        front_end.update(replace(second, motion_covariance=covariance)).status
        is StepStatus.SEARCHED
    )
    assert front_end.keyframes[-1].covariance[:2, :2].trace() > 0.5 * front_end.config.reach_m**2


def after_one_scan() -> tuple[FrontEnd, Measurement]:
    """A front end that has seen one scan, and the next one."""
    front_end = FrontEnd(ring.T_BASE_LASER)
    first, second = ring.drive(ring.way(0.01), np.random.default_rng(0))[:2]
    front_end.update(first)
    return front_end, second


def two_poses(monkeypatch, front_end: FrontEnd, gain: float) -> None:
    """Has a scan fit half well where the wheels lead, and better by a gain next door."""
    match = front_end._window.surfaces.match

    def badly(*args, **kwargs):
        return replace(match(*args, **kwargs), inlier_ratio=0.8, cost=0.4)

    def around(points, told, usual):
        found = badly(points, told.T_map_base, told.T_map_base, told.odometry)
        T_there = told.T_map_base @ NEXT_DOOR
        return replace(found, T_map_base=T_there, inlier_ratio=0.9, cost=0.4 - gain)

    monkeypatch.setattr(front_end._window.surfaces, "match", badly)
    monkeypatch.setattr(front_end._placing.candidates, "around", around)


@pytest.mark.parametrize(
    ("ratio", "noise_m", "denied", "status", "is_slid"),
    [
        (
            0.72,
            0.05,
            0,
            StepStatus.MATCHED,
            False,
        ),  # aces, thinned: it had slid a metre along a wall
        (0.72, 0.05, 50, StepStatus.BROKEN, False),  # and others deny that it is where wheels led
        (0.80, 0.05, 0, StepStatus.MATCHED, True),
        (0.72, 0.40, 0, StepStatus.MATCHED, True),
    ],
)
def test_scan_that_fits_badly_where_wheels_did_not_lead_is_where_they_led_or_begins_a_piece(
    monkeypatch, ratio, noise_m, denied, status, is_slid
):
    front_end, second = after_one_scan()
    match = front_end._window.surfaces.match

    def around(points, told, usual):
        found = match(points, told.T_map_base, told.T_map_base, told.odometry)
        return replace(found, T_map_base=told.T_map_base @ NEXT_DOOR, inlier_ratio=ratio)

    def led(points, _, told):
        return around(points, told, None)

    monkeypatch.setattr(front_end._placing.candidates, "led", led)
    monkeypatch.setattr(front_end._placing.candidates, "around", around)
    monkeypatch.setattr(front_end._placing.candidates, "denied", lambda *_: (100, denied))
    covariance = np.diag([noise_m**2, noise_m**2, 0.05**2])
    step = front_end.update(replace(second, motion_covariance=covariance))
    assert step.status is status
    T_wheels = front_end.keyframes[0].T_map_base @ second.motion
    if status is StepStatus.MATCHED:
        T_expected = T_wheels @ NEXT_DOOR if is_slid else T_wheels
        assert step.T_map_base.is_near(T_expected, 0.1, 0.1)


def test_scans_of_a_laser_that_somebody_stands_before_are_carried_and_break_nothing():
    front_end, rng = FrontEnd(ring.T_BASE_LASER), np.random.default_rng(0)
    steps = []
    for k, measurement in enumerate(ring.drive(ring.way(1.5), rng)[:40]):
        if 20 <= k < 26:  # a trouser leg, all around
            scan = measurement.scan
            near_m = rng.uniform(0.03, 0.5, len(scan.ranges_m))
            measurement = replace(measurement, scan=replace(scan, ranges_m=near_m))
        steps.append(front_end.update(measurement))
    statuses = [step.status for step in steps]
    assert statuses[20:26] == [StepStatus.CARRIED] * 6
    assert set(statuses[1:20] + statuses[26:]) == {StepStatus.MATCHED}
    assert not any(keyframe.is_break for keyframe in front_end.keyframes)


@pytest.mark.parametrize("variance", [1e-4, 1e-3, 4e-3])
def test_a_scan_that_looks_through_the_walls_just_seen_is_not_placed_among_them(variance):
    passage, hall = room(-0.6, -3.0, 0.6, 1.5), room(-6.0, -6.0, 6.0, 1.5)
    front_end, rng, pose = (
        FrontEnd(SE2.identity()),
        np.random.default_rng(1),
        SE2(0.1, -0.3, math.pi / 2),
    )
    steps = []
    for index in range(11):
        scan = scan_of(passage if index < 9 else hall, pose, rng, 0.01, range_max_m=12.0)
        told = SE2(0.0, -0.1, 0.0) if index else SE2.identity()
        if index == 9:  # 0.89 of it lies on the wall ahead, which both have
            beams = Beams.of(scan, SE2.identity())
            assert front_end._placing.candidates.passed(front_end.T_map_base @ told, beams) > 0.8
        steps.append(front_end.update(Measurement(0.2 * index, told, scan, variance * np.eye(3))))
        pose = pose @ SE2(0.0, -0.1, 0.0)
    assert max(step.passed_ratio for step in steps[:9]) < 0.1
    assert steps[9].status is StepStatus.BROKEN
    assert steps[10].status is StepStatus.MATCHED


@pytest.mark.parametrize("step_m", [-0.05, 0.0, 0.05])
def test_between_bare_walls_the_wheels_alone_say_how_far(step_m):
    # of noise, what scans seem to tell of the way adds up: 10 m of 12 were lost, or 2 m come by standing
    walls, angles = room(-30.0, -1.0, 75.0, 1.0), np.radians(np.linspace(-120.0, 120.0, 683))
    front_end, rng, pose = FrontEnd(SE2.identity()), np.random.default_rng(0), SE2(5.0, 0.0, 0.0)
    noise = np.diag([0.011, 0.011, 0.008]) ** 2
    for index in range(121):
        scan = scan_of(walls, pose, rng, 0.01, angles, range_max_m=4.0)
        told = SE2(step_m, 0.0, 0.0) if index else SE2.identity()
        step = front_end.update(Measurement(0.1 * index, told, scan, noise))
        assert index == 0 or step.is_open
        pose = pose @ SE2(step_m, 0.0, 0.0)
    assert front_end.T_map_base.x == pytest.approx(120 * step_m, abs=0.02)
    assert abs(front_end.T_map_base.y) < 0.02


def test_what_is_held_along_the_open_direction_agrees_with_the_scan_in_all_others():
    walls, rng, surfaces = room(-9.0, -1.0, 9.0, 1.0), np.random.default_rng(4), SurfaceMap()

    def seen_at(pose: SE2) -> np.ndarray:
        points = scan_of(walls, pose, rng, 0.01, range_max_m=4.0).points(SE2.identity())
        return faced(points, np.zeros(2))

    surfaces.add(seen_at(SE2.identity()))
    true, told, odometry = SE2(0.3, 0.05, 0.02), SE2(0.35, 0.0, 0.0), np.diag([1e3, 1e3, 1e4])
    match = surfaces.match(seen_at(true), told, told, odometry)
    held = match.held_along_open(told, odometry)
    # along a corridor that runs in its own direction
    along = np.array([math.cos(true.theta), -math.sin(true.theta), 0.0])
    assert held.T_map_base.x == pytest.approx(0.35, abs=1e-3)
    assert abs(held.T_map_base.y - true.y) < 0.01
    assert abs(held.T_map_base.theta - true.theta) < 0.005
    assert along @ held.information @ along < 1e-3 * (along @ match.information @ along) + 1.0
    assert 1.0 / (along @ held.covariance @ along) == pytest.approx(1e3, rel=0.05)
    assert np.linalg.eigvalsh(held.information).min() > -1e-6


def test_after_odometry_jumped_a_scan_is_looked_for_where_the_robot_was_as_well():
    # back along a corridor: but for the board on the wall ahead, it fits there as well, 0.02 worse
    walls = np.concatenate([room(-30.0, -1.0, 30.0, 1.0), box(3.0, 0.9, 3.15, 1.0)])
    front_end, rng, pose = FrontEnd(SE2.identity()), np.random.default_rng(3), SE2.identity()
    angles = np.radians(np.arange(-180.0, 180.0, 0.5))
    for index in range(31):
        has_jumped = index == 30
        told = SE2(-1.6, 0.0, 0.0) if has_jumped else SE2(0.1, 0.0, 0.0)
        noise = np.diag([1.6 if has_jumped else 0.02, 0.01, 0.01]) ** 2
        scan = scan_of(walls, pose, rng, 0.01, angles, range_max_m=4.0)
        motion = told if index else SE2.identity()
        usual = SE2(0.1, 0.0, 0.0)
        front_end.update(
            Measurement(0.3 * index, motion, scan, noise), usual if has_jumped else None
        )
        pose = pose @ usual
    assert front_end.T_map_base.is_near(SE2(3.0, 0.0, 0.0), 0.1, 0.02)


@pytest.mark.parametrize("told_m", [0.0, 0.4])
def test_scan_is_looked_for_as_far_as_wheels_that_stood_for_long_leave_open(told_m):
    """Wheels of aces stuck for 10 s: a scan fitted 1.3 m short of where it lay, out of reach."""
    # boxes of which both ends were seen, or neither is
    boxes = [box(-2.5, 0.7, -1.4, 1.0), box(6.8, -1.0, 9.5, -0.7), box(8.4, 0.6, 9.5, 1.0)]
    walls = np.concatenate([room(-30.0, -1.0, 9.5, 1.0), *boxes])
    front_end, rng, pose = FrontEnd(SE2.identity()), np.random.default_rng(3), SE2.identity()
    angles = np.radians(np.arange(-180.0, 180.0, 0.5))
    for index in range(21):
        is_stuck = index == 20
        way_m = (3.0 if is_stuck else 0.1) if index else 0.0
        pose = pose @ SE2(way_m, 0.0, 0.0)
        motion = SE2(told_m if is_stuck else way_m, 0.0, 0.0)
        covariance = np.diag([3.0 if is_stuck else 0.01, 0.01, 0.01]) ** 2
        scan = scan_of(walls, pose, rng, 0.01, angles, range_max_m=8.0)
        time_s = 0.5 * index + 8.0 * is_stuck
        front_end.update(Measurement(time_s, motion, scan, covariance))
    assert front_end.T_map_base.is_near(pose, 0.05, 0.02)


@pytest.mark.parametrize("sigma_m", [0.05, 1.5])
def test_motion_that_was_not_believed_is_where_a_scan_is_looked_for_too(sigma_m):
    P, T_last, other = np.eye(3) * sigma_m**2, SE2(1.0, 2.0, 0.5), SE2(-1.5, 0.0, 0.1)
    told = Prediction(T_last, T_last @ SE2(0.2, 0.0, 0.0), P, np.linalg.inv(P), 1.0, False, other)
    # wheels that know the way leave no other
    assert told.others == ([T_last, T_last @ other] if sigma_m > 1.0 else [])


@pytest.mark.parametrize(
    ("beams", "off_m", "status"),
    [
        (30, 0.0, StepStatus.MATCHED),
        # a hall by a laser of 8 m: 22 points drew the first keyframe 0.2 m aside
        (30, 0.3, StepStatus.CARRIED),
        (60, 0.3, StepStatus.SEARCHED),
    ],
)
def test_few_points_are_not_believed_against_the_wheels(beams, off_m, status):
    walls, angles = (
        room(-2.0, -1.5, 2.0, 1.5),
        np.linspace(-math.pi, math.pi, beams, endpoint=False),
    )
    front_end, rng = FrontEnd(SE2.identity()), np.random.default_rng(3)
    for index in range(3):
        scan = scan_of(walls, SE2(off_m * (index == 2), 0.0, 0.0), rng, 0.01, angles)
        step = front_end.update(Measurement(0.5 * index, SE2.identity(), scan, np.eye(3) * 0.02**2))
    assert step.status is status


def test_odometry_that_stands_still_does_not_hold_what_sees_the_end_of_the_way():
    # the end wall, a few of many beams, is an outlier once the wheels have held the scan for a while
    walls, half_circle = room(-2.0, -1.0, 14.0, 1.0), np.radians(np.arange(-90.0, 90.5, 0.5))
    front_end, rng, pose = FrontEnd(SE2.identity()), np.random.default_rng(0), SE2(0.0, 0.0, 0.0)
    for index in range(80):
        scan = scan_of(walls, pose, rng, 0.01, half_circle)
        is_stuck = index == 0 or 20 <= index < 50
        told, sigma = (SE2.identity(), 1e-3) if is_stuck else (SE2(0.1, 0.0, 0.0), 0.011)
        front_end.update(Measurement(0.2 * index, told, scan, np.eye(3) * sigma**2))
        pose = pose @ SE2(0.1, 0.0, 0.0)
    assert front_end.T_map_base.x == pytest.approx(7.9, abs=0.05)


def test_a_search_does_not_find_what_lies_beyond_its_reach(monkeypatch):
    front_end = FrontEnd(ring.T_BASE_LASER)
    first, second = ring.drive(ring.way(0.01), np.random.default_rng(0))[:2]
    front_end.update(first)
    match, places = front_end._window.surfaces.match, []

    def wandering(points, T_start, T_predicted, odometry, *args):
        found = match(points, T_start, T_predicted, odometry, *args)
        places.append(T_start)
        is_first = len(places) == 1  # where wheels lead
        off = SE2.identity() if is_first else SE2(2.0 if len(places) % 2 else 1.0, 0.0, 0.0)
        return replace(found, T_map_base=T_start @ off, cost=0.5 if is_first else 0.4 - off.x / 10)

    monkeypatch.setattr(front_end._window.surfaces, "match", wandering)
    monkeypatch.setattr(
        front_end._window.surfaces, "searched", lambda *_, **__: [SE2.identity()] * 2
    )
    here = SE2.identity()
    told = Prediction(here, here, np.eye(3), np.eye(3), noise=1.0, is_coasting=False)
    found = front_end._placing.candidates.around(
        front_end._seen(front_end._beams(second)), told, None
    )
    assert found.T_map_base.x == pytest.approx(1.0)


@pytest.mark.parametrize(("beams", "status"), [(30, "CARRIED"), (90, "BROKEN")])
def test_few_points_that_fit_nothing_begin_no_new_piece(beams, status):
    # among trees, such scans fit where they should not
    front_end, rng = FrontEnd(SE2.identity()), np.random.default_rng(0)
    angles = np.radians(np.linspace(-90.0, 90.0, beams))
    for k in range(4):
        scan = scan_of(room(-3.0, -2.0, 3.0, 2.0), SE2.identity(), rng, 0.01, angles)
        if k == 3:
            scan = replace(scan, ranges_m=rng.uniform(1.0, 8.0, beams))
        step = front_end.update(Measurement(0.2 * k, SE2.identity(), scan, np.eye(3) * 1e-4))
    assert step.status is StepStatus[status]


@pytest.mark.parametrize(
    ("sigma_m", "status"), [(0.05, StepStatus.MATCHED), (1.0, StepStatus.BROKEN)]
)
def test_wheels_that_are_a_guess_lead_blind_for_two_metres(sigma_m, status):
    front_end, rng = FrontEnd(SE2.identity()), np.random.default_rng(0)
    walls, covariance = room(-3.0, -2.0, 9.0, 2.0), np.diag([sigma_m**2, sigma_m**2, 0.01])
    blind = scan_of(walls, SE2.identity(), rng, 0.01, np.zeros(1))
    for k in range(8):
        scan = blind if 0 < k < 7 else scan_of(walls, SE2(0.4 * k, 0.0, 0.0), rng, 0.01)
        told = SE2(0.4, 0.0, 0.0) if k else SE2.identity()
        step = front_end.update(Measurement(1.0 * k, told, scan, covariance))
    assert step.status is status


@pytest.mark.parametrize("seed", [0, 7])
def test_robot_whose_odometry_turns_by_a_right_angle_is_looked_for_where_it_went_on_to(seed):
    """As of aces: a metre on, and farther than the search reaches from where it was and is said to be."""
    rng, posts, x = np.random.default_rng(seed), [], 1.0
    while x < 29.0:
        low = 1.0 if len(posts) % 2 == 0 else -1.2
        posts.append(box(x, low, x + rng.uniform(0.3, 1.0), low + 0.2))
        x += rng.uniform(0.6, 1.6)
    walls, front_end = (
        np.concatenate([room(0.0, -1.2, 30.0, 1.2), *posts]),
        FrontEnd(SE2.identity()),
    )
    for k, x in enumerate(np.arange(8.0, 18.0, 1.25)):
        motion = SE2(0.6, 0.65, math.pi / 2.0) if k == 6 else SE2(1.25 * (k > 0), 0.0, 0.0)
        scan = scan_of(walls, SE2(x, 0.0, 0.0), rng, 0.01, range_max_m=8.0)
        told = 0.05**2 * (k > 0) * np.eye(3)
        step = front_end.update(Measurement(3.0 * k, motion, scan, told))
        assert step.T_map_base.is_near(SE2(x - 8.0, 0.0, 0.0), 0.15, 0.05)
        assert step.status is (StepStatus.SEARCHED if k == 6 else step.status)

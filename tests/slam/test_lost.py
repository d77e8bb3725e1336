"""The verdict: a robot that follows itself, is carried away, and says what it knows."""

import math
from dataclasses import replace

import numpy as np
import pytest

from slam import SE2, Localizer
from slam.beams import Beams
from slam.guard.laser_faults import LaserFaultConfig, says_nothing
from slam.guard.look import Look, Step
from slam.guard.verdict_limits import VerdictLimits
from slam.measurements import LaserScan
from slam.scan_match import MatchStatus, ScanMatch
from slam.verdict import Status
from tests.slam.all_methods import SIGMA_M
from tests.slam.guarded import LASER, START, STILL, Robot, made
from tests.slam.synthetic import ANGLES_RAD, ROOM_SEGMENTS, scan_of

ELSEWHERE = [SE2(1.5, 1.0, 2.0), SE2(3.4, 3.2, -1.0), SE2(5.3, 1.6, 3.0), SE2(2.6, 2.3, 0.4)]
STEP = SE2(0.02, 0.0, 0.01)
BOX = np.array([[0.0, 0.0], [6.0, 0.0], [6.0, 4.0], [0.0, 4.0], [0.0, 0.0]])
TWIN_ROOM = np.stack([BOX[:-1], BOX[1:]], axis=1)
"""Looks the same from either end."""


@pytest.fixture(scope="module")
def room():
    return made(ROOM_SEGMENTS)


@pytest.fixture(scope="module")
def twin_room():
    return made(TWIN_ROOM)


def test_ordinary_driving_is_tracking_and_gives_no_reasons(room):
    robot = Robot(room, START)
    for _ in range(60):
        estimate = robot.look(STEP)
        assert estimate.verdict.status is Status.TRACKING
        assert estimate.verdict.reasons == ()
        assert robot.is_right(estimate)


@pytest.mark.parametrize("target", ELSEWHERE)
def test_carried_away_it_is_lost_at_once_and_tracks_again_at_the_next_scan(room, target):
    robot = Robot(room, START)
    robot.look()
    robot.at = target
    first = robot.look(told=SE2.identity())
    assert first.verdict.status is Status.LOST
    assert "carried away" in first.verdict.reasons[0]
    assert first.verdict.recovery_s is None
    second = robot.look(told=SE2.identity())
    assert second.verdict.status is Status.TRACKING
    assert second.verdict.recovery_s == pytest.approx(0.1)
    assert robot.is_right(second)
    assert robot.look(STEP).verdict.status is Status.TRACKING


def test_without_a_start_the_first_scan_tells(room):
    for index, pose in enumerate(ELSEWHERE):
        robot = Robot(room, None, at=pose, seed=index)
        estimate = robot.look()
        assert estimate.verdict.status is Status.TRACKING
        assert estimate.verdict.recovery_s == 0.0
        assert robot.is_right(estimate)


@pytest.mark.parametrize(
    ("count", "said"),
    [
        (0, "the scan has no beams; it takes 3 to tell of a place"),
        (1, "the scan has 1 beam; it takes 3 to tell of a place"),
        (2, "the scan has 2 beams; it takes 3 to tell of a place"),
    ],
)
def test_first_scan_of_next_to_no_beams_says_nothing_and_spoils_nothing(count, said, room):
    robot = Robot(room, None)
    stump = LaserScan(0.0, ANGLES_RAD[:count].copy(), np.full(count, 2.0))
    first = robot.look(scan=stump)
    assert first.verdict.status is Status.UNSURE
    assert first.verdict.reasons == (said,)
    # one beam in twenty measures somebody
    scan = scan_of(room[0], robot.at @ LASER, robot.rng, SIGMA_M)
    ranges_m = scan.ranges_m.copy()
    ranges_m[::20] = 0.7
    second = robot.look(scan=LaserScan(0.0, ANGLES_RAD, ranges_m))
    assert second.verdict.status is Status.TRACKING
    assert robot.is_right(second)


def test_limits_are_those_of_the_largest_fan_seen(room):
    guard = Robot(room, START).localizer.guard
    whole = scan_of(room[0], START @ LASER)
    assert guard is not None

    def limits_of(count):
        part = LaserScan(0.0, ANGLES_RAD[:count].copy(), whole.ranges_m[:count].copy())
        return guard._usual.limits(Beams.of(part, LASER))

    expected = VerdictLimits.usual_for(room[2], Beams.of(whole, LASER))
    assert limits_of(60) != expected
    for count in (len(ANGLES_RAD), 60, len(ANGLES_RAD) - 3):
        assert limits_of(count) == expected


@pytest.mark.parametrize(
    ("hits", "beams", "beam_count", "said"),
    [
        (4, 8, 8, ""),
        (3, 8, 8, "3 of 8 beams came back: no laser, or nothing in its reach"),
        (3, 3, 3, ""),
        (8, 8, 481, "the scan has 8 beams where there were 481 before; it takes 20 to tell of a place"),
        (19, 481, 481, "19 of 481 beams came back: no laser, or nothing in its reach"),
        (20, 481, 481, ""),
    ],
)  # fmt: skip
def test_half_of_a_small_laser_is_enough_but_no_stump_of_a_large_one(hits, beams, beam_count, said):
    ranges_m = np.where(np.arange(beams) < hits, 2.0, np.inf)
    scan = Beams(np.zeros((beams, 2)), ANGLES_RAD[:beams], ranges_m)
    assert says_nothing(scan, beam_count, LaserFaultConfig()) == said


def test_a_start_without_a_pose_needs_a_guard(room):
    with pytest.raises(ValueError, match="needs a guard"):
        Localizer(room[1], None, LASER)


def test_a_room_that_looks_the_same_from_two_ends_stays_unsure(twin_room):
    robot = Robot(twin_room, None, at=SE2(1.4, 1.1, 0.3))
    for _ in range(8):
        estimate = robot.look(SE2(0.05, 0.0, 0.5))
        assert estimate.verdict.status is Status.UNSURE
        assert "another place fits nearly as well" in estimate.verdict.reasons[0]
        places = [place.T_map_base for place in estimate.verdict.hypotheses[:2]]
        off_m = [math.hypot(place.x - robot.at.x, place.y - robot.at.y) for place in places]
        assert min(off_m) < 0.05


def test_wheels_that_spin_are_told_from_a_kidnap(room):
    robot = Robot(room, START)
    robot.look()
    statuses = []
    for _ in range(12):
        estimate = robot.look(SE2.identity(), told=SE2(0.02, 0.0, 0.0))
        assert robot.is_right(estimate)
        statuses.append(estimate.verdict.status)
        assert Status.LOST not in statuses
    # 5 cm at 0.2 m/s are a quarter of a second
    assert set(statuses[3:]) == {Status.UNSURE}
    assert "wheels slip or spin" in estimate.verdict.reasons[0]
    for _ in range(12):
        estimate = robot.look(STEP)
    assert estimate.verdict.status is Status.TRACKING


def test_frozen_scan_is_never_fine(room):
    robot = Robot(room, START)
    scan = scan_of(ROOM_SEGMENTS, START @ LASER, robot.rng, SIGMA_M)
    robot.look(scan=scan)
    for _ in range(3):
        estimate = robot.look(STEP, scan=scan)
        assert estimate.verdict.status is Status.UNSURE
        assert "frozen" in estimate.verdict.reasons[0]
    assert robot.look(STEP).verdict.status is Status.TRACKING


@pytest.mark.parametrize("ranges", [0.05, np.inf, -np.inf, np.nan])
def test_blocked_laser_is_never_fine_and_no_kidnap(room, ranges):
    robot = Robot(room, START)
    robot.look()
    for count in range(4):
        values = np.full(len(ANGLES_RAD), ranges) + 1e-3 * count
        estimate = robot.look(STEP, scan=LaserScan(0.0, ANGLES_RAD, values))
        assert estimate.verdict.status is Status.UNSURE
        assert estimate.verdict.reasons
        assert robot.is_right(estimate)
    assert robot.look(STEP).verdict.status is Status.TRACKING


def test_what_the_map_does_not_explain_ends_lost(room):
    robot = Robot(room, START)
    robot.look()
    statuses = []
    for _ in range(6):
        nonsense = robot.rng.uniform(0.3, 6.0, len(ANGLES_RAD))
        estimate = robot.look(told=SE2.identity(), scan=LaserScan(0.0, ANGLES_RAD, nonsense))
        statuses.append(estimate.verdict.status)
    assert Status.TRACKING not in statuses
    assert statuses[-1] is Status.LOST


def test_corridor_without_an_end_is_unsure():
    corridor = np.array([[[-40.0, 0.0], [40.0, 0.0]], [[-40.0, 2.0], [40.0, 2.0]]])
    robot = Robot(made(corridor), SE2(0.0, 1.0, 0.0), at=SE2(0.0, 1.0, 0.0))
    for _ in range(5):
        estimate = robot.look(STEP)
        assert estimate.verdict.status is Status.UNSURE
        assert "direction open" in estimate.verdict.reasons[0]


def test_end_of_a_corridor_is_no_kidnap():
    # what slid along the open direction was once judged as if it were certain
    walls = [[[-9.0, 0.0], [30.0, 0.0]], [[-9.0, 2.0], [30.0, 2.0]], [[30.0, 0.0], [30.0, 2.0]]]
    robot = Robot(made(np.array(walls)), SE2(12.0, 1.0, 0.0), at=SE2(12.0, 1.0, 0.0))
    statuses = []
    for _ in range(70):
        step = SE2(0.15, 0.0, 0.0)
        scan = scan_of(
            robot.segments, robot.at @ step @ LASER, robot.rng, SIGMA_M, range_max_m=10.0
        )
        statuses.append(robot.look(step, scan=scan).verdict.status)
    assert Status.LOST not in statuses
    assert statuses[10] is Status.UNSURE
    assert statuses[-1] is Status.TRACKING


def test_match_that_went_astray_is_no_kidnap(room):
    robot = Robot(room, START)
    robot.look()
    matcher, starts = robot.localizer.matcher, []

    def astray_at_first(beams, T_predicted):
        starts.append(T_predicted)
        match = matcher(beams, T_predicted)
        if len(starts) > 1:
            return match
        return replace(match, T_map_base=match.T_map_base @ SE2(0.4, 0.0, 0.2))

    robot.localizer.matcher = astray_at_first
    estimate = robot.look(STEP)
    assert len(starts) == 2
    assert estimate.verdict.status is Status.TRACKING
    assert robot.is_right(estimate)


def test_slide_along_an_open_direction_is_no_jump(room):
    guard = Robot(room, START).localizer.guard
    slid = ScanMatch(
        START @ SE2(0.45, 0.0, 0.0), MatchStatus.DEGENERATE, information=np.diag([1e-14, 1e6, 1e6])
    )
    known = ScanMatch(slid.T_map_base, MatchStatus.MATCHED, information=np.diag([1e6, 1e6, 1e6]))
    step = Step(START, START, np.diag([1e-4, 1e-4, 1e-4]), np.zeros((3, 3)))
    assert guard._jump(slid, step) is None
    assert guard._jump(known, step) is not None


def test_what_no_match_explains_moves_the_pose_nowhere(room):
    robot = Robot(room, START)
    robot.look()
    guard = robot.localizer.guard
    step = Step(START, START, np.diag([1e-4, 1e-4, 1e-4]), np.zeros((3, 3)))
    astray = ScanMatch(START @ SE2(2.0, 0.0, 1.0), MatchStatus.DEGENERATE)
    scan = scan_of(ROOM_SEGMENTS, START @ LASER, robot.rng, SIGMA_M)
    beams = Beams.of(scan, LASER)

    def never(beams: Beams, T_start: SE2) -> ScanMatch:
        return ScanMatch(T_start, MatchStatus.NOT_CONVERGED)

    judged = guard.judge(Look(0.0, beams, never), astray, step)
    assert judged.verdict.status is Status.LOST
    assert judged.match is None
    assert not judged.is_restart


def test_laser_blocked_in_part_is_never_fine(room):
    robot = Robot(room, START)
    robot.look()
    for count in range(30):
        scan = scan_of(ROOM_SEGMENTS, robot.at @ LASER, robot.rng, SIGMA_M)
        ranges_m = scan.ranges_m.copy()
        ranges_m[:150] = 0.1 + 1e-4 * count
        blocked = LaserScan(0.0, ANGLES_RAD, ranges_m)
        estimate = robot.look(told=STILL, scan=blocked)
        assert estimate.verdict.status is Status.UNSURE
        assert "laser blocked" in estimate.verdict.reasons[0]


def test_robot_set_down_before_a_wall_is_not_blocked(room):
    robot = Robot(room, None, at=SE2(2.0, 0.28, -math.pi / 2))
    scan = scan_of(ROOM_SEGMENTS, robot.at @ LASER, robot.rng, SIGMA_M)
    assert np.count_nonzero(scan.ranges_m < 0.2) > 0.15 * len(scan.ranges_m)
    for _ in range(4):
        estimate = robot.look(told=STILL)
        assert not any("blocked" in reason for reason in estimate.verdict.reasons)


def test_robot_carried_before_a_wall_is_lost_not_blocked(room):
    robot = Robot(room, START)
    robot.look()
    robot.at = SE2(2.0, 0.28, -math.pi / 2)
    assert robot.look(told=STILL).verdict.status is Status.LOST
    assert robot.is_right(robot.look(told=STILL))


def test_robot_turned_before_a_wall_near_by_is_lost_not_blocked(room):
    # 20 cm and 56 degrees off: so near that refining the pose believed leads to the true one
    robot = Robot(room, SE2(2.1, 0.45, -math.pi / 2 + 0.98), at=SE2(2.1, 0.45, -math.pi / 2 + 0.98))
    assert robot.look().verdict.status is Status.TRACKING
    robot.at = SE2(2.0, 0.28, -math.pi / 2)
    assert robot.look(told=STILL).verdict.status is Status.LOST
    assert robot.is_right(robot.look(told=STILL))


def test_motion_without_a_scan_moves_pose_and_places(room):
    robot = Robot(room, None, at=ELSEWHERE[0])
    robot.look()
    turn = SE2(0.0, 0.0, 0.7)
    robot.at, robot.time_s = robot.at @ turn, robot.time_s + 1.0
    robot.localizer.move(robot.time_s, turn, np.zeros((3, 3)))
    estimate = robot.look(told=SE2.identity())
    assert estimate.verdict.status is Status.TRACKING
    assert robot.is_right(estimate)

"""Scans alone that jump, and robots that do."""

from dataclasses import replace

import numpy as np
import pytest

from slam import SE2
from slam.frontend.keyframes import FrontEndStep, StepStatus
from slam.frontend.told_steps import ToldStep
from slam.map_checks.scan_jumps import scan_jumps

COUNT, FIRST, STEP_M, STEP_S = 60, 3, 0.1, 0.3
AT = 40
POSES = np.array([[1.0, 2.0, np.pi / 2.0]])
GUESS, TOLD = np.eye(3) * 100.0, np.eye(3) * 1e-4


def driven(step_m: np.ndarray | None = None) -> list[FrontEndStep]:
    """A session of some scans, and one of many, each a step ahead of the one before; all seen from one
    keyframe."""
    ahead_m = np.cumsum(np.full(COUNT, STEP_M) if step_m is None else step_m)
    before = [step_of(float(k), 10.0 * k, 0) for k in range(FIRST)]
    return before + [step_of(5.0 + STEP_S * k, x, 1) for k, x in enumerate(ahead_m)]


def step_of(time_s: float, x: float, session: int) -> FrontEndStep:
    T = SE2(x, 0.0, 0.0)
    return FrontEndStep(time_s, 0, T, T, StepStatus.MATCHED, 1.0, False, session)


def said_of(steps: list[FrontEndStep], covariance: np.ndarray = GUESS) -> list[str]:
    told = [ToldStep(SE2.identity(), covariance)] * (len(steps) - FIRST)
    return scan_jumps(steps, FIRST, told, POSES, 1.0)


def with_status(steps: list[FrontEndStep], at: int, status: StepStatus) -> list[FrontEndStep]:
    """The same, one scan of the last session placed in another way."""
    return [replace(one, status=status) if k == FIRST + at else one for k, one in enumerate(steps)]


def steps_with(jump_m: float, back_m: float = 0.0) -> np.ndarray:
    step_m = np.full(COUNT, STEP_M)
    step_m[AT] += jump_m
    step_m[AT + 1] += back_m
    return step_m


@pytest.mark.parametrize(("jump_m", "back_m"), [(0.5, -0.5), (-0.5, 0.5), (-0.7, 0.0), (0.5, 0.0)])
def test_scan_that_jumps_fails_the_map(jump_m, back_m):
    (said,) = said_of(driven(steps_with(jump_m, back_m)))
    assert "by scans alone, and neither before nor after" in said
    # there, or back
    assert said.startswith(f"at {5.0 + STEP_S * AT:.2f} s") or back_m
    assert "m in 0.30 s" in said


@pytest.mark.parametrize(
    ("usual_m", "back_m", "status", "is_jump"),
    [
        (0.5, -0.6, StepStatus.SEARCHED, True),
        (0.5, -0.6, StepStatus.MATCHED, False),  # there are robots that do
        (0.5, -0.4, StepStatus.SEARCHED, False),
        (0.2, -0.23, StepStatus.SEARCHED, False),  # by so little a right map may be off
    ],
)
def test_who_drives_does_not_turn_back_for_a_step_and_on_again(usual_m, back_m, status, is_jump):
    # of a real log without wheels, played backwards: a metre ahead at once, 1.4 m off and good
    step_m = np.full(COUNT, usual_m)
    step_m[AT] = back_m
    assert bool(said_of(with_status(driven(step_m), AT, status))) is is_jump
    if status is StepStatus.SEARCHED:
        steps = driven(step_m)
        steps[FIRST + AT] = replace(steps[FIRST + AT], is_open=True)
        assert bool(said_of(steps)) is is_jump


def test_drive_as_it_is_has_no_jumps():
    assert said_of(driven()) == []
    assert said_of(driven(steps_with(0.15, -0.15))) == []


def test_robot_that_speeds_up_for_a_while_does_not_jump():
    step_m = np.full(COUNT, STEP_M)
    step_m[AT : AT + 3] = 0.4  # 1.3 m/s
    assert said_of(driven(step_m)) == []
    # nor one that mostly stands
    step_m = np.zeros(COUNT)
    step_m[10:34] = 0.5
    assert said_of(driven(step_m)) == []


def test_how_far_the_robot_was_found_after_breaks_is_not_how_fast_it_drives():
    step_m = steps_with(0.8)
    breaks = range(5, 35, 5)
    step_m[breaks] += 1.5
    steps = driven(step_m)
    for at in breaks:
        steps = with_status(steps, at, StepStatus.BROKEN)
    (said,) = said_of(steps)
    assert said.startswith(f"at {5.0 + STEP_S * AT:.2f} s")


def test_scans_that_come_rarely_tell_of_long_ways():
    late = [
        replace(one, time_s=one.time_s + (5.0 if at > FIRST + AT - 1 else 0.0))
        for at, one in enumerate(driven(steps_with(0.5)))
    ]
    assert said_of(late) == []
    assert said_of(driven(steps_with(0.5)))


def test_stamps_that_stand_are_no_infinite_speed():
    stamped = driven()
    stamped[FIRST + AT] = replace(stamped[FIRST + AT], time_s=stamped[FIRST + AT - 1].time_s)
    assert said_of(stamped) == []
    assert said_of([replace(one, time_s=7.0) for one in driven()]) == []


def test_wheels_and_breaks_are_asked_elsewhere():
    jumped = driven(steps_with(0.5, -0.5))
    assert said_of(jumped, TOLD) == []
    jumped[FIRST + AT] = replace(jumped[FIRST + AT], status=StepStatus.BROKEN)
    assert said_of(jumped) == []
    assert said_of(driven()[: FIRST + 2]) == []
    assert said_of(driven()[: FIRST + 1]) == said_of(driven()[:FIRST]) == []


@pytest.mark.parametrize("jump_m", [0.6, -0.6])
def test_scans_that_jump_where_wheels_went_on_fail_the_map(jump_m):
    # 0.7 m and 0.35 m aside in one of two scans a second, beside people in a hall; wheels told 0.24 m
    steps = driven(steps_with(jump_m))
    on = [ToldStep(SE2(STEP_M, 0.0, 0.0), TOLD)] * COUNT
    (said,) = scan_jumps(steps, FIRST, on, POSES, 1.0)
    assert "by scans against the wheels, and neither before nor after" in said
    assert scan_jumps(driven(), FIRST, on, POSES, 1.0) == []
    # they are as noisy as they show, stood as the robot was lifted, or have jumped
    assert scan_jumps(steps, FIRST, on, POSES, 100.0) == []
    stood = ToldStep(SE2.identity(), TOLD)
    lost = ToldStep(SE2(STEP_M, 0.0, 0.0), GUESS)
    # and who drives as fast does so by the wheels as well
    fast = ToldStep(SE2(STEP_M + jump_m, 0.0, 0.0), TOLD)
    for one in (stood, lost, fast):
        assert scan_jumps(steps, FIRST, [*on[:AT], one, *on[AT + 1 :]], POSES, 1.0) == []


def test_wheels_that_tell_of_a_way_within_a_brief_interval_go_on():
    # 12 mm in 0.1 s are 0.12 m/s: slower than a robot that stands only if metres were taken for speeds
    step_m = np.full(COUNT, 0.012)
    step_m[AT] += 0.6
    steps = [replace(one, time_s=0.1 * k) for k, one in enumerate(driven(step_m))]
    on = [ToldStep(SE2(0.012, 0.0, 0.0), TOLD)] * COUNT
    assert "by scans against the wheels" in scan_jumps(steps, FIRST, on, POSES, 1.0)[0]
    creeps = [ToldStep(SE2(0.004, 0.0, 0.0), TOLD)] * COUNT
    assert scan_jumps(steps, FIRST, creeps, POSES, 1.0) == []


@pytest.mark.parametrize("status", [StepStatus.BROKEN, StepStatus.CARRIED])
def test_what_no_scan_placed_has_not_jumped_against_the_wheels(status):
    steps = with_status(driven(steps_with(0.6)), AT, status)
    on = [ToldStep(SE2(STEP_M, 0.0, 0.0), TOLD)] * COUNT
    assert scan_jumps(steps, FIRST, on, POSES, 1.0) == []


@pytest.mark.parametrize(
    ("at", "fits"), [(AT + 1, 0.93), (AT - 2, 0.93), (AT - 3, 0.5), (AT, 0.95)]
)
def test_scans_that_fit_are_not_denied_by_wheels_that_were_doubted(at, fits):
    # where a robot dashes while its wheels lag, maps right to 2 cm failed
    steps = driven(steps_with(0.6))
    steps[FIRST + at] = replace(steps[FIRST + at], inlier_ratio=fits)
    on = [ToldStep(SE2(STEP_M, 0.0, 0.0), TOLD)] * COUNT
    on[AT + 2] = ToldStep(SE2(STEP_M + 0.6, 0.0, 0.0), TOLD)
    is_denied = fits < 0.94 and at > AT - 3
    assert bool(scan_jumps(steps, FIRST, on, POSES, 1.0, is_odometry_doubted=True)) is is_denied
    assert scan_jumps(steps, FIRST, on, POSES, 1.0)


@pytest.mark.parametrize(
    ("beside", "is_denied"), [(-3, False), (-1, False), (3, False), (-4, True), (4, True)]
)
def test_doubted_wheels_that_are_right_before_and_after_deny_scans_that_fit(beside, is_denied):
    # a door at the end of a corridor that opens between two scans: all of them fit, 0.39 m RMS and good
    steps = driven(steps_with(0.6))
    on = [ToldStep(SE2(STEP_M, 0.0, 0.0), TOLD)] * COUNT
    assert scan_jumps(steps, FIRST, on, POSES, 1.0, is_odometry_doubted=True)
    on[AT + beside] = ToldStep(SE2(STEP_M + 0.6, 0.0, 0.0), TOLD)
    said = scan_jumps(steps, FIRST, on, POSES, 1.0, is_odometry_doubted=True)
    assert bool(said) is is_denied
    on[AT + beside] = ToldStep(SE2(STEP_M, 0.0, 0.0), GUESS)
    said = scan_jumps(steps, FIRST, on, POSES, 1.0, is_odometry_doubted=True)
    assert bool(said) is is_denied


@pytest.mark.parametrize("jumps", [(20, 40), (15, 30, 45), range(4, 56, 8)])
def test_many_scans_that_jump_are_none_the_less_jumps(jumps):
    step_m = np.full(COUNT, STEP_M)
    for at in jumps:
        step_m[at] += 0.6
        step_m[at + 1] -= 0.6
    assert said_of(driven(step_m))


@pytest.mark.parametrize("at", [1, COUNT - 1])
def test_the_first_and_the_last_scan_may_have_jumped(at):
    step_m = np.full(COUNT, STEP_M)
    step_m[at] = 2.0
    assert said_of(driven(step_m))[0].startswith(f"at {5.0 + STEP_S * at:.2f} s")


def test_wheels_that_fell_silent_had_told_how_fast_the_robot_drives():
    at, step_m = 50, np.full(COUNT, STEP_M)
    step_m[at] += 0.9
    step_m[at + 1] -= 0.9
    steps = driven(step_m)
    told = [ToldStep(SE2.identity(), TOLD)] * 45
    told += [ToldStep(SE2.identity(), GUESS)] * (len(steps) - FIRST - len(told))
    assert scan_jumps(steps, FIRST, told, POSES, 1.0)[0].startswith(f"at {5.0 + STEP_S * at:.2f} s")


@pytest.mark.parametrize("beside", [-2, 1])
def test_a_scan_that_tells_nothing_beside_one_that_jumps_hides_it_not(beside):
    blind = with_status(driven(steps_with(0.6, -0.6)), AT + beside, StepStatus.CARRIED)
    assert said_of(blind)[0].startswith(f"at {5.0 + STEP_S * AT:.2f} s")
    # nor one that nobody placed, and which went as far
    blind = with_status(driven(steps_with(0.6, 0.6)), AT + 1, StepStatus.CARRIED)
    assert said_of(blind)
    # between two such scans nothing tells how the robot went
    assert said_of(with_status(blind, AT - 2, StepStatus.CARRIED)) == []


def test_scans_that_were_searched_for_jump_and_those_that_nobody_placed_do_not():
    jumped = driven(steps_with(0.5))
    assert said_of(with_status(jumped, AT, StepStatus.SEARCHED))
    for at in (AT - 1, AT):
        assert said_of(with_status(jumped, at, StepStatus.CARRIED)) == []


def test_a_way_that_nothing_measured_is_no_jump_beside_those_that_were():
    """A robot that was lifted: its wheels are not believed there, and scans alone say how far."""
    guess, told = (ToldStep(SE2.identity(), one) for one in (GUESS, TOLD))
    one = [guess if at == AT else told for at in range(COUNT)]
    assert scan_jumps(driven(steps_with(0.5)), FIRST, one, POSES, 1.0) == []
    # and what was measured is none beside those that were not
    others = [told if at == AT else guess for at in range(COUNT)]
    assert scan_jumps(driven(steps_with(0.5)), FIRST, others, POSES, 1.0) == []


def test_how_fast_a_robot_drives_is_known_after_a_while():
    steps = driven(steps_with(0.5))
    # the one that jumped and its neighbours, of whom one is apart as well, say nothing of it
    assert said_of(steps[FIRST + AT - 12 :][: FIRST + 20]) == []
    assert said_of(steps[FIRST + AT - 12 :][: FIRST + 24])


def test_robot_that_is_mostly_slow_or_stands_is_as_fast_as_it_drives():
    step_m = np.zeros(600)
    step_m[100:125] = 0.7
    assert said_of(driven(step_m)) == []
    step_m = steps_with(0.31)
    step_m[10:20] = 0.25
    assert said_of(driven(step_m)) == []


def test_a_few_fast_steps_are_not_how_it_drives():
    step_m = steps_with(0.4)
    step_m[10:12] = 0.35
    assert said_of(driven(step_m))


def test_brief_interval_is_as_brief_as_scans_come():
    step_m = np.full(COUNT, 0.5)
    close = driven(step_m)
    close[FIRST + AT] = replace(close[FIRST + AT], time_s=close[FIRST + AT - 1].time_s + 0.001)
    assert said_of(close) == []
    # 0.9 m in 0.18 s are three times as fast as others, in 0.3 s were not
    step_m[AT] = 0.9
    brief = [
        replace(one, time_s=one.time_s - 0.12 * (at >= FIRST + AT))
        for at, one in enumerate(driven(step_m))
    ]
    assert said_of(brief)


def test_it_is_the_jump_that_is_told_and_not_a_pause():
    late = [
        replace(one, time_s=one.time_s + 5.0 * (at >= FIRST + 20))
        for at, one in enumerate(driven(steps_with(0.5)))
    ]
    assert said_of(late)[0].startswith(f"at {10.0 + STEP_S * AT:.2f} s")

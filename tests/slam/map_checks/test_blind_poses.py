"""Where scans were taken that tell nothing, the wheels have to tell."""

from dataclasses import replace

import numpy as np
import pytest

from slam import SE2
from slam.frontend.keyframes import FrontEndStep, StepStatus
from slam.frontend.told_steps import ToldStep
from slam.map_checks.blind_poses import _known, unknown_blind_poses

BLIND, STEP = 16, SE2(0.3, 0.0, 0.0)
FIRST = 4
"""Scans of a session before: seen, blind twice, seen."""
OFFSET = SE2(0.0, -1.0, 0.0)
"""Of the last scan, as seen from its keyframe."""
POSES = np.array([[5.0, 5.0, 0.0], [0.0, 0.0, 0.0], [STEP.x * BLIND, 1.0, 0.0]])
GUESS = 100.0 * np.eye(3)


def steps_of(seen: StepStatus = StepStatus.MATCHED) -> list[FrontEndStep]:
    """A session before, and one: seen, blind all along but for the last scan."""
    T = SE2.identity()
    before = [step_of(-10.0 + k, 0, seen) for k in range(FIRST)]
    before[1:3] = [replace(one, status=StepStatus.CARRIED) for one in before[1:3]]
    first = FrontEndStep(2.0, 1, T, T, StepStatus.MATCHED, 1.0, True, session=1)
    blind = [step_of(3.0 + k, 1, StepStatus.CARRIED) for k in range(BLIND - 1)]
    last = replace(step_of(2.0 + BLIND, 2, seen), T_keyframe_base=OFFSET)
    return [*before, first, *blind, last]


def step_of(time_s: float, keyframe: int, status: StepStatus) -> FrontEndStep:
    T = SE2.identity()
    return FrontEndStep(time_s, keyframe, T, T, status, 1.0, False, session=1)


def told_by(sigma_m: float, step: SE2 = STEP, sigma_rad: float = 1e-6) -> list[ToldStep]:
    """To the first scan of the session nobody knows, and it does not matter."""
    covariance = np.diag(np.square([sigma_m, sigma_m, sigma_rad]))
    return [ToldStep(SE2(9.0, 9.0, 1.0), GUESS), *[ToldStep(step, covariance)] * BLIND]


def said_of(
    told: list[ToldStep],
    steps: list[FrontEndStep] | None = None,
    poses: np.ndarray = POSES,
    noise: float = 1.0,
) -> list[str]:
    return unknown_blind_poses(steps or steps_of(), FIRST, told, poses, noise)


@pytest.mark.parametrize(("middle_m", "is_known"), [(0.19, True), (0.21, False)])
def test_middle_of_a_blind_way_is_known_as_well_as_a_bridge_is(middle_m, is_known):
    # Brownian bridge: a quarter of the variance of the end is left in the middle
    sigma_m = 2.0 * middle_m / np.sqrt(BLIND)
    said = said_of(told_by(sigma_m))
    assert (said == []) is is_known
    if not is_known:
        assert said[0].startswith("from 2.00 to 18.00 s no scan tells where the robot is")
        assert "leave open 0.2 m of where" in said[0]


def test_heading_that_is_unsure_is_a_way_aside_that_is():
    # of an integrated bridge, held at both ends, 1/192 of T^3 is left: sigma 0.25 m
    way_m, middle_m = STEP.x * BLIND, 0.25
    sigma_rad = middle_m * np.sqrt(192.0 / BLIND) / way_m
    assert said_of(told_by(1e-6, sigma_rad=sigma_rad))
    assert said_of(told_by(1e-6, sigma_rad=0.5 * sigma_rad)) == []


def test_wheels_are_as_noisy_as_scans_show_elsewhere():
    assert said_of(told_by(0.05)) == []
    assert said_of(told_by(0.05), noise=5.0)


def test_wheels_that_end_elsewhere_are_noisier_than_they_say():
    moved = POSES + np.array([[0.0, 0.0, 0.0], [0.0, 0.0, 0.0], [1.0, 0.0, 0.0]])
    assert said_of(told_by(0.05), poses=moved)


def test_where_the_way_is_sure_it_does_not_matter_how_unsure_it_is_elsewhere():
    # one step that nobody knows: what is before it is known from before, what is after from after
    sure, unsure = told_by(0.001), told_by(0.12)
    assert said_of([*sure[:9], unsure[9], *sure[10:]]) == []
    assert said_of(unsure)


@pytest.mark.parametrize("at", [1, 8])
def test_a_step_that_nobody_measured_says_nothing_of_the_others(at):
    """A jump, or a record that is lost: what is blind was called known, and was 0.5 to 0.7 m off."""
    told = told_by(0.12)
    told[at] = replace(told[at], covariance=GUESS)
    assert said_of(told)
    assert said_of(told, noise=0.01) == []


@pytest.mark.parametrize("motion", [SE2.identity(), STEP])
def test_what_nobody_measured_may_have_led_anywhere_however_good_the_wheels_are(motion):
    """A jump of 10 m: the others are no worse for it."""
    told = told_by(0.3)
    told[8] = ToldStep(motion, GUESS)
    moved = POSES + np.array([[0.0, 0.0, 0.0], [0.0, 0.0, 0.0], [10.0, 0.0, 0.0]])
    assert said_of(told, poses=moved, noise=0.01) == []
    assert said_of(told_by(0.3), poses=moved, noise=0.01)


@pytest.mark.parametrize("count", [1, 3])
def test_log_that_ends_before_a_scan_tells_all_of_its_place_has_gone_blind_all_the_same(count):
    """Of 68 drives that ended so 20 were called good, 12 of them wrong by up to 1.8 m."""
    told, (*steps, last) = told_by(0.25), steps_of()
    for at in range(count):
        steps.append(replace(last, time_s=last.time_s + at, is_open=True))
    told += [told[-1]] * (count - 1)
    (said,) = said_of(told, steps)
    assert said.startswith("from 2.00 to")
    # that is not known any better by what comes after, and scans that see nothing at all
    steps.append(replace(last, time_s=last.time_s + count, status=StepStatus.CARRIED))
    assert said_of([*told, told[-1]], steps) == [said]


def test_longest_of_blind_ways_is_told():
    steps, told = steps_of(), told_by(0.25)
    steps[FIRST + 12] = replace(
        steps[FIRST + 12], status=StepStatus.MATCHED, T_keyframe_base=SE2(STEP.x * 12, 0.0, 0.0)
    )
    (said,) = said_of(told, steps)
    assert said.startswith("from 2.00 to 14.00 s")


def test_robot_of_which_nothing_measured_the_way_goes_on_evenly_for_a_while_at_most():
    told = [replace(one, covariance=GUESS, motion=SE2.identity()) for one in told_by(0.1)]
    assert said_of(told)
    steps = steps_of()
    seen = [
        replace(one, status=StepStatus.MATCHED, T_keyframe_base=SE2(STEP.x * k, 0.0, 0.0))
        if k % 2 == 0 and k < BLIND
        else one
        for k, one in enumerate(steps[FIRST:])
    ]
    # a scan here and there, a tenth of a second from the next
    seen = [replace(one, time_s=0.1 * one.time_s) for one in seen]
    assert said_of(told, [*steps[:FIRST], *seen]) == []
    # or with stamps that go back
    seen = [replace(one, time_s=-100.0 * one.time_s) for one in seen]
    assert said_of(told, [*steps[:FIRST], *seen]) == []


@pytest.mark.parametrize(("count", "is_known"), [(6, True), (8, False)])
def test_robot_that_goes_on_evenly_is_known_for_a_few_scans(count, is_known):
    # each leaves open 0.15 m, and half the root of their number is left in the middle; a turn of 0.1 rad
    # at each hardly matters so soon
    told = [replace(one, covariance=GUESS, motion=SE2.identity()) for one in told_by(0.1)]
    steps = steps_of()[: FIRST + count + 1]
    end = SE2(STEP.x * count, 0.0, 0.0)
    steps[-1] = replace(steps[-1], status=StepStatus.MATCHED, T_keyframe_base=end)
    steps = [replace(one, time_s=0.1 * one.time_s) for one in steps]
    assert (said_of(told, steps) == []) is is_known


def test_robot_that_stands_before_a_blocked_laser_goes_nowhere():
    poses = np.array([[5.0, 5.0, 0.0], [0.0, 0.0, 0.0], [0.0, 1.0, 0.0]])
    stands = told_by(0.2, step=SE2.identity())
    assert said_of(stands, poses=poses) == []
    # one whose wheels say so, and which is elsewhere in the end
    assert said_of(stands, poses=POSES)


def test_robot_that_turns_on_the_spot_does_not_stand():
    turn = SE2(0.0, 0.0, 0.05)
    end = SE2(0.0, 0.0, turn.theta * BLIND) @ OFFSET.inverse()
    poses = np.array([POSES[0], POSES[1], end.as_array()])
    assert said_of(told_by(0.2, step=turn), poses=poses)
    assert said_of(told_by(0.05, step=turn), poses=poses) == []


def test_the_last_pose_is_that_of_a_scan_that_sees():
    told = told_by(0.1)[1:]
    assert len(list(_known(told, SE2(STEP.x * BLIND, 0.0, 0.0)))) == BLIND - 1


def test_only_scans_that_tell_nothing_of_this_session_are_asked():
    told = told_by(0.25)
    assert said_of(told)
    seen = [
        replace(
            one, status=StepStatus.MATCHED, T_keyframe_base=SE2(STEP.x * (at - FIRST), 0.0, 0.0)
        )
        if (at - FIRST) % 2 == 0 and 0 <= at - FIRST < BLIND
        else one
        for at, one in enumerate(steps_of())
    ]
    assert said_of(told, seen) == []
    # nor is a way known without its end
    assert said_of(told, steps_of()[:-1]) == []
    assert unknown_blind_poses([], 0, [], POSES, 1.0) == []
    # nor blind between two scans that see, one after the other
    assert said_of(told, [replace(one, status=StepStatus.MATCHED) for one in steps_of()]) == []


def test_scan_that_is_a_keyframe_all_the_same_is_an_end():
    told, steps = told_by(0.12), steps_of()
    steps[FIRST + 8] = replace(
        steps[FIRST + 8], is_keyframe=True, T_keyframe_base=SE2(STEP.x * 8, 0.0, 0.0)
    )
    assert said_of(told)
    assert said_of(told, steps) == []


@pytest.mark.parametrize("is_whole", [True, False])
def test_where_what_broke_off_lies_is_not_known_before_the_map_holds_together(is_whole):
    broken, told = steps_of(StepStatus.BROKEN), told_by(1.0)
    seen = steps_of(StepStatus.MATCHED)
    assert bool(unknown_blind_poses(broken, FIRST, told, POSES, 1.0, is_whole)) is is_whole
    assert unknown_blind_poses(seen, FIRST, told, POSES, 1.0, is_whole)


@pytest.mark.parametrize(("has_wheels", "is_known"), [(True, False), (False, True)])
def test_scans_that_leave_open_how_far_wheels_that_dropped_out_went_tell_nothing(
    has_wheels, is_known
):
    # aces, odometry stuck for ten seconds along a corridor: two scans half a metre off, and good
    steps, (sure,) = steps_of(), told_by(0.001)[-1:]
    steps[FIRST + 1 : -1] = [
        replace(one, status=StepStatus.MATCHED, is_open=True) for one in steps[FIRST + 1 : -1]
    ]
    assert said_of([ToldStep(STEP, GUESS), *[sure] * BLIND], steps) == []
    told = [sure, *[ToldStep(SE2.identity(), GUESS)] * (BLIND - 1), sure if has_wheels else None]
    told[-1] = told[-1] or ToldStep(SE2.identity(), GUESS)
    assert (said_of(told, steps) == []) is is_known


@pytest.mark.parametrize("is_open", [True, False])
def test_wheels_that_say_where_they_led_and_not_how_leave_open_what_scans_leave_open(is_open):
    # odometry told late by 8 s: keyframes of aces between walls that look the same, 0.5 m off
    seen = [
        replace(one, status=StepStatus.MATCHED, is_keyframe=True, keyframe=1, is_open=is_open)
        for one in steps_of()[FIRST:-1]
    ]
    steps = [*steps_of()[:FIRST], replace(seen[0], is_open=False), *seen[1:], steps_of()[-1]]
    assert bool(said_of(told_by(0.15), steps)) is is_open
    # less of a step is told well enough: see `open_ways`
    assert said_of(told_by(0.09), steps, noise=10.0) == []

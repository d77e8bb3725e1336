"""What a drive says against its map: wheels that stood still while the scans show a motion."""

import math

import numpy as np
import pytest

from slam import SE2, LaserScan, Measurement
from slam.frontend.keyframes import FrontEndStep, StepStatus
from slam.map_checks.drive_monitor import DriveMonitor

SCAN = LaserScan(0.0, np.radians([-1.0, 0.0, 1.0]), np.ones(3))


def objections(by_wheels: SE2, by_scan: SE2, *, is_open: bool, covariance=None) -> list[str]:
    """After one scan, matched there."""
    return objections_to([(by_wheels, by_scan)], is_open=is_open, covariance=covariance)


def objections_to(motions, *, is_open: bool, covariance=None) -> list[str]:
    """After scans from 7 s on, each with its motion by the wheels and that to where it was matched."""
    return objections_where([(*one, is_open) for one in motions], 0.2, covariance)


def objections_where(motions, step_s: float, covariance=None) -> list[str]:
    """After scans, each with its motions and whether it leaves a direction open."""
    monitor, T, steps = DriveMonitor(5.0), SE2(4.0, 1.0, 0.2), []
    for k, (by_wheels, by_scan, is_open) in enumerate(motions):
        T_before, T = T, T @ by_scan
        time_s = 7.0 + step_s * k
        steps.append(FrontEndStep(time_s, 0, T, T, StepStatus.MATCHED, 0.9, True, is_open=is_open))
        measurement = Measurement(time_s, by_wheels, SCAN, covariance)
        monitor.take(measurement, T_before, steps[-1], measurement.motion_covariance[0, 0])
    return monitor.objections(steps, lambda *_: math.inf)


@pytest.mark.parametrize("by_scan", [SE2(0.0, 0.0, 0.07), SE2(0.0, 0.1, 0.0)])
def test_a_motion_that_the_wheels_deny_may_have_been_longer_where_scans_leave_a_way_open(by_scan):
    (said,) = objections(SE2.identity(), by_scan, is_open=True)
    assert said.startswith("at 7.00 s the wheels stood still, and the robot did not")
    assert not objections(SE2.identity(), by_scan, is_open=False)
    assert not objections(SE2(0.05, 0.0, 0.0), by_scan, is_open=True)
    # scans alone: nothing was denied
    assert not objections(SE2.identity(), by_scan, is_open=True, covariance=np.eye(3))


def test_a_robot_that_stands_may_be_placed_a_hair_aside():
    # 28 scans of intel: by 6 mm and 2 mrad at most
    assert not objections(SE2.identity(), SE2(0.02, 0.0, 0.006), is_open=True)


STOOD, DROVE = (SE2.identity(), SE2.identity()), (SE2(0.05, 0.0, 0.0), SE2(0.05, 0.0, 0.0))
UNTOLD = SE2.identity(), SE2(0.0, 0.0, 0.3)


def test_odometry_that_lags_denies_nothing():
    # five equal records of mit-csail, then a turn of 86 degrees at once, of which scans had shown 69
    told_late = SE2(0.02, 0.0, 1.5), SE2(0.02, 0.0, 0.3)
    assert not objections_to([DROVE, *[UNTOLD] * 4, told_late, DROVE], is_open=True)
    # by a fan of 120 degrees, of which they had shown 53 and 16: the wheels tell of a fifth more
    told_more = SE2(0.467, 0.006, math.radians(85.5)), SE2(0.15, -0.15, math.radians(15.6))
    shown = SE2.identity(), SE2(0.08, 0.0, math.radians(53.2 / 4))
    assert not objections_to([DROVE, *[shown] * 4, told_more, DROVE], is_open=True)
    # by one of 90 degrees, which drew some of them half a metre aside
    aside = SE2.identity(), SE2(0.13, 0.05, math.radians(53.2 / 4))
    assert objections_to([DROVE, *[aside] * 4, told_more, DROVE], is_open=True)


def test_a_turn_that_wheels_and_scans_tell_alike_makes_up_for_none_before_it():
    # wheels that stalled over a metre of a bare corridor, and woke while the robot looked around: 1 m off and good
    stalled = SE2.identity(), SE2(0.005, 0.0, 0.03)
    around = SE2(0.0, 0.0, 0.5), SE2(0.0, 0.0, 0.5)
    assert objections_to([DROVE, *[stalled] * 4, around, DROVE], is_open=True)


def test_scans_of_a_robot_that_stood_before_it_turned_have_shown_no_way():
    # 200 scans, a few millimetres this way and that
    jitter = [(SE2.identity(), SE2(0.003 * (-1.0) ** k, 0.0, 0.0)) for k in range(200)]
    told_late = SE2(0.02, 0.0, 1.5), SE2(0.02, 0.0, 0.3)
    assert not objections_to([DROVE, *jitter, *[UNTOLD] * 4, told_late, DROVE], is_open=True)


@pytest.mark.parametrize(
    "after",
    [
        [],  # nobody knows what the next record would have told
        [DROVE],
        [STOOD, DROVE],
        [(SE2(0.02, 0.0, 0.7), SE2(0.02, 0.0, 0.3))],  # a third of it
        [(SE2(0.02, 0.0, -0.9), SE2(0.02, 0.0, 0.3))],
    ],
)
def test_wheels_that_never_tell_a_turn_denied_it(after):
    (said,) = objections_to([DROVE, *[UNTOLD] * 4, *after], is_open=True)
    assert said.startswith("at 7.20 s the wheels stood still")


def test_first_of_several_denials_is_told():
    untold_way = SE2.identity(), SE2(0.2, 0.0, 0.0)
    late = SE2(0.0, 0.0, 0.3), SE2.identity()
    (said,) = objections_to([UNTOLD, late, untold_way, DROVE, UNTOLD], is_open=True)
    assert said.startswith("at 7.40 s")  # the turn was told, a way never is


@pytest.mark.parametrize(("step_s", "is_denied"), [(0.2, False), (1.0, True)])
@pytest.mark.parametrize("after", [STOOD, DROVE])
def test_scans_that_see_the_way_just_before_and_after_leave_nothing_to_deny(
    step_s, is_denied, after
):
    # one scan of mit-csail, barely open, while its odometry stood still for five
    motions = [(*DROVE, False), (*UNTOLD, True), (*after, False), (*DROVE, False)]
    assert bool(objections_where(motions, step_s)) is is_denied
    # what was denied before is no less so
    motions = [(*UNTOLD, True), (*DROVE, True), *motions]
    assert objections_where(motions, step_s)


@pytest.mark.parametrize(("sigma_m", "is_told"), [(0.3, True), (1.4, False)])
def test_way_that_neither_scans_nor_wheels_tell_may_be_told_by_loops(sigma_m, is_told):
    # a scan of keyframe 3 sees where the robot is, those of 4 to 9 leave it open, that of 10 sees again
    monitor, asked = DriveMonitor(5.0), list[tuple[int, int]]()
    steps = [
        FrontEndStep(
            float(k), k, SE2.identity(), SE2(0.3 * k, 0.0, 0.0), StepStatus.MATCHED, 0.9, True,
            is_open=4 <= k < 10,
        )
        for k in range(14)
    ]  # fmt: skip
    for step in steps:
        measurement = Measurement(step.time_s, SE2.identity(), SCAN, 9.0 * np.eye(3))
        monitor.take(measurement, step.T_map_base, step, 9.0)

    def between_m(one: int, other: int) -> float:
        asked.append((one, other))
        return sigma_m

    said = monitor.objections(steps, between_m)
    assert asked == [(3, 10)]
    assert (said == []) is is_told
    if not is_told:
        assert said[0].startswith("from 3.00 to 9.00 s neither scans nor wheels tell how far")


@pytest.mark.parametrize(
    ("sees", "ends"),
    [
        ((), [(3, 12)]),
        ((7,), [(3, 12)]),
        ((7, 8), [(3, 12)]),
        ((7, 8, 9), [(3, 7)]),
        # from the third of them on
        ((5, 6, 7), [(7, 12)]),
    ],
)
def test_one_scan_of_many_that_seems_to_see_does_not_end_what_nothing_measured(sees, ends):
    # 16 m off and good: of 37 scans between bare walls one fitted in one place by noise
    monitor, asked = DriveMonitor(5.0), list[tuple[int, int]]()
    steps = [
        FrontEndStep(
            float(k), k, SE2.identity(), SE2(0.3 * k, 0.0, 0.0), StepStatus.MATCHED, 0.9, True,
            is_open=4 <= k < 12 and k not in sees,
        )
        for k in range(16)
    ]  # fmt: skip
    for step in steps:
        measurement = Measurement(step.time_s, SE2.identity(), SCAN, 9.0 * np.eye(3))
        monitor.take(measurement, step.T_map_base, step, 9.0)
    monitor.objections(steps, lambda *ends: asked.append(ends) or 0.0)
    assert asked == ends


def test_where_wheels_measured_the_way_one_scan_sees_where_the_robot_is():
    monitor, asked = DriveMonitor(1.0), list[tuple[int, int]]()
    steps = [
        FrontEndStep(
            float(k), k, SE2.identity(), SE2(0.3 * k, 0.0, 0.0), StepStatus.MATCHED, 0.9, True,
            is_open=k % 8 > 0,
        )
        for k in range(17)
    ]  # fmt: skip
    for step in steps:
        measurement = Measurement(step.time_s, SE2(0.3, 0.0, 0.0), SCAN, 0.08 * np.eye(3))
        monitor.take(measurement, step.T_map_base, step, 0.08)
    assert monitor.objections(steps, lambda *ends: asked.append(ends) or 9.0) == []
    assert asked == []


@pytest.mark.parametrize("is_open", [True, False])
def test_how_far_odometry_jumped_the_scan_itself_tells_or_nobody(is_open):
    # 1.9 m back at once between walls that look the same: much less than wheels are believed for, and
    # loops to what looks the same tie it wrongly
    monitor, steps = DriveMonitor(5.0), []
    for k in range(8):
        step = FrontEndStep(
            float(k), k, SE2.identity(), SE2(0.3 * k, 0.0, 0.0), StepStatus.MATCHED, 0.9, True,
            is_open=is_open and 3 <= k < 6,
        )  # fmt: skip
        steps.append(step)
        noise = (2.0 if k == 4 else 0.05) ** 2 * np.eye(3)
        measurement = Measurement(step.time_s, SE2(0.3, 0.0, 0.0), SCAN, noise)
        monitor.take(measurement, step.T_map_base @ SE2(-0.3, 0.0, 0.0), step, 0.05**2, k == 4)
    assert bool(monitor.objections(steps, lambda *_: 0.1)) is is_open


@pytest.mark.parametrize("jumped_at", [4, 5])
def test_a_jump_where_a_scan_saw_nothing_is_not_forgotten(jumped_at):
    # at 4, somebody stood before the laser, and at 5 a scan sees the end of bare walls again
    monitor, steps = DriveMonitor(5.0), []
    for k in range(8):
        status = StepStatus.CARRIED if k == 4 else StepStatus.MATCHED
        steps.append(
            FrontEndStep(
                float(k), k, SE2.identity(), SE2(0.3 * k, 0.0, 0.0), status, 0.9, k != 4,
                is_open=3 <= k < (6 if jumped_at == 4 else 5),
            )
        )  # fmt: skip
        noise = (2.0 if k == jumped_at else 0.05) ** 2 * np.eye(3)
        measurement = Measurement(float(k), SE2(0.3, 0.0, 0.0), SCAN, noise)
        T_before = steps[-1].T_map_base @ SE2(-0.3, 0.0, 0.0)
        monitor.take(measurement, T_before, steps[-1], 0.05**2, k == jumped_at)
    (said,) = monitor.objections(steps, lambda *_: 0.1)
    assert "neither scans nor wheels tell how far" in said

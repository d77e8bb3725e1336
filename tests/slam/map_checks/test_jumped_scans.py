"""Scans between keyframes that jumped by scans alone are put where they fit on an even way; no others are."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from slam.beams import Beams
from slam.frontend.keyframes import FrontEndStep, Keyframe, StepStatus
from slam.frontend.told_steps import ToldStep
from slam.map_checks.jumped_scans import with_jumped_put_back
from slam.map_checks.scan_jumps import jumps_between
from slam.mapping import Mapper
from slam.se2 import SE2
from slam.surface.surface_map import SurfaceMapConfig
from slam.surface.views import Glances
from tests.slam import ring
from tests.slam.synthetic import box, room, scan_of

CORRIDOR = np.concatenate([room(0.0, -1.0, 10.5, 1.0), box(8.5, 0.7, 9.0, 1.0)])
BARE = np.array([[[-40.0, y], [60.0, y]] for y in (-1.0, 1.0)])
COUNT, STEP_M, FIRST = 32, 0.2, 1
AT = 15
DRAWN = SE2(-0.5, 0.0, 0.0)
GUESS, SURE = 100.0 * np.eye(3), 1e-4 * np.eye(3)


def way(at: int) -> SE2:
    return SE2(2.0 + STEP_M * at, 0.0, 0.0)


def beams_at(pose: SE2, walls: np.ndarray) -> Beams:
    rng = np.random.default_rng(7)
    return Beams.of(scan_of(walls, pose, rng, 0.01, range_max_m=20.0), SE2.identity())


def with_somebody(ahead_m: float = 1.2) -> np.ndarray:
    x = way(AT).x + ahead_m
    return np.concatenate([CORRIDOR, box(x, -0.15, x + 0.2, 0.15)])


class Drive:
    """Along walls, a keyframe at each so many scans; one sees others, and some lie where they were not taken."""

    def __init__(
        self,
        off: dict[int, SE2] | None = None,
        every: int = 2,
        walls: np.ndarray = CORRIDOR,
        seen: np.ndarray | None = None,
    ) -> None:
        self.keyframes, self.steps, self.glances = list[Keyframe](), list[FrontEndStep](), {}
        off, seen = {AT: DRAWN} if off is None else off, with_somebody() if seen is None else seen
        self.steps.append(replace(step_of(-1.0, 0, SE2.identity(), False), session=0))
        for at in range(COUNT):
            beams, k = beams_at(way(at), seen if at == AT else walls), at // every
            if is_new := at % every == 0:
                T_before = SE2(every * STEP_M, 0.0, 0.0)
                self.keyframes.append(
                    Keyframe(float(at), way(at), T_before, SURE, beams.points, beams, False)
                )
                since = Glances()
            T = way(every * k).between(way(at)) @ off.get(at, SE2.identity())
            if not is_new:
                since.take(T, beams)
            self.glances[k] = since.kept
            self.steps.append(step_of(float(at), k, T, is_new))
        self.poses = np.array([one.T_map_base.as_array() for one in self.keyframes])
        self.told = [ToldStep(SE2.identity(), GUESS)] * COUNT

    def put_back(self) -> list[FrontEndStep]:
        return with_jumped_put_back(
            self.steps, FIRST, self.told, self.keyframes, self.poses, self.glances,
            SurfaceMapConfig(),
        )  # fmt: skip

    def has_jumped(self) -> bool:
        jumps = jumps_between(self.steps[FIRST:], self.told, self.poses, 1.0)
        return bool(jumps.by_scans_alone.any())

    def is_put_back(self, within_m: float = 0.02) -> bool:
        """Whether scans are, where they were taken; or all of them stay."""
        found = self.put_back()
        if all(one is other for one, other in zip(found, self.steps, strict=True)):
            return False
        for at in range(COUNT):
            assert found[FIRST + at].placed(self.poses).is_near(way(at), within_m, 0.01)
        return True


def step_of(time_s: float, k: int, T: SE2, is_keyframe: bool) -> FrontEndStep:
    return FrontEndStep(time_s, k, T, T, StepStatus.MATCHED, 1.0, is_keyframe, session=1)


def standing(every: int) -> dict[int, SE2]:
    """Scans after the keyframe at half the way that seem to have been taken where it was."""
    start = COUNT // 2 // every * every
    return {
        at: way(at).between(way(start)) @ SE2(1e-6 * at, 0.0, 0.0)
        for at in range(start + 1, start + every)
    }


@pytest.mark.parametrize("drawn", [DRAWN, SE2(0.5, 0.0, 0.0), SE2(-0.3, 0.05, 0.05)])
def test_scan_that_somebody_drew_aside_is_put_where_it_fits_without_him(drawn):
    """none 102012, offices: 0.50 m off by 58 points of somebody a metre ahead, of 13 of the end of the corridor."""
    drive = Drive({AT: drawn})
    assert drive.has_jumped()
    assert drive.is_put_back()
    # both its poses, on the map and as the front end had it, go the same way
    step = drive.put_back()[FIRST + AT]
    assert step.T_map_base.is_near(step.T_keyframe_base, 1e-9, 1e-9)


@pytest.mark.parametrize("every", [4, 8])
def test_scans_that_seemed_to_stand_until_the_next_keyframe_are_put_on_the_way(every):
    """intel played backwards without wheels: eight scans of a corridor, up to 1.08 m off."""
    drive = Drive(standing(every), every)
    assert drive.has_jumped()
    assert drive.is_put_back()


def test_scan_of_which_nothing_was_kept_lies_evenly_between_those_beside_it():
    drive = Drive(standing(8), 8)
    k = COUNT // 2 // 8
    drive.glances[k] = [one for at, one in enumerate(drive.glances[k]) if at != 3]
    assert drive.is_put_back()
    drive.glances[k] = ()
    assert not drive.is_put_back()


def test_scan_that_lies_near_the_way_stays():
    assert not Drive({AT: SE2(-0.15, 0.0, 0.0)}).is_put_back()


def test_scan_that_fits_nowhere_on_the_way_stays():
    assert not Drive(seen=room(-1.0, -6.0, 9.0, 3.0)).is_put_back()
    # with more of people in view than of walls
    crowd = [box(way(AT).x + 1.0, y, way(AT).x + 1.2, y + 0.3) for y in np.arange(-0.9, 0.9, 0.35)]
    around = [box(way(AT).x - 0.6, y, way(AT).x + 0.9, y + 0.1) for y in (-0.8, 0.7)]
    assert not Drive(seen=np.concatenate([CORRIDOR, *crowd, *around])).is_put_back()


def test_scans_that_leave_the_way_open_stay():
    """Between bare walls nobody knows where they were taken."""
    assert not Drive(walls=BARE, seen=BARE).is_put_back()
    assert not Drive(standing(8), 8, BARE, BARE).is_put_back()


@pytest.mark.parametrize("every", [2, 8])
@pytest.mark.parametrize("shift_m", [0.5, 0.8])
def test_scans_at_which_all_is_shifted_stay(shift_m, every):
    """The next door of a corridor taken for this one: whatever lies between would hide that."""
    drive = Drive({}, every, seen=CORRIDOR)
    for k in range(COUNT // 2 // every + 1, len(drive.poses)):
        drive.poses[k, 0] += shift_m
    assert drive.has_jumped()
    assert not drive.is_put_back()


def test_open_scans_do_not_hide_a_shift():
    """Evenly between two keyframes they would: 0.5 m is little of 1.6 m."""
    drive = Drive({}, 8, seen=CORRIDOR)
    k = COUNT // 2 // 8
    open_ = Drive({}, 8, BARE, BARE)
    drive.glances[k] = (*drive.glances[k][:2], *open_.glances[k][2:5], *drive.glances[k][5:])
    drive.poses[k + 1 :, 0] += 0.5
    assert drive.has_jumped()
    assert not drive.is_put_back()


def test_nobody_is_put_back_against_wheels_that_were_there():
    for beside in (0, 1):
        drive = Drive()
        drive.told[AT + beside] = ToldStep(SE2.identity(), SURE)
        assert not drive.is_put_back()


def test_over_a_break_nobody_knows_the_way():
    drive = Drive()
    k = AT // 2 + 1
    drive.keyframes[k] = replace(drive.keyframes[k], is_break=True)
    assert not drive.is_put_back()


def test_scan_that_is_seen_from_another_than_the_keyframe_before_is_left_where_it_is():
    drive = Drive({AT: DRAWN})
    k, step = AT // 2, drive.steps[FIRST + AT]
    way_ = SE2.from_array(drive.poses[k + 1]).between(step.placed(drive.poses))
    drive.steps[FIRST + AT] = replace(step, keyframe=k + 1, T_keyframe_base=way_)
    assert drive.has_jumped()
    assert not drive.is_put_back()


def test_scan_that_nothing_placed_is_left_where_it_is():
    drive = Drive()
    drive.steps[FIRST + AT] = replace(drive.steps[FIRST + AT], status=StepStatus.CARRIED)
    assert not drive.is_put_back()


def test_mapper_puts_a_drawn_scan_back_on_the_finished_map():
    mapper = Mapper(ring.T_BASE_LASER)
    for one in ring.drive(ring.way(0.1, 0.1), np.random.default_rng(0)):
        mapper.update(replace(one, motion=SE2.identity(), motion_covariance=GUESS))
    drive = mapper._drive
    at = next(k for k in range(25, 40) if not drive.steps[k].is_keyframe)
    step = drive.steps[at]
    drawn = replace(
        step,
        T_keyframe_base=step.T_keyframe_base @ DRAWN,
        T_map_base=step.T_map_base @ DRAWN,
    )
    drive.steps[at] = drawn
    drive.front_end.glances[step.keyframe].move({step.T_keyframe_base: drawn.T_keyframe_base})
    slam_map = mapper.finish()
    assert not any("by scans alone" in one for one in slam_map.verdict.reasons)
    assert slam_map.steps[at].T_keyframe_base.is_near(step.T_keyframe_base, 0.02, 0.01)
    # nor is it shown where it was not
    ways = {one.T_keyframe_base for one in slam_map.keyframes[step.keyframe].glances}
    assert drawn.T_keyframe_base not in ways

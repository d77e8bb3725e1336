"""Scans seen from a keyframe that is put back: those that were right stay, those drawn with it go with it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from slam.backend.hindsight import right_strays
from slam.frontend.keyframes import FrontEndStep, StepStatus
from slam.frontend.told_steps import ToldStep
from slam.map_checks.followers import with_followers_left
from slam.mapping import Mapper
from slam.se2 import SE2
from tests.slam import ring

STEP, DRAWN = SE2(0.2, 0.0, 0.05), SE2(0.3, 0.1, 0.02)
SURE, GUESS = np.diag([4e-4, 4e-4, 4e-4]), 100.0 * np.eye(3)
FIRST, EVERY = 3, 3
RIGHT = (4, 5)  # since the second keyframe; those since the third were drawn with it
AT = 40


def drive() -> tuple[list[FrontEndStep], np.ndarray]:
    """Scans of two sessions, of the second each third one a keyframe, and the poses of these. The second and third
    keyframes were drawn aside and are put back; of the scans since, those of the second had been right."""
    steps = [step_of(float(at), 0, SE2.identity(), is_keyframe=at == 0) for at in range(FIRST)]
    poses, T = [SE2.identity()], SE2(3.0, 1.0, 0.4)
    for at in range(12):
        if at % EVERY == 0:
            poses.append(T)
        T_back = poses[-1].between(T)
        if at in RIGHT:
            T_back = DRAWN.inverse() @ T_back
        steps.append(step_of(10.0 + at, len(poses) - 1, T_back, is_keyframe=at % EVERY == 0))
        T = T @ STEP
    return steps, np.array([one.as_array() for one in poses])


def step_of(time_s: float, k: int, T: SE2, is_keyframe: bool) -> FrontEndStep:
    return FrontEndStep(time_s, k, T, T, StepStatus.MATCHED, 1.0, is_keyframe, session=int(k > 0))


def told_by(covariance: np.ndarray) -> list[ToldStep]:
    motion = STEP if covariance is SURE else SE2.identity()
    return [ToldStep(motion, covariance)] * 12


@pytest.mark.parametrize("covariance", [SURE, GUESS], ids=["wheels", "scans alone"])
@pytest.mark.parametrize("is_timed", [True, False])
def test_scans_that_were_right_stay_and_those_drawn_with_their_keyframe_go_with_it(
    covariance, is_timed
):
    steps, poses = drive()
    if not is_timed:
        steps = [replace(one, time_s=0.0) for one in steps]
    moved = {2: DRAWN, 3: DRAWN}
    found = with_followers_left(steps, FIRST, told_by(covariance), poses, moved)
    for at, (one, step) in enumerate(zip(found, steps, strict=True), start=-FIRST):
        assert (one is step) == (at not in RIGHT)
        if at >= 0:
            T_right = SE2(3.0, 1.0, 0.4)
            for _ in range(at):
                T_right = T_right @ STEP
            assert one.placed(poses).is_near(T_right, 1e-9, 1e-9)


def test_scans_of_keyframes_that_did_not_move_stay_as_they_are():
    steps, poses = drive()
    assert with_followers_left(steps, FIRST, told_by(GUESS), poses, {}) == steps
    assert with_followers_left(steps, FIRST, told_by(GUESS), poses, {3: DRAWN, 4: DRAWN}) == steps


def test_scans_that_are_seen_from_others_than_the_keyframe_before_stay_as_they_are():
    steps, poses = drive()
    for at in RIGHT:  # as if their own keyframe was let go
        steps[FIRST + at] = replace(steps[FIRST + at], keyframe=4)
    assert with_followers_left(steps, FIRST, told_by(SURE), poses, {2: DRAWN, 3: DRAWN}) == steps


def by_scans_alone() -> Mapper:
    """Half of the ring."""
    mapper = Mapper(ring.T_BASE_LASER)
    for one in ring.drive(ring.way(0.5, 0.1), np.random.default_rng(0)):
        mapper.update(replace(one, motion=SE2.identity(), motion_covariance=GUESS))
    return mapper


def test_mapper_puts_a_keyframe_back_without_the_scans_that_follow_it():
    """none 102012, offices: two scans 0.3 m off, since their keyframe had been, and was not any more."""
    mapper = by_scans_alone()
    drive = mapper._drive
    steps, front_end, poses = drive.steps, drive.front_end, drive.graph.poses.copy()
    followers = [at for at, one in enumerate(steps) if one.keyframe == AT and not one.is_keyframe]
    assert followers
    right = [steps[at].placed(poses) for at in followers]
    T_right = SE2.from_array(poses[AT])
    T_drawn = T_right @ SE2(-0.5, 0.0, 0.0)
    poses[AT] = T_drawn.as_array()
    drive.graph.renew(drive.graph.keyframes, [], poses)
    back = T_drawn.between(T_right)
    for at in followers:
        steps[at] = replace(steps[at], T_keyframe_base=back @ steps[at].T_keyframe_base)
    front_end.glances[AT]._kept = [
        one._replace(T_keyframe_base=back @ one.T_keyframe_base)
        for one in front_end.glances[AT].kept
    ]
    right_strays(drive)
    poses = drive.graph.poses
    assert SE2.from_array(poses[AT]).is_near(T_right, 0.03, 0.01)
    for at, T in zip(followers, right, strict=True):
        assert drive.steps[at].placed(poses).is_near(T, 0.01, 0.01)
    # what they saw is where they are
    ways = {drive.steps[at].T_keyframe_base for at in followers}
    assert {one.T_keyframe_base for one in front_end.glances[AT].kept} == ways

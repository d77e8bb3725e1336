"""Keyframes off the way are put back where they fit as well; those that belong there stay."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from slam.backend import hindsight
from slam.beams import Beams
from slam.frontend.keyframes import Keyframe
from slam.frontend.strays import (
    StrayConfig,
    ToldStep,
    may_have_strayed,
    standing_on_way,
    surfaces_beside,
    without_strays,
)
from slam.map_checks.there_and_back import put_strays_back
from slam.mapping import Mapper
from slam.se2 import SE2
from slam.slam_map import SlamMap
from slam.surface.surface_map import SurfaceMap
from tests.slam import ring
from tests.slam.synthetic import box, room, scan_of

AT, BESIDE = 40, SE2(-0.6, 0.0, 0.0)
SURE, GUESS = np.diag([0.02**2, 0.02**2, 0.02**2]), np.eye(3)


def driven() -> Mapper:
    """Half of the ring, by wheels as good as told."""
    mapper = Mapper(ring.T_BASE_LASER)
    rng = np.random.default_rng(0)
    for measurement in ring.drive(ring.way(0.5), rng, turn_scale=1.0, way_scale=1.0):
        mapper.update(measurement)
    return mapper


@pytest.fixture(scope="module")
def slam_map() -> SlamMap:
    return driven().finish()


def told_by(keyframes: tuple[Keyframe, ...], covariance: np.ndarray) -> list[ToldStep]:
    return [ToldStep(one.T_before, covariance) for one in keyframes]


def pushed(slam_map: SlamMap, *strays: int) -> np.ndarray:
    poses = slam_map.poses.copy()
    for k in strays:
        poses[k] = (SE2.from_array(poses[k]) @ BESIDE).as_array()
    return poses


def off_m(poses: np.ndarray, slam_map: SlamMap) -> float:
    return float(np.hypot(*(poses - slam_map.poses)[:, :2].T).max())


@pytest.mark.parametrize("covariance", [SURE, GUESS], ids=["wheels", "scans alone"])
@pytest.mark.parametrize("strays", [(AT,), (AT, AT + 1)])
def test_keyframe_that_strayed_is_put_back_on_the_way(slam_map, strays, covariance):
    told = told_by(slam_map.keyframes, covariance)
    poses = pushed(slam_map, *strays)
    keyframes, _, found, put_back = without_strays(slam_map.keyframes, [], poses, told)
    assert set(put_back) == set(strays)
    assert off_m(found, slam_map) < 0.05
    # nearer ones are left, if that is asked for
    far = StrayConfig(least_m=1.3)
    assert without_strays(slam_map.keyframes, [], poses, told, far)[3] == []
    # the steps to it and on from it are measured anew
    for k in (strays[0], strays[-1] + 1):
        T_before = SE2.from_array(found[k - 1]).inverse() @ SE2.from_array(found[k])
        assert keyframes[k].T_before.is_near(T_before, 1e-9, 1e-9)


def test_scans_that_come_back_to_the_way_may_have_broken_off(slam_map):
    torn = list(slam_map.keyframes)
    torn[AT + 1] = replace(torn[AT + 1], is_break=True, covariance=0.25 * np.eye(3))
    told = told_by(slam_map.keyframes, SURE)
    keyframes, _, found, put_back = without_strays(torn, [], pushed(slam_map, AT), told)
    assert put_back == [AT]
    # the way over the break is known no better for it
    assert np.array_equal(keyframes[AT + 1].covariance, torn[AT + 1].covariance)
    assert np.trace(keyframes[AT].covariance) < 0.01
    assert off_m(found, slam_map) < 0.05
    # of one that begins a piece, nobody knows where it should be
    torn[AT] = replace(torn[AT], is_break=True)
    assert without_strays(torn, [], pushed(slam_map, AT), told)[3] == []


@pytest.mark.parametrize("gap", [AT, AT + 1])
def test_where_those_next_to_it_were_let_go_nobody_knows_the_way(slam_map, gap):
    torn, told = list(slam_map.keyframes), told_by(slam_map.keyframes, SURE)
    torn[gap] = replace(torn[gap], is_after_gap=True)
    assert without_strays(torn, [], pushed(slam_map, AT), told)[3] == []


@pytest.mark.parametrize(("gaps", "count"), [((), 10), ((8, 14), 5)])
def test_surfaces_beside_a_keyframe_are_those_up_to_a_gap(slam_map, gaps, count):
    added = list[np.ndarray]()

    class Noted(SurfaceMap):
        def add(self, points: np.ndarray) -> None:
            added.append(points)

    torn = [replace(one, is_after_gap=k in gaps) for k, one in enumerate(slam_map.keyframes)]
    surfaces_beside(Noted(), torn, slam_map.poses, (10, 12), StrayConfig(half=5))
    assert len(added) == count


def test_map_without_strays_stays_as_it_is(slam_map):
    told = told_by(slam_map.keyframes, SURE)
    keyframes, loops, poses, put_back = without_strays(
        slam_map.keyframes, slam_map.loops, slam_map.poses, told
    )
    assert put_back == []
    assert keyframes == list(slam_map.keyframes)
    assert loops == list(slam_map.loops)
    assert np.array_equal(poses, slam_map.poses)


def test_keyframes_of_sessions_before_stay(slam_map):
    told = told_by(slam_map.keyframes, SURE)[AT + 10 :]
    assert without_strays(slam_map.keyframes, [], pushed(slam_map, AT), told)[3] == []


def test_wheels_that_agree_with_a_keyframe_keep_it_where_it_is(slam_map):
    # a robot that went back and forth, if its wheels say so
    poses = pushed(slam_map, AT)
    told = [
        ToldStep(SE2.from_array(poses[max(k - 1, 0)]).inverse() @ SE2.from_array(poses[k]), SURE)
        for k in range(len(poses))
    ]
    assert without_strays(slam_map.keyframes, [], poses, told)[3] == []


@pytest.mark.parametrize("first", [30, 36])
def test_keyframe_does_not_come_back_to_the_way_alone_where_wheels_led_on_from_it(slam_map, first):
    """aces, wheels stuck: all from there on were 1.3 m short, and one of them was put back."""
    told = told_by(slam_map.keyframes, SURE)
    told[first] = replace(told[first], covariance=30.0 * GUESS)
    poses = slam_map.poses.copy()
    T_first = SE2.from_array(poses[first])
    T_off = T_first @ SE2(1.3, 0.0, 0.0) @ T_first.inverse()
    poses[first:] = [(T_off @ SE2.from_array(pose)).as_array() for pose in poses[first:]]
    assert without_strays(slam_map.keyframes, [], poses, told)[3] == []


def test_keyframe_that_odometry_led_aside_by_a_jump_is_put_back_where_the_next_step_begins(
    slam_map,
):
    """aces, noisier: a scan that left the way open stood where odometry had jumped, 1.07 m off."""
    told = told_by(slam_map.keyframes, SURE)
    told[AT] = ToldStep(told[AT].motion @ BESIDE, SURE)
    _, _, found, put_back = without_strays(slam_map.keyframes, [], pushed(slam_map, AT), told)
    assert put_back == [AT]
    assert off_m(found, slam_map) < 0.05
    # nor does what odometry tells after it alone move one that fits where it is
    told = told_by(slam_map.keyframes, SURE)
    told[AT + 1] = ToldStep(BESIDE @ told[AT + 1].motion, SURE)
    assert without_strays(slam_map.keyframes, [], slam_map.poses, told)[3] == []


@pytest.mark.parametrize("covariance", [SURE, GUESS], ids=["wheels", "scans alone"])
def test_keyframes_about_one_aside_of_the_way_may_have_strayed(slam_map, covariance):
    told, poses = told_by(slam_map.keyframes, covariance), pushed(slam_map, AT)
    half = StrayConfig.half
    # the step on from it leads aside as well, if wheels tell it
    asked = (AT - half - 2, AT - half, AT, AT + half, AT + half + 3)
    found = [may_have_strayed(slam_map.keyframes, poses, k, told) for k in asked]
    assert found == [False, True, True, True, False]
    # as many as are asked for
    less = StrayConfig(half=2)
    asked = (AT - 4, AT - 2, AT + 2, AT + 5)
    found = [may_have_strayed(slam_map.keyframes, poses, k, told, less) for k in asked]
    assert found == [False, True, True, False]
    assert not may_have_strayed(slam_map.keyframes, slam_map.poses, AT, told)
    # nor does the last one, beyond which nothing is known
    count = AT + 1
    driven_so_far = slam_map.keyframes[:count], slam_map.poses[:count]
    assert not may_have_strayed(*driven_so_far, AT, told[:count])
    # of a session before nothing is told
    assert not may_have_strayed(slam_map.keyframes, poses, AT, told[AT + 10 :])


@pytest.mark.parametrize(("aside_m", "has_strayed"), [(0.15, False), (0.25, True)])
def test_two_that_strayed_together_where_nothing_measured_the_way_may_have(
    slam_map, aside_m, has_strayed
):
    # each is beside the other: the way between those before and after both tells
    told, poses = told_by(slam_map.keyframes, GUESS), slam_map.poses.copy()
    for k in (AT, AT + 1):
        poses[k] = (SE2.from_array(poses[k]) @ SE2(0.0, aside_m, 0.0)).as_array()
    # all those whose surfaces are looked at with the pair
    half = StrayConfig.half
    asked = range(AT - half, AT + half + 2)
    found = {may_have_strayed(slam_map.keyframes, poses, k, told) for k in asked}
    assert found == {has_strayed}


def test_scan_that_may_have_strayed_is_kept_in_a_crowd():
    """none 1537, a ring of corridors with people: 0.54 m off, and no scan to look at once more."""
    mapper = driven()
    drive = mapper._drive
    drive.config = replace(mapper.config, crowd=0)
    poses = drive.graph.poses.copy()
    poses[AT] = (SE2.from_array(poses[AT]) @ BESIDE).as_array()
    drive.graph.set_poses(poses)
    drive.thin_crowd(AT)
    assert not drive.graph.keyframes[AT].is_place_alone
    drive.thin_crowd(AT - 20)
    assert drive.graph.keyframes[AT - 20].is_place_alone


def test_keyframe_that_fits_on_the_way_once_all_is_adjusted_is_put_back_then(monkeypatch):
    """none 103001, trees: beside others that were not yet where they belong it fitted as badly, 0.31 m off."""
    mapper, rng = Mapper(ring.T_BASE_LASER), np.random.default_rng(0)
    for one in ring.drive(ring.way(0.5), rng):
        mapper.update(replace(one, motion=SE2.identity(), motion_covariance=100.0 * GUESS))
    graph = mapper._drive.graph
    keyframes, before = list(graph.keyframes), graph.poses.copy()
    for k, T_before in (
        (AT, keyframes[AT].T_before @ BESIDE),
        (AT + 1, BESIDE.inverse() @ keyframes[AT + 1].T_before),
    ):
        keyframes[k] = replace(keyframes[k], T_before=T_before, covariance=1e-6 * SURE)
    loops = [one for one in graph.loops if AT not in (one.earlier, one.later)]
    poses = before.copy()
    poses[AT] = (SE2.from_array(poses[AT]) @ BESIDE).as_array()
    graph.renew(keyframes, loops, poses)
    asked = list[int]()

    def put_back_later(*args: Any) -> dict[int, SE2]:
        asked.append(len(asked))
        return put_strays_back(*args) if len(asked) > 1 else {}

    monkeypatch.setattr(hindsight, "put_strays_back", put_back_later)
    slam_map = mapper.finish()
    assert len(asked) == 2
    assert np.hypot(*(slam_map.poses[AT] - before[AT])[:2]) < 0.1
    assert not any("by scans alone" in one for one in slam_map.verdict.reasons)


PILLAR = np.concatenate([room(-30.0, -1.0, 16.0, 1.0), box(6.7, 0.2, 7.0, 0.7)])
IN_FRONT = np.concatenate([PILLAR, box(6.2, 0.2, 6.5, 0.7)])
SEES_HIM = 15


def along_a_corridor(walls: np.ndarray) -> list[Keyframe]:
    """Past a pillar, a keyframe each 0.2 m; one of them sees other walls."""
    rng, keyframes = np.random.default_rng(7), list[Keyframe]()
    for at in range(25):
        pose = SE2(2.0 + 0.2 * at, 0.0, 0.0)
        scan = scan_of(walls if at == SEES_HIM else PILLAR, pose, rng, 0.01, range_max_m=20.0)
        beams = Beams.of(scan, SE2.identity())
        T_before = SE2(0.2, 0.0, 0.0)
        keyframes.append(Keyframe(float(at), pose, T_before, SURE, beams.points, beams, False))
    return keyframes


@pytest.mark.parametrize("covariance", [SURE, GUESS], ids=["wheels", "scans alone"])
def test_somebody_before_a_pillar_does_not_hold_a_keyframe_where_he_is_taken_for_it(covariance):
    """none 103001, trees: somebody drew a scan 0.80 m off, where no other keyframe sees him."""
    keyframes = along_a_corridor(IN_FRONT)
    poses = np.array([one.T_map_base.as_array() for one in keyframes])
    poses[SEES_HIM, 0] += 0.5
    told = told_by(tuple(keyframes), covariance)
    _, _, found, put_back = without_strays(keyframes, [], poses, told)
    # wheels that were there know of him as little as before
    assert put_back == ([SEES_HIM] if covariance is GUESS else [])
    if covariance is GUESS:
        assert found[SEES_HIM, 0] == pytest.approx(2.0 + 0.2 * SEES_HIM, abs=0.02)


def test_what_others_look_through_is_no_part_of_a_place_where_most_of_a_scan_stands():
    config, ends = StrayConfig(), (SEES_HIM - 1, SEES_HIM + 1)
    for walls, is_believed in ((IN_FRONT, True), (room(-30.0, -0.5, 16.0, 0.5), False)):
        keyframes = along_a_corridor(walls)
        poses = np.array([one.T_map_base.as_array() for one in keyframes])
        one = keyframes[SEES_HIM]
        points = standing_on_way(one, one.T_map_base, keyframes, poses, ends, config)
        seen_x = one.faced[:, 0] + one.T_map_base.x
        is_he = (abs(one.faced[:, 1] - 0.45) < 0.3) & (abs(seen_x - 6.35) < 0.2)
        expected = one.faced[~is_he] if is_believed else one.faced
        assert len(points) == pytest.approx(len(expected), abs=2)

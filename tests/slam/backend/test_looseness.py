"""Loops to keyframes that leave open how far along they lie are as loose as these lie among the others."""

import math
from dataclasses import replace

import numpy as np
import pytest

from slam import SE2, Beams, Mapper
from slam.backend.looseness import Looseness
from slam.files.slam_map_files import read_slam_map, write_slam_map
from slam.frontend.keyframes import Keyframe
from slam.loop_closing import LoopCloser
from tests.slam.frontend.test_open_runs import WALLS, driven, kept, mapped


def keyframe_of(sigma_m: float) -> Keyframe:
    noise, nothing = np.diag([sigma_m, 0.01, 0.01]) ** 2, np.zeros((0, 2))
    beams = Beams(nothing, np.zeros(0), np.zeros(0))
    return Keyframe(0.0, SE2.identity(), SE2.identity(), noise, nothing, beams, is_break=False)


def test_keyframes_between_two_that_see_where_they_are_lie_as_loosely_as_both_ends_have_it():
    keyframes = [keyframe_of(sigma_m) for sigma_m in (0.5, 0.3, 0.4, 1.2, 0.1, 0.2)]
    looseness = Looseness()
    for k, keyframe in enumerate(keyframes):
        looseness.take(keyframe, k in (1, 2, 5))
        if k == 2:  # nothing tells it from the other end yet
            assert looseness.sigmas_m == pytest.approx([0.0, 0.3, 0.5])
    between = [math.sqrt(way_m2 * (1.69 - way_m2) / 1.69) for way_m2 in (0.09, 0.25)]
    assert looseness.sigmas_m == pytest.approx([0.0, *between, 0.0, 0.0, 0.2])
    assert (Looseness(keyframes, (1, 2, 5)).sigmas_m == looseness.sigmas_m).all()
    # none knows anything of where the first ones of a drive were
    first = Looseness(keyframes[1:], (0, 1)).sigmas_m
    assert first == pytest.approx([*between, 0.0, 0.0, 0.0])


def test_a_way_that_is_open_aside_is_as_loose_as_one_ahead():
    keyframes = [keyframe_of(0.3) for _ in range(3)]
    turned = np.diag([0.01, 0.3, 0.01]) ** 2
    aside = [replace(one, covariance=turned) for one in keyframes]
    assert Looseness(aside, (1,)).sigmas_m == pytest.approx(Looseness(keyframes, (1,)).sigmas_m)


def seen_again(turned_rad: float = 0.0) -> tuple[list[Keyframe], np.ndarray]:
    """Keyframes past boxes, and one more that sees them again; and their poses."""
    rng = np.random.default_rng(3)
    places = [SE2(x, 0.0, 0.0) for x in np.arange(-2.0, 6.0, 0.4)]
    places.append(SE2(-1.0, 0.0, turned_rad))
    poses = np.array([place.as_array() for place in places])
    noise = np.diag([0.1, 0.01, 0.01]) ** 2
    return [replace(kept(WALLS, one, rng), covariance=noise) for one in places], poses


@pytest.mark.parametrize("turned_rad", [0.0, 0.7])
def test_a_loop_to_a_keyframe_is_as_loose_as_it_lies_among_those_around(turned_rad):
    # of loops that were told as sure to 2 cm, to keyframes off by 0.6 m, a map was made off as much
    keyframes, poses = seen_again(turned_rad)
    closer, pair = LoopCloser(), (3, len(keyframes) - 1)
    sure, loose = (closer.verified(keyframes, poses, *pair, (0.0, 0.0), one) for one in (0.0, 0.3))
    assert sure is not None
    assert loose is not None
    assert loose.T_earlier_later.is_near(sure.T_earlier_later, 1e-9, 1e-9)
    more = np.linalg.inv(loose.information) - np.linalg.inv(sure.information)
    # along the corridor, as the later one has it ahead
    ahead = np.array([math.cos(turned_rad), -math.sin(turned_rad)])
    assert more[:2, :2] == pytest.approx(0.09 * np.outer(ahead, ahead), abs=1e-3)
    assert more[2] == pytest.approx(np.zeros(3), abs=1e-6)


@pytest.mark.parametrize(("loose", "is_told"), [((3,), True), ((20,), True), ((3, 20), False)])
def test_two_keyframes_that_leave_open_where_they_lie_tell_nothing_of_one_another(loose, is_told):
    keyframes, poses = seen_again()
    assert len(keyframes) == 21
    loose_m = np.zeros(len(keyframes))
    loose_m[list(loose)] = 0.1
    loops = LoopCloser().found(keyframes, poses, [20], loose_m=loose_m, others=range(3, 4))
    assert [(one.earlier, one.later) for one in loops] == ([(3, 20)] if is_told else [])


def test_the_mapper_tells_loops_which_keyframes_lie_loosely(monkeypatch, tmp_path):
    told, found = list[np.ndarray](), LoopCloser.found

    def noted(*args, **kwargs):
        told.append(args[6])
        return found(*args, **kwargs)

    monkeypatch.setattr(LoopCloser, "found", noted)
    slam_map = mapped()
    is_open = [step.is_open for step in slam_map.steps if step.is_keyframe]
    assert any(is_open)
    assert not all(is_open)
    assert [bool(one) for one in told[-1] > 0.0] == is_open
    write_slam_map(tmp_path / "map.kitasap", slam_map)
    read = read_slam_map(tmp_path / "map.kitasap")
    assert [step.is_open for step in read.steps] == [step.is_open for step in slam_map.steps]
    # a session that continues it is told of them as well, from its join on
    told.clear()
    for one in (slam_map, read):
        again = Mapper.continued(one, SE2.identity(), SE2.identity())
        for measurement in driven()[:12]:
            again.update(measurement)
        again.finish()
    assert [bool(one) for one in told[0][: len(is_open)] > 0.0] == is_open
    half = len(told) // 2
    assert all((one == other).all() for one, other in zip(told[:half], told[half:], strict=True))


def test_a_session_says_nothing_of_how_the_one_before_it_ended():
    slam_map = mapped(30)
    graph = Mapper.continued(slam_map, SE2.identity(), SE2.identity())._drive.graph
    before = graph.looseness.sigmas_m
    assert before[-1] > 0.05
    mapper = Mapper.continued(slam_map, SE2.identity(), SE2.identity())
    for measurement in driven()[:3]:
        mapper.update(measurement)
    after = mapper._drive.graph.looseness.sigmas_m
    assert len(after) > len(before)
    assert after[: len(before)] == pytest.approx(before, rel=1e-3)

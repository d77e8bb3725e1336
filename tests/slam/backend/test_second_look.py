"""Keyframes that may have strayed: those that did keep their scans, and those beside them."""

from collections.abc import Collection

import numpy as np
import pytest

from slam.backend.second_look import SecondLook
from slam.frontend.kept_keyframes import Keyframes
from slam.frontend.strays import StrayConfig, StraySearch, may_have_strayed
from slam.mapping import Mapper
from slam.slam_map import SlamMap
from slam.surface.surface_map import SurfaceMapConfig
from tests.slam import ring
from tests.slam.frontend.test_strays import AT, GUESS, pushed, told_by
from tests.slam.test_rounds_of_a_room import FEW, by_scans_alone, drive, driven, way

AGE = 20
CONFIG = StrayConfig(half=3, runs=(1, 2))
BESIDE = 5
RECENT = AGE + 2 * BESIDE


@pytest.fixture(scope="module")
def slam_map() -> SlamMap:
    """Round half of the ring by scans alone."""
    mapper, rng = Mapper(ring.T_BASE_LASER), np.random.default_rng(0)
    for one in ring.drive(ring.way(0.5), rng, 1.0, 1.0):
        mapper.update(by_scans_alone(one))
    return mapper.finish()


def known(
    slam_map: SlamMap,
    poses: np.ndarray,
    recent: int,
    first: int = 0,
    needless: Collection[int] = range(1000),
) -> list[int]:
    """The keyframes that a second look finds where they belong, as they come, of those that are needless."""
    look, found = SecondLook(recent, CONFIG, SurfaceMapConfig()), list[int]()
    told = told_by(slam_map.keyframes, GUESS)
    for count in range(1, len(poses) + 1):
        keyframes = Keyframes(slam_map.keyframes[:count])
        own = told[min(first, count) : count]
        k = look.next(keyframes, poses[:count], own, needless.__contains__)
        assert k is None or count - recent < k <= count - recent + 2 * BESIDE
        found += [] if k is None else [k]
    return found


def test_all_but_those_beside_a_stray_are_known_to_be_none(slam_map):
    # each is known once all beside it were asked, which are asked when they are so old
    last = len(slam_map.poses) - AGE - BESIDE
    assert last > AT + 3 * BESIDE
    assert known(slam_map, slam_map.poses, RECENT) == list(range(1 + BESIDE, last + 1))
    strayed = known(slam_map, pushed(slam_map, AT), RECENT)
    assert set(range(AT - BESIDE, AT + BESIDE + 1)).isdisjoint(strayed)
    assert len(strayed) > last - 4 * BESIDE
    # of those as young as that, nobody knows the way on
    assert known(slam_map, slam_map.poses, 3 * BESIDE) == []
    assert known(slam_map, slam_map.poses, 3 * BESIDE + 1) != []


def test_nobody_asks_who_is_beside_none_that_is_needless(slam_map, monkeypatch):
    asked, of = list[int](), StraySearch.on_the_way
    monkeypatch.setattr(StraySearch, "on_the_way", lambda *args: asked.append(args[2]) or of(*args))
    assert known(slam_map, slam_map.poses, RECENT, needless=(30, 60)) == [30, 60]
    about = {*range(30 - BESIDE, 31 + BESIDE), *range(60 - BESIDE, 61 + BESIDE)}
    assert set(asked) == about
    assert known(slam_map, pushed(slam_map, AT), RECENT, needless=(AT - BESIDE, 60)) == [60]


def test_who_comes_to_a_corner_may_have_strayed_and_has_not():
    found = driven([by_scans_alone(one) for one in drive(way(1))], FEW).finish()
    told = told_by(found.keyframes, GUESS)
    may = [
        k
        for k in known(found, found.poses, RECENT)
        if may_have_strayed(found.keyframes, found.poses, k, told, CONFIG)
    ]
    assert len(may) > 0.2 * len(found.keyframes)


def test_keyframes_of_sessions_before_are_not_asked(slam_map):
    found = known(slam_map, slam_map.poses, RECENT, first=30)
    assert min(found) == 31 + BESIDE

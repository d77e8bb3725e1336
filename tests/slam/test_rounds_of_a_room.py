"""A robot that drives round a room over and over: keyframes are let go, and nothing else is worse for it."""

import math
from dataclasses import replace
from itertools import islice, pairwise

import numpy as np
import pytest

from slam.files.slam_map_files import read_slam_map, write_slam_map
from slam.frontend.keyframes import StepStatus
from slam.frontend.remaining import Remaining
from slam.frontend.told_steps import ToldStep
from slam.in_steps import all_at_once
from slam.loop_closing import Loop
from slam.mapper_config import MapperConfig
from slam.mapping import Mapper
from slam.measurements import Measurement
from slam.metrics import absolute_errors
from slam.se2 import SE2
from slam.slam_map import SlamMap
from tests.slam import ring
from tests.slam.synthetic import box, room

WALLS = np.concatenate(
    [
        room(-1.0, -1.0, 5.0, 3.0), box(1.0, 1.0, 3.0, 2.0), box(4.5, -1.0, 5.0, -0.6),
        box(-1.0, 2.4, -0.5, 3.0), box(2.0, -1.0, 2.4, -0.8), box(3.6, 2.6, 4.2, 3.0),
    ]
)  # fmt: skip
CORNERS = np.array([[0.0, 0.0], [4.0, 0.0], [4.0, 2.4], [0.0, 2.4], [0.0, 0.0]])
SCANS = 80
"""Of a round."""
ROUNDS, KEYFRAMES = 7, 305
"""That are driven, and that are taken then."""
FEW = MapperConfig(crowd=3, recent=70)


def way(rounds: int) -> list[SE2]:
    poses, heading = list[SE2](), 0.0
    for _ in range(rounds):
        for start, end in pairwise(CORNERS):
            length_m = float(np.hypot(*(end - start)))
            along = math.atan2(*(end - start)[::-1])
            while abs(turn := math.remainder(along - heading, math.tau)) > 1e-6:
                heading += min(turn, 0.4)
                poses.append(SE2(*start, heading))
            places = (
                start + share * (end - start) for share in np.arange(0.0, 1.0, 0.2 / length_m)
            )
            poses += [SE2(*place, heading) for place in places]
    return poses


def drive(poses: list[SE2], seed: int = 0) -> list[Measurement]:
    return ring.drive(poses, np.random.default_rng(seed), 1.005, 1.01, WALLS)


def by_scans_alone(one: Measurement) -> Measurement:
    return replace(one, motion=SE2.identity(), motion_covariance=np.eye(3))


def driven(measurements: list[Measurement], config: MapperConfig) -> Mapper:
    mapper = Mapper(ring.T_BASE_LASER, config)
    for one in measurements:
        mapper.update(one)
    return mapper


def off_m(found: SlamMap, poses: list[SE2]) -> float:
    """At most."""
    true = np.array([pose.as_array() for pose in poses])
    return absolute_errors(found.trajectory.poses, true).position_m.max


@pytest.fixture(scope="module")
def rounds() -> list[Measurement]:
    return drive(way(ROUNDS))


@pytest.fixture(scope="module")
def slam_map(rounds) -> SlamMap:
    return driven(rounds, FEW).finish()


def test_keyframes_grow_with_the_room_and_every_scan_has_its_place(rounds, slam_map):
    fewer = driven(rounds[: 5 * SCANS], FEW)
    assert len(slam_map.keyframes) < len(fewer.keyframes) + 20
    assert len(slam_map.keyframes) < 0.6 * KEYFRAMES
    assert any(one.is_after_gap for one in slam_map.keyframes)
    assert slam_map.verdict.is_good
    assert len(slam_map.steps) == len(rounds)
    # 4 mm by all keyframes
    assert off_m(slam_map, way(ROUNDS)) < 0.01


def test_drive_goes_on_after_its_map_was_asked_for(rounds):
    mapper, third = driven(rounds[: 4 * SCANS], FEW), slice(4 * SCANS, 6 * SCANS)
    first = mapper.finish()
    count = len(mapper.keyframes)
    steps = [mapper.update(one) for one in rounds[third]]
    assert all(one.status is StepStatus.MATCHED for one in steps)
    assert len(mapper.keyframes) < count + 40
    for one in rounds[6 * SCANS :]:
        mapper.update(one)
    found = mapper.finish()
    assert found.verdict.is_good
    assert off_m(found, way(ROUNDS)) < 0.01
    # the one before is what it was
    assert len(first.steps) == 4 * SCANS
    assert off_m(first, way(ROUNDS)[: 4 * SCANS]) < 0.01


def test_map_with_gaps_is_kept_and_continued(slam_map, tmp_path):
    path = tmp_path / "map.kitasap"
    write_slam_map(path, slam_map)
    known = read_slam_map(path)
    write_slam_map(tmp_path / "again.kitasap", known)
    assert path.read_bytes() == (tmp_path / "again.kitasap").read_bytes()
    poses = way(4)[30:]
    mapper = Mapper.continued(known, ring.T_BASE_LASER, poses[0], FEW)
    # the last scans, which its own drive still matched with: else each session leaves as many
    left = sum(not one.is_place_alone for one in known.keyframes)
    assert sum(not one.is_place_alone for one in mapper.keyframes) <= left - 5
    steps = [mapper.update(one) for one in drive(poses, 7)]
    assert steps[-1].is_joined
    # of those of both sessions
    assert len(mapper.keyframes) < len(known.keyframes) + 60
    found = mapper.finish()
    assert found.verdict.is_good
    assert found.unjoined == ()
    true = np.array([pose.as_array() for pose in poses])
    assert absolute_errors(found.trajectory_of(1).poses, true).position_m.max < 0.02
    assert off_m(found, [*way(ROUNDS), *poses]) < 0.02
    assert found.localizer(ring.T_BASE_LASER) is not None


def test_session_that_was_joined_wrongly_is_a_piece_of_its_own_again(slam_map):
    poses = way(3)
    mapper = Mapper.continued(slam_map, ring.T_BASE_LASER, poses[0], FEW)
    for one in drive(poses, 8):
        mapper.update(one)
    session = mapper._drive.session
    assert session.is_joined
    assert session.first < len(slam_map.keyframes)  # some of the map's were let go
    session.unjoin()
    graph = mapper._drive.graph
    apart = session.kept_apart(graph.poses)
    assert apart.shape == graph.poses.shape
    of_map = [k for k in range(session.first) if not graph.keyframes[k].is_place_alone]
    assert all(graph.keyframes[k].session == 0 for k in of_map)
    before = {
        one.time_s: pose for one, pose in zip(slam_map.keyframes, slam_map.poses, strict=True)
    }
    for k in of_map:
        assert np.allclose(apart[k], before[graph.keyframes[k].time_s])
    # it is looked for among those that it is one of now
    joiner = session._joiner
    assert (joiner._first, joiner._next) == (session.first, joiner._next)
    assert session.first <= joiner._next <= len(graph)
    for one in drive(way(2), 9)[1:]:
        mapper.update(one)
    assert mapper._drive.session.is_joined


ELSEWHERE = np.concatenate(
    [
        room(-1.5, -1.2, 9.0, 1.2), box(2.0, 0.6, 2.6, 1.2), box(5.0, -1.2, 5.3, -0.7),
        box(7.0, 0.9, 7.9, 1.2),
    ]
)  # fmt: skip


@pytest.fixture(scope="module")
def elsewhere() -> SlamMap:
    poses = [SE2(x, 0.0, 0.0) for x in np.arange(0.0, 7.5, 0.15)]
    return driven(ring.drive(poses, np.random.default_rng(1), 1.0, 1.0, ELSEWHERE), FEW).finish()


def test_whatever_names_a_keyframe_names_the_same_one_when_others_are_gone(rounds):
    mapper = driven(rounds[: 4 * SCANS], FEW)
    drive, keyframes = mapper._drive, mapper.keyframes
    # of the last round, whose keyframes are let go soon, one way in eight that nobody measured
    ends = range(len(keyframes) - 40, len(keyframes) - 5, 8)
    stretch = drive.monitor._open
    drive.monitor._long = [replace(stretch, first=one, last=other) for one, other in pairwise(ends)]
    said = np.eye(3), np.zeros((3, 3))
    drive.weak_steps._said.update(dict.fromkeys((3, ends[1], ends[3]), said))
    drive.closer.doubted = drive.weak_steps._said.keys()
    drive.breaks._said = dict.fromkeys((5, ends[2]), said)
    drive.session._check_at = len(keyframes) + 200

    def named() -> list[list[float]]:
        long = drive.monitor._long
        numbers = (
            [one.first for one in long], [one.last for one in long],
            drive.weak_steps._said, drive.closer.doubted, drive.breaks._said,
        )  # fmt: skip
        return [[keyframes[k].time_s for k in ks] for ks in numbers]

    before, count, left = named(), len(keyframes), drive.session._check_at - len(keyframes)
    drive.session.check = lambda: None  # type: ignore[method-assign]
    taken, add = [], drive.graph.add
    drive.graph.add = lambda *args: taken.append(args) or add(*args)  # type: ignore[method-assign]
    for one in rounds[4 * SCANS :]:
        mapper.update(one)
    assert len(keyframes) < count + len(taken) - 60
    assert named() == before
    # so many more that are to come
    assert drive.session._check_at - len(keyframes) == left - len(taken)


def test_session_that_is_never_joined_grows_with_the_room_too(elsewhere, rounds):
    mapper = Mapper.continued(elsewhere, ring.T_BASE_LASER, SE2(3.0, 0.0, 1.0), FEW)
    steps = [mapper.update(one) for one in rounds]
    assert not steps[-1].is_joined
    assert len(mapper.keyframes) < len(elsewhere.keyframes) + 0.75 * KEYFRAMES
    found = mapper.finish()
    assert found.unjoined == (1,)
    true = np.array([pose.as_array() for pose in way(ROUNDS)])
    assert absolute_errors(found.trajectory_of(1).poses, true).position_m.max < 0.02
    assert len(found.steps) == len(elsewhere.steps) + len(rounds)


def test_scans_of_a_map_do_not_crowd_a_session_that_may_be_anywhere(slam_map):
    mapper = Mapper.continued(slam_map, ring.T_BASE_LASER, None, FEW)
    poses = [SE2(x, 0.0, 0.0) for x in np.arange(0.0, 4.0, 0.15)]
    for one in ring.drive(poses, np.random.default_rng(1), 1.0, 1.0, ELSEWHERE):
        mapper.update(one)
    drive = mapper._drive
    own = range(drive.session.first, len(drive.graph))
    assert not any(drive.is_crowded(k) for k in own)
    # where it is joined, as the first ones of it would be
    drive.session.is_joined = True
    assert any(drive.is_crowded(k) for k in own)


def test_search_that_was_begun_when_keyframes_were_let_go_is_begun_anew(elsewhere, rounds):
    mapper = Mapper.continued(elsewhere, ring.T_BASE_LASER, None, FEW)
    measurements, session = iter(rounds), mapper._drive.session
    joiner = session._joiner
    while joiner._task is None or len(mapper.keyframes) < len(elsewhere.keyframes) + 20:
        mapper.update(next(measurements))
    next_, count = joiner._next, len(mapper.keyframes)
    gone = 3, 4, mapper._drive.session.first + 1
    joiner._backlog = [gone[2], count - 3, count - 2]
    way = SE2.identity(), np.eye(3), 1.0, 0.0
    joiner._loops = [Loop(k, count - 2, *way) for k in (2, 3, 5)]
    graph = mapper._drive.graph
    is_kept = ~np.isin(np.arange(count), gone)
    step = ToldStep(SE2(0.6, 0.0, 0.0), 0.01 * np.eye(3))
    ways = {5: step, session.first + 2: step}
    remaining = Remaining(is_kept, np.where(is_kept, np.arange(count), 2), ways)
    own = remaining.after(session.first)
    graph.renumber(remaining)
    mapper._drive.front_end.renumber(own)
    session.renumber(remaining)
    assert (joiner._task, joiner._next) == (None, next_ - 1 - 3)
    assert joiner._first == session.first == len(elsewhere.keyframes) - 2
    assert joiner._backlog == [count - 6, count - 5]
    assert [(one.earlier, one.later) for one in joiner._loops] == [(2, count - 5), (3, count - 5)]
    joiner._backlog, joiner._loops = [], []
    for one in islice(measurements, 20):
        mapper.update(one)
    assert mapper.finish().unjoined == (1,)


def test_scans_that_may_show_where_a_session_lies_are_kept_until_they_are_looked_at(
    elsewhere, rounds, monkeypatch
):
    mapper = Mapper.continued(elsewhere, ring.T_BASE_LASER, None, FEW)
    for one in rounds[:SCANS]:
        mapper.update(one)
    drive, joiner = mapper._drive, mapper._drive.session._joiner
    joiner._next, joiner._backlog = len(drive.graph) - 20, []
    monkeypatch.setattr("slam.backend.drive.may_have_strayed", lambda *_: False)
    monkeypatch.setattr(type(drive), "_is_crowded", lambda *_: True)
    first = drive.session.asked_from
    assert first < joiner._next - 5
    for k in (first, first - 1):
        assert drive._is_needless(k) is (k < first)
        drive.thin_crowd(k)
        assert drive.graph.keyframes.has_scan(k) is (k == first)
    # of one that is gone there is nothing to look at
    looks = joiner._looks
    assert all_at_once(joiner._looked_at(first - 1)) is None
    assert joiner._looks == looks


def test_scans_that_tell_nothing_lie_where_wheels_led_between_those_that_do(rounds):
    hidden = rounds
    for first in range(20, len(rounds), SCANS):
        hidden = ring.blinded(hidden, first, first + 12)
    mapper = driven(hidden, FEW)
    assert any(one.is_after_gap for one in mapper.keyframes)
    settled = len(mapper._drive.front_end.loose_runs.ended)
    assert settled < len(rounds) // SCANS
    # 0.06 m where those of keyframes that are let go lie as the wheels alone led
    assert off_m(mapper.finish(), way(ROUNDS)) < 0.015


@pytest.mark.parametrize("is_told", [True, False])
def test_rounds_without_wheels_that_are_believed_are_mapped_as_well(rounds, is_told):
    config = replace(FEW, is_odometry_doubted=is_told)
    if not is_told:
        rounds = [by_scans_alone(one) for one in rounds]
    found = driven(rounds, config).finish()
    assert len(found.keyframes) < 0.75 * KEYFRAMES
    assert found.verdict.is_good, found.verdict.reasons
    assert off_m(found, way(ROUNDS)) < 0.02
    # what was seen first stays, however often it is seen again: else the map wanders
    first = [one for one in found.keyframes if one.time_s < 0.2 * SCANS]
    assert sum(not one.is_place_alone for one in first) > 40

"""Maps continued in a second session: joined where its scans show where it is, or said to be not."""

import io
import math
import pickle
import zipfile
from dataclasses import replace

import numpy as np
import pytest

from slam import relocalization
from slam.backend.session_joining import JoiningConfig, SessionJoiner
from slam.evidence import evidence_of
from slam.files.slam_map_files import read_slam_map, write_slam_map
from slam.guard import verdict_limits
from slam.guard.hypotheses import Hypotheses
from slam.guard.lost_search import LostSearch
from slam.guard.verdict_limits import _VIRTUAL_SCAN, VerdictLimits, virtual_scan
from slam.loop_closing import LoopCloser
from slam.lost import Guard
from slam.mapper_config import MapperConfig
from slam.mapping import Mapper, MapperStep
from slam.metrics import absolute_errors
from slam.se2 import SE2
from slam.slam_map import SlamMap
from slam.verdict import Status
from tests.slam import ring
from tests.slam.synthetic import box, room

WAY = ring.way(1.4, 0.3)
FIRST, SECOND = WAY[:90], WAY[50:130]
"""Half a lap, and the rest of it from the middle of that on."""


def mapped(measurements, mapper: Mapper | None = None) -> tuple[SlamMap, list[MapperStep]]:
    mapper = mapper or Mapper(ring.T_BASE_LASER)
    steps = [mapper.update(measurement) for measurement in measurements]
    return mapper.finish(), steps


def continued(slam_map: SlamMap, measurements, start: SE2 | None = None):
    return mapped(measurements, Mapper.continued(slam_map, ring.T_BASE_LASER, start))


@pytest.fixture(scope="module")
def first() -> SlamMap:
    return mapped(ring.drive(FIRST, np.random.default_rng(0)))[0]


@pytest.fixture(scope="module")
def both(first) -> tuple[SlamMap, list[MapperStep]]:
    # the first two scans tell nothing
    return continued(first, ring.blinded(ring.drive(SECOND, np.random.default_rng(1)), 0, 2))


def test_second_session_is_joined_where_it_is(first, both):
    slam_map, _ = both
    assert slam_map.verdict.is_good
    assert slam_map.unjoined == ()
    assert slam_map.session_count == 2
    # the stamps of the sessions are the same, and the poses of each are told apart
    assert slam_map.steps[0].time_s == slam_map.steps[len(first.steps)].time_s == 0.0
    assert [len(slam_map.trajectory_of(k)) for k in (0, 1)] == [len(FIRST), len(SECOND)]
    true = np.array([pose.as_array() for pose in (*FIRST, *SECOND)])
    errors = absolute_errors(slam_map.trajectory.poses, true).position_m
    assert errors.rmse < 0.05
    assert errors.max < 0.15
    count = len(first.keyframes)
    assert sum(loop.earlier < count <= loop.later for loop in slam_map.loops) > 5


def test_pose_is_told_on_the_map_from_the_join_on(both):
    _, steps = both
    is_joined = [step.is_joined for step in steps]
    at = is_joined.index(True)
    assert 0 < at < 60  # a search takes several scans
    assert all(is_joined[at:])
    true = FIRST[0].inverse() @ SECOND[-1]
    assert steps[-1].T_map_base.is_near(true, 0.15, 0.05)
    assert steps[0].T_map_base.is_near(SE2.identity(), 1e-9, 1e-9)


@pytest.mark.slow
def test_map_that_was_kept_is_continued_as_the_one_at_hand(first, tmp_path):
    measurements = ring.drive(SECOND[:16], np.random.default_rng(1))
    start = FIRST[0].inverse() @ SECOND[0]
    path = tmp_path / "map.kitasap"
    write_slam_map(path, first)
    found = []
    for slam_map in (first, read_slam_map(path)):
        write_slam_map(path, continued(slam_map, measurements, start)[0])
        found.append(path.read_bytes())
    assert found[0] == found[1]
    again = read_slam_map(path)
    assert [again.session_count, again.keyframes[-1].session] == [2, 1]
    write_slam_map(path, again)
    assert path.read_bytes() == found[0]


@pytest.mark.slow
def test_session_in_another_building_is_never_joined_and_said_to_be_so(first):
    walls = np.concatenate([room(-4.0, -3.0, 9.0, 4.0), box(2.0, 1.0, 3.0, 4.0)])
    elsewhere = [SE2(-2.0 + 0.3 * k, -1.0, 0.0) for k in range(6)]
    slam_map, steps = continued(first, ring.drive(elsewhere, np.random.default_rng(2), walls=walls))
    assert not any(step.is_joined for step in steps)
    assert not slam_map.verdict.is_good
    assert slam_map.unjoined == (1,)
    assert slam_map.verdict.reasons == (
        "session 2, from 0.00 s on, was never joined with the map before it",
    )
    # the map is as it was, and nothing of the other is drawn into it
    count = len(first.keyframes)
    np.testing.assert_array_equal(slam_map.poses[:count], first.poses)
    beside = slam_map.points[:, 0] > first.points[:, 0].max() + 5.0
    assert beside.sum() > 200
    off_m = np.linalg.norm(slam_map.points[~beside, None] - first.points, axis=2).min(axis=1)
    assert np.quantile(off_m, 0.99) < 0.05
    with pytest.raises(ValueError, match="session 2 of the map was never joined"):
        Mapper.continued(slam_map, ring.T_BASE_LASER)


@pytest.mark.slow
@pytest.mark.parametrize("is_best", [True, False])
def test_session_is_joined_where_it_likely_is_though_little_of_it_is_mapped(
    first, monkeypatch, is_best
):
    """aces, its second half on its first: by a hair no scan was explained by enough of the map, and it was never
    joined; loops tell that it lies where the search has it. Not where another place is as likely."""
    look = LostSearch.look_in_steps

    def unsure(self, *args, **kwargs):
        judged = yield from look(self, *args, **kwargs)
        verdict = replace(judged.verdict, status=Status.UNSURE, reasons=("explains too little",))
        return replace(judged, verdict=verdict)

    monkeypatch.setattr(LostSearch, "look_in_steps", unsure)
    if not is_best:
        monkeypatch.setattr(Hypotheses, "margin", 0.0)
    slam_map, steps = continued(first, ring.drive(SECOND, np.random.default_rng(1)))
    assert any(step.is_joined for step in steps) == is_best
    if is_best:
        true = np.array([pose.as_array() for pose in (*FIRST, *SECOND)])
        assert absolute_errors(slam_map.trajectory.poses, true).position_m.max < 0.15


@pytest.mark.slow
def test_place_is_tried_at_keyframes_alone_of_which_it_was_searched(first, monkeypatch):
    """Where it was not searched for, the place that is likely is that of a robot some way back."""
    monkeypatch.setattr(LostSearch, "likely", SE2(3.0, 0.0, 0.0))
    search, asked = Guard.search_in_steps, []

    def unsure(self, look, *args):
        asked.append("searched")
        judged = yield from search(self, look, *args)
        return replace(judged, verdict=replace(judged.verdict, status=Status.UNSURE))

    def tried(self, *_):
        asked.append("tried")
        return []
        yield

    joining = JoiningConfig(eager=4, burst=2)
    mapper = Mapper.continued(first, ring.T_BASE_LASER, config=MapperConfig(joining=joining))
    monkeypatch.setattr(Guard, "search_in_steps", unsure)
    monkeypatch.setattr(SessionJoiner, "_loops_at", tried)
    for measurement in ring.drive(SECOND[:20], np.random.default_rng(1)):
        mapper.update(measurement)
    mapper._drive.session.look_for_join(math.inf)
    count = asked.count("searched")
    assert 4 < count < len(mapper._drive.front_end.keyframes)
    assert asked == ["searched", "tried"] * count


@pytest.mark.slow
def test_join_is_taken_back_when_the_scans_contradict_it(first):
    # the same corridor, and behind its corner another building
    walls = ring.RING.copy()
    walls[np.isclose(walls, 13.5) & (np.arange(2) == 0)] = 16.5
    walls = np.concatenate([walls, box(10.5, 2.5, 12.4, 12.0)])
    poses = [*WAY[:42]]
    corner = poses[-1]
    poses += [corner @ SE2(0.3 * k, 0.0, 0.0) for k in range(1, 6)]
    turn = poses[-1]
    poses += [turn @ SE2(0.0, 0.0, 0.25 * k) for k in range(1, 7)]
    poses += [poses[-1] @ SE2(0.3 * k, 0.0, 0.0) for k in range(1, 40)]
    slam_map, steps = continued(first, ring.drive(poses, np.random.default_rng(3), walls=walls))
    assert any(step.is_joined for step in steps)
    assert not slam_map.verdict.is_good
    assert slam_map.unjoined == (1,)


def test_start_that_is_told_needs_no_search_and_a_wrong_one_is_not_believed(first, monkeypatch):
    monkeypatch.setattr("slam.backend.session_joining.Guard", lambda *_: pytest.fail("searched"))
    measurements = ring.drive(SECOND[:20], np.random.default_rng(1))
    true = FIRST[0].inverse() @ SECOND[0]
    slam_map, steps = continued(first, measurements, true @ SE2(0.3, -0.2, 0.1))
    assert steps[0].T_map_base.is_near(true, 0.4, 0.11)
    assert steps[-1].is_joined
    assert slam_map.verdict.is_good
    assert slam_map.trajectory_of(1).poses[0] == pytest.approx(true.as_array(), abs=0.1)
    slam_map, _ = continued(first, measurements, true @ SE2(2.0, 0.0, 1.5))
    assert not slam_map.verdict.is_good
    assert slam_map.unjoined == (1,)


def test_what_no_later_session_can_say_is_not_forgotten_when_it_ties_what_broke_off():
    # scans that tell nothing, by noisy wheels; then as many that a second session drives by as well
    way = ring.way(0.7)
    drive = ring.drive(way[:200], np.random.default_rng(2))
    drive = ring.blinded(ring.blinded(drive, 60, 85), 120, 190)
    noisy = np.diag(np.square([0.12, 0.12, 0.02]))
    drive[60:86] = [replace(one, motion_covariance=noisy) for one in drive[60:86]]
    made, _ = mapped(drive)
    torn, unknown = made.verdict.reasons
    assert "broke off" in torn
    assert unknown.startswith("from 11.80 to 17.00 s no scan tells where the robot is")
    made, _ = continued(made, ring.drive(way[90:230], np.random.default_rng(5)))
    assert made.verdict.reasons == (unknown,)


def test_session_that_saw_nothing_fails_the_map(first):
    measurements = ring.drive(SECOND[:5], np.random.default_rng(1))
    slam_map, _ = continued(first, ring.blinded(measurements, 0, 5))
    assert not slam_map.verdict.is_good
    assert slam_map.unjoined == (1,)
    assert len(slam_map.trajectory) == len(FIRST) + 5


def test_map_of_the_first_version_is_read_as_one_session(first, tmp_path):
    path = tmp_path / "map.kitasap"
    write_slam_map(path, first)
    old = io.BytesIO()
    with zipfile.ZipFile(path) as archive, zipfile.ZipFile(old, "w") as written:
        for name in archive.namelist():
            content = io.BytesIO()
            if name == "version.npy":
                np.save(content, np.array(1))
            elif not name.endswith("sessions.npy"):
                content.write(archive.read(name))
            else:
                continue
            written.writestr(name, content.getvalue())
    path.write_bytes(old.getvalue())
    again = read_slam_map(path)
    assert again.session_count == 1
    assert {keyframe.session for keyframe in again.keyframes} == {0}


@pytest.mark.slow
def test_mapper_can_be_sent_elsewhere_in_the_middle_of_its_search(first):
    config = MapperConfig(joining=JoiningConfig(work=5.0))
    mapper = Mapper.continued(first, ring.T_BASE_LASER, config=config)
    measurements = iter(ring.drive(SECOND, np.random.default_rng(1)))
    while mapper._drive.session._joiner._task is None:
        mapper.update(next(measurements))
    elsewhere = pickle.loads(pickle.dumps(mapper))
    for one in measurements:
        assert mapper.update(one).T_map_base == elsewhere.update(one).T_map_base
    here, there = mapper.finish(), elsewhere.finish()
    assert here.unjoined == ()
    assert np.array_equal(here.poses, there.poses)


@pytest.mark.slow
def test_search_of_a_whole_map_is_spread_over_the_scans(first, monkeypatch):
    # on the Intel map one search takes 0.2 s, and a scan must not wait for it
    counts = [0]

    def counted(*told):
        counts[-1] += 1
        return evidence_of(*told)

    monkeypatch.setattr(relocalization, "evidence_of", counted)
    second = ring.drive(SECOND, np.random.default_rng(1))
    joined_at, looks = [], []
    for work in (math.inf, 60.0):
        config = MapperConfig(joining=JoiningConfig(work=work))
        mapper = Mapper.continued(first, ring.T_BASE_LASER, config=config)
        del counts[:]
        steps = []
        for one in second:
            counts.append(0)
            steps.append(mapper.update(one))
        joined_at.append([step.is_joined for step in steps].index(True))
        looks.append(max(counts))
    assert joined_at[1] > joined_at[0]
    # a log with a scan each two seconds has the time
    slow = [replace(one, time_s=20.0 * one.time_s) for one in second]
    mapper = Mapper.continued(first, ring.T_BASE_LASER)
    assert [mapper.update(one).is_joined for one in slow].index(True) < 0.7 * joined_at[1]
    assert looks[0] > 100
    # what is announced leaves out a look or two at the best of what was found
    assert looks[1] <= 66
    # a log that ends before all is looked at
    short = second[: joined_at[1] - 1]
    slam_map, steps = mapped(
        short,
        Mapper.continued(
            first, ring.T_BASE_LASER, config=MapperConfig(joining=JoiningConfig(work=60.0))
        ),
    )
    assert not steps[-1].is_joined
    assert slam_map.unjoined == ()


@pytest.mark.slow
def test_no_scan_of_a_session_waits_for_what_is_usual_on_the_map_or_for_all_loops_at_once(
    first, monkeypatch
):
    # both took most of 0.8 s on the map of half of intel
    mapper, asked = Mapper.continued(first, ring.T_BASE_LASER), list[int]()
    found = LoopCloser.found
    monkeypatch.setattr(VerdictLimits, "_learnt", None)
    monkeypatch.setattr(
        LoopCloser,
        "found",
        lambda *told, **more: asked.append(len(told[3])) or found(*told, **more),
    )
    steps = [mapper.update(one) for one in ring.drive(SECOND, np.random.default_rng(1))]
    assert steps[-1].is_joined
    assert max(asked) == 3


@pytest.mark.slow
def test_no_scan_of_another_laser_waits_for_what_is_usual_for_it(first, monkeypatch):
    # of the laser of the map it is learnt before; of half its beams it took 0.6 s of the first update
    counts = [0]

    def counted(*told):
        counts[-1] += 1
        return virtual_scan(*told)

    monkeypatch.setattr(verdict_limits, "virtual_scan", counted)
    mapper = Mapper.continued(first, ring.T_BASE_LASER)
    learnt_before, steps = counts.pop(), []
    for one in ring.drive(SECOND, np.random.default_rng(1)):
        counts.append(0)
        angles_rad, ranges_m = one.scan.angles_rad[::2], one.scan.ranges_m[::2]
        scan = replace(one.scan, angles_rad=angles_rad, ranges_m=ranges_m)
        steps.append(mapper.update(replace(one, scan=scan)))
    assert steps[-1].is_joined
    assert sum(counts) == learnt_before > 100
    assert max(counts) <= 1 + JoiningConfig().work // _VIRTUAL_SCAN


def test_what_a_drive_said_against_its_map_is_not_forgotten_in_the_next(first):
    # 22 m off in a corridor, called failed, and good once another session was joined with it
    objection = "walls along the way look the same all along: the map may be off by 2 m"
    again, _ = continued(first.objected([objection]), ring.drive(SECOND, np.random.default_rng(1)))
    assert again.unjoined == ()
    assert again.verdict.reasons == (objection,)
    assert not again.verdict.is_good


def test_scans_are_seen_from_keyframes_of_their_own_session_whatever_was_kept_of_those_before(
    first,
):
    true, count = FIRST[0].inverse() @ SECOND[0], len(first.keyframes)
    mapper = Mapper.continued(replace(first, steps=()), ring.T_BASE_LASER, true)
    for measurement in ring.drive(SECOND[:6], np.random.default_rng(1)):
        mapper.update(measurement)
    assert min(step.keyframe for step in mapper._drive.steps) == count


@pytest.mark.parametrize(
    ("is_of_first", "is_doubted"), [(False, False), (True, False), (False, True)]
)
def test_a_keyframe_aside_is_put_back_if_it_is_of_the_session(first, is_of_first, is_doubted):
    config = replace(MapperConfig(), is_odometry_doubted=is_doubted)
    start, count = FIRST[0].inverse() @ SECOND[0], len(first.keyframes)
    mapper = Mapper.continued(first, ring.T_BASE_LASER, start, config)
    for measurement in ring.drive(SECOND[:40], np.random.default_rng(1)):
        mapper.update(measurement)
    graph, off = mapper._drive.graph, SE2(0.0, 0.6, 0.0)
    assert len(graph) > count + 24
    at = count - 8 if is_of_first else count + 20
    keyframes, poses = list(graph.keyframes), graph.poses
    before = poses[at].copy()
    poses[at] = (SE2.from_array(before) @ off).as_array()
    one, after = keyframes[at : at + 2]
    # nothing but wheels tells that it was elsewhere: it saw nothing
    keyframes[at] = replace(one.place_alone(), T_before=one.T_before @ off)
    keyframes[at + 1] = replace(after, T_before=off.inverse() @ after.T_before)
    loops = [loop for loop in graph.loops if at not in (loop.earlier, loop.later)]
    graph.renew(keyframes, loops, poses)
    slam_map = mapper.finish()
    assert not slam_map.keyframes[at + 1].is_place_alone
    off_m = float(np.hypot(*(slam_map.poses[at] - before)[:2]))
    assert off_m == pytest.approx(0.6 if is_of_first else 0.0, abs=0.1)
    slopes = [step.slope for step in mapper._drive.front_end.scaled_steps]
    own = () if is_of_first else (at - count, at + 1 - count)
    # a second look takes those that leave the way open by the wheels as well: one, earlier
    still = [k for k, slope in enumerate(slopes) if k > 14 and not slope.any()]
    assert still == list(own)


def test_a_map_of_nothing_is_not_continued():
    # a log without fault on it ended failed, for what an empty map has against itself
    with pytest.raises(ValueError, match=r"nothing is on the map"):
        Mapper.continued(Mapper(SE2.identity()).finish(), SE2.identity())

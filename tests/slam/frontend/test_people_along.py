"""People who walk along between bare walls, where nothing but them and the wheels tells of the way; and walls
that are none, though wheels that spin or tell late deny them."""

from dataclasses import replace

import numpy as np
import pytest

from slam.beams import Beams
from slam.frontend.candidates import Candidates
from slam.frontend.front_end import FrontEnd
from slam.frontend.front_end_config import FrontEndConfig
from slam.frontend.keyframes import Keyframe
from slam.frontend.people_along import PeopleAlong
from slam.frontend.prediction import Prediction
from slam.frontend.seen_before import LastSeen, SeenBefore
from slam.measurements import Measurement
from slam.se2 import SE2
from slam.surface.surface_map import SurfaceMap, faced, moved
from slam.surface.surface_match import SurfaceMatch
from tests.slam.corridors import ANGLES_RAD, ROOM, WALLS, mapped, person, spun
from tests.slam.frontend.test_open_runs import kept
from tests.slam.synthetic import box, room, scan_of

CONFIG = FrontEndConfig()


def ahead(x: float) -> list[np.ndarray]:
    """Of a robot at x, one who walks two metres ahead of it for a while."""
    return [person(x + 2.0, 0.3)] if 3.0 < x < 8.0 else []


def slower(x: float) -> list[np.ndarray]:
    """Two, whom the robot comes up to."""
    first = 5.0 + 0.6 * (x - 3.0)
    return [person(first, 0.4), person(first + 0.3, -0.4)] if 3.0 < x < 8.0 else []


@pytest.mark.parametrize("people", [ahead, slower])
@pytest.mark.parametrize("step_m", [0.5, 1.0])
@pytest.mark.parametrize("sigma_m", [0.003, 0.01])
def test_good_wheels_are_believed_rather_than_people_who_walk_along(people, step_m, sigma_m):
    # 0.3 to 4 m off, and some of them good
    true_m, told_m = np.arange(0.0, 16.0, step_m), np.full(round(16.0 / step_m), step_m)
    told_m[0] = 0.0
    slam_map, off_m = mapped(
        true_m, told_m, sigma_m, lambda x: np.concatenate([WALLS, *people(x)]), turn_rad=0.005
    )
    assert off_m < 0.3
    # of a scan each metre there are too few to learn the wheels' scale
    assert slam_map.verdict.is_good or step_m == 1.0


@pytest.mark.parametrize("people", [ahead, slower])
@pytest.mark.parametrize("sigma_m", [0.003, 0.01])
@pytest.mark.parametrize(("step_m", "beams"), [(0.05, 361), (0.1, 361), (0.1, 1081)])
def test_people_who_draw_each_scan_by_less_than_wheels_could_deny(people, sigma_m, step_m, beams):
    # 2 to 5 m off, and of 16 with a scan each 0.1 m two good
    true_m = np.arange(0.0, 16.0, step_m)
    told_m = np.full(len(true_m), step_m)
    told_m[0] = 0.0
    slam_map, off_m = mapped(
        true_m, told_m, sigma_m, lambda x: np.concatenate([WALLS, *people(x)]),
        angles_rad=np.radians(np.linspace(-135.0, 135.0, beams)), turn_rad=0.005,
    )  # fmt: skip
    assert off_m < 0.3
    # steps of 5 cm are as sure as the scans' own noise: between bare walls nobody knows the way well enough
    assert slam_map.verdict.is_good or step_m == 0.05


@pytest.mark.parametrize(
    ("step_m", "sigma_m", "seed"), [(0.7, 0.05, 0), (0.7, 0.05, 1), (1.0, 0.05, 1), (0.7, 0.08, 0)]
)
def test_people_who_draw_a_scan_farther_off_than_wheels_are(step_m, sigma_m, seed):
    # not so far off that nothing else could tell it; 1.3 to 2.8 m off, and two of them good
    true_m = np.arange(0.0, 14.0, step_m)
    told_m = np.full(len(true_m), step_m)
    told_m[0] = 0.0
    slam_map, off_m = mapped(
        true_m, told_m, sigma_m,
        lambda x: np.concatenate([WALLS, *([person(5.5 + 0.6 * (x - 4.0), 0.3)] if x > 4.0 else [])]),
        seed=seed,
    )  # fmt: skip
    assert off_m < 0.35, slam_map.verdict


@pytest.mark.parametrize(
    ("sigma_m", "gone_m", "is_led"), [(0.01, 0.5, True), (0.3, 0.5, False), (0.01, 0.0, False)]
)
def test_where_wheels_surely_lead_a_scan_lies_if_it_fits_there_all_but_for_people(
    sigma_m, gone_m, is_led
):
    """Of a person who went as far as the robot; but odometry that stands may tell late of a way."""
    rng, surfaces = np.random.default_rng(1), SurfaceMap()
    for x in (-0.5, 0.0):
        surfaces.add(moved_by(x, faced(seen(x, [person(x + 2.0, 0.3)], rng).points, np.zeros(2))))
    beams = seen(0.5, [person(2.5, 0.3)], rng)
    points = faced(beams.points, np.zeros(2))
    led = SE2(0.5, 0.0, 0.0)
    last = led @ SE2(-gone_m, 0.0, 0.0)
    covariance = np.diag([sigma_m**2, sigma_m**2, 0.01**2])
    information = np.linalg.inv(covariance)
    told = Prediction(last, led, covariance, information, 1.0, is_coasting=False)
    bare = room(-30.0, -1.0, 30.0, 1.0)
    before = [kept(bare, SE2(x, 0.0, 0.0), rng) for x in np.arange(-4.0, 0.1, 0.5)]
    match = Candidates(LastSeen(surfaces, before, CONFIG)).led(points, beams, told)
    assert match.T_map_base.is_near(led, 0.1, 0.02) is is_led


@pytest.mark.parametrize("step_m", [0.25, 0.5])
@pytest.mark.parametrize("sigma_m", [0.003, 0.01])
@pytest.mark.parametrize(("slips", "every"), [(True, 1), (False, 2)])
def test_walls_of_a_room_are_no_people_however_sure_wheels_are(step_m, sigma_m, slips, every):
    # wheels that spin for a metre, or tell of two steps at each second scan: 0.5 to 1 m off and good
    true_m, told_m = np.arange(0.0, 14.0, step_m), np.full(round(14.0 / step_m), step_m)
    told_m[0] = 0.0
    if slips:
        true_m, told_m = spun(true_m, len(true_m) // 2, 1.0)
    if every == 2:
        told_m[2::2] += told_m[1:-1:2]
        told_m[1::2] = 0.0
    slam_map, off_m = mapped(true_m, told_m, sigma_m, lambda _: ROOM)
    assert off_m < 0.35, slam_map.verdict


@pytest.mark.parametrize(("at", "beams", "seed"), [(4, 181, 3), (4, 181, 6), (12, 1081, 4)])
def test_walls_that_have_just_come_into_reach_are_no_people(at, beams, seed):
    # of a laser that sees 4 m: 1 m off and good
    angles_rad = np.radians(np.linspace(-135.0, 135.0, beams))
    true_m, told_m = spun(np.arange(0.0, 14.0, 0.5), at, 1.0)
    slam_map, off_m = mapped(
        true_m, told_m, 0.01, lambda _: ROOM, angles_rad=angles_rad, range_m=4.0, seed=seed
    )
    assert off_m < 0.35, slam_map.verdict


@pytest.mark.parametrize(("drawn_m", "are_people"), [(0.0, False), (0.3, False), (0.9, True)])
def test_walls_seen_before_are_none_though_the_wheels_drew_a_match_aside(drawn_m, are_people):
    # in a corridor with doors, wheels that spun for 2 m: a match 0.27 m aside of where its walls had been
    rng, pose = np.random.default_rng(1), SE2(4.0, 0.0, 0.0)
    before = [kept(ROOM, SE2(x, 0.0, 0.0), rng) for x in np.arange(-1.0, 3.6, 0.5)]
    assert (
        seen_before(before, ROOM, pose, rng).are_people(at(4.0 + drawn_m), SE2(6.0, 0.0, 0.0))
        is are_people
    )


def test_people_that_those_before_saw_as_well_are_told_by_who_looked_through_there():
    """They walk slower than the robot: a little farther back the scan fits what was seen of them."""
    rng, bare = np.random.default_rng(4), room(-30.0, -1.0, 30.0, 1.0)
    before = []
    for k, x in enumerate(np.arange(0.0, 3.1, 0.25)):
        at_m = 2.5 + 0.1 * max(k - 5, 0)
        walls = np.concatenate([bare, person(at_m, 0.4)]) if k >= 5 else bare
        before.append(kept(walls, SE2(x, 0.0, 0.0), rng))
    walls = np.concatenate([bare, person(3.4, 0.4)])
    asked = seen_before(before, walls, SE2(3.25, 0.0, 0.0), rng)
    assert asked.are_people(at(3.0), SE2(3.25, 0.0, 0.0))


def test_somebody_whom_one_of_those_before_met_is_no_wall():
    # where others stand about, each in one scan of three, one of them drew a scan to where another had stood: with a
    # scan each 3 cm 0.58 m off, against wheels that told of it to 3 cm, and good
    rng, bare, before = np.random.default_rng(8), room(-30.0, -1.0, 30.0, 1.0), []
    for k, x in enumerate(np.arange(0.0, 3.1, 0.25)):
        walls = np.concatenate([bare, person(5.5, 0.3)]) if k == 6 else bare
        before.append(kept(walls, SE2(x, 0.0, 0.0), rng))
    walls = np.concatenate([bare, person(4.9, 0.3)])
    asked = seen_before(before, walls, SE2(3.25, 0.0, 0.0), rng)
    assert asked.are_people(at(3.85), SE2(3.25, 0.0, 0.0))


@pytest.mark.parametrize(
    ("far_m", "are_people"),
    [
        (5.5, True),  # where beams of those before came back from nowhere
        (8.1, False),  # at the end of what these could have seen
    ],
)
def test_people_stand_where_those_before_looked_through(far_m, are_people):
    rng, bare = np.random.default_rng(2), room(-30.0, -1.0, 30.0, 1.0)
    before = [kept(bare, SE2(x, 0.0, 0.0), rng) for x in np.arange(0.0, 3.1, 0.25)]
    walls = np.concatenate([bare, person(far_m, 0.3)])
    assert (
        seen_before(before, walls, SE2(4.0, 0.0, 0.0), rng).are_people(at(4.0), SE2(4.5, 0.0, 0.0))
        is are_people
    )


def test_of_a_room_where_somebody_else_walks_by_the_walls_are_none():
    rng, before = np.random.default_rng(5), []
    for k, x in enumerate(np.arange(0.0, 3.1, 0.25)):
        walls = np.concatenate([ROOM, person(4.5, -1.8 + 0.25 * k)])
        before.append(kept(walls, SE2(x, 0.0, 0.0), rng))
    walls = np.concatenate([ROOM, person(4.5, 1.6)])
    asked = seen_before(before, walls, SE2(3.25, 0.0, 0.0), rng)
    assert not asked.are_people(at(3.25), SE2(4.0, 0.0, 0.0))


def test_at_the_start_the_first_keyframe_says_what_stood_there():
    # the last two lie aside, where wheels that spun led
    rng = np.random.default_rng(6)
    scans = [kept(ROOM, SE2(x, 0.0, 0.0), rng) for x in (0.0, 0.25, 0.25)]
    before = [
        replace(one, T_map_base=SE2(x, 0.0, 0.0))
        for one, x in zip(scans, (0.0, 0.55, 0.85), strict=True)
    ]
    asked = seen_before(before, ROOM, SE2(0.25, 0.0, 0.0), rng)
    assert not asked.are_people(at(0.25), SE2(1.0, 0.0, 0.0))


def test_a_cart_close_by_hides_what_is_behind_it_from_all_but_the_last():
    rng, bare = np.random.default_rng(7), room(-30.0, -1.0, 30.0, 1.0)

    def with_it(x: float) -> np.ndarray:
        return np.concatenate([bare, box(x + 0.7, -0.4, x + 0.9, 0.4)])

    before = [kept(with_it(x), SE2(x, 0.0, 0.0), rng) for x in np.arange(0.0, 3.1, 0.25)]
    asked = seen_before(before, with_it(3.25), SE2(3.25, 0.0, 0.0), rng)
    assert asked.are_people(at(3.0), SE2(3.25, 0.0, 0.0))


def test_one_beam_that_strays_does_not_say_how_far_a_laser_sees():
    rng, bare = np.random.default_rng(2), room(-30.0, -1.0, 30.0, 1.0)
    before = [kept(bare, SE2(x, 0.0, 0.0), rng) for x in np.arange(0.0, 3.1, 0.25)]
    ranges_m = before[-1].beams.ranges_m.copy()
    ranges_m[3] = 40.0
    before[-1] = replace(before[-1], beams=replace(before[-1].beams, ranges_m=ranges_m))
    walls = np.concatenate([bare, person(9.5, 0.0)])
    asked = seen_before(before, walls, SE2(4.0, 0.0, 0.0), rng)
    assert not asked.are_people(at(4.0), SE2(4.5, 0.0, 0.0))


def test_keyframes_of_which_only_the_place_is_kept_say_nothing():
    rng, bare = np.random.default_rng(2), room(-30.0, -1.0, 30.0, 1.0)
    before = [kept(bare, SE2(x, 0.0, 0.0), rng).place_alone() for x in np.arange(0.0, 3.1, 0.25)]
    walls = np.concatenate([bare, person(5.5, 0.0)])
    asked = seen_before(before, walls, SE2(4.0, 0.0, 0.0), rng)
    assert not asked.are_people(at(4.0), SE2(4.5, 0.0, 0.0))


def test_what_hid_where_it_is_now_is_told_by_where_it_was():
    # a cart before the robot all along: behind it nobody saw anything, and now the scan looks through where it was
    rng, bare = np.random.default_rng(3), room(-30.0, -1.0, 30.0, 1.0)

    def with_it(x: float) -> np.ndarray:
        return np.concatenate([bare, box(x + 2.0, -0.2, x + 2.3, 0.2)])

    before = [kept(with_it(x), SE2(x, 0.0, 0.0), rng) for x in np.arange(0.0, 3.1, 0.25)]
    asked = seen_before(before, with_it(4.0), SE2(4.0, 0.0, 0.0), rng)
    assert asked.are_people(at(4.0), SE2(4.5, 0.0, 0.0))


class Alone(SurfaceMap):
    """Of which any scan matches at one place."""

    def __init__(self, place: SE2, cost: float = 0.04) -> None:
        super().__init__()
        self.place, self.cost = place, cost

    def match(self, points_base, T_start, *_):
        nothing = np.zeros((3, 3))
        return SurfaceMatch(self.place, nothing, nothing, 1.0, 1.0, self.cost, 1.0)


@pytest.mark.parametrize(
    ("alone", "cost", "step_m", "told_m", "are_people"),
    [
        (SE2(0.1, 0.0, 0.0), 0.04, 0.1, 0.2, True),
        (SE2(0.19, 0.0, 0.0), 0.04, 0.1, 0.2, False),  # by no more than noise
        (SE2(0.19, 0.0, 0.1), 0.04, 0.1, 0.2, False),  # a turn, which walls tell
        (SE2(0.1, 0.0, 0.0), 0.12, 0.1, 0.2, False),  # rough walls, as of a mine
        (SE2(0.1, 0.0, 0.0), 0.04, 0.5, 0.2, False),  # a long step, no farther off than wheels are
        (SE2(0.1, 0.0, 0.0), 0.12, 0.5, 0.3, True),
        # wheels that had spun, and were denied then: where somebody crosses they led all of it farther
        (SE2(0.1, 0.0, 0.0), 0.04, 0.1, 0.17, False),
    ],
)
def test_people_who_draw_scans_little_by_little(
    monkeypatch, alone, cost, step_m, told_m, are_people
):
    monkeypatch.setattr(SeenBefore, "are_people", lambda *_: True)
    P, led = 0.02**2 * np.eye(3), SE2(told_m, 0.0, 0.0)
    last = SE2(told_m - step_m, 0.0, 0.0)
    told = Prediction(last, led, P, np.linalg.inv(P), 1.0, is_coasting=False)
    since = replace(told, T_map_base=SE2(0.2, 0.0, 0.0))
    match = Alone(SE2(0.17, 0.0, 0.0)).match(None, led)
    asked = PeopleAlong(LastSeen(Alone(alone, cost), [], CONFIG))
    assert asked.have_drawn(np.zeros((0, 3)), None, told, since, match) is are_people


def test_walls_tell_what_lies_across_the_way_that_people_drew_a_scan_aside():
    rng, surfaces = np.random.default_rng(9), SurfaceMap()
    before = np.concatenate([room(-30.0, -1.0, 30.0, 1.0), person(1.7, 0.3)])
    surfaces.add(kept(before, SE2.identity(), rng).faced)
    walls = np.concatenate([room(-30.0, -1.0, 30.0, 1.0), person(2.0, 0.3)])
    points = kept(walls, SE2(0.3, 0.0, 0.0), rng).faced
    # by wheels that are sure, but turn by 6 degrees and go aside
    led, P = SE2(0.3, 0.1, 0.1), 0.01**2 * np.eye(3)
    since = Prediction(SE2.identity(), led, P, np.linalg.inv(P), 1.0, is_coasting=False)
    drawn = Alone(SE2.identity()).match(None, led)
    held = PeopleAlong(LastSeen(surfaces, [], CONFIG)).held_along(points, since, drawn)
    assert held.T_map_base.is_near(SE2(0.3, 0.0, 0.0), 0.05, 0.02)


@pytest.mark.parametrize("seed", [0, 1])
def test_wheels_that_spun_do_not_lead_on_because_somebody_crosses(seed):
    # of a laser that sees 4 m ahead, a metre farther and good
    def with_people(x: float) -> np.ndarray:
        crossing = [
            person(at_m + 1.0, -1.5 + 1.2 * (x - at_m + 2.5))
            for at_m in (4.0, 7.0, 9.0)
            if abs(x - at_m) < 2.5
        ]
        return np.concatenate([ROOM, *crossing])

    true_m, told_m = spun(np.arange(0.0, 14.0, 0.15), 45, 1.0)
    slam_map, off_m = mapped(
        true_m,
        told_m,
        0.01,
        with_people,
        angles_rad=np.radians(np.linspace(-90.0, 90.0, 181)),
        range_m=4.0,
        seed=seed,
    )
    assert off_m < 0.35, slam_map.verdict


@pytest.mark.parametrize(
    ("sigma_m", "is_held"),
    [(0.02, True), (0.4, False)],  # nobody knows the way
)
def test_where_people_drew_scans_the_wheels_lead_from_the_last_keyframe(
    monkeypatch, sigma_m, is_held
):
    front_end, rng = FrontEnd(SE2.identity()), np.random.default_rng(8)
    asked = []
    # people at the third scan
    monkeypatch.setattr(
        PeopleAlong, "have_drawn", lambda *args: bool(asked.append(args) or len(asked) == 2)
    )
    monkeypatch.setattr(PeopleAlong, "may_be", lambda *_: True)
    learnt = []
    monkeypatch.setattr(FrontEnd, "_learn_scale", lambda *args: learnt.append(args))
    for k in range(3):
        scan = scan_of(ROOM, SE2(0.05 * k, 0.0, 0.0), rng, 0.01, ANGLES_RAD, 8.0)
        motion = SE2(0.1 if k else 0.0, 0.0, 0.0)
        step = front_end.update(Measurement(0.2 * k, motion, scan, np.diag([sigma_m**2] * 3)))
    told = front_end._told
    assert len(asked) == (2 if is_held else 0)
    assert len(learnt) == (1 if is_held else 2)
    if is_held:
        since = asked[-1][4]
        assert since.T_map_base.is_near(SE2(0.2, 0.0, 0.0), 1e-9, 1e-9)
        assert np.allclose(since.covariance, told.covariance)
        # held to the wheels more than scans are let pull else
        assert step.T_map_base.x > 0.12


def seen_before(
    before: list[Keyframe], walls: np.ndarray, pose: SE2, rng: np.random.Generator
) -> SeenBefore:
    """Of a scan taken at a pose."""
    scan = scan_of(walls, pose, rng, 0.01, ANGLES_RAD, 8.0)
    points = faced(scan.points(SE2.identity()), np.zeros(2))
    # what it holds counts for nothing: not even that all of the scan stood there
    scratch = SurfaceMap()
    scratch.add(moved(pose, points))
    return SeenBefore(before, points, Beams.of(scan, SE2.identity()), CONFIG, scratch)


def at(x: float) -> SurfaceMatch:
    """A match that tells nothing but where it is."""
    return SurfaceMatch(SE2(x, 0.0, 0.0), np.eye(3), np.zeros((3, 3)), 1.0, 1.0, 0.1, 1.0)


def seen(x: float, people: list[np.ndarray], rng: np.random.Generator) -> Beams:
    """Between bare walls."""
    walls = np.concatenate([room(-30.0, -1.0, 30.0, 1.0), *people])
    scan = scan_of(walls, SE2(x, 0.0, 0.0), rng, 0.01, ANGLES_RAD, 8.0)
    return Beams.of(scan, SE2.identity())


def moved_by(x: float, points: np.ndarray) -> np.ndarray:
    return points + np.array([x, 0.0, 0.0])

import contextlib
import math
from dataclasses import replace

import numpy as np
import pytest

from kitasap_sim import Place, Simulation
from kitasap_sim.laser import laser
from tests.kitasap_sim.all_places import PLACES

HEIGHTS_M = (0.10, 0.17, 0.40)

TIGHT = """
<mujoco>
  <worldbody>
    <geom name="wall_s" type="box" size="1.1 0.05 0.5" pos="1 -0.05 0.5"/>
    <geom name="wall_n" type="box" size="1.1 0.05 0.5" pos="1 2.05 0.5"/>
    <geom name="wall_w" type="box" size="0.05 1.1 0.5" pos="-0.05 1 0.5"/>
    <geom name="wall_e" type="box" size="0.05 1.1 0.5" pos="2.05 1 0.5"/>
    {more}
    <site name="start" pos="1 1 0"/>
  </worldbody>
</mujoco>
"""
STOOLS = """
    <body name="stool" pos="0.3 0.3 0"><geom type="cylinder" size="0.1 0.2" pos="0 0 0.2"/></body>
    <geom name="rail" type="capsule" size="0.02" fromto="1.5 1.6 0.1 1.8 1.6 0.1"/>
    <frame pos="1.7 0.3 0"><geom name="crate" type="box" size="0.1 0.1 0.2" pos="0 0 0.2"/></frame>
"""


def points_near(place, spot_m, reach_m):
    points = place.map_at(0.10).points_m(0.01)
    return points[np.hypot(*(points - spot_m).T) < reach_m]


@pytest.mark.slow
@pytest.mark.parametrize("name", PLACES)
def test_every_place_has_something_that_can_be_pushed(name):
    place = Place(name)
    for height_m in HEIGHTS_M:
        piece = place.movable(height_m)
        assert not any(word in piece for word in ("wall", "column", "pillar", "post", "door"))
        for seed, distance_m in enumerate((0.1, 0.2, 0.3)):
            push_m = place.pushed(piece, distance_m, np.random.default_rng(seed))
            assert math.hypot(*push_m) == pytest.approx(distance_m)
    moved = place.rearranged({piece: push_m})
    assert moved.start == pytest.approx(place.start)
    assert moved.is_free(moved.track_m).all()  # the robot still drives its track
    assert len(moved.free_centres_m) > 0.9 * len(place.free_centres_m)


def test_chairs_are_taken_first():
    for name in ("room_fig4", "place_fig6"):
        assert "chair" in Place(name).movable(0.10)


def test_a_moved_chair_is_seen_where_it_stands_and_not_on_the_map():
    place, exact = Place("room_fig4"), laser("utm_30lx").without_errors()
    rng = np.random.default_rng
    plain = Simulation(place, exact, "ideal", rng=rng(0))
    moved = Simulation(place, exact, "ideal", rng=rng(0), moved_m={"chair_east": (-0.2, 0.1)})
    assert moved.place is place
    plain_m, moved_m = plain.true_ranges_m(), moved.true_ranges_m()
    assert 2 <= (plain_m != moved_m).sum() < 60
    for simulation in (plain, moved):
        x, y, heading = simulation.truth().pose
        angles = exact.angles_rad + heading
        laser_m = np.array([x, y]) + 0.19 * np.array([np.cos(heading), np.sin(heading)])
        ranges_m = simulation.true_ranges_m()
        ends = laser_m + ranges_m[:, None] * np.stack([np.cos(angles), np.sin(angles)], axis=1)
        points = simulation.world.map_at(0.17).points_m(0.002)
        near = ends[np.hypot(*(ends - [4.9, 2.1]).T) < 0.6]
        assert len(near) > 3
        # within half the spacing of the map's points, and 0.3 mm of a leg's facets
        assert max(np.hypot(*(points - end).T).min() for end in near) < 2e-3


def test_frames_bodies_and_geoms_are_moved_by_their_names(place_file):
    place = Place(place_file(TIGHT.format(more=STOOLS)))
    shifts = {"stool": (0.2, 0.1), "rail": (-0.5, 0.1), "crate": (0.0, 0.3)}
    moved = place.rearranged(shifts)
    for spot, shift in zip(([0.3, 0.3], [1.65, 1.6], [1.7, 0.3]), shifts.values(), strict=True):
        old = points_near(place, spot, 0.25)
        new = points_near(moved, np.add(spot, shift), 0.25)
        assert len(old) == pytest.approx(len(new), abs=2)
        assert new.mean(axis=0) - old.mean(axis=0) == pytest.approx(shift, abs=5e-3)
    assert place.rearranged({}).digest == place.digest
    back = moved.rearranged({name: (-dx, -dy) for name, (dx, dy) in shifts.items()})
    assert back.map_at(0.1).segments_m == pytest.approx(place.map_at(0.1).segments_m)


def test_pieces_that_are_not_there_are_refused_with_those_that_are(place_file):
    place = Place(place_file(TIGHT.format(more=STOOLS)))
    known = r"no piece called 'sofa'; there are: rail, crate, stool, wall_s, .*"
    for refused in (
        lambda: place.rearranged({"sofa": (0.1, 0.0)}),
        lambda: place.pushed("sofa", 0.1, np.random.default_rng(0)),
        lambda: Simulation(place, None, rng=np.random.default_rng(0), moved_m={"sofa": (0, 0)}),
    ):
        with pytest.raises(ValueError, match=known) as caught:
            refused()
        assert "\n" not in str(caught.value)
    with pytest.raises(ValueError, match=r"floor, bench, .* and 26 more"):
        Place("place_fig6").rearranged({"": (0.1, 0.0)})
    with pytest.raises(ValueError, match="two finite numbers"):
        place.rearranged({"stool": (0.1, math.nan)})


def test_a_place_without_loose_furniture_says_so(place_file):
    shelf = '<geom name="shelf" type="box" size="0.2 0.1 0.5" pos="0.2 0.1 0.5"/>'  # at the wall
    with pytest.raises(ValueError, match="no free-standing piece of furniture"):
        Place(place_file(TIGHT.format(more=shelf))).movable(0.10)


def test_a_piece_is_pushed_only_where_there_is_room(place_file):
    alley = "".join(
        f'<geom name="rail_{i}" type="box" size="0.3 0.02 0.2" pos="0.3 {y} 0.2"/>'
        for i, y in enumerate((0.24, 0.56))
    )
    stool = '<geom name="stool" type="cylinder" size="0.1 0.2" pos="0.15 0.4 0.2"/>'
    place = Place(place_file(TIGHT.format(more=alley + stool)))
    pushes_m = []
    for seed in range(20):
        with contextlib.suppress(ValueError):  # no direction drawn led along the alley
            pushes_m.append(place.pushed("stool", 0.1, np.random.default_rng(seed)))
    assert len(pushes_m) > 5
    for dx, dy in pushes_m:  # 4 cm of room on either side, 2 of them to be kept; the wall behind
        assert dx > 0.09
        assert abs(dy) < 0.04
    with pytest.raises(ValueError, match="something is in each way"):
        place.pushed("stool", 0.9, np.random.default_rng(0))  # onto the robot's start


@pytest.mark.slow
def test_people_and_the_hand_mind_what_was_moved():
    moved = Simulation(
        "room_fig4", None, rng=np.random.default_rng(0), people=2, moved_m={"table": (1.0, 0.8)}
    )
    segments = moved.world.map_at(0.10).segments_m
    points = []
    for _ in range(200):
        moved.run(0.1)
        points.append(moved.people_m().reshape(-1, 2))
    ends = segments.reshape(-1, 2)
    gaps_m = np.linalg.norm(np.concatenate(points)[:, None] - ends, axis=2).min(axis=1)
    assert gaps_m.min() > 0.19


def test_a_laser_mounted_askew_works_in_a_simulation():
    spec = laser("utm_30lx").without_errors()
    askew = replace(spec, first_angle_rad=spec.first_angle_rad + 4 * spec.step_rad)
    rng = np.random.default_rng
    straight_m = Simulation("room_fig4", spec, rng=rng(0)).true_ranges_m()
    askew_m = Simulation("room_fig4", askew, rng=rng(0)).true_ranges_m()
    assert askew_m[:-4] == pytest.approx(straight_m[4:], abs=1e-6)
    aside = replace(spec, mount_m=(0.19, 0.02, 0.17))
    assert not np.allclose(Simulation("room_fig4", aside, rng=rng(0)).true_ranges_m(), straight_m)

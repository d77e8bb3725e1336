import re
from itertools import pairwise

import mujoco
import numpy as np
import pytest

from kitasap_sim import KITASAP2, Place
from kitasap_sim.drive import Pilot
from kitasap_sim.place_files import place_names
from tests.kitasap_sim.all_places import PLACES

FLOOR_AND_WALLS = """
<mujoco>
  <worldbody>
    {floor}
    <geom type="box" size="1.1 0.05 0.5" pos="1 -0.05 0.5"/>
    <geom type="box" size="1.1 0.05 0.5" pos="1 2.05 0.5"/>
    <geom type="box" size="0.05 1.1 0.5" pos="-0.05 1 0.5"/>
    <geom type="box" size="0.05 1.1 0.5" pos="2.05 1 0.5"/>
    {more}
  </worldbody>
</mujoco>
"""

OPEN_CORNER = """
<mujoco>
  <worldbody>
    <geom type="box" size="1.1 0.05 0.5" pos="1 -0.05 0.5"/>
    <geom type="box" size="1.1 0.05 0.5" pos="1 2.05 0.5"/>
    <geom type="box" size="0.05 1.1 0.5" pos="-0.05 1 0.5"/>
    <geom type="box" size="0.05 0.5 0.5" pos="2.05 0.5 0.5"/>
    {more}
  </worldbody>
</mujoco>
"""


def distance_to_map(points, place_map):
    start, end = place_map.segments_m[:, 0], place_map.segments_m[:, 1]
    along = end - start
    share = np.einsum("ksd,sd->ks", points[:, None] - start, along) / (along**2).sum(1)
    nearest = start + np.clip(share, 0, 1)[..., None] * along
    return np.linalg.norm(points[:, None] - nearest, axis=2).min(axis=1)


@pytest.mark.parametrize("name", PLACES)
def test_every_beam_ends_on_the_true_map(name, make):
    place = Place(name)
    simulation = make(place)
    place_map = place.map_at(0.10)
    rng = np.random.default_rng(1)
    for _ in range(3):
        simulation.reset(place.draw_free_pose(rng))
        x, y, heading = simulation.truth().pose
        ranges_m = simulation.true_ranges_m()
        angles = simulation.laser.angles_rad + heading
        laser_m = np.array([x, y]) + 0.19 * np.array([np.cos(heading), np.sin(heading)])
        points = laser_m + ranges_m[:, None] * np.stack([np.cos(angles), np.sin(angles)], 1)
        assert np.isfinite(ranges_m).all()
        distances_m = distance_to_map(points, place_map)
        # circles are drawn with 128 sides; where a beam grazes the back of a chair's lying foot,
        # micrometres of height are millimetres of range
        assert np.quantile(distances_m, 0.98) < 1e-4
        assert distances_m.max() < 5e-3


def test_the_map_of_a_room_is_its_inner_faces_alone(box_room):
    points = box_room.map_at(0.10).points_m(0.01)
    inside = (points >= -0.02).all(axis=1) & (points <= [4.02, 3.02]).all(axis=1)
    assert inside.all()  # no outer faces, 10 cm further out
    # outline and pillar, a point for each centimetre at least; no table, shelf or glass
    wanted = (14 + 0.4 * np.pi) / 0.01
    assert wanted <= len(points) < 1.15 * wanted


def test_the_roomiest_spot_is_not_inside_of_a_wall(place_file):
    # a corridor of 1 m around the outside of a solid block of 4 x 4 m, closed by a fence
    fence = "".join(
        f'<geom type="box" size="{a} {b} 0.5" pos="{x} {y} 0.5"/>'
        for a, b, x, y in ((3.1, 0.05, 0, 3), (3.1, 0.05, 0, -3), (0.05, 3, 3, 0), (0.05, 3, -3, 0))
    )
    block = '<geom type="box" size="2 2 0.5" pos="0 0 0.5"/>'
    text = f"<mujoco><worldbody>{fence}{block}</worldbody></mujoco>"
    place = Place(place_file(text))
    assert np.abs(place.start[:2]).max() > 2.0
    assert np.abs(place.free_centres_m).max(axis=1).min() > 2.2


def test_what_lies_within_other_solids_is_not_on_the_map(place_file):
    # a wall of two boxes that run into each other, one of them turned, and a post at their joint
    more = """
    <geom type="box" size="0.3 0.05 0.5" pos="0.75 1 0.5"/>
    <geom type="box" size="0.3 0.05 0.5" pos="1.25 1 0.5" euler="0 0 10"/>
    <geom type="cylinder" size="0.02 0.5" pos="1 1 0.5"/>
    """
    segments_m = (
        Place(place_file(FLOOR_AND_WALLS.format(floor="", more=more))).map_at(0.10).segments_m
    )
    middles = segments_m.mean(axis=1)
    off = middles - [1.25, 1.0]
    turn = np.radians(10.0)
    turned = off @ np.array([[np.cos(turn), -np.sin(turn)], [np.sin(turn), np.cos(turn)]])
    for inside in (
        (np.abs(middles - [0.75, 1.0]) < [0.3 - 1e-6, 0.05 - 1e-6]).all(axis=1),
        (np.abs(turned) < [0.3 - 1e-6, 0.05 - 1e-6]).all(axis=1),
        np.hypot(*(middles - 1.0).T) < 0.02 - 1e-4,
    ):
        assert not inside.any()
    # what is left is closed: each piece begins where another ends, to the micrometre
    firsts, lasts = (np.unique(np.round(segments_m[:, k], 6), axis=0) for k in range(2))
    assert np.array_equal(firsts, lasts)


def test_no_wall_of_the_round_room_stands_within_another():
    # the ends of its boxes once did, and drew the points near them: NEES 15 instead of 3
    place = Place("round_room")
    segments_m = place.map_at(0.10).segments_m
    along = segments_m[:, 1] - segments_m[:, 0]
    aside = np.stack([-along[:, 1], along[:, 0]], axis=1) / np.hypot(*along.T)[:, None]
    data = mujoco.MjData(place.model)
    mujoco.mj_forward(place.model, data)
    geom = np.zeros(1, dtype=np.int32)
    for x, y in segments_m.mean(axis=1) + 1e-4 * aside:
        # from within a wall a ray meets its top, 0.8 m high; in the open nothing, or a seat
        at, up = np.array([x, y, 0.10]), np.array([0.0, 0.0, 1.0])
        above_m = mujoco.mj_ray(place.model, data, at, up, None, 1, -1, geom, None)
        assert above_m != pytest.approx(0.7, abs=0.01)


def test_the_map_changes_with_the_height_of_the_laser(box_room):
    at_shelf = box_room.map_at(0.30).points_m(0.01)
    assert (np.abs(at_shelf - [3.3, 0.3]).max(axis=1) < 0.21).any()


def test_free_space_keeps_the_robot_clear_of_everything_in_reach(box_room):
    margin_m = KITASAP2.radius_m
    assert box_room.is_free(np.array([1.5, 1.2]))[0]
    assert box_room.is_free(np.array([0.6, 2.4]))[0]  # under the table
    for taken in ([margin_m - 0.02, 1.5], [3.0, 1.5], [3.6, 0.6], [0.4, 0.4], [5.0, 1.0]):
        assert not box_room.is_free(np.array(taken))[0], taken


@pytest.mark.parametrize("name", place_names())
def test_a_robot_put_anywhere_free_touches_nothing_but_the_floor(name, make):
    place = Place(name)
    simulation = make(place, laser=None)
    rng = np.random.default_rng(2)
    for _ in range(100):
        simulation.reset(place.draw_free_pose(rng))
        simulation.step()
        assert simulation.data.ncon == 3  # two tires and the caster


def test_ways_lead_around_furniture(box_room):
    start, end = np.array([2.4, 2.0]), np.array([3.62, 2.0])
    assert not box_room.is_way_free(start, end)
    way = box_room.way(start, end)
    assert np.array_equal(way[[0, -1]], [start, end])
    assert all(box_room.is_way_free(a, b) for a, b in pairwise(way))
    length_m = np.linalg.norm(np.diff(way, axis=0), axis=1).sum()
    # around a pillar of 0.2 m with 0.3 m of robot: a little over the half circle's chord
    assert 1.3 < length_m < 2.2


def test_a_place_without_floor_or_start_gets_both(place_file, make):
    place = Place(place_file(FLOOR_AND_WALLS.format(floor="", more="")))
    assert not place.has_floor
    assert place.start == pytest.approx([1.0, 1.0, 0.0], abs=0.05)
    simulation = make(place)
    simulation.run(1.0)
    assert simulation.truth().height_m == pytest.approx(0.075, abs=1e-4)


def test_a_box_can_be_the_floor(place_file):
    floor = '<geom type="box" size="2 2 0.1" pos="1 1 -0.1"/>'
    assert Place(place_file(FLOOR_AND_WALLS.format(floor=floor, more=""))).has_floor


def test_meshes_spheres_and_capsules_are_on_the_map(place_file, make):
    more = """
    <geom type="sphere" size="0.2" pos="0.5 0.5 0.1"/>
    <geom type="capsule" size="0.1 0.3" pos="1.5 0.5 0.3"/>
    <geom type="ellipsoid" size="0.2 0.1 0.3" pos="1.5 1.6 0.2" euler="0 0 30"/>
    """
    place = Place(place_file(FLOOR_AND_WALLS.format(floor="", more=more)))
    points = place.map_at(0.10).points_m(0.005)
    for centre, radius_m in (((0.5, 0.5), 0.2), ((1.5, 0.5), 0.1)):
        distances_m = np.linalg.norm(points - centre, axis=1)
        near = distances_m[distances_m < radius_m + 0.05]
        assert near == pytest.approx(radius_m, abs=1e-3)
        assert near.size > 100


def test_a_users_place_is_loaded_by_path_and_its_errors_take_one_line(place_file, tmp_path):
    with pytest.raises(ValueError, match=r"no place called 'nowhere', nor a file.*room_fig4"):
        Place("nowhere")
    cases = {
        "<mujoco><worldbody>": "not a valid MJCF file",
        "not xml at all": "not a valid MJCF file",
        "<mujoco><worldbody><geom/></worldbody></mujoco>": "not",
        "<mujoco><worldbody><geom type='plane' size='1 1 1'/></worldbody></mujoco>": "nothing",
    }
    for text, reason in cases.items():
        with pytest.raises(ValueError, match=reason) as caught:
            Place(place_file(text))
        assert "\n" not in str(caught.value)
    with pytest.raises(ValueError, match=r"not a valid MJCF file: such end in \.xml"):
        Place(place_file("a room", "room.txt"))
    for end, makes in ((".yaml", "from-map (or from-plan)"), (".json", "from-houseexpo")):
        with pytest.raises(ValueError, match=re.escape(f"`kitasap world {makes}` makes one")):
            Place(place_file("image: room.pgm", f"room{end}"))
    blocked = FLOOR_AND_WALLS.format(floor="", more='<site name="start" pos="0.1 1 0"/>')
    with pytest.raises(ValueError, match=r"start .* room around it"):
        _ = Place(place_file(blocked)).free_centres_m
    gap = OPEN_CORNER.format(more="")
    with pytest.raises(ValueError, match=r"no site 'start'.*add the site") as caught:
        _ = Place(place_file(gap)).free_centres_m
    assert "\n" not in str(caught.value)
    helped = OPEN_CORNER.format(more='<site name="start" pos="1 1 0"/>')
    assert Place(place_file(helped)).is_free(np.array([1.0, 1.0]))[0]
    assert not list(tmp_path.iterdir())


def test_the_symmetric_room_is_symmetric_but_for_one_box():
    place = Place("symmetric_room")
    points = place.map_at(0.10).points_m(0.01)
    turned = np.array([6.0, 4.0]) - points
    distances_m = np.array([np.linalg.norm(points - point, axis=1).min() for point in turned])
    odd = turned[distances_m > 0.02]
    assert 0.2 < np.ptp(odd, axis=0).max() < 1.2  # the box, and the wall that it hides
    assert len(odd) < 0.06 * len(points)


def test_the_round_room_has_no_straight_wall():
    place = Place("round_room")
    for height_m in (0.10, 0.40):
        segments = place.map_at(height_m).segments_m
        assert np.linalg.norm(segments[:, 1] - segments[:, 0], axis=1).max() < 0.20


def test_the_kidnap_pair_of_the_laboratory_is_free():
    place = Place("room_fig4")
    one = place.start[:2]
    two = one + np.array([0.0, -1.0])
    assert place.is_free(np.array([one, two])).all()
    assert place.is_way_free(one, two)


@pytest.mark.parametrize("name", place_names())
def test_the_scripted_track_is_free_and_closed(name):
    place = Place(name)
    assert len(place.track_m) > 5
    assert np.array_equal(place.track_m[0], place.track_m[-1])
    assert all(place.is_way_free(a, b) for a, b in pairwise(place.track_m))


@pytest.mark.slow
def test_the_robot_drives_its_scripted_track_at_twenty_centimetres_a_second(make):
    place = Place("symmetric_room")
    simulation = make(place)
    simulation.reset(np.array([*place.track_m[0], 0.0]))
    speeds_mps = []
    for _ in Pilot(simulation).follow(place.track_m):
        speeds_mps.append(simulation.truth().speed_mps)
    assert np.median([v for v in speeds_mps if v > 0.05]) == pytest.approx(0.2, rel=0.01)
    # the ideal robot's odometry is true to millimetres over 9 m
    assert np.hypot(*(simulation.truth().pose[:2] - place.track_m[-1])) < 0.01


def test_the_digest_changes_with_what_a_place_includes(tmp_path):
    place_file = tmp_path / "place.xml"
    part = tmp_path / "part.xml"
    include = '<include file="part.xml"/>'
    place_file.write_text(FLOOR_AND_WALLS.format(floor="", more=include))
    digests = []
    for size in ("0.1", "0.1", "0.1000000000001", "0.2"):
        part.write_text(f'<mujocoinclude><geom size="{size}" pos="1 1 0.1"/></mujocoinclude>')
        place = Place(place_file)
        digests.append((place.digest, place.shape_digest))
    alike, same, nearly, other = digests
    assert alike == same
    assert nearly[0] != same[0]
    assert nearly[1] == same[1]
    assert other[0] != same[0]
    assert other[1] != same[1]

import numpy as np
import pytest
from scipy.spatial import cKDTree

from kitasap_sim import Place, Simulation, kidnap
from kitasap_sim.drive import Pilot
from kitasap_sim.laser import laser
from kitasap_sim.tracks import Track, Tracks
from tests.kitasap_sim.all_places import PLACES

LEG_RADIUS_M = 0.055
ROBOT_RADIUS_M = 0.30


def crowded(place, laser="urg_04lx", people=3, seed=0, **options) -> Simulation:
    return Simulation(
        place, laser, "ideal", rng=np.random.default_rng(seed), people=people, **options
    )


def walked(simulation, duration_s, every_s=0.05):
    """(T, N, 2, 2) where the legs were, and (T, 2) the robot."""
    legs, robot = [], []
    while simulation.time_s < duration_s:
        simulation.run(every_s)
        legs.append(simulation.people_m())
        robot.append(simulation.truth().pose[:2])
    return np.array(legs), np.array(robot)


@pytest.mark.parametrize("name", PLACES)
def test_no_leg_is_ever_within_a_solid_or_the_robot(name):
    place = Place(name)
    legs, robot = walked(crowded(place, None, people=4), 15.0, every_s=0.1)
    points = legs.reshape(-1, 2)
    for height_m in (0.10, 0.40):
        gaps_m, _ = cKDTree(place.map_at(height_m).points_m(0.01)).query(points)
        # 0.30 m of room for the robot's middle, less 0.10 m from body to foot
        assert gaps_m.min() > 0.19
    # no wall crossed: each spot lies within a step of one where the robot may stand
    bodies = legs.mean(axis=2).reshape(-1, 2)
    assert place.is_free(bodies).mean() > 0.9
    assert np.linalg.norm(legs - robot[:, None, None], axis=3).min() > 0.5


@pytest.mark.slow
def test_people_keep_clear_of_a_robot_that_drives_among_them():
    place = Place("room_fig4")
    simulation = crowded(place, people=4)
    simulation.reset(np.array([*place.track_m[0], 0.0]))
    gaps_m = []
    for _ in Pilot(simulation).follow(place.track_m):
        offset_m = simulation.people_m() - simulation.truth().pose[:2]
        gaps_m.append(np.linalg.norm(offset_m, axis=2).min())
    assert len(gaps_m) > 500
    # a body keeps 0.5 m from the robot's middle, a foot is 0.1 m aside
    assert min(gaps_m) > 0.4 > ROBOT_RADIUS_M + LEG_RADIUS_M


@pytest.mark.slow
def test_people_walk_at_a_strolls_speed_one_foot_still_while_the_other_swings(box_room):
    simulation = crowded("room_fig4", None)
    legs, _ = walked(simulation, 30.0, every_s=0.01)
    speeds = np.linalg.norm(np.diff(legs, axis=0), axis=3) / 0.01
    slow, fast = np.sort(speeds, axis=2)[..., 0], speeds.max(axis=2)
    is_walking = fast > 0.3
    assert is_walking.mean() > 0.5
    # turning on the spot moves both; a step moves one
    assert (slow[is_walking] < 1e-6).mean() > 0.8
    # a smooth swing is at most three times as fast as the body, at 1.2 m/s, plus corners
    assert fast.max() < 3 * 1.2 * 1.3
    bodies_mps = np.linalg.norm(np.diff(legs.mean(axis=2)[::100], axis=0), axis=2)
    assert 0.5 < np.quantile(bodies_mps, 0.8) < 1.3
    feet_apart_m = np.linalg.norm(legs[:, :, 0] - legs[:, :, 1], axis=2)
    assert feet_apart_m.min() > 2 * LEG_RADIUS_M
    assert feet_apart_m.max() < 0.9


def test_a_track_is_walked_in_whole_steps():
    track = Track.along(np.array([[0.0, 0.0], [2.5, 0.0]]), 0, 1)
    assert track.step_m == pytest.approx(0.625)
    for steps in range(5):
        left_m, right_m = track.feet_m(steps * track.step_m)
        assert left_m == pytest.approx(right_m)
        assert left_m == pytest.approx(steps * track.step_m)
    (left, right, *_), (foot, _) = track.legs(0.0), track.feet_m(0.5)
    assert left == pytest.approx((0.0, 0.1))
    assert right == pytest.approx((0.0, -0.1))
    assert foot != pytest.approx(track.feet_m(0.5)[1])


def test_legs_stop_beams_where_they_stand():
    spec = laser("rplidar_a2").without_errors()
    simulation, empty = crowded("symmetric_room", spec), crowded("symmetric_room", spec, people=0)
    simulation.run(0.5)
    empty.run(0.5)
    ranges_m, bare_m = simulation.true_ranges_m(), empty.true_ranges_m()
    x, y, heading = simulation.truth().pose
    angles = spec.angles_rad + heading
    directions = np.stack([np.cos(angles), np.sin(angles)], axis=1)
    seen = np.zeros(len(angles), dtype=bool)
    for leg in simulation.people_m().reshape(-1, 2):
        along_m = directions @ (leg - (x, y))
        aside_m = np.abs(directions @ np.array([[0, -1], [1, 0]]) @ (leg - (x, y)))
        is_at = (aside_m < LEG_RADIUS_M - 1e-3) & (along_m > 0) & (bare_m > along_m)
        ends_m = along_m - np.sqrt(np.maximum(LEG_RADIUS_M**2 - aside_m**2, 0.0))
        # the robot on its tires is some micrometres off the upright
        assert (ranges_m[is_at] < ends_m[is_at] + 1e-4).all()
        seen |= is_at & (np.abs(ranges_m - ends_m) < 1e-4)
    assert seen.sum() > 10
    is_cut_short = ranges_m < bare_m - 1e-4
    assert (is_cut_short & ~seen).sum() <= 2 * 6  # at the edges of six legs


def test_each_beam_of_the_fan_sees_the_legs_of_its_own_instant():
    spec = laser("utm_30lx").without_errors()
    rolling, still = crowded("symmetric_room", spec), crowded("symmetric_room", spec)
    empty = crowded("symmetric_room", spec, people=0)
    frame = [rolling.next_frame() for _ in range(8)][-1]
    still.run(frame.beam_times_s.min() - 0.5 * still.timestep_s)
    checked = on_legs = 0
    while still.time_s < frame.time_s:
        fired = np.flatnonzero(np.abs(frame.beam_times_s - still.time_s) < 1e-6)
        now_m = still.true_ranges_m()[fired]
        assert frame.ranges_m[fired] == pytest.approx(now_m, abs=1e-9)
        checked += fired.size
        on_legs += int((empty.true_ranges_m()[fired] - now_m > 0.1).sum())
        still.step()
    assert checked == spec.beam_count
    assert on_legs > 20


@pytest.mark.slow
def test_equal_seeds_give_equal_people_and_frames_however_the_steps_are_asked_for():
    def run(seed, by_step=False):
        simulation = crowded("room_fig4", seed=seed)
        simulation.drive(0.05, 0.2)
        if by_step:
            frames = [frame for _ in range(1000) if (frame := simulation.step()) is not None]
        else:
            frames = simulation.run(2.0)
        ranges_m = np.stack([frame.ranges_m for frame in frames])
        return ranges_m.tobytes(), simulation.people_m().tobytes()

    assert run(1) == run(1) == run(1, by_step=True)
    assert run(1)[1] != run(2)[1]


def test_without_people_nothing_changes_and_with_them_the_robot_and_its_noise_do_not(box_room):
    def run(**options):
        rng = np.random.default_rng(3)
        simulation = Simulation(box_room, "urg_04lx", "rough_floor", rng=rng, **options)
        simulation.drive(0.1, 0.2)
        frames = simulation.run(1.0)
        ranges_m = np.stack([frame.ranges_m for frame in frames])
        ticks = np.stack([frame.wheel_ticks for frame in frames])
        return ranges_m, ticks, simulation.truth().pose, rng.bit_generator.state

    plain, none, some = run(), run(people=0), run(people=1)
    for a, b in zip(plain, none, strict=True):
        assert np.array_equal(a, b, equal_nan=True) if isinstance(a, np.ndarray) else a == b
    assert np.array_equal(plain[1], some[1])
    assert np.array_equal(plain[2], some[2])
    assert plain[3] == some[3]  # as many random numbers drawn
    is_same = (plain[0] == some[0]) | (np.isnan(plain[0]) & np.isnan(some[0]))
    assert 0.5 < is_same.mean() < 1.0


@pytest.mark.slow
def test_a_reset_spreads_people_anew_and_away_from_the_robot():
    place = Place("round_room")
    simulation = crowded(place, None, people=4)
    rng, before = np.random.default_rng(0), simulation.people_m()
    for _ in range(20):
        pose = place.draw_free_pose(rng)
        simulation.reset(pose)
        legs = simulation.people_m()
        assert np.linalg.norm(legs - pose[:2], axis=2).min() > 0.5
        bodies = legs.mean(axis=1)
        apart_m = np.linalg.norm(bodies[:, None] - bodies, axis=2)[~np.eye(4, dtype=bool)]
        assert apart_m.min() > 0.3
        assert not np.array_equal(legs, before)
        before = legs


@pytest.mark.slow
def test_the_hand_carries_the_robot_through_people_as_it_does_without(box_room):
    placed = []
    for people in (0, 2):
        simulation = crowded("room_fig4", people=people)
        done = kidnap(simulation, np.array([4.3, 0.75, 0.0]))
        placed.append(done.placed)
        assert len(done.frames) > 40
    assert np.array_equal(placed[0], placed[1])


def test_people_who_do_not_fit_are_refused_in_one_line(box_room):
    for people, reason in ((-1, "people are 0 or more, not -1"), (60, "too small for 60 people")):
        with pytest.raises(ValueError, match=reason) as caught:
            crowded(box_room, None, people=people)
        assert "\n" not in str(caught.value)
    assert crowded(box_room, None, people=0).people_m().shape == (0, 2, 2)


def test_waypoints_are_those_of_the_obvious_loop():
    place = Place("symmetric_room")
    for count in (5, 60):  # 60: more than there is room for
        left_m = np.random.default_rng(3).permutation(place.free_centres_m)
        obvious = []
        while len(left_m) and len(obvious) < count:
            obvious.append(left_m[0])
            left_m = left_m[np.hypot(*(left_m - left_m[0]).T) >= 1.0]
        found = Tracks(place, count, np.random.default_rng(3))
        np.testing.assert_array_equal(found._waypoints_m, obvious)
        assert len(found) <= count

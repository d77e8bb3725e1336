import mujoco
import numpy as np
import pytest

from kitasap_sim import LASERS, Place, Simulation
from kitasap_sim.laser import laser
from kitasap_sim.place_files import place_names


@pytest.mark.parametrize("name", ["urg_04lx", "lms200", "rplidar_a1"])
def test_the_fan_equals_multi_ray_at_the_same_pose(box_room, make, name):
    simulation = make(box_room, name)
    for pose in ([1.5, 1.2, 0.3], [2.2, 0.8, -2.0]):
        simulation.reset(np.array(pose))
        simulation.run(0.4)
        mujoco.mj_sensorPos(simulation.model, simulation.data)
        assert simulation.fan_ranges_m() == pytest.approx(simulation.true_ranges_m(), abs=1e-9)


def test_each_beam_is_fired_at_its_own_instant_of_the_sweep(box_room, make):
    simulation = make(box_room)
    delays_s, step_s = simulation.laser.delays_s(), simulation.timestep_s
    for sweep, frame in enumerate(simulation.run(0.5)):
        wanted_s = sweep * 0.1 + delays_s
        # fired at the first step at or after its instant, never before
        assert (frame.beam_times_s >= wanted_s - 1e-9).all()
        assert (frame.beam_times_s < wanted_s + step_s + 1e-9).all()
        assert frame.time_s >= frame.beam_times_s.max()


def test_a_rolling_scan_of_a_turning_robot_is_what_each_beam_saw_at_its_time(box_room, make):
    exact = laser("urg_04lx").without_errors()
    rolling, still = make(box_room, exact), make(box_room, exact)
    rolling.drive(0.0, 0.5)
    rolling.run(0.5)
    frame = rolling.next_frame()
    still.drive(0.0, 0.5)
    checked = 0
    while still.time_s < frame.time_s:
        fired = np.flatnonzero(np.abs(frame.beam_times_s - still.time_s) < 1e-6)
        if fired.size:
            now_m = still.true_ranges_m()
            assert frame.ranges_m[fired] == pytest.approx(now_m[fired], abs=1e-9)
            checked += fired.size
        still.step()
    assert checked == 682


def test_a_turning_robots_scan_is_skewed(box_room, make):
    simulation = make(box_room, laser("urg_04lx").without_errors())
    simulation.drive(0.0, 0.5)
    simulation.run(1.0)
    frame = simulation.next_frame()
    skew_m = np.abs(frame.ranges_m - simulation.true_ranges_m())
    assert np.median(skew_m) > 2e-3  # 67 ms at 0.5 rad/s are 1.9 degrees from first to last beam


def test_frames_come_at_the_lasers_rate_whatever_the_control_period(box_room, make):
    for chunk_s in (0.02, 0.05, 1.0):
        simulation = make(box_room)
        frames = [frame for _ in range(round(1.0 / chunk_s)) for frame in simulation.run(chunk_s)]
        assert len(frames) == 10
        assert np.diff([frame.time_s for frame in frames]) == pytest.approx(0.1, abs=1e-9)


def test_encoders_give_whole_counts_of_the_wheel_angle(open_floor, make):
    simulation = make(open_floor)
    simulation.drive(0.2, 0.0)
    simulation.run(3.0)
    simulation.drive(0.0, 0.0)
    simulation.run(1.0)
    ticks = simulation.wheel_ticks()
    assert ticks.dtype == np.int64
    metres = ticks * 2 * np.pi * 0.075 / 132_000
    assert metres == pytest.approx(simulation.truth().pose[0], abs=3e-3)


def test_equal_seeds_give_equal_frames_to_the_bit(box_room, make):
    def frames(seed):
        simulation = make(box_room, seed=seed)
        simulation.drive(0.1, 0.2)
        return np.stack([frame.ranges_m for frame in simulation.run(1.0)])

    assert frames(1).tobytes() == frames(1).tobytes()
    assert frames(1).tobytes() != frames(2).tobytes()


def test_reset_puts_the_robot_exactly_there_and_starts_anew(box_room, make):
    simulation = make(box_room)
    simulation.drive(0.2, 0.5)
    simulation.run(1.0)
    simulation.reset(np.array([2.0, 1.0, -3.0]))
    assert simulation.truth().pose == pytest.approx([2.0, 1.0, -3.0], abs=1e-12)
    assert simulation.time_s == 0.0
    assert np.array_equal(simulation.wheel_ticks(), [0, 0])
    assert simulation.next_frame().time_s < 0.1  # no beam is left over from before the reset


def test_a_simulation_without_a_laser_gives_no_frames_and_says_so(open_floor, make):
    simulation = make(open_floor, laser=None)
    assert simulation.run(1.0) == []
    with pytest.raises(ValueError, match="without a laser"):
        simulation.next_frame()


@pytest.mark.slow
@pytest.mark.parametrize("name", place_names())
def test_no_place_gives_a_warning_within_sixty_seconds(name):
    simulation = Simulation(name, None, "rough_floor", rng=np.random.default_rng(0))
    simulation.drive(0.05, 0.4)
    simulation.run(60.0)
    assert [warning.number for warning in simulation.data.warning] == [0] * 7
    assert simulation.truth().height_m == pytest.approx(0.075, abs=5e-3)


@pytest.mark.parametrize("name", LASERS)
def test_a_frame_holds_the_beams_of_one_sweep(box_room, make, name):
    simulation = make(box_room, name)
    simulation.drive(0.1, 0.3)
    period_s, delays_s = simulation.laser.period_s, simulation.laser.delays_s()
    for sweep, frame in enumerate(simulation.run(1.0)):
        # a laser that sees all around fires the next sweep's first beam within the same step
        late_s = frame.beam_times_s - (sweep * period_s + delays_s)
        assert late_s.min() > -1e-6
        assert late_s.max() < simulation.timestep_s + 1e-6


def test_a_place_cannot_change_the_robots_physics(place_file, make):
    room = """
    <mujoco>
      <option gravity="0 0 -1.6" wind="5 0 0" density="100" timestep="0.01">
        <flag contact="disable" sensor="disable" actuation="disable" equality="disable"/>
      </option>
      <default><geom contype="0" conaffinity="0" margin="0.01"/></default>
      <worldbody>
        <geom type="box" size="0.05 3 0.5" pos="3 0 0.5"/>
        <site name="start"/>
      </worldbody>
    </mujoco>
    """
    simulation = make(Place(place_file(room)))
    assert simulation.truth().height_m == pytest.approx(0.075, abs=1e-4)
    simulation.drive(0.2, 0.0)
    simulation.run(2.0)
    assert simulation.truth().speed_mps == pytest.approx(0.2, rel=0.01)
    assert np.isfinite(simulation.next_frame().ranges_m).any()


@pytest.mark.parametrize(
    ("geoms", "reason"),
    [
        ('<geom type="plane" size="9 9 1" pos="0 0 0.5"/>', "does not stand on a floor at z = 0"),
        ('<geom type="plane" size="9 9 1"/><geom name="kitasap2/hull" size="1"/>', "repeated name"),
    ],
)
def test_a_place_that_the_robot_cannot_stand_in_is_refused_in_one_line(
    place_file, make, geoms, reason
):
    wall = '<geom type="box" size="0.1 3 0.5" pos="3 0 0.5"/><site name="start"/>'
    with pytest.raises(ValueError, match=reason) as caught:
        make(place_file(f"<mujoco><worldbody>{geoms}{wall}</worldbody></mujoco>"))
    assert "\n" not in str(caught.value)


def test_a_pose_that_is_none_is_refused(box_room, make):
    simulation = make(box_room)
    for pose in ([np.nan, 0, 0], [1.0, 1.0]):
        with pytest.raises(ValueError, match="three finite numbers"):
            simulation.reset(np.array(pose))

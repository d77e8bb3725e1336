import numpy as np
import pytest

from kitasap_sim import Operator, kidnap


@pytest.mark.parametrize("wheels", ["held", "coast"])
def test_the_papers_kidnap_is_placed_within_a_tenth_of_a_millimetre(box_room, make, wheels):
    simulation = make(box_room, odometry="as_built")
    simulation.reset(np.array([1.5, 2.2, 0.4]))
    simulation.next_frame()
    pose = np.array([1.5, 1.2, 0.4 + np.pi / 2])
    done = kidnap(simulation, pose, wheels)
    assert np.hypot(*(done.placed - pose)[:2]) < 1e-4
    assert done.placed[2] == pytest.approx(pose[2], abs=1e-5)
    assert np.abs(done.ticks_after - done.ticks_before).max() <= 20
    assert simulation.truth().height_m == pytest.approx(0.075, abs=1e-4)  # it stands again


def test_the_robot_is_really_lifted_and_scans_go_on_from_the_air(box_room, make):
    simulation = make(box_room)
    simulation.reset(np.array([1.5, 2.0, 0.0]))
    heights_m = []
    step = simulation.step

    def watched_step():
        heights_m.append(simulation.truth().height_m)
        return step()

    simulation.step = watched_step
    done = kidnap(simulation, np.array([1.5, 1.0, 1.0]))
    assert max(heights_m) == pytest.approx(0.175, abs=1e-3)
    assert len(done.frames) > 40


def test_the_robot_drives_after_it_was_set_down(box_room, make):
    simulation = make(box_room)
    simulation.reset(np.array([1.0, 2.0, 0.0]))
    kidnap(simulation, np.array([1.0, 1.0, 0.0]), "coast")
    simulation.drive(0.2, 0.0)
    simulation.run(3.0)
    assert simulation.truth().pose[0] == pytest.approx(1.6, abs=0.05)


def test_the_hand_carries_around_what_stands_in_the_way(box_room, make):
    simulation = make(box_room)
    simulation.reset(np.array([2.4, 2.0, 0.0]))
    pose = np.array([3.62, 2.0, 2.0])
    done = kidnap(simulation, pose)
    assert len(done.way_m) > 2
    assert np.hypot(*(done.placed - pose)[:2]) < 1e-4
    assert np.abs(done.ticks_after - done.ticks_before).max() <= 20


def test_the_hand_refuses_a_pose_where_the_robot_cannot_stand(box_room, make):
    simulation = make(box_room)
    with pytest.raises(ValueError, match="something is in the robot's way at"):
        kidnap(simulation, np.array([3.0, 2.0, 0.0]))


def test_the_operator_is_as_inaccurate_as_he_says():
    rng = np.random.default_rng(0)
    aimed = np.array([Operator().aimed(np.zeros(3), rng) for _ in range(4000)])
    # 4000 draws: a standard deviation is known to 1.1 %
    assert aimed.std(axis=0) == pytest.approx([0.01, 0.01, 0.02], rel=0.05)


def test_coasting_wheels_turn_on_where_held_ones_are_stopped(box_room, make):
    counts = {}
    for wheels in ("held", "coast"):
        simulation = make(box_room)
        simulation.reset(np.array([1.0, 2.0, 0.0]))
        simulation.drive(0.3, 0.0)
        simulation.run(1.0)  # taken while it drives
        done = kidnap(simulation, np.array([1.0, 1.0, 0.0]), wheels)
        counts[wheels] = (done.ticks_after - done.ticks_before).min()
    assert counts["coast"] > 1.5 * counts["held"]


def test_wheels_are_held_or_coast_and_nothing_else(box_room, make):
    with pytest.raises(ValueError, match="wheels are held or coast, not 'Held'"):
        kidnap(make(box_room), np.array([1.0, 1.0, 0.0]), "Held")

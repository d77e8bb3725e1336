"""The relations metric, its files, and relations built of a reference."""

import math
from pathlib import Path

import numpy as np
import pytest

from slam.metrics import (
    Relations,
    built_relations,
    read_relations,
    relation_errors,
    write_relations,
)
from slam.pose_arrays import between, composed
from slam.pose_lookup import PoseLookup
from slam.readers.carmen import read_carmen
from slam.se2 import SE2
from slam.trajectory import Trajectory, read_tum
from tests.slam.logs import shared_log

LAP_S = 60.0


def laps(count: int, step_s: float = 1.0) -> Trajectory:
    """Poses on a circle of 5 m, once around in a minute."""
    times_s = np.arange(0.0, count * LAP_S + 0.5 * step_s, step_s)
    turned = 2.0 * math.pi * times_s / LAP_S
    return Trajectory(times_s, np.column_stack([5 * np.sin(turned), -5 * np.cos(turned), turned]))


def test_perfect_trajectory_in_another_frame_has_no_error():
    reference = laps(3)
    moved = Trajectory(reference.times_s, composed(SE2(7.0, 8.0, 2.0).as_array(), reference.poses))
    scores = relation_errors(built_relations(reference), PoseLookup(moved))
    assert scores["all"].coverage == 1.0
    assert scores["all"].errors.translation_m.max < 1e-9
    assert scores["all"].errors.rotation_rad.max < 1e-9


def test_errors_are_those_of_each_relation_alone():
    rng = np.random.default_rng(3)
    times_s = np.arange(100.0)
    estimated = rng.uniform(-3.0, 3.0, (100, 3))
    chosen = rng.integers(0, 100, (40, 2))
    motions = rng.uniform(-3.0, 3.0, (40, 3))
    relations = Relations(times_s[chosen], motions)
    lengths, turns = [], []
    for (first, second), motion in zip(chosen, motions, strict=True):
        A, B = SE2.from_array(estimated[first]), SE2.from_array(estimated[second])
        off = SE2.from_array(motion).inverse() @ (A.inverse() @ B)
        lengths.append(math.hypot(off.x, off.y))
        turns.append(abs(off.theta))
    found = relation_errors(relations, PoseLookup(Trajectory(times_s, estimated)))
    is_loop = np.abs(chosen[:, 1] - chosen[:, 0]) > 30
    for name, part in (("all", is_loop | True), ("loop", is_loop), ("sequential", ~is_loop)):
        score = found[name]
        assert (score.count, score.covered) == (part.sum(), part.sum())
        assert score.errors.translation_m.mean == pytest.approx(np.array(lengths)[part].mean())
        assert score.errors.translation_m.std == pytest.approx(np.array(lengths)[part].std())
        assert score.errors.rotation_rad.mean == pytest.approx(np.array(turns)[part].mean())
        assert score.errors.translation_m.max == pytest.approx(np.array(lengths)[part].max())
    worst = times_s[chosen[int(np.argmax(lengths))]]
    assert found["all"].worst == tuple(worst)


def test_relation_without_a_pose_at_both_ends_counts_in_the_coverage_alone():
    trajectory = Trajectory([0.0, 1.0, 10.0], np.zeros((3, 3)))
    times_s = [[0.0, 1.0], [0.5, 1.0], [1.0, 5.0], [10.0, 11.0]]
    score = relation_errors(
        Relations(times_s, np.tile([3.0, 4.0, 0.1], (4, 1))), PoseLookup(trajectory)
    )
    assert (score["all"].count, score["all"].covered, score["all"].coverage) == (4, 2, 0.5)
    assert score["all"].errors.translation_m.mean == pytest.approx(5.0)
    assert score["all"].errors.rotation_rad.max == pytest.approx(0.1)
    assert score["loop"].count == 0
    assert math.isnan(score["loop"].coverage)
    assert score["loop"].worst is None


def test_turn_of_one_pose_is_seen_by_the_relations_that_touch_it():
    reference = laps(1)
    poses = reference.poses.copy()
    poses[20, 2] += 0.2
    scores = relation_errors(
        built_relations(reference), PoseLookup(Trajectory(reference.times_s, poses))
    )
    turned = scores["sequential"].errors.rotation_rad
    assert turned.mean * turned.count == pytest.approx(0.4)


def test_built_relations_join_neighbours_and_each_pose_with_the_nearest_of_before():
    reference = laps(2)
    relations = built_relations(reference)
    assert (~relations.is_loop).sum() == 120
    loops = relations.times_s[relations.is_loop]
    # from when the robot is within 1 m of its start, a lap ahead of it
    assert len(loops) == 62
    np.testing.assert_allclose(loops[1:, 1] - loops[1:, 0], LAP_S)
    first = reference.poses[loops[:, 0].astype(int)]
    second = reference.poses[loops[:, 1].astype(int)]
    np.testing.assert_allclose(relations.motions[relations.is_loop], between(first, second))
    assert np.hypot(*relations.motions[relations.is_loop, :2].T).max() <= 1.0


def test_built_relations_do_not_hang_on_the_order_of_the_lines():
    reference = laps(2)
    shuffled = np.random.default_rng(1).permutation(len(reference))
    again = built_relations(Trajectory(reference.times_s[shuffled], reference.poses[shuffled]))
    np.testing.assert_array_equal(again.times_s, built_relations(reference).times_s)


def test_pause_of_the_reference_is_no_loop_and_an_empty_one_has_no_relations():
    paused = Trajectory([0.0, 1.0, 100.0, 101.0], [[0, 0, 0], [1, 0, 0], [9, 0, 0], [10, 0, 0]])
    assert built_relations(paused).times_s.tolist() == [[0.0, 1.0], [100.0, 101.0]]
    assert len(built_relations(Trajectory(np.empty(0), np.empty((0, 3))))) == 0


def test_relations_survive_the_file(tmp_path):
    relations = built_relations(laps(2))
    write_relations(tmp_path / "a.relations", relations)
    back = read_relations(tmp_path / "a.relations")
    np.testing.assert_allclose(back.times_s, relations.times_s, atol=1e-6)
    np.testing.assert_allclose(back.motions, relations.motions, atol=1e-9)
    assert [path.name for path in tmp_path.iterdir()] == ["a.relations"]


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (b"# only a comment\n", "no relation in it, lines of timestamp1 timestamp2 x y"),
        (b"# head\n1 2 0 0 0 0 0 0\n1 2 0 0\n", r"line 3: a relation has 8 numbers, .*, found 4$"),
        (b"1 2 x 0 0 0 0 0\n", r"line 1: expected a number, found 'x'$"),
        (b"1 2 nan 0 0 0 0 0\n", r"line 1: a number is not finite$"),
        (b"\x1f\x8b\xff\x00", "binary, not a file of relations"),
    ],
)
def test_broken_file_is_named(tmp_path: Path, content, message):
    (tmp_path / "a.relations").write_bytes(content)
    with pytest.raises(ValueError, match=rf"/a\.relations:? {message}"):
        read_relations(tmp_path / "a.relations")


@pytest.mark.slow
def test_reference_and_odometry_of_intel_score_as_is_known():
    # data/README.md: 0.029 m for the reference; 7.37 +- 14.3 m and 39 degrees for the wheels alone
    relations = read_relations(shared_log("intel.relations"))
    records = list(read_carmen(shared_log("intel.clf.gz")).records)
    odometry = Trajectory(
        [record.time_s for record in records],
        [record.T_odom_base.as_array() for record in records],
    )
    wheels = relation_errors(relations, PoseLookup(odometry))["all"]
    assert (wheels.count, wheels.coverage) == (2984, 1.0)
    assert wheels.errors.translation_m.mean == pytest.approx(7.37, abs=0.01)
    assert wheels.errors.translation_m.std == pytest.approx(14.3, abs=0.1)
    assert math.degrees(wheels.errors.rotation_rad.mean) == pytest.approx(39.0, abs=0.5)
    reference = read_tum(shared_log("intel.reference.tum"))
    scores = relation_errors(relations, PoseLookup(reference, odometry))
    assert scores["all"].coverage == 1.0
    assert scores["all"].errors.translation_m.mean == pytest.approx(0.029, abs=0.001)
    assert (scores["loop"].count, scores["sequential"].count) == (1211, 1773)

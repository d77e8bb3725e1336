"""Trajectories in TUM format, and interpolation."""

import math

import numpy as np
import pytest

from slam.trajectory import Trajectory, read_tum, write_tum


def test_trajectory_survives_the_file(tmp_path):
    rng = np.random.default_rng(0)
    times_s = 976052857.4 + np.arange(50) * 0.1
    poses = rng.uniform(-3.1, 3.1, (50, 3))
    poses[0, 2], poses[1, 2] = math.pi, -math.pi + 1e-6
    write_tum(tmp_path / "a.tum", Trajectory(times_s, poses))
    back = read_tum(tmp_path / "a.tum")
    # nine decimals; stamps of 1e9 s hold 1e-7 s
    np.testing.assert_allclose(back.times_s, times_s, atol=2e-7)
    np.testing.assert_allclose(back.poses[:, :2], poses[:, :2], atol=1e-9)
    turn = np.exp(1j * back.poses[:, 2]) / np.exp(1j * poses[:, 2])
    np.testing.assert_allclose(np.angle(turn), 0.0, atol=4e-9)
    assert [path.name for path in tmp_path.iterdir()] == ["a.tum"]


def test_empty_trajectory_survives_the_file(tmp_path):
    write_tum(tmp_path / "a.tum", Trajectory(np.empty(0), np.empty((0, 3))))
    assert len(read_tum(tmp_path / "a.tum")) == 0


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("# head\n1 2 3 0 0 0 0 1\n1 2 3 0 0\n", "/a.tum line 3: expected 8 numbers, found 5$"),
        ("1 2 x 0 0 0 0 1\n", "/a.tum line 1: expected a number, found 'x'$"),
        ("1 nan 3 0 0 0 0 1\n", "/a.tum line 1: a number is not finite$"),
        ("1 2 1e300 0 0 0 0 1\n", r"/a.tum line 1: at 2 1e\+300; expected metres, none beyond 1e"),
    ],
)
def test_broken_line_is_named(tmp_path, text, message):
    (tmp_path / "a.tum").write_text(text)
    with pytest.raises(ValueError, match=message):
        read_tum(tmp_path / "a.tum")


def test_binary_file_is_no_trajectory(tmp_path):
    (tmp_path / "a.tum").write_bytes(b"\x1f\x8b\xff\x00")
    with pytest.raises(ValueError, match="binary"):
        read_tum(tmp_path / "a.tum")


def test_heading_between_two_poses_goes_the_short_way():
    trajectory = Trajectory([0.0, 1.0], [[0.0, 0.0, 3.0], [1.0, 2.0, -3.0]])
    x, y, theta = trajectory.at([0.5])[0]
    assert (x, y, abs(theta)) == pytest.approx((0.5, 1.0, math.pi))


def test_times_outside_or_going_back_are_refused():
    with pytest.raises(ValueError, match="within"):
        Trajectory([0.0, 1.0], np.zeros((2, 3))).at([1.1])
    with pytest.raises(ValueError, match="increase"):
        Trajectory([1.0, 0.0], np.zeros((2, 3))).at([0.5])


def test_a_quaternion_that_is_none_is_refused(tmp_path):
    (tmp_path / "zero.tum").write_text("1.0 0 0 0 0 0 0 0\n")
    with pytest.raises(ValueError, match=r"zero\.tum line 1: the quaternion .* not of length 1"):
        read_tum(tmp_path / "zero.tum")

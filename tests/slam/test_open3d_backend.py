"""Open3D on planar clouds: mirror images, determinism, imports."""

import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from slam import open3d_backend
from slam.open3d_backend import best_pose_open3d, explained, registration_icp
from slam.point_map import PointMap
from slam.se2 import SE2
from tests.slam.synthetic import ROOM_CENTRE, ROOM_SEGMENTS, sampled, scan_of

REPOSITORY = Path(__file__).parents[2]


def kabsch(source: np.ndarray, target: np.ndarray) -> SE2:
    """The best pose in closed form, in the plane: the slow, obvious twin."""
    a, b = source - source.mean(axis=0), target - target.mean(axis=0)
    cross, dot = np.sum(a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]), np.sum(a * b)
    theta = np.arctan2(cross, dot)
    shift = target.mean(axis=0) - (SE2(0.0, 0.0, theta) @ source).mean(axis=0)
    return SE2(*shift, theta)


@pytest.mark.parametrize("seed", range(20))
def test_best_pose_is_the_closed_form_one(seed):
    rng = np.random.default_rng(seed)
    source = rng.uniform(-5.0, 5.0, (50, 2))
    target = SE2(*rng.uniform(-3.0, 3.0, 3)) @ source + rng.normal(0.0, 0.3, (50, 2))
    best = best_pose_open3d(source, target).as_array()
    # doubles of 5 m beside planes at 100 m: 1e-12 relative, times their ratio
    np.testing.assert_allclose(best, kabsch(source, target).as_array(), atol=1e-9)


def test_best_pose_of_a_noisy_single_wall_is_never_its_mirror_image():
    # Noise across the wall is all that tells left from right: flat clouds came back with a
    # heading error of pi, or with a rotation about the wall, in half of these.
    rng = np.random.default_rng(0)
    wall = np.column_stack([np.linspace(-2.0, 2.0, 200), np.full(200, 1.5)])
    for _ in range(50):
        target = wall + rng.normal(0.0, 0.01, wall.shape)
        pose = best_pose_open3d(wall + rng.normal(0.0, 0.01, wall.shape), target)
        # 1 cm noise on 200 points, lever 1.15 m rms: 0.9 mrad; ten of these
        assert abs(pose.theta) < 0.009
        assert np.hypot(pose.x, pose.y) < 0.03


def test_best_pose_stays_a_rotation_when_the_pairs_are_mirrored_across_a_wide_place():
    # The best orthogonal fit of a mirrored cloud is a reflection. With planes 1 m apart Open3D
    # mends it by turning the planes over, since they are closer than the cloud is wide, and what
    # is left in the plane is the reflection.
    rng = np.random.default_rng(1)
    source = rng.uniform(-20.0, 20.0, (300, 2)) * [1.0, 0.7]
    target = source * [1.0, -1.0]
    best = best_pose_open3d(source, target)
    np.testing.assert_allclose(best.as_array(), kabsch(source, target).as_array(), atol=1e-9)


def test_pairs_of_different_number_are_refused():
    with pytest.raises(ValueError, match="3 and 2"):
        best_pose_open3d(np.zeros((3, 2)), np.zeros((2, 2)))
    with pytest.raises(ValueError, match="0 and 0"):
        best_pose_open3d(np.zeros((0, 2)), np.zeros((0, 2)))


def test_distance_at_which_the_planes_would_mix_is_refused():
    with pytest.raises(ValueError, match="max_distance_m"):
        registration_icp(np.zeros((3, 2)), PointMap(np.zeros((1, 2)), 0.1), SE2.identity(), 200, 1)


def test_registration_sees_points_added_to_the_map():
    # the cached cloud must not outlive a change of the map
    scan = np.random.default_rng(0).uniform(0.0, 1.0, (50, 2))
    point_map = PointMap([[50.0, 50.0]], 1e-3)
    assert registration_icp(scan, point_map, SE2.identity(), 0.5, 30) == SE2.identity()
    point_map.integrate(SE2(0.01, 0.0, 0.0) @ scan)
    assert registration_icp(scan, point_map, SE2.identity(), 0.5, 30).x == pytest.approx(0.01)


_FINGERPRINT = """
from tests.slam.test_open3d_backend import fingerprint
print(fingerprint())
"""


def fingerprint() -> str:
    """Poses that Open3D finds from ten starts, to the last bit."""
    room = PointMap(sampled(ROOM_SEGMENTS, 0.01), 0.01)
    rng = np.random.default_rng(5)
    points = scan_of(ROOM_SEGMENTS, ROOM_CENTRE, rng, 0.02).points(SE2.identity())
    poses = []
    for _ in range(10):
        start = ROOM_CENTRE @ SE2.exp(rng.uniform(-0.15, 0.15, 3))
        poses.append(registration_icp(points, room, start, 0.3, 7).as_array())
    return np.array(poses).tobytes().hex()


@pytest.mark.slow
def test_registration_is_the_same_to_the_bit_on_one_core_and_on_all():
    if not hasattr(os, "sched_setaffinity"):
        pytest.skip("only Linux binds a process to one core")
    answers = set()
    for cores in (os.sched_getaffinity(0), {min(os.sched_getaffinity(0))}):
        code = f"import os; os.sched_setaffinity(0, {cores})\n{_FINGERPRINT}"
        answers.add(_python(code))
    answers.update(fingerprint() for _ in range(5))
    assert len(answers) == 1


def test_open3d_runs_on_one_thread_while_it_registers_and_on_all_afterwards():
    if not sys.platform.startswith("linux"):
        pytest.skip("the name of TBB's function is that of Linux")
    open3d = open3d_backend.load_open3d()
    (library,) = Path(open3d.__file__).parent.glob("libtbb.so*")
    active = open3d_backend.ctypes.CDLL(str(library))[
        "_ZN3tbb6detail2r127global_control_active_valueEi"
    ]
    active.restype = open3d_backend.ctypes.c_size_t
    before = active(0)
    with open3d_backend._one_thread():
        assert active(0) == 1
    assert active(0) == before


def test_slam_works_without_mujoco_and_does_not_import_open3d():
    code = """
import sys

BLOCKED = {"mujoco", "gymnasium", "kitasap_sim", "experiments", "matplotlib"}

class Blocked:
    def find_spec(self, name, path=None, target=None):
        if name.split(".")[0] in BLOCKED:
            raise ImportError(f"{name} is blocked")

sys.meta_path.insert(0, Blocked())
import pkgutil, importlib, slam
for module in pkgutil.walk_packages(slam.__path__, "slam."):
    importlib.import_module(module.name)
assert "open3d" not in sys.modules, "imported with the library"
from slam.open3d_backend import best_pose_open3d
import numpy as np
corner = np.array([[0.0, 0.0], [1.0, 0.0], [0.0, 2.0]])
print(round(best_pose_open3d(corner, corner + 1.0).x, 9))
"""
    # Open3D imports matplotlib where it is installed, and goes on where it is not.
    assert _python(code) == "1.0"


@pytest.mark.parametrize(
    ("message", "package"),
    [
        ("libGL.so.1: cannot open shared object file", "libgl1"),
        ("libEGL.so.1: cannot open shared object file", "libegl1"),
        ("libX11.so.6: cannot open shared object file", "libx11-6"),
        ("libusb-1.0.so.0: cannot open shared object file", "libusb-1.0-0"),
    ],
)
def test_missing_system_library_is_explained_by_its_package(message, package):
    assert f"apt-get install {package} " in explained(ImportError(message))


def _python(code: str) -> str:
    done = subprocess.run(
        [sys.executable, "-c", code], cwd=REPOSITORY, capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr
    return done.stdout.strip()

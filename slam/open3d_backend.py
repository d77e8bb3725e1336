"""Open3D's point-to-point registration for planar clouds: the only module that imports Open3D.

NumPy and SE2 in, SE2 out. Open3D is imported at the first call, not with the module: it takes a
second, and most of the library does without.
"""

from __future__ import annotations

import ctypes
import importlib
import math
from collections.abc import Iterator
from contextlib import contextmanager
from functools import cache
from pathlib import Path
from typing import Any
from weakref import WeakKeyDictionary

import numpy as np

from slam.arrays import FloatArray, checked_points
from slam.point_map import PointMap
from slam.se2 import SE2

# Open3D fits rotations of space. To it a flat cloud (z = 0) turned over about a line in its plane
# is a rotation like any other, so a mirror image passes: facing a single wall the fit came back
# flipped in half of the trials. Every cloud is therefore doubled onto two planes, z = -LIFT_M and
# z = +LIFT_M. Umeyama's fit mends a reflection on the axis of least spread: the planes lie farther
# apart than any scan is wide, so that this axis never is z.
LIFT_M = 100.0

# What each missing system library is called on Debian and Ubuntu.
_DEBIAN_PACKAGES = {
    "libusb-1.0": "libusb-1.0-0",
    "libGL.so": "libgl1",
    "libEGL.so": "libegl1",
    "libX11.so": "libx11-6",
    "libgomp.so": "libgomp1",
    "libudev.so": "libudev1",
    "libidn2.so": "libidn2-0",
    "libstdc++.so": "libstdc++6",
}


def best_pose_open3d(source: FloatArray, target: FloatArray) -> SE2:
    """The pose that moves source (P, 2) onto target (P, 2) with the least mean squared distance.

    Row i of one belongs to row i of the other. Raises ValueError unless both are (P, 2), P >= 1.
    """
    source, target = checked_points(source, "source"), checked_points(target, "target")
    if len(source) != len(target) or len(source) == 0:
        raise ValueError(f"need as many points, at least one: {len(source)} and {len(target)}")
    open3d = load_open3d()
    ids = np.repeat(np.arange(2 * len(source), dtype=np.int32)[:, np.newaxis], 2, axis=1)
    matrix = _point_to_point().compute_transformation(
        _lifted_cloud(source), _lifted_cloud(target), open3d.utility.Vector2iVector(ids)
    )
    return planar(matrix)


def registration_icp(
    points_base: FloatArray,
    point_map: PointMap,
    T_map_base: SE2,
    max_distance_m: float,
    max_iterations: int,
    tolerance: float = 1e-9,
) -> SE2:
    """Where Open3D's own point-to-point ICP ends, started at T_map_base.

    tolerance: Open3D stops when neither its fitness nor its RMSE [m] changed by more. Whether that
    is convergence is for the caller to judge by the poses.
    Raises ValueError for a map without points, or a distance at which the two planes would mix.
    """
    points = checked_points(points_base, "points_base")
    if len(points) == 0 or len(point_map) == 0:
        raise ValueError(f"cannot register {len(points)} points on a map of {len(point_map)}")
    if not 0.0 < max_distance_m < 2.0 * LIFT_M:
        raise ValueError(f"max_distance_m must lie in (0, {2.0 * LIFT_M}), not {max_distance_m}")
    registration = load_open3d().pipelines.registration
    criteria = registration.ICPConvergenceCriteria(tolerance, tolerance, max_iterations)
    with _one_thread():
        result = registration.registration_icp(
            _lifted_cloud(points),
            _map_cloud(point_map),
            max_distance_m,
            spatial(T_map_base),
            _point_to_point(),
            criteria,
        )
    return planar(result.transformation)


@cache
def load_open3d() -> Any:
    """The module open3d, with libusb-1.0 taken from the `libusb-package` wheel where it lacks.

    Raises ImportError that names the Debian package when another system library is missing.
    """
    try:
        return importlib.import_module("open3d")
    except ImportError as error:
        if "libusb-1.0" not in str(error):
            raise ImportError(explained(error)) from error
    _preload_libusb()
    try:
        return importlib.import_module("open3d")
    except ImportError as error:
        raise ImportError(explained(error)) from error


def explained(error: ImportError) -> str:
    """What to install when the import of Open3D failed like this."""
    for library, package in _DEBIAN_PACKAGES.items():
        if library in str(error):
            return f"Open3D needs {library}: sudo apt-get install {package} ({error})"
    return f"Open3D cannot be imported: {error}"


def _preload_libusb() -> None:
    # Open3D links libusb for depth cameras nobody uses here. Loaded with RTLD_GLOBAL, the wheel's
    # copy carries the soname that the linker looks for, and the import goes through.
    try:
        libusb_package = importlib.import_module("libusb_package")
    except ImportError as error:
        raise ImportError(
            "Open3D needs libusb-1.0: pip install libusb-package, or sudo apt-get install"
            " libusb-1.0-0"
        ) from error
    ctypes.CDLL(str(libusb_package.get_library_path()), mode=ctypes.RTLD_GLOBAL)


class _TbbGlobalControl(ctypes.Structure):
    """Layout of oneTBB's tbb::global_control: value, reserved, parameter."""

    _fields_ = (
        ("value", ctypes.c_size_t),
        ("reserved", ctypes.c_ssize_t),
        ("parameter", ctypes.c_int),
    )


@contextmanager
def _one_thread() -> Iterator[None]:
    """Open3D's CPU loops run on the calling thread alone; undone at the end.

    Found in Open3D 0.20: the wheel carries no OpenMP; its legacy ICP sums the pairs in a
    tbb::parallel_reduce, whose order of summation is free to depend on which worker is idle (older
    sources: an OpenMP loop with the same fault). In forty runs on two cores the bits never
    differed, but nothing promises that on sixty-four. One thread makes it a plain loop in order,
    costs no more CPU time, and keeps parallel trials from fighting over the cores.
    """
    control = _TbbGlobalControl(1, 0, 0)  # parameter 0 is max_allowed_parallelism
    tbb = _tbb()
    if tbb is None:
        yield
        return
    create, destroy = tbb
    create(ctypes.byref(control))
    try:
        yield
    finally:
        destroy(ctypes.byref(control))


@cache
def _tbb() -> tuple[Any, Any] | None:
    """The constructor and destructor of tbb::global_control in Open3D's own copy of oneTBB.

    None where the wheel has no such library: the test of determinism then tells whether it matters.
    """
    for path in sorted(Path(load_open3d().__file__).parent.glob("libtbb.*")):
        library = ctypes.CDLL(str(path))
        create = getattr(library, "_ZN3tbb6detail2r16createERNS0_2d114global_controlE", None)
        destroy = getattr(library, "_ZN3tbb6detail2r17destroyERNS0_2d114global_controlE", None)
        if create is not None and destroy is not None:
            return create, destroy
    return None


# Open3D's copy of each map, with the version it was made of.
_map_clouds: WeakKeyDictionary[PointMap, tuple[int, Any]] = WeakKeyDictionary()


def _map_cloud(point_map: PointMap) -> Any:
    version, cloud = _map_clouds.get(point_map, (-1, None))
    if version != point_map.version:
        cloud = _lifted_cloud(point_map.points)
        _map_clouds[point_map] = (point_map.version, cloud)
    return cloud


def _lifted_cloud(points: FloatArray) -> Any:
    open3d = load_open3d()
    lifted = np.empty((2 * len(points), 3))
    lifted[: len(points), :2] = lifted[len(points) :, :2] = points
    lifted[: len(points), 2], lifted[len(points) :, 2] = -LIFT_M, LIFT_M
    return open3d.geometry.PointCloud(open3d.utility.Vector3dVector(lifted))


def _point_to_point() -> Any:
    return load_open3d().pipelines.registration.TransformationEstimationPointToPoint()


def spatial(pose: SE2) -> FloatArray:
    """The homogeneous matrix (4, 4) of a pose in the plane z = 0."""
    matrix = np.eye(4)
    matrix[:2, :2] = pose.matrix()[:2, :2]
    matrix[:2, 3] = pose.x, pose.y
    return matrix


def planar(matrix: FloatArray) -> SE2:
    """The pose in the plane of a homogeneous matrix (4, 4)."""
    return SE2(matrix[0, 3], matrix[1, 3], math.atan2(matrix[1, 0], matrix[0, 0]))

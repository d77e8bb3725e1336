"""The libraries that `kitasap bench registration` measures beside ours, each used as it asks to be.

All search pairs within `MAX_PAIR_DISTANCE_M`, and are given NumPy arrays: making their own type of
cloud of the scan is part of each registration, that of the map is not. All but SciPy work in space:
a scan lies there at z = 0. To fits of points that is enough as long as walls all around keep a
mirror image from fitting best (slam/open3d_backend.py doubles the clouds, since a robot may face a
single wall). To fits of planes height, roll and pitch are free then, which both solvers bear; the
doubled cloud cost Open3D 2.7 times the time, for the same poses.
"""

import importlib
import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.spatial import cKDTree

from experiments.bench.registration import KnownMap, Register, Registration
from slam.arrays import FloatArray
from slam.measurements import LaserScan
from slam.open3d_backend import load_open3d, planar, spatial
from slam.se2 import SE2

MAX_PAIR_DISTANCE_M = 0.1
"""Chosen: of 0.1, 0.2, 0.3 and 1.0 the best for Open3D and small_gicp, by RMSE (room_fig4, seed 7,
200 scans: 2.8, 2.8, 2.9, 3.3 mm for Open3D; one of them fails whichever it is)."""
_CONVERGED = 1e-6
"""Steps [m, rad] below this are a thousandth of what one scan can tell."""
_CONVERGED_RMSE = 1e-9
"""Open3D asks for the change of the RMSE [m], which is quadratic in the step."""
_MANY = 200
_NEIGHBOURS = 10
"""For normals and covariances: small_gicp's own default."""
_ZIGZAG_M = 0.005


@dataclass(frozen=True)
class Open3dLegacy:
    """open3d.pipelines.registration.registration_icp, which builds the map's tree at each call.

    tolerance: of fitness, and of the RMSE [m].
    """

    name: str
    note: str
    max_iterations: int = 30
    tolerance: float = 1e-6
    to_plane: bool = False
    package: str | None = None

    def prepare(self, known: KnownMap) -> Register:
        """The map as a cloud, with normals where they are asked for."""
        open3d = load_open3d()
        registration = open3d.pipelines.registration

        def cloud(points: FloatArray) -> Any:
            return open3d.geometry.PointCloud(open3d.utility.Vector3dVector(points))

        target = cloud(_flat(known.points))
        estimation = registration.TransformationEstimationPointToPoint()
        if self.to_plane:
            target.normals = open3d.utility.Vector3dVector(_flat(_normals(known.points)))
            estimation = registration.TransformationEstimationPointToPlane()
        criteria = registration.ICPConvergenceCriteria(
            self.tolerance, self.tolerance, self.max_iterations
        )

        def register(points_base: FloatArray, scan: LaserScan, T_start: SE2) -> SE2:
            source, start = cloud(_flat(points_base)), spatial(T_start)
            result = registration.registration_icp(
                source, target, MAX_PAIR_DISTANCE_M, start, estimation, criteria
            )
            return planar(result.transformation)

        return register


@dataclass(frozen=True)
class Open3dTensor:
    """open3d.t.pipelines.registration.icp on the CPU; it too builds the map's search each time."""

    name: str
    note: str
    package: str | None = None

    def prepare(self, known: KnownMap) -> Register:
        """The map as a cloud of doubles; float32 is no faster."""
        open3d = load_open3d()
        registration, tensor = open3d.t.pipelines.registration, open3d.core.Tensor
        target = open3d.t.geometry.PointCloud(tensor(_flat(known.points)))
        estimation = registration.TransformationEstimationPointToPoint()
        criteria = registration.ICPConvergenceCriteria(1e-6, 1e-6, 30)

        def register(points_base: FloatArray, scan: LaserScan, T_start: SE2) -> SE2:
            source = open3d.t.geometry.PointCloud(tensor(_flat(points_base)))
            start = tensor(spatial(T_start))
            result = registration.icp(
                source, target, MAX_PAIR_DISTANCE_M, start, estimation, criteria
            )
            return planar(result.transformation.numpy())

        return register


@dataclass(frozen=True)
class ScipyPointToPoint:
    """What one writes in ten lines: cKDTree for the pairs, the closed form in the plane."""

    name: str
    note: str
    package: str | None = None

    def prepare(self, known: KnownMap) -> Register:
        """The map's tree."""
        tree = cKDTree(known.points)

        def register(points_base: FloatArray, scan: LaserScan, T_start: SE2) -> SE2:
            T_map_base = T_start
            for _ in range(_MANY):
                points_map = T_map_base @ points_base
                distances_m, ids = tree.query(points_map, distance_upper_bound=MAX_PAIR_DISTANCE_M)
                near = np.isfinite(distances_m)
                if np.count_nonzero(near) < 2:
                    break
                step = _best_motion(points_map[near], known.points[np.asarray(ids)[near]])
                T_map_base = step @ T_map_base
                if math.hypot(step.x, step.y) < _CONVERGED and abs(step.theta) < _CONVERGED:
                    break
            return T_map_base

        return register


@dataclass(frozen=True)
class SmallGicp:
    """small_gicp.align on clouds and a tree that are preprocessed, as its documentation advises.

    kind: registration_type. epsilon: of rotation [rad] and translation [m], None for the defaults.
    """

    name: str
    note: str
    kind: str
    epsilon: float | None = None
    max_iterations: int = 20
    package: str | None = "small_gicp"

    def prepare(self, known: KnownMap) -> Register:
        """The map as a cloud with its tree, and with normals or covariances for the two kinds that
        use them.

        They are estimated from neighbours, and of a flat cloud every normal would be upright: every
        other point lies a little higher, the rest a little lower. A scan at z = 0 finds the pairs
        that it would find in the plane; GICP wants covariances of the scan too, and so its zigzag.
        """
        small_gicp = importlib.import_module("small_gicp")
        is_flat = self.kind == "ICP"
        target = small_gicp.PointCloud(_flat(known.points) if is_flat else _zigzag(known.points))
        tree = small_gicp.KdTree(target)
        if not is_flat:
            small_gicp.estimate_normals_covariances(target, tree, _NEIGHBOURS)
        epsilons = {}
        if self.epsilon is not None:
            epsilons = {"rotation_epsilon": self.epsilon, "translation_epsilon": self.epsilon}

        def register(points_base: FloatArray, scan: LaserScan, T_start: SE2) -> SE2:
            if self.kind == "GICP":
                source = small_gicp.PointCloud(_zigzag(points_base))
                small_gicp.estimate_covariances(source, None, _NEIGHBOURS)
            else:
                source = small_gicp.PointCloud(_flat(points_base))
            result = small_gicp.align(
                target,
                source,
                tree,
                spatial(T_start),
                registration_type=self.kind,
                max_correspondence_distance=MAX_PAIR_DISTANCE_M,
                num_threads=1,
                max_iterations=self.max_iterations,
                **epsilons,
            )
            return planar(result.T_target_source)

        return register


@dataclass(frozen=True)
class KissIcp:
    """KISS-ICP's registration on its voxel map, the part that its pipeline calls for each frame."""

    name: str
    note: str
    package: str | None = "kiss-icp"

    def prepare(self, known: KnownMap) -> Register:
        """The map in voxels as wide as pairs may be apart: neighbours are searched one voxel far.

        A voxel takes a point that lies voxel_size / sqrt(max_points_per_voxel) from all others in
        it: 3 mm here, less than the map's spacing. With KISS-ICP's own 20 points a voxel of 10 cm
        would keep points each 22 mm.
        """
        mapping = importlib.import_module("kiss_icp.mapping")
        registration = importlib.import_module("kiss_icp.registration")
        voxel_map = mapping.VoxelHashMap(
            voxel_size=MAX_PAIR_DISTANCE_M,
            max_distance=1000.0,
            max_points_per_voxel=round((MAX_PAIR_DISTANCE_M / 0.003) ** 2),
        )
        voxel_map.add_points(_flat(known.points))
        # its own defaults, but one thread
        aligner = registration.Registration(500, 1e-4, max_num_threads=1)

        def register(points_base: FloatArray, scan: LaserScan, T_start: SE2) -> SE2:
            matrix = aligner.align_points_to_map(
                points=_flat(points_base),
                voxel_map=voxel_map,
                initial_guess=spatial(T_start),
                # the pipeline's own ratio: pairs reach three times the kernel's width
                max_correspondance_distance=MAX_PAIR_DISTANCE_M,
                kernel=MAX_PAIR_DISTANCE_M / 3.0,
            )
            return planar(matrix)

        return register


PEERS: tuple[Registration, ...] = (
    Open3dLegacy("Open3D legacy, p2p, default", "30 iterations; tree rebuilt each call"),
    Open3dLegacy(
        "Open3D legacy, p2p, converged",
        "up to 200 iterations; tree rebuilt",
        _MANY,
        _CONVERGED_RMSE,
    ),
    Open3dLegacy(
        "Open3D legacy, point to plane",
        "normals given once; tree rebuilt",
        to_plane=True,
    ),
    Open3dTensor("Open3D tensor, p2p, CPU", "30 iterations; search rebuilt"),
    ScipyPointToPoint("SciPy cKDTree + NumPy, p2p", "to convergence; tree once"),
    SmallGicp("small_gicp ICP, default stop", "stops at steps of 1 mm; tree once", "ICP"),
    SmallGicp(
        "small_gicp ICP, eps 1e-6", "up to 200 iterations; tree once", "ICP", _CONVERGED, _MANY
    ),
    SmallGicp("small_gicp PLANE_ICP", "default stop; tree, normals once", "PLANE_ICP"),
    SmallGicp("small_gicp GICP, default stop", "scan's covariances each call", "GICP"),
    SmallGicp(
        "small_gicp GICP, eps 1e-6", "up to 200 iterations; the same", "GICP", _CONVERGED, _MANY
    ),
    KissIcp("KISS-ICP registration", "voxel map once, 10 cm; kernel 3.3 cm"),
)
"""In the order of the table; the first is the one that the others are compared with."""


def _flat(points: FloatArray) -> FloatArray:
    return np.column_stack([points, np.zeros(len(points))])


def _zigzag(points: FloatArray) -> FloatArray:
    return np.column_stack([points, np.where(np.arange(len(points)) % 2, _ZIGZAG_M, -_ZIGZAG_M)])


def _normals(points: FloatArray) -> FloatArray:
    """(K, 2) across the line through each point's neighbours. As good as the exact ones here."""
    _, ids = cKDTree(points).query(points, _NEIGHBOURS)
    centred = points[ids] - points[ids].mean(axis=1, keepdims=True)
    _, axes = np.linalg.eigh(np.einsum("kni,knj->kij", centred, centred))
    return np.asarray(axes[:, :, 0])


def _best_motion(source: FloatArray, target: FloatArray) -> SE2:
    """What moves source (P, 2) onto target (P, 2) with the least squares, in closed form."""
    source_mean, target_mean = source.mean(axis=0), target.mean(axis=0)
    (xx, xy), (yx, yy) = (source - source_mean).T @ (target - target_mean)
    turn = SE2(0.0, 0.0, math.atan2(xy - yx, xx + yy))
    ((x, y),) = target_mean - turn @ source_mean[np.newaxis]
    return SE2(x, y, turn.theta)

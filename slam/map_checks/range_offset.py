"""One offset that all ranges share, as scans of the same surfaces from several places show it.

A point that a scan saw at p [m] along the unit ray u, both in its base frame, is at p - c u, if all its ranges are
too long by c [m]. Another scan saw the surface there at q along v, with the unit normal n. With the first's pose (t, R)
as seen from the second, and R' = dR/dtheta, the two agree where

    e = n . (t + R (p - c u) - (q - c v)) = 0,    de/dc = -n . (R u - v),    de/dt = n,    de/dtheta = n . R' p

so that a wall tells of c that one saw at a right angle and the other aslant: it bends by c times what the cosines
differ. Poses that were matched by such ranges have taken up what of it they can; so each pair of scans has a pose of
its own, free, and only what that cannot take up counts: the Schur complement of its block of the normal equations
(Triggs et al., Bundle Adjustment - A Modern Synthesis, 2000). No walls need to be straight, nothing of the map needs to be right but
where about the two scans were, and ranges that are wrong by a share are no offset: all of it is larger then, and agrees.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np
from scipy.spatial import cKDTree

from slam.arrays import FloatArray, IntArray
from slam.beams import POINTS_WITHIN_M
from slam.frontend.keyframes import Keyframe
from slam.se2 import SE2
from slam.surface.surface_map import faced_and_variances

_WORTH_M, _SIGMAS = 0.04, 5.0
"""An offset that fails a map, and by how many standard deviations it must differ from none. Chosen: mit-csail with 0.04 m
added to its ranges makes a right map, 0.141 m off (RMS), and with 0.05 m one that is 0.183 m off. Measured: right maps of
five real logs say up to 0.011 m, of eleven simulated buildings 0.002 m; with 0.05 to 0.15 m added or taken off, the
estimate is that and what it was before to 0.012 m."""
_APART_M = 0.5, 4.0
"""Of two scans: nearer ones see all walls at the same angles, farther ones hardly the same walls. Chosen."""
_MOST_PAIRS, _MOST_POINTS = 600, 180
"""Looked at, and points of the one scan in each. Chosen."""
_LEAST_POINTS, _LEAST_SCANS = 30, 40
"""On surfaces of the other scan, and scans of pairs that have so many, of which a word is made. Chosen: of stretches of
two real logs without an offset, of 8 to 16 keyframes one of forty showed up to 0.12 m, and of 400 of 24 to 80 none did:
what few scans saw is not all of straight pieces, and scatter does not tell."""
_LEAST_KNOWN, _FARTHEST_M = 1e4, 1.0
"""Information on the offset [1/m2], and offset, beyond which it is none: of one wall that beams meet alike nothing is
told. Chosen."""
_NEAR_M, _ALIKE = 0.3, math.cos(0.35)
"""Within which points of two scans are of one surface, and cosine of what their normals may differ. Chosen."""
_KERNEL_M, _SIGMA_M = 0.05, 0.02
"""Residual at which a point counts a quarter (Geman and McClure, 1987), and noise of one. Chosen."""
_STRAIGHT_RAD2 = 0.004
"""Variance of a facing that is known. Chosen: between pillars each half metre, of which near scans see the recesses and
far ones the faces alone, a laser without an offset showed 0.031 m with 0.05 rad2; with this too little is left to say."""
_LITTLE = 1.0
"""Information by which a direction that nothing holds stays where it is."""
_ROUNDS, _SETTLED_M = 8, 0.004
"""Of Gauss-Newton at most, and change of the offset in the last one. Chosen."""
_BLOCKS = 10
"""Pieces of the drive that tell by how much the estimate scatters. Chosen."""


class RangeOffset(NamedTuple):
    """By how much all ranges are too long [m], and the standard deviation of that, by how pieces of the drive differ."""

    offset_m: float
    sigma_m: float

    @property
    def is_shown(self) -> bool:
        """Whether the ranges are worth being put right, beyond doubt."""
        return abs(self.offset_m) > max(_WORTH_M, _SIGMAS * self.sigma_m)


class _Seen(NamedTuple):
    """What a scan saw, (N, 2) each, base frame: points [m], the normals of their surfaces, and the rays to them."""

    points: FloatArray
    normals: FloatArray
    rays: FloatArray

    @staticmethod
    def of(keyframe: Keyframe) -> _Seen:
        beams = keyframe.beams
        is_hit = beams.ranges_m < POINTS_WITHIN_M
        is_hit &= beams.is_hit
        rays = beams.directions[is_hit]
        points = beams.origins_m[is_hit] + beams.ranges_m[is_hit, np.newaxis] * rays
        faced, variances = faced_and_variances(points, beams.middle_m, is_lone_told=False)
        is_known = np.isfinite(faced[:, 2]) & (variances < _STRAIGHT_RAD2)
        facing_rad = faced[is_known, 2]
        normals = np.column_stack([np.cos(facing_rad), np.sin(facing_rad)])
        return _Seen(points[is_known], normals, rays[is_known])

    def shortened(self, offset_m: float) -> _Seen:
        return self._replace(points=self.points - offset_m * self.rays)

    def thinned(self) -> _Seen:
        every = max(1, -(-len(self.points) // _MOST_POINTS))
        return _Seen(self.points[::every], self.normals[::every], self.rays[::every])


def said_of_ranges(keyframes: Sequence[Keyframe], poses: FloatArray) -> list[str]:
    """In words, that all ranges of a map's last session are too long, or too short. poses: (K, 3) [m, rad]."""
    found = range_offset(keyframes, poses)
    if found is None or not found.is_shown:
        return []
    return [
        f"all ranges are {off_by(found.offset_m)} (standard deviation {found.sigma_m:.3f} m): scans of one"
        " surface from several places show it, and the map is bent by it (MapperConfig.range_offset_m puts them"
        " right, and kitasap slam does so by itself)"
    ]


def off_by(offset_m: float) -> str:
    """Of ranges that are too long by an offset [m], in words."""
    return f"{abs(offset_m):.3f} m too {'long' if offset_m > 0.0 else 'short'}"


def range_offset(keyframes: Sequence[Keyframe], poses: FloatArray) -> RangeOffset | None:
    """The offset of all ranges of a map's last session, from keyframes at poses (K, 3) [m, rad]; None where too few
    scans saw the same from several places."""
    pairs = _pairs(keyframes, poses)
    if len(np.unique(pairs)) < _LEAST_SCANS:
        return None
    seen = {k: _Seen.of(keyframes[k]) for k in np.unique(pairs).tolist()}
    T_between = np.array(
        [
            (SE2.from_array(poses[j]).inverse() @ SE2.from_array(poses[i])).as_array()
            for i, j in pairs.tolist()
        ]
    )
    offset_m, found = 0.0, None
    for _ in range(_ROUNDS):
        step = _step(seen, pairs, T_between, offset_m)
        if step is None:
            return found
        offset_m += step.offset_m
        if abs(offset_m) > _FARTHEST_M:
            return None
        found = RangeOffset(offset_m, step.sigma_m)
        if abs(step.offset_m) < _SETTLED_M:
            break
    return found


def _pairs(keyframes: Sequence[Keyframe], poses: FloatArray) -> IntArray:
    """(P, 2) keyframes of the last session, evenly taken from all that may have seen the same from two places."""
    if not keyframes:
        return np.empty((0, 2), np.int64)
    is_asked = [
        one.session == keyframes[-1].session and not one.is_place_alone for one in keyframes
    ]
    asked = np.flatnonzero(is_asked)
    nearest_m, farthest_m = _APART_M
    found = cKDTree(poses[asked, :2]).query_pairs(farthest_m, output_type="ndarray")
    pairs = asked[found]
    apart = poses[pairs[:, 0], :2] - poses[pairs[:, 1], :2]
    pairs = pairs[np.hypot(*apart.T) > nearest_m]
    pairs = pairs[np.lexsort((pairs[:, 1], pairs[:, 0]))]
    thinned: IntArray = pairs[:: max(1, -(-len(pairs) // _MOST_PAIRS))]
    return thinned


def _step(
    seen: Mapping[int, _Seen], pairs: IntArray, T_between: FloatArray, offset_m: float
) -> RangeOffset | None:
    """One step of Gauss-Newton: of the offset, and of the poses (P, 3) of each pair's first scan as seen from its
    second, in place. None where too few scans saw the same, or all at the same angles."""
    scans = {k: one.shortened(offset_m) for k, one in seen.items()}
    trees = {k: cKDTree(one.points) for k, one in scans.items() if len(one.points)}
    told, steps = list[tuple[float, float]](), list[tuple[int, FloatArray]]()
    for row, (i, j) in enumerate(pairs.tolist()):
        if i not in trees or j not in trees:
            continue
        residuals, jacobian = _residuals(scans[i].thinned(), scans[j], trees[j], T_between[row])
        if len(residuals) < _LEAST_POINTS:
            continue
        share = _KERNEL_M**2 / (_KERNEL_M**2 + residuals**2)
        weighed = jacobian.T * (share / _SIGMA_M) ** 2
        information, pull = weighed @ jacobian, -weighed @ residuals
        held = information[:3, :3] + _LITTLE * np.eye(3)
        asked = np.column_stack([pull[:3], information[:3, 3]])
        moved = np.linalg.solve(held, asked).astype(np.float64)
        told.append(
            (
                information[3, 3] - information[3, :3] @ moved[:, 1],
                pull[3] - information[3, :3] @ moved[:, 0],
            )
        )
        steps.append((row, moved))
    if len(np.unique(pairs[[row for row, _ in steps]])) < _LEAST_SCANS:
        return None
    informations, pulls = np.array(told).T
    known = float(informations.sum())
    if not known > _LEAST_KNOWN:
        return None
    step_m = float(pulls.sum()) / known
    for row, moved in steps:
        T_between[row] += moved[:, 0] - step_m * moved[:, 1]
    blocks = np.array_split(pulls - step_m * informations, _BLOCKS)
    scatter = math.sqrt(_BLOCKS / (_BLOCKS - 1) * sum(float(one.sum()) ** 2 for one in blocks))
    return RangeOffset(step_m, scatter / known)


def _residuals(
    scan: _Seen, other: _Seen, tree: cKDTree, T_other_scan: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """(M,) how far points of a scan lie off the surfaces of another [m], and (M, 4) the derivatives by the pose
    (x, y [m], theta [rad]) and by the offset [m]."""
    theta = float(T_other_scan[2])
    turn = np.array([[math.cos(theta), math.sin(theta)], [-math.sin(theta), math.cos(theta)]])
    turned = scan.points @ turn
    points = turned + T_other_scan[:2]
    apart_m, nearest = tree.query(points, distance_upper_bound=_NEAR_M)
    normals, is_near = scan.normals @ turn, np.isfinite(apart_m)
    nearest = np.where(is_near, nearest, 0)
    is_near &= np.einsum("ij,ij->i", normals, other.normals[nearest]) > _ALIKE
    nearest, turned = nearest[is_near], turned[is_near]
    normals = normals[is_near] + other.normals[nearest]
    normals /= np.hypot(*normals.T)[:, np.newaxis]
    off = points[is_near] - other.points[nearest]
    rays = (scan.rays @ turn)[is_near] - other.rays[nearest]
    derivatives = np.column_stack(
        [
            normals,
            normals[:, 1] * turned[:, 0] - normals[:, 0] * turned[:, 1],
            -np.einsum("ij,ij->i", normals, rays),
        ]
    )
    return np.einsum("ij,ij->i", normals, off), derivatives

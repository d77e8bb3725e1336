"""Gauss-Newton on the beam likelihood from blurred to sharp, then what the edges tell."""

from __future__ import annotations

import math

import numpy as np

from slam.arrays import BoolArray, FloatArray, IntArray
from slam.kernels import compiled, copy_into
from slam.kernels.beam_likelihood import (
    OFFSET_CROSS,
    OFFSET_INFORMATION,
    OFFSET_PULL,
    look,
)
from slam.kernels.edge_moments import moments_about
from slam.kernels.edges import (
    doubt,
    edge_likelihoods,
    propagate,
    ranges_beside,
    share_absent,
    smoothed,
)
from slam.kernels.mixed_pixels import mixing_shares
from slam.kernels.normal_equations import inverted, moved, solved, variance_along
from slam.kernels.ray_casting import cast_fan, to_base
from slam.kernels.smooth_beams import keep_smooth, look_smooth

_BLUR_OF_POSTERIOR = 0.5
"""Chosen: half the standard deviation reached. Without it one beam that touches a round leg claims
micrometres; with all of it, grazing beams that do tell are lost (a twentieth of the accuracy)."""

_LEAST_SHARE = 0.7
"""Chosen: of the information of Gauss-Newton, however bent the likelihood is; rooms have 0.8 to 1."""
_WIDEST_BLUR_M = 0.003
_EARLY_TOLERANCE = 0.5
_PATIENCE = 4
_SHORT_STEP = 1.0
"""Chosen, in standard deviations: the next stage takes up what an early one leaves."""


@compiled
def reach_of(limits: FloatArray) -> float:
    """How far beams are followed [m]: farther than the laser measures, what lies beyond counts too."""
    result: float = 1.2 * limits[1] + 1.0
    return result


@compiled
def climb(
    map_vertices: FloatArray,
    walls: IntArray,
    wall_normals: FloatArray,
    wall_sigmas: FloatArray,
    origins: FloatArray,
    directions: FloatArray,
    angles: FloatArray,
    middle: FloatArray,
    spread: float,
    measured: FloatArray,
    noise: FloatArray,
    limits: FloatArray,
    outliers: FloatArray,
    blur: float,
    max_steps: int,
    tolerance: float,
    targets: FloatArray,
    is_kept: BoolArray,
    pose: FloatArray,
    predicted: FloatArray,
    hit_walls: IntArray,
    vertices: FloatArray,
    bearings: FloatArray,
    information: FloatArray,
    pull: FloatArray,
    sums: FloatArray,
) -> tuple[int, bool]:
    """Gauss-Newton steps at one blur, the pose (3,) in place; how many, and whether it settled.

    tolerance: length of a step, in standard deviations of the pose, that is not worth taking; what
    the last look said belongs to the pose. It also counts as settled where edges let no
    tolerance be reached, but the last step was shorter than a standard deviation.
    """
    step, length = np.empty(3), np.inf
    reach = reach_of(limits)
    for taken in range(max_steps):
        to_base(map_vertices, pose[0], pose[1], pose[2], vertices)
        cast_fan(
            vertices, walls, origins, directions, angles, middle, spread, reach, targets,
            bearings, predicted, hit_walls,
        )  # fmt: skip
        look(
            wall_normals, wall_sigmas, origins, directions, measured, noise, limits,
            outliers, blur, pose[2], predicted, hit_walls, is_kept, information, pull, sums,
        )  # fmt: skip
        solved(information, pull, step)
        length = math.sqrt(max(float(step @ pull), 0.0))
        if length <= tolerance:
            return taken + 1, True
        if taken >= _PATIENCE:
            # two edges take turns in drawing the pose over to their side: meet in between
            step *= 0.5 if taken < 2 * _PATIENCE else 0.25
        moved(pose, step)
    to_base(map_vertices, pose[0], pose[1], pose[2], vertices)
    cast_fan(
        vertices, walls, origins, directions, angles, middle, spread, reach, targets, bearings,
        predicted, hit_walls,
    )  # fmt: skip
    look(
        wall_normals, wall_sigmas, origins, directions, measured, noise, limits, outliers, blur,
        pose[2], predicted, hit_walls, is_kept, information, pull, sums,
    )  # fmt: skip
    return max_steps, length <= _SHORT_STEP


@compiled
def _sharpest_blur(covariance: FloatArray) -> float:
    """The blur [m] of the last stage, given the covariance (3, 3) reached."""
    deviation = math.sqrt(0.5 * (covariance[0, 0] + covariance[1, 1]))
    return _BLUR_OF_POSTERIOR * min(deviation, _WIDEST_BLUR_M)


@compiled
def maximise(
    map_vertices: FloatArray,
    walls: IntArray,
    wall_normals: FloatArray,
    wall_sigmas: FloatArray,
    origins: FloatArray,
    directions: FloatArray,
    angles: FloatArray,
    middle: FloatArray,
    spread: float,
    measured: FloatArray,
    noise: FloatArray,
    limits: FloatArray,
    outliers: FloatArray,
    blurs: FloatArray,
    max_steps: int,
    tolerance: float,
    targets: FloatArray,
    pose: FloatArray,
    information: FloatArray,
    sums: FloatArray,
    predicted: FloatArray,
    hit_walls: IntArray,
) -> tuple[int, bool]:
    """The pose (3,), in place, from which the map explains the scan best; steps, and if settled.

    Blur by blur, the last one following the posterior: `climb` over all beams.
    """
    count = angles.shape[0]
    vertices, bearings = np.empty_like(map_vertices), np.empty_like(map_vertices)
    is_kept = np.ones(count, dtype=np.bool_)
    pull = np.empty(3)
    steps, settled = 0, False
    for stage in range(blurs.shape[0] + 2):
        is_last = stage >= blurs.shape[0]
        if stage > blurs.shape[0] and settled:
            break
        if is_last:
            covariance = inverted(information)
            # where two edges disagree the steps may go on for ever: once more, less sharp
            sharpness = 1.0 if stage == blurs.shape[0] else 4.0
            blur = sharpness * _sharpest_blur(covariance)
        else:
            blur = blurs[stage]
        taken, settled = climb(
            map_vertices, walls, wall_normals, wall_sigmas, origins, directions, angles, middle,
            spread, measured, noise, limits, outliers, blur, max_steps,
            tolerance if is_last else max(tolerance, _EARLY_TOLERANCE), targets, is_kept, pose, predicted,
            hit_walls, vertices, bearings, information, pull, sums,
        )  # fmt: skip
        steps += taken
    return steps, settled


@compiled
def _pull_offset(sums: FloatArray, step: FloatArray) -> None:
    """The pull on the common offset in `sums`, as it is once the pose has taken a step (3,)."""
    for j in range(3):
        sums[OFFSET_PULL] -= sums[OFFSET_CROSS + j] * step[j]


@compiled
def sharpen(
    map_vertices: FloatArray,
    walls: IntArray,
    wall_normals: FloatArray,
    wall_sigmas: FloatArray,
    origins: FloatArray,
    directions: FloatArray,
    angles: FloatArray,
    middle: FloatArray,
    spread: float,
    measured: FloatArray,
    noise: FloatArray,
    limits: FloatArray,
    outliers: FloatArray,
    smoothness: FloatArray,
    nodes: FloatArray,
    sweeps: int,
    edge_blurs: int,
    pose: FloatArray,
    information: FloatArray,
    sums: FloatArray,
    predicted: FloatArray,
    hit_walls: IntArray,
    is_kept: BoolArray,
    points: FloatArray,
    smooth_pose: FloatArray,
    smooth_information: FloatArray,
    smooth_sums: FloatArray,
    moments: FloatArray,
) -> None:
    """The pose (3,) and information (3, 3) of `maximise`, in place, with each edge taken for itself.

    Beams whose range bends or jumps over the uncertainty are taken out of the Gaussian and joined
    by expectation propagation. smoothness: (2,) sigmas and bend of `keep_smooth`. nodes: (K,) in
    standard deviations, where an edge's likelihood is looked at. predicted, hit_walls: (N,) at the
    pose. sums, is_kept: of the smooth beams. smooth_pose: (3,), smooth_information: (3, 3),
    smooth_sums: results: what the smooth beams say alone. moments: (3, 3) result of `moments_about`
    the pose, with points (P, 3); zeros without edges.
    """
    count = angles.shape[0]
    vertices, bearings = np.empty_like(map_vertices), np.empty_like(map_vertices)
    pull, step = np.empty(3), np.empty(3)
    reach = reach_of(limits)
    to_base(map_vertices, pose[0], pose[1], pose[2], vertices)
    covariance = inverted(information)
    keep_smooth(
        vertices, walls, origins, directions, angles, middle, spread, reach, noise, covariance,
        smoothness[0], smoothness[1], _sharpest_blur(covariance), bearings, predicted, hit_walls,
        is_kept,
    )  # fmt: skip
    curved, shares = np.empty((3, 3)), np.empty(2)
    mixing_shares(predicted, measured, noise, is_kept, outliers[1], shares)
    look_smooth(
        wall_normals, origins, directions, measured, noise, limits, outliers, shares, pose[2],
        predicted, hit_walls, is_kept, information, curved, pull, sums,
    )  # fmt: skip
    # beams that may be mixed pixels tell less than their weights; how much less as one number, since
    # their curvature alone may leave a direction open that the beams do hold
    share = np.trace(inverted(information) @ curved) / 3.0
    share = min(max(share, _LEAST_SHARE), 1.0)
    information *= share
    sums[OFFSET_INFORMATION] *= share
    for j in range(3):
        sums[OFFSET_CROSS + j] *= share
    # smooth beams are straight over the uncertainty: one step is all they need
    solved(information, pull, step)
    moved(pose, step)
    _pull_offset(sums, step)
    copy_into(pose, smooth_pose)
    copy_into(information, smooth_information)
    copy_into(sums, smooth_sums)
    moments[:] = 0.0
    to_base(map_vertices, pose[0], pose[1], pose[2], vertices)
    edges = np.empty(count, dtype=np.int64)
    edge_count = 0
    for i in range(count):
        if not is_kept[i] and math.isfinite(measured[i]):
            edges[edge_count] = i
            edge_count += 1
    edges = edges[:edge_count]
    if edge_count == 0:
        return
    covariance = inverted(information)
    axes, shifts = np.empty((edge_count, 3)), np.empty((edge_count, nodes.shape[0]))
    ranges, likelihoods = np.empty_like(shifts), np.empty_like(shifts)
    distances, is_due = np.empty(edge_count), np.ones(edge_count, dtype=np.bool_)
    for e in range(edge_count):
        distances[e] = min(predicted[edges[e]], limits[1])
    for attempt in range(2):
        # a turn moves the beam sideways by the distance of the edge: the nearest seen on either side
        for e in range(edge_count):
            i = edges[e]
            ux, uy = directions[i, 0], directions[i, 1]
            axes[e, 0], axes[e, 1] = -uy, ux
            axes[e, 2] = distances[e] + origins[i, 0] * ux + origins[i, 1] * uy
            sigma = math.sqrt(variance_along(axes[e], covariance))
            for k in range(nodes.shape[0]):
                shifts[e, k] = sigma * nodes[k]
        ranges_beside(vertices, walls, edges, origins, directions, shifts, is_due, reach, ranges)
        if attempt == 0:
            for e in range(edge_count):
                nearest = ranges[e].min()
                is_due[e] = nearest < distances[e]
                distances[e] = min(distances[e], nearest)
    absent = np.empty(edge_count)
    for e in range(edge_count):
        absent[e] = share_absent(edges[e], distances[e], predicted, measured, noise, is_kept)
    edge_likelihoods(
        ranges, edges, measured, noise, limits, outliers, shares, absent, predicted, likelihoods
    )
    likelihoods[absent == 1.0] = 1.0
    doubt(likelihoods)
    smoothed(likelihoods, edge_blurs)
    mean = np.zeros(3)
    propagate(information, axes, shifts, likelihoods, sweeps, mean, covariance)
    moments_about(smooth_information, axes, shifts, likelihoods, points, mean, information, moments)
    moved(pose, mean)
    _pull_offset(sums, mean)

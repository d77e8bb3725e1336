"""Where the beams of a fan hit the walls: each wall is drawn over the beams that it may stop.

A depth buffer over the beams instead of a search along each: a wall costs two angles and the beams
it covers, so a scan of 700 beams among 800 walls takes microseconds.
"""

from __future__ import annotations

import math

import numpy as np

from slam.arrays import BoolArray, FloatArray, IntArray
from slam.kernels import compiled, copy_into

_TOUCH = 1e-9
"""Share of a wall's length by which it is taken to be longer, so that no beam slips between two."""


@compiled
def to_base(vertices: FloatArray, x: float, y: float, theta: float, out: FloatArray) -> None:
    """Vertices (V, 2) of the map seen from the pose x, y, theta, into out (V, 2)."""
    c, s = math.cos(theta), math.sin(theta)
    for i in range(vertices.shape[0]):
        dx, dy = vertices[i, 0] - x, vertices[i, 1] - y
        out[i, 0] = c * dx + s * dy
        out[i, 1] = c * dy - s * dx


@compiled
def bearing_span(
    vertices: FloatArray,
    walls: IntArray,
    w: int,
    middle: FloatArray,
    spread: float,
    range_max: float,
    first_angle: float,
    last_angle: float,
    bearings: FloatArray,
) -> tuple[float, float]:
    """From which to which angle beams from about the middle may meet a wall; nan where none may.

    bearings: (V, 2) scratch of `distances_into`: angle (nan: not known yet) and distance of each
    vertex. Walls are seen from their left; origins lie within spread of the middle.
    """
    a, b = walls[w, 0], walls[w, 1]
    ax, ay = vertices[a, 0] - middle[0], vertices[a, 1] - middle[1]
    bx, by = vertices[b, 0] - middle[0], vertices[b, 1] - middle[1]
    ex, ey = bx - ax, by - ay
    length = math.sqrt(ex * ex + ey * ey)
    near = min(bearings[a, 1], bearings[b, 1])
    # twice the area that the wall spans: positive where the middle is on its left
    turning = ax * by - ay * bx
    if near - length > range_max or turning < -spread * length:
        return np.nan, np.nan
    if turning <= 3.0 * spread * length or near <= 3.0 * spread:
        return first_angle, last_angle  # some origins are behind it: any beam may hit
    if math.isnan(bearings[a, 0]):
        bearings[a, 0] = math.atan2(ay, ax)
    if math.isnan(bearings[b, 0]):
        bearings[b, 0] = math.atan2(by, bx)
    start, stop = bearings[a, 0], bearings[b, 0]
    if stop < start:
        stop += 2.0 * math.pi
    pad = 1.1 * spread / near if spread > 0.0 else 0.0
    return start - pad, stop + pad


@compiled
def distances_into(vertices: FloatArray, middle: FloatArray, bearings: FloatArray) -> None:
    """Distance of each vertex (V, 2) from the middle into bearings (V, 2), the angle left open."""
    for v in range(vertices.shape[0]):
        dx, dy = vertices[v, 0] - middle[0], vertices[v, 1] - middle[1]
        bearings[v, 0] = np.nan  # an arc tangent for those vertices alone whose wall faces us
        bearings[v, 1] = math.sqrt(dx * dx + dy * dy)


@compiled
def first_beam(angles: FloatArray, low: float, per_rad: float) -> int:
    """Index of the first beam at an angle of `low` or more; the number of beams where none is."""
    count = angles.shape[0]
    i: int = min(max(int((low - angles[0]) * per_rad), 0), count - 1)
    while i > 0 and angles[i - 1] >= low:
        i -= 1
    while i < count and angles[i] < low:
        i += 1
    return i


@compiled
def cast_fan(
    vertices: FloatArray,
    walls: IntArray,
    origins: FloatArray,
    directions: FloatArray,
    angles: FloatArray,
    middle: FloatArray,
    spread: float,
    range_max: float,
    targets: FloatArray,
    bearings: FloatArray,
    ranges: FloatArray,
    hit_walls: IntArray,
) -> None:
    """Range to the nearest wall along each beam, and which wall; inf and -1 where there is none.

    vertices: (V, 2) in the frame of the beams. walls: (W, 2) vertices at both ends; a wall is seen
    from its left only. origins, directions: (N, 2); angles: (N,) of the directions, increasing.
    targets: (N,) of all walls along a beam, the one nearest to this range is taken; 0: the first.
    middle: (2,), from which no origin is farther than spread. bearings: (V, 2) scratch. ranges,
    hit_walls: (N,) results.
    """
    count = angles.shape[0]
    for i in range(count):
        ranges[i] = np.inf
        hit_walls[i] = -1
    if count == 0:
        return
    distances_into(vertices, middle, bearings)
    per_rad = (count - 1) / max(angles[count - 1] - angles[0], 1e-12)
    for w in range(walls.shape[0]):
        start, stop = bearing_span(
            vertices, walls, w, middle, spread, range_max, angles[0], angles[count - 1], bearings
        )
        if math.isnan(start):
            continue
        a, b = walls[w, 0], walls[w, 1]
        ax, ay = vertices[a, 0], vertices[a, 1]
        ex, ey = vertices[b, 0] - ax, vertices[b, 1] - ay
        for turns in range(-1, 2):
            low, high = start + 2.0 * math.pi * turns, stop + 2.0 * math.pi * turns
            if high < angles[0] or low > angles[count - 1]:
                continue
            # one more on either side: rounding must not open a crack where two walls meet
            i = max(first_beam(angles, low, per_rad) - 1, 0)
            is_past = False
            while i < count and not is_past:
                is_past = angles[i] > high
                ox, oy = ax - origins[i, 0], ay - origins[i, 1]
                ux, uy = directions[i, 0], directions[i, 1]
                determinant = ux * ey - uy * ex
                if determinant > 0.0:  # from the wall's left
                    along_beam = (ox * ey - oy * ex) / determinant
                    along_wall = (ox * uy - oy * ux) / determinant
                    target = targets[i]
                    if (
                        abs(along_beam - target) < abs(ranges[i] - target)
                        and 0.0 < along_beam <= range_max
                        and -_TOUCH <= along_wall <= 1.0 + _TOUCH
                    ):
                        ranges[i] = along_beam
                        hit_walls[i] = w
                i += 1


@compiled
def cast_beside(
    vertices: FloatArray,
    walls: IntArray,
    origins: FloatArray,
    directions: FloatArray,
    angles: FloatArray,
    middle: FloatArray,
    spread: float,
    range_max: float,
    shifts: FloatArray,
    bearings: FloatArray,
    lefts: FloatArray,
    rights: FloatArray,
) -> None:
    """Range to the nearest wall along each beam, were it shifted to its left, and to its right.

    As `cast_fan`, twice, in hardly more time than once. shifts: (N,) [m], 0 or more; origins so
    shifted are no farther than spread from the middle. Walls farther than range_max may be left out.
    lefts, rights: (N,) results; inf where nothing is met.
    """
    # walls and beams are gone through as there, written again: what they share, as a function called
    # for each wall, makes both a third slower
    count = angles.shape[0]
    lefts[:] = np.inf
    rights[:] = np.inf
    if count == 0:
        return
    distances_into(vertices, middle, bearings)
    per_rad = (count - 1) / max(angles[count - 1] - angles[0], 1e-12)
    for w in range(walls.shape[0]):
        start, stop = bearing_span(
            vertices, walls, w, middle, spread, range_max, angles[0], angles[count - 1], bearings
        )
        if math.isnan(start):
            continue
        a, b = walls[w, 0], walls[w, 1]
        ax, ay = vertices[a, 0], vertices[a, 1]
        ex, ey = vertices[b, 0] - ax, vertices[b, 1] - ay
        for turns in range(-1, 2):
            low, high = start + 2.0 * math.pi * turns, stop + 2.0 * math.pi * turns
            if high < angles[0] or low > angles[count - 1]:
                continue
            # one more on either side: rounding must not open a crack where two walls meet
            i = max(first_beam(angles, low, per_rad) - 1, 0)
            is_past = False
            while i < count and not is_past:
                is_past = angles[i] > high
                ux, uy = directions[i, 0], directions[i, 1]
                determinant = ux * ey - uy * ex
                if determinant > 0.0:  # from the wall's left
                    ox, oy = ax - origins[i, 0], ay - origins[i, 1]
                    along_beam, along_wall = ox * ey - oy * ex, ox * uy - oy * ux
                    shift = shifts[i]
                    farther = shift * (ux * ex + uy * ey)
                    least, most = -_TOUCH * determinant, (1.0 + _TOUCH) * determinant
                    left = (along_beam + farther) / determinant
                    right = (along_beam - farther) / determinant
                    if 0.0 < left < lefts[i] and least <= along_wall + shift <= most:
                        lefts[i] = left
                    if 0.0 < right < rights[i] and least <= along_wall - shift <= most:
                        rights[i] = right
                i += 1


@compiled
def near_visible(
    vertices: FloatArray,
    walls: IntArray,
    angles: FloatArray,
    middle: FloatArray,
    spread: float,
    range_max: float,
    bearings: FloatArray,
    ranges: FloatArray,
    margin: float,
    beside: int,
    is_near: BoolArray,
) -> None:
    """Which walls (W,) are seen, or would be after a small motion, given the ranges (N,) seen now.

    Not hidden by more than a margin [m] from all beams that it covers, and `beside` more on either
    side. bearings: (V, 2) as `cast_fan` from the same middle leaves them.
    """
    count = angles.shape[0]
    per_rad = (count - 1) / max(angles[count - 1] - angles[0], 1e-12)
    for w in range(walls.shape[0]):
        is_near[w] = False
        start, stop = bearing_span(
            vertices, walls, w, middle, spread + margin, range_max, angles[0], angles[count - 1],
            bearings,
        )  # fmt: skip
        if math.isnan(start):
            continue
        a, b = walls[w, 0], walls[w, 1]
        distance = _distance_m(vertices[a], vertices[b], middle)
        for turns in range(-1, 2):
            low, high = start + 2.0 * math.pi * turns, stop + 2.0 * math.pi * turns
            if high < angles[0] or low > angles[count - 1]:
                continue
            i = max(first_beam(angles, low, per_rad) - beside, 0)
            past = 0
            while i < count and past < beside and not is_near[w]:
                past += angles[i] > high
                is_near[w] = distance <= ranges[i] + margin
                i += 1


@compiled
def _distance_m(a: FloatArray, b: FloatArray, point: FloatArray) -> float:
    """Distance of a point (2,) from the segment between a and b (2,)."""
    ex, ey = b[0] - a[0], b[1] - a[1]
    px, py = point[0] - a[0], point[1] - a[1]
    share = min(max((px * ex + py * ey) / (ex * ex + ey * ey), 0.0), 1.0)
    return math.sqrt((px - share * ex) ** 2 + (py - share * ey) ** 2)


@compiled
def visible_part(
    map_vertices: FloatArray,
    walls: IntArray,
    normals: FloatArray,
    sigmas: FloatArray,
    pose: FloatArray,
    origins: FloatArray,
    directions: FloatArray,
    angles: FloatArray,
    middle: FloatArray,
    spread: float,
    range_max: float,
    margin: float,
    beside: int,
) -> tuple[FloatArray, IntArray, FloatArray, FloatArray]:
    """Vertices, walls, normals and sigmas of what `near_visible` finds from a pose (3,)."""
    vertices, bearings = np.empty_like(map_vertices), np.empty_like(map_vertices)
    ranges, hits = np.empty(angles.shape[0]), np.empty(angles.shape[0], dtype=np.int64)
    is_near = np.empty(walls.shape[0], dtype=np.bool_)
    to_base(map_vertices, pose[0], pose[1], pose[2], vertices)
    cast_fan(
        vertices, walls, origins, directions, angles, middle, spread, range_max,
        np.zeros(angles.shape[0]), bearings, ranges, hits,
    )  # fmt: skip
    near_visible(
        vertices, walls, angles, middle, spread, range_max, bearings, ranges, margin, beside,
        is_near,
    )  # fmt: skip
    count = is_near.sum()
    part, part_normals, part_sigmas = (
        np.empty((count, 2), np.int64),
        np.empty((count, 2)),
        np.empty(count),
    )
    renamed = np.full(map_vertices.shape[0], -1)
    part_vertices = np.empty((2 * count, 2))
    used, k = 0, 0
    for w in range(walls.shape[0]):
        if not is_near[w]:
            continue
        for end in range(2):
            v = walls[w, end]
            if renamed[v] < 0:
                renamed[v] = used
                copy_into(map_vertices[v], part_vertices[used])
                used += 1
            part[k, end] = renamed[v]
        copy_into(normals[w], part_normals[k])
        part_sigmas[k] = sigmas[w]
        k += 1
    return part_vertices[:used].copy(), part, part_normals, part_sigmas

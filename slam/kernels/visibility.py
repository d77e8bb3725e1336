"""What one scan says of another's points: in view, and in view but passed."""

from __future__ import annotations

import math

from slam.arrays import FloatArray, IntArray
from slam.kernels import compiled

_ALONG = 0.2
"""Sine of the angle to a surface: beams along it pass beside it."""
_ASIDE_M = 0.04
"""Chosen: beams that pass by so near may have missed a thin leg that stands a little aside."""
_STRAIGHT = 0.8
"""Chosen: of the sine: glass and black cloth return what meets them so straight, and nothing else."""


@compiled
def contradictions(
    points: FloatArray,
    pose: FloatArray,
    origin: FloatArray,
    angles: FloatArray,
    ranges: FloatArray,
    margin_m: float,
    margin_share: float,
    aside_m: float,
) -> tuple[int, int]:
    """Of points (N, 2) with their frame at a pose (3,), seen from an origin (2,): how many lie
    within the fan of a scan, and how many where its beams went through.

    angles: (B,) increasing, ranges: (B,) of the scan's beams, +inf where nothing was met: that says
    nothing. A point is passed if the beams to either side of it also end farther by the margin, and
    so do those that go by within aside_m: along a wall, a beam misses a point by a hair.
    """
    seen = passed = 0
    c, s = math.cos(pose[2]), math.sin(pose[2])
    count = angles.shape[0]
    for i in range(points.shape[0]):
        x = pose[0] + c * points[i, 0] - s * points[i, 1] - origin[0]
        y = pose[1] + s * points[i, 0] + c * points[i, 1] - origin[1]
        bearing, distance = math.atan2(y, x), math.sqrt(x * x + y * y)
        while bearing < angles[0]:
            bearing += 2.0 * math.pi
        while bearing >= angles[0] + 2.0 * math.pi:
            bearing -= 2.0 * math.pi
        low, high = 0, count - 1
        while high - low > 1:
            middle = (low + high) // 2
            if angles[middle] <= bearing:
                low = middle
            else:
                high = middle
        if bearing > angles[count - 1] or low < 1 or low + 2 >= count:
            continue
        nearest = math.inf
        for k in range(low - 1, low + 3):
            # nan, or too close: nothing is known there
            nearest = min(nearest, ranges[k]) if ranges[k] > 0.0 else -math.inf
        if not math.isfinite(nearest):
            continue
        seen += 1
        aside = math.asin(min(aside_m / max(distance, aside_m), 1.0))
        k = low - 2
        while k >= 0 and bearing - angles[k] < aside:
            if ranges[k] > 0.0:
                nearest = min(nearest, ranges[k])
            k -= 1
        k = low + 3
        while k < count and angles[k] - bearing < aside:
            if ranges[k] > 0.0:
                nearest = min(nearest, ranges[k])
            k += 1
        margin = margin_m + margin_share * distance
        passed += distance < nearest - margin
    return seen, passed


@compiled
def looks_into(
    points: FloatArray,
    normals: FloatArray,
    pose: FloatArray,
    origin: FloatArray,
    angles: FloatArray,
    ranges: FloatArray,
    margin_m: float,
    margin_share: float,
    coarsest_m: float,
    reach_m: float,
    hardest: FloatArray,
    met: IntArray,
    passed: IntArray,
    silent: IntArray,
) -> None:
    """Adds to met, passed and silent (N,) what a scan says of points (N, 2) of surfaces facing normals (N, 2).

    The scan's frame is at a pose (3,) in theirs, its beams start at an origin (2,) in it, angles:
    (B,) increasing, ranges: (B,). Of a point before the surface of which it stands, and where beams
    are no farther apart than coarsest_m: met where a beam beside it ends no farther from it than
    the margin, passed where all beams about it end beyond, silent where some of these come back from
    nowhere although the surface is no farther than reach_m and straight before the laser, or has
    returned others from as far and as much along it. hardest: (N, 2) of those that it returned, the
    greatest distance [m] and the least sine of the angle to it: kept up to date.
    """
    c, s = math.cos(pose[2]), math.sin(pose[2])
    count = angles.shape[0]
    step = (angles[count - 1] - angles[0]) / (count - 1)
    eye_x = pose[0] + c * origin[0] - s * origin[1]
    eye_y = pose[1] + s * origin[0] + c * origin[1]
    for i in range(points.shape[0]):
        dx, dy = points[i, 0] - eye_x, points[i, 1] - eye_y
        squared = dx * dx + dy * dy
        if squared * step * step > coarsest_m * coarsest_m:
            continue
        distance = math.sqrt(squared)
        before = -(dx * normals[i, 0] + dy * normals[i, 1])
        if abs(before) < _ALONG * distance:
            continue
        bearing = math.atan2(c * dy - s * dx, c * dx + s * dy)
        while bearing < angles[0]:
            bearing += 2.0 * math.pi
        while bearing >= angles[0] + 2.0 * math.pi:
            bearing -= 2.0 * math.pi
        low, high = 0, count - 1
        while high - low > 1:
            middle = (low + high) // 2
            if angles[middle] <= bearing:
                low = middle
            else:
                high = middle
        first, last = low - 1, low + 2
        aside = _ASIDE_M / distance
        while first > 0 and angles[first] > bearing - aside:
            first -= 1
        while last < count - 1 and angles[last] < bearing + aside:
            last += 1
        if bearing > angles[count - 1] or first < 0 or last >= count:
            continue
        margin = margin_m + margin_share * distance
        nearest, farthest, is_met = math.inf, 0.0, False
        for k in range(first, last + 1):
            if not ranges[k] > 0.0:
                nearest = -math.inf
                continue
            nearest, farthest = min(nearest, ranges[k]), max(farthest, ranges[k])
            is_met |= abs(ranges[k] - distance) <= margin
        if is_met:
            if before > 0.0:
                met[i] += 1
                hardest[i, 0] = max(hardest[i, 0], distance)
                hardest[i, 1] = min(hardest[i, 1], before / distance)
        elif nearest > distance + margin:
            if farthest < math.inf:
                passed[i] += 1
            elif distance < reach_m and (
                abs(before) > _STRAIGHT * distance
                or (distance <= hardest[i, 0] and abs(before) >= hardest[i, 1] * distance)
            ):
                silent[i] += 1

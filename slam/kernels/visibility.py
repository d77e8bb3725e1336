"""What one scan says of another's points: in view, and in view but passed."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from slam.arrays import FloatArray, IntArray
from slam.kernels import compiled

_ALONG = 0.2
"""Sine of the angle to a surface: beams along it pass beside it."""
_ASIDE_M = 0.05
"""Chosen: beams that pass by so near may have missed a thin leg that stands a little aside. With 0.04 a
foot of a chair was left out where the robot was 2 cm off (1 map of 300); with 0.08 more of those who
stood there stay."""
_WITHIN = 0.4
"""Of a surface to either side of its middle, where a beam that goes there meets it. Chosen: poses are off by a few
millimetres; of the legs of chairs, 2.6 cm thin, that beams 5 cm apart pass by to either side, most were left out."""
_STRAIGHT = 0.8
"""Chosen: of the sine: glass and black cloth return what meets them so straight, and nothing else."""
_SURE, _EDGE = 0.9, 0.97
"""Chosen: of the farthest return of all: beyond, a laser hardly tells that nothing is there; and does
not, by its noise alone, of what has returned its beams from nearly there."""
_NEARLY = 1.05
"""Chosen: what returns beams from so far does from so much farther too."""
MET, PASSED, SILENT, ROW, MOST_PASSED = range(5)
"""Columns of what `looks_into` counts: of scans, of those that passed since one last met it, and the
most of these."""
COUNTS = 5
UNSEEN, NOT_THROUGH, THROUGH = range(3)
"""What a scan says of a point: nothing, that its beams do not go through, that they do."""


@compiled
def contradictions(
    points: FloatArray,
    pose_x: float,
    pose_y: float,
    heading: float,
    origin: FloatArray,
    angles: FloatArray,
    ranges: FloatArray,
    margin_m: float,
    margin_share: float,
    aside_m: float,
) -> tuple[int, int]:
    """Of points (N, 2) with their frame at a pose, seen from an origin (2,): how many lie
    within the fan of a scan, and how many where its beams went through.

    angles: (B,) increasing, ranges: (B,) of the scan's beams, +inf where nothing was met: that says
    nothing. A point is passed if the beams to either side of it also end farther by the margin, and
    so do those that go by within aside_m: along a wall, a beam misses a point by a hair.
    """
    seen = passed = 0
    c, s = math.cos(heading), math.sin(heading)
    for i in range(points.shape[0]):
        x = pose_x + c * points[i, 0] - s * points[i, 1] - origin[0]
        y = pose_y + s * points[i, 0] + c * points[i, 1] - origin[1]
        beyond = _beyond(x, y, angles, ranges, margin_m, margin_share, aside_m)
        if beyond == beyond:
            seen += 1
            passed += beyond > 0.0
    return seen, passed


@compiled
def statements_into(
    faced: FloatArray,
    pose: FloatArray,
    origin: FloatArray,
    angles: FloatArray,
    ranges: FloatArray,
    margin_m: float,
    margin_share: float,
    aside_m: float,
    along: float,
    said: NDArray[np.int8],
) -> None:
    """Into said (N,): what a scan says of each of faced points (N, 3): UNSEEN, NOT_THROUGH, THROUGH.

    As `contradictions`; of a surface along which the scan looks, with a sine of less than `along`
    between them, it says nothing: there a hair decides. Nor of one whose direction is not known.
    """
    c, s = math.cos(pose[2]), math.sin(pose[2])
    for i in range(faced.shape[0]):
        said[i] = UNSEEN
        x = pose[0] + c * faced[i, 0] - s * faced[i, 1] - origin[0]
        y = pose[1] + s * faced[i, 0] + c * faced[i, 1] - origin[1]
        facing = faced[i, 2] + pose[2]
        across = abs(math.cos(facing) * x + math.sin(facing) * y)
        if not across >= along * math.hypot(x, y):
            continue
        beyond = _beyond(x, y, angles, ranges, margin_m, margin_share, aside_m)
        if beyond == beyond:
            said[i] = THROUGH if beyond > 0.0 else NOT_THROUGH


@compiled
def _beam_at(bearing: float, angles: FloatArray) -> tuple[float, int]:
    """A bearing [rad], no less than the first of increasing angles, and the last beam up to there that
    has one after it."""
    while bearing < angles[0]:
        bearing += 2.0 * math.pi
    while bearing >= angles[0] + 2.0 * math.pi:
        bearing -= 2.0 * math.pi
    low, high = 0, angles.shape[0] - 1
    while high - low > 1:
        middle = (low + high) // 2
        if angles[middle] <= bearing:
            low = middle
        else:
            high = middle
    return bearing, low


@compiled
def _beyond(
    x: float,
    y: float,
    angles: FloatArray,
    ranges: FloatArray,
    margin_m: float,
    margin_share: float,
    aside_m: float,
) -> float:
    """By how much more than the margin all beams about a point at x, y, as seen from where they start,
    end beyond it [m]; nan where the scan says nothing of it."""
    count = angles.shape[0]
    bearing, distance = math.atan2(y, x), math.sqrt(x * x + y * y)
    bearing, low = _beam_at(bearing, angles)
    if bearing > angles[count - 1] or low < 1 or low + 2 >= count:
        return math.nan
    nearest = math.inf
    for k in range(low - 1, low + 3):
        # nan, or too close: nothing is known there
        nearest = min(nearest, ranges[k]) if ranges[k] > 0.0 else -math.inf
    if not math.isfinite(nearest):
        return math.nan
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
    return nearest - distance - margin_m - margin_share * distance


@compiled
def looks_into(
    points: FloatArray,
    normals: FloatArray,
    half_m: FloatArray,
    pose: FloatArray,
    origin: FloatArray,
    angles: FloatArray,
    ranges: FloatArray,
    margin_m: float,
    margin_share: float,
    coarsest_m: float,
    farthest_m: float,
    hardest: FloatArray,
    counts: IntArray,
) -> None:
    """Counts (N, 5) what a scan says of points (N, 2) in the middle of surfaces facing normals (N, 2), which
    reach half_m (N,) to either side [m].

    The scan's frame is at a pose (3,) in theirs, its beams start at an origin (2,) in it, angles:
    (B,) increasing, ranges: (B,). Of a point before the surface of which it stands, and where beams
    are no farther apart than coarsest_m: met where a beam beside it ends no farther from it than
    the margin, passed where one goes through it and all beams about it end beyond, none alone before
    its neighbours, silent where one goes through it and some of these come back from nowhere although
    the surface is straight before the laser, or has returned others from as far and as much along it.
    hardest: (N, 2) of those that it returned, the greatest distance [m] and the least sine of the
    angle to it: kept up to date.
    """
    c, s = math.cos(pose[2]), math.sin(pose[2])
    beam_count = angles.shape[0]
    step = (angles[beam_count - 1] - angles[0]) / (beam_count - 1)
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
        bearing, low = _beam_at(bearing, angles)
        first, last = low - 1, low + 2
        aside = _ASIDE_M / distance
        while first > 0 and angles[first] > bearing - aside:
            first -= 1
        while last < beam_count - 1 and angles[last] < bearing + aside:
            last += 1
        if bearing > angles[beam_count - 1] or first < 0 or last >= beam_count:
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
                counts[i, MET] += 1
                counts[i, ROW] = 0
                hardest[i, 0] = max(hardest[i, 0], distance)
                hardest[i, 1] = min(hardest[i, 1], before / distance)
        elif (
            nearest > distance + margin
            and min(bearing - angles[low], angles[low + 1] - bearing) * distance * distance
            <= _WITHIN * half_m[i] * abs(before)
            and not _is_mixed(ranges, first, last, margin)
        ):
            is_straight = abs(before) > _STRAIGHT * distance and distance < _SURE * farthest_m
            is_easier = distance <= _NEARLY * hardest[i, 0] and distance < _EDGE * farthest_m
            is_easier &= abs(before) >= hardest[i, 1] * distance
            if farthest < math.inf:
                counts[i, PASSED] += 1
                counts[i, ROW] += 1
                counts[i, MOST_PASSED] = max(counts[i, MOST_PASSED], counts[i, ROW])
            elif is_straight or is_easier:
                counts[i, SILENT] += 1


@compiled
def _is_mixed(ranges: FloatArray, first: int, last: int, margin_m: float) -> bool:
    """Whether one of some beams ends alone, nearer than those beside it: light of a thin leg, or of an
    edge, mixed with that from behind."""
    for k in range(max(first, 1), min(last, ranges.shape[0] - 2) + 1):
        if ranges[k] < min(ranges[k - 1], ranges[k + 1]) - margin_m:
            return True
    return False

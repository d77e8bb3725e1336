"""Light that an edge splits: a range between the two walls beside it, and which beam measures it."""

from __future__ import annotations

import math

from slam.arrays import BoolArray, FloatArray
from slam.kernels import compiled
from slam.kernels.beam_likelihood import bell, sigma_at

_JUMP_M = 0.1
"""Chosen, as the simulated lasers have it: nearer ranges are mostly one wall seen flat, on which a
spot is longer, but no mixture. From 2 cm on, smooth beams claimed 5 to 10 % too little."""
_PRIOR_EDGES = 3.0
"""Chosen: what is assumed of a laser weighs as much as three edges seen; a scan shows ten to forty."""
_CLEAR = 3.0
_MOST = 0.5
_ROOT_TWO_PI = 2.5066282746310002
_ROOT_HALF = 0.7071067811865476


@compiled
def mixing_shares(
    predicted: FloatArray,
    measured: FloatArray,
    noise: FloatArray,
    is_kept: BoolArray,
    odds: float,
    shares: FloatArray,
) -> None:
    """(2,) share of the beams that are mixed where they have an edge to their left, to their right.

    A spot that moves while it is measured mixes on one side of an edge more than on the other; taken
    for the same, heading is drawn to one side by all edges at once. Told by the beams is_kept (N,)
    that pass no edge but lie beside one, from ranges clear of both walls. odds: of a mixed pixel
    against a good beam, assumed before.
    """
    for side in range(2):
        seen = _PRIOR_EDGES
        mixed = seen * odds / (1.0 + odds)
        for i in range(predicted.shape[0]):
            j = i + 1 - 2 * side
            if not 0 <= j < predicted.shape[0] or not is_kept[i]:
                continue
            jump = abs(predicted[j] - predicted[i])
            if not (jump > _JUMP_M and math.isfinite(jump) and math.isfinite(measured[i])):
                continue
            low, high = min(predicted[i], predicted[j]), max(predicted[i], predicted[j])
            margin = _CLEAR * sigma_at(noise, high)
            if jump < 3.0 * margin:
                continue
            seen += 1.0 - 2.0 * margin / jump
            mixed += low + margin < measured[i] < high - margin
        shares[side] = min(mixed / seen, _MOST)


@compiled
def density_beside(
    z: float,
    h: float,
    clean: float,
    left: float,
    right: float,
    noise: FloatArray,
    shares: FloatArray,
) -> float:
    """Density of a range z of a beam whose wall is at h and its neighbours' at left and right, times
    the square root of 2 pi; clean: that of a beam beside no edge."""
    unmixed, mixed = 1.0, 0.0
    for side in range(2):
        other = right if side else left
        jump = abs(other - h)
        if jump > _JUMP_M and math.isfinite(jump):
            unmixed -= shares[side]
            low, high = min(h, other), max(h, other)
            between = _step((z - low) / sigma_at(noise, low))
            between -= _step((z - high) / sigma_at(noise, high))
            mixed += shares[side] * max(between, 0.0) / jump
    return unmixed * clean + mixed * _ROOT_TWO_PI


@compiled
def _step(sigmas: float) -> float:
    """Probability that Gaussian noise stays below so many standard deviations."""
    if abs(sigmas) > 5.0:
        return 1.0 if sigmas > 0.0 else 0.0
    return 0.5 * math.erfc(-sigmas * _ROOT_HALF)


@compiled
def slope_and_bend(
    z: float,
    h: float,
    left: float,
    right: float,
    sigma: float,
    shares: FloatArray,
    outlier: float,
) -> tuple[float, float, float]:
    """Of the log likelihood of a range z by h, the beam's wall: its derivative, its second one with
    the sign changed, and the probability that the range is that of the wall.

    left, right: the neighbours' ranges, which move with h, as on one flat wall; where they do not,
    z is near one of them at most. outlier: odds per metre.
    """
    q = (z - h) / sigma
    unmixed, mixed = 1.0, outlier * _ROOT_TWO_PI * sigma
    first = second = 0.0
    for side in range(2):
        jump = (right if side else left) - h
        if not (abs(jump) > _JUMP_M and math.isfinite(jump)):
            continue
        unmixed -= shares[side]
        share = shares[side] * sigma / abs(jump)
        above, below = q - min(jump, 0.0) / sigma, q - max(jump, 0.0) / sigma
        at_low, at_high = bell(above), bell(below)
        mixed += share * _ROOT_TWO_PI * (_step(above) - _step(below))
        first += share * (at_low - at_high)
        second += share * (below * at_high - above * at_low)
    clean = unmixed * math.exp(-0.5 * q * q)
    whole = clean + mixed
    first = (first - q * clean) / whole
    second = (second + (q * q - 1.0) * clean) / whole
    return -first / sigma, (first * first - second) / (sigma * sigma), clean / whole

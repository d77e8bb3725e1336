"""The median of the last of many values, kept in order."""

from __future__ import annotations

from slam.arrays import FloatArray
from slam.kernels import compiled


@compiled
def take_among(last: FloatArray, in_order: FloatArray, taken: int, value: float) -> float:
    """The median of the last values (M,), of which so many were taken, and of one more, in the place of the oldest
    if there is no other; in_order: (M,) the same, the least first. Of an even number, the mean of the middle two."""
    most = last.shape[0]
    count = min(taken, most)
    at = 0
    if count == most:
        oldest = last[taken % most]
        # a NaN would not be found: not past the end for it
        while at < count - 1 and in_order[at] != oldest:
            at += 1
        count -= 1
        for k in range(at, count):
            in_order[k] = in_order[k + 1]
    last[taken % most] = value
    at = count
    while at > 0 and in_order[at - 1] > value:
        in_order[at] = in_order[at - 1]
        at -= 1
    in_order[at] = value
    count += 1
    half = count // 2
    if count % 2 == 1:
        return float(in_order[half])
    return float((in_order[half - 1] + in_order[half]) / 2.0)

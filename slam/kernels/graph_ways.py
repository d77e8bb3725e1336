"""The shortest way from one keyframe to each other, over the steps between them and over loops."""

from __future__ import annotations

from slam.arrays import FloatArray, IntArray
from slam.kernels import compiled


@compiled
def ways_from(
    start: int, steps_m: FloatArray, ends: IntArray, loops_m: FloatArray, ways_m: FloatArray
) -> None:
    """Into ways_m (K,): the shortest way from keyframe `start` to each [m].

    steps_m: (K,) from the keyframe before to each, the first one's is of no interest; ends (L, 2),
    loops_m (L,): keyframes that loops lie between, and how far apart these are. Bellman and Ford's
    relaxation, along the chain to and fro, then over the loops: a few rounds, since these are few.
    """
    count = ways_m.shape[0]
    for k in range(count):
        ways_m[k] = 1e18
    ways_m[start] = 0.0
    is_shorter = True
    while is_shorter:
        for k in range(1, count):
            ways_m[k] = min(ways_m[k], ways_m[k - 1] + steps_m[k])
        for k in range(count - 2, -1, -1):
            ways_m[k] = min(ways_m[k], ways_m[k + 1] + steps_m[k + 1])
        is_shorter = False
        for i in range(loops_m.shape[0]):
            one, other = ends[i, 0], ends[i, 1]
            if ways_m[one] + loops_m[i] < ways_m[other]:
                ways_m[other] = ways_m[one] + loops_m[i]
                is_shorter = True
            elif ways_m[other] + loops_m[i] < ways_m[one]:
                ways_m[one] = ways_m[other] + loops_m[i]
                is_shorter = True

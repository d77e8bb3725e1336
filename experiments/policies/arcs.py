"""How much room a robot keeps on an arc that it tries in thought; an inner loop, compiled."""

import numpy as np

from slam.arrays import FloatArray
from slam.kernels import compiled


@compiled
def room_on_arc(
    points_m: FloatArray,
    boxes_m: FloatArray,
    now: tuple[float, float],
    wanted: tuple[float, float],
    accelerations: tuple[float, float],
    times_s: tuple[float, float, float],
) -> tuple[float, float]:
    """How near a robot comes to points (K, 2) in its frame, if it does as wanted, then stops [m].

    boxes_m: (B, 4) its outline: least and most x, least and most y of each. now, wanted: speed and
    turn rate. accelerations: of both. times_s: before the command acts, while it does, of a step.
    Returns the least distance on the way, and the distance now. Inside it is 0; without points inf.
    """
    lag_s, held_s, step_s = times_s
    v, w = now
    x = y = theta = 0.0
    first = _room(points_m, boxes_m, x, y, theta)
    least = first
    time_s = 0.0
    while time_s < 10.0:
        time_s += step_s
        if time_s > lag_s:
            goal_v, goal_w = wanted if time_s <= lag_s + held_s else (0.0, 0.0)
            v += min(max(goal_v - v, -accelerations[0] * step_s), accelerations[0] * step_s)
            w += min(max(goal_w - w, -accelerations[1] * step_s), accelerations[1] * step_s)
            if time_s > lag_s + held_s and v == 0.0 and w == 0.0:
                break
        theta += 0.5 * w * step_s
        x += v * step_s * np.cos(theta)
        y += v * step_s * np.sin(theta)
        theta += 0.5 * w * step_s
        least = min(least, _room(points_m, boxes_m, x, y, theta))
        if least <= 0.0:
            break
    return least, first


@compiled
def _room(
    points_m: FloatArray,
    boxes_m: FloatArray,
    x: float,
    y: float,
    theta: float,
) -> float:
    c, s = np.cos(theta), np.sin(theta)
    least = np.inf
    for k in range(len(points_m)):
        dx, dy = points_m[k, 0] - x, points_m[k, 1] - y
        px, py = c * dx + s * dy, c * dy - s * dx
        for b in range(len(boxes_m)):
            off_x = max(boxes_m[b, 0] - px, px - boxes_m[b, 1], 0.0)
            off_y = max(boxes_m[b, 2] - py, py - boxes_m[b, 3], 0.0)
            least = min(least, off_x * off_x + off_y * off_y)
    result: float = np.sqrt(least)
    return result

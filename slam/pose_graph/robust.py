"""Descent of a pose graph that believes its odometry and doubts its loops."""

from __future__ import annotations

from dataclasses import dataclass, replace
from enum import IntEnum

import numpy as np

from slam.arrays import BoolArray, FloatArray, IntArray
from slam.pose_graph.equations import Covariances, Equations, System, surprises


class EdgeKernel(IntEnum):
    """How an edge is trusted: PLAIN always, HUBER less when far off, LOOP not at all when far off.

    LOOP is dynamic covariance scaling (Agarwal et al., ICRA 2013): its pull falls with the third
    power of the residual, and up to `loop_chi_square` it is plain.
    """

    PLAIN = 0
    HUBER = 1
    LOOP = 2


@dataclass(frozen=True)
class PoseGraphConfig:
    """When loops and odometry count as far off, and when the descent ends.

    loop_chi_square, huber_chi_square: exceeded by 1 % and 5 % of right edges (3 degrees of freedom).
    gates: chi-squares of a new loop by the graph's own uncertainty up to which a start in stages
    begins with it unweighted; one run each. Chosen by measurement: 0 and 16 hold against groups of
    wrong loops that agree with each other, 64 against odometry three times worse than it claims.
    first_doubt: stages begin with loops that are up to so many times (variance) less certain in the
    graph than measured; chosen, 3 to 30 come out alike.
    """

    loop_chi_square: float = 11.34
    huber_chi_square: float = 7.81
    max_iterations: int = 100
    gates: tuple[float, ...] = (16.0, 0.0, 64.0)
    first_doubt: float = 10.0


REJECTED_BELOW = 0.25
"""A loop with less weight is rejected: dynamic covariance scaling gives a quarter at three times
its limit, where the loop's pull has passed its largest and falls."""

_UNUSED = 1e-9
"""Weight of a loop that no stage has taken in: none, but it holds parts that nothing else joins."""
_STAGE_ITERATIONS = 6
"""Chosen: twelve were no better, in trials."""
_LEAST_STAGE = 0.02
"""Chosen: a stage takes at least this share of the loops, or doubts are let grow."""
_DOUBT_GROWTH = 4.0
_FIRST_DAMPING, _LAST_DAMPING = 1e-6, 1e6
_HOLD = 1e-12
"""Damping of every step: a direction that no edge fixes stays, what edges fix is reached anyway."""
_DECREMENT = 1e-8
"""Square of the last step in standard deviations, of all poses together: nobody could see it."""


@dataclass(frozen=True, eq=False)
class Descent:
    """Where a descent ended: poses (N, 3), of the sorted edges chi_squares and weights (E,)."""

    poses: FloatArray
    chi_squares: FloatArray
    weights: FloatArray
    cost: float
    is_converged: bool
    iterations: int


def weigh(
    chi_squares: FloatArray,
    edge_kernels: IntArray,
    config: PoseGraphConfig,
    relaxation: FloatArray | float = 1.0,
) -> tuple[FloatArray, FloatArray]:
    """Weights and costs (E,) of edges; `relaxation` multiplies the limits of loops, (E,) or one."""
    limits = np.where(edge_kernels == EdgeKernel.LOOP, config.loop_chi_square * relaxation, np.inf)
    safe = np.where(np.isfinite(limits), limits, 1.0)
    is_far = chi_squares > limits
    weights = np.where(is_far, (2.0 * safe / (safe + chi_squares)) ** 2, 1.0)
    far = safe * (3.0 * chi_squares - safe) / (safe + chi_squares)
    costs = np.where(is_far, far, chi_squares)
    is_far = (edge_kernels == EdgeKernel.HUBER) & (chi_squares > config.huber_chi_square)
    roots = np.sqrt(config.huber_chi_square * chi_squares[is_far])
    weights[is_far] = config.huber_chi_square / roots
    costs[is_far] = 2.0 * roots - config.huber_chi_square
    return weights, costs


def descend(
    equations: Equations,
    poses: FloatArray,
    config: PoseGraphConfig,
    relaxation: FloatArray | None = None,
    in_use: BoolArray | None = None,
    max_iterations: int | None = None,
) -> Descent:
    """The minimum near the poses, by Levenberg-Marquardt on the manifold.

    relaxation: (E,) factors of the loops' limits at first, halved each step until they are 1.
    in_use: (E,) edges that count, all if None.
    """

    def weighed(chi_squares: FloatArray, relaxation: FloatArray) -> tuple[FloatArray, FloatArray]:
        weights, costs = weigh(chi_squares, equations.edge_kernels, config, relaxation)
        if in_use is not None:
            weights, costs = np.where(in_use, weights, _UNUSED), np.where(in_use, costs, 0.0)
        return weights, costs

    if relaxation is None:
        relaxation = np.ones(len(equations.ends))
    chi_squares = equations.chi_squares(poses)
    weights, costs = weighed(chi_squares, relaxation)
    damping, is_converged, iterations = 0.0, False, 0
    for _ in range(config.max_iterations if max_iterations is None else max_iterations):
        iterations += 1
        system = equations.system(poses, weights)
        while damping <= _LAST_DAMPING:
            step = _step(system, damping)
            decrement = np.inf if step is None else float(step @ system.pull)
            if step is not None:
                moved = system.moved(poses, step)
                moved_chi_squares = equations.chi_squares(moved)
                moved_weights, moved_costs = weighed(moved_chi_squares, relaxation)
                # of the edges that made the step; of a step that is nothing, only rounding is left
                gain = (costs - moved_costs)[equations.members].sum()
                if gain >= 0.0 or (damping == 0.0 and decrement <= _DECREMENT):
                    damping = damping / 10.0 if damping > _FIRST_DAMPING else 0.0
                    break
            damping = max(10.0 * damping, _FIRST_DAMPING)
        else:
            break
        poses, chi_squares, weights, costs = moved, moved_chi_squares, moved_weights, moved_costs
        if relaxation.max() > 1.0:
            relaxation = np.maximum(0.5 * relaxation, 1.0)
            weights, costs = weighed(chi_squares, relaxation)
        elif damping == 0.0 and decrement <= _DECREMENT:
            is_converged = True
            break
    return Descent(poses, chi_squares, weights, float(costs.sum()), is_converged, iterations)


def descend_in_stages(
    equations: Equations, poses: FloatArray, config: PoseGraphConfig, gate: float
) -> Descent:
    """The minimum reached by taking in first the loops that the graph itself foresees best.

    A loop over a short drive is foreseen well by the odometry: right or wrong shows. Those that are
    right make the graph stiffer, and with it longer ones can be judged. Each stage takes the loops
    whose way is at most so many times less certain in the graph than measured; where these are few,
    the limit grows. A new loop within `gate` of what the graph expects starts unweighted.
    """
    is_loop = equations.edge_kernels == EdgeKernel.LOOP
    in_use = ~is_loop
    doubt, iterations = config.first_doubt, 0
    while not in_use.all():
        rest = np.flatnonzero(~in_use)
        chi_squares = equations.chi_squares(poses)
        weights, _ = weigh(chi_squares, equations.edge_kernels, config)
        system = equations.system(poses, np.where(in_use, weights, _UNUSED))
        covariances = Covariances(system).of_ways(poses, equations.ends[rest])
        information = equations.information[rest]
        doubts = np.einsum("nij,nji->n", covariances, information) / 3.0
        least = min(len(rest), max(1, int(_LEAST_STAGE * is_loop.sum())))
        doubt = _grown(doubt, np.partition(doubts, least - 1)[least - 1])
        is_foreseen = doubts <= doubt
        in_use[rest[is_foreseen]] = True
        surprise = surprises(
            poses, equations.ends[rest], equations.measured[rest], information, covariances
        )
        welcome = rest[is_foreseen & (surprise <= gate)]
        relaxation = np.ones(len(in_use))
        relaxation[welcome] = np.maximum(1.0, chi_squares[welcome] / config.loop_chi_square)
        stage = descend(equations, poses, config, relaxation, in_use, _STAGE_ITERATIONS)
        poses = stage.poses
        iterations += stage.iterations
    last = descend(equations, poses, config)
    return Descent(
        last.poses, last.chi_squares, last.weights, last.cost, last.is_converged,
        iterations + last.iterations,
    )  # fmt: skip


def best_descent(equations: Equations, poses: FloatArray, config: PoseGraphConfig) -> Descent:
    """The lowest of the minima reached in stages, one run per gate, and from the poses at once.

    The first that rejects no loop is taken: no other could agree with all that was measured.
    """
    is_loop = equations.edge_kernels == EdgeKernel.LOOP
    found = []
    for gate in config.gates:
        found.append(descend_in_stages(equations, poses, config, gate))
        if not (found[-1].weights[is_loop] < REJECTED_BELOW).any():
            break
    else:
        found.append(descend(equations, poses, config))
    best = min(found, key=lambda descent: descent.cost)
    return replace(best, iterations=sum(descent.iterations for descent in found))


def _grown(doubt: float, least: float) -> float:
    while doubt < least:
        doubt *= _DOUBT_GROWTH
    return doubt


def _step(system: System, damping: float) -> FloatArray | None:
    """The step of the present system, None where it is singular."""
    try:
        step = system.factored(damping, _HOLD).solve(system.pull)
    except RuntimeError:  # all that SuperLU says of a singular matrix
        return None
    return np.asarray(step) if np.isfinite(step).all() else None

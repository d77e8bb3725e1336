"""A start of a pose graph that needs no poses: headings first, then positions, both linear."""

from __future__ import annotations

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.linalg import splu

from slam.arrays import FloatArray
from slam.pose_graph.equations import Equations


def chordal_poses(equations: Equations, poses: FloatArray) -> FloatArray:
    """Poses (N, 3) from the edges alone; of `poses` only those of fixed nodes count.

    A heading is a complex number, so that no turn has to be unwrapped: least squares of
    z_j - z_i exp(i theta_ij), then of p_j - p_i - z_i t_ij / |z_i|. All edges count, wrong ones too.
    Carlone, Tron, Daniilidis and Dellaert (ICRA 2015), the chordal relaxation, in the plane.
    """
    information = equations.information
    turns = np.exp(1j * equations.measured[:, 2])
    of_turns = np.maximum(information[:, 2, 2], 1e-12)
    headings = _least_squares(equations, turns, of_turns, np.exp(1j * poses[:, 2]), 0.0)
    headings /= np.maximum(np.abs(headings), 1e-300)
    shifts = equations.measured[:, 0] + 1j * equations.measured[:, 1]
    of_shifts = np.maximum(0.5 * (information[:, 0, 0] + information[:, 1, 1]), 1e-12)
    positions = poses[:, 0] + 1j * poses[:, 1]
    positions = _least_squares(
        equations,
        np.ones(len(shifts), dtype=np.complex128),
        of_shifts,
        positions,
        headings[equations.ends[:, 0]] * shifts,
    )
    return np.column_stack([positions.real, positions.imag, np.angle(headings)])


def _least_squares(
    equations: Equations,
    factors: np.ndarray,
    weights: FloatArray,
    known: np.ndarray,
    offsets: np.ndarray | float,
) -> np.ndarray:
    """(N,) complex values that minimise sum weights |v_j - factors v_i - offsets|^2."""
    i, j = equations.ends.T
    count = int((~equations.is_fixed).sum())
    unknowns = np.full(len(known), -1)
    unknowns[~equations.is_fixed] = np.arange(count)
    rows = np.arange(len(i))
    root = np.sqrt(weights)
    columns = np.concatenate([i, j])
    entries = np.concatenate([-factors * root, root.astype(np.complex128)])
    all_rows = np.concatenate([rows, rows])
    is_free = unknowns[columns] >= 0
    J = coo_array(
        (entries[is_free], (all_rows[is_free], unknowns[columns[is_free]])), shape=(len(i), count)
    ).tocsc()
    target = np.zeros(len(i), dtype=np.complex128) + root * offsets
    np.subtract.at(target, all_rows[~is_free], (entries * known[columns])[~is_free])
    adjoint = J.conj().T
    system = (adjoint @ J).tocsc()
    factor = splu(
        system, permc_spec="MMD_AT_PLUS_A", diag_pivot_thresh=0.0, options={"SymmetricMode": True}
    )
    solved = factor.solve(adjoint @ target)
    values = known.astype(np.complex128)
    values[unknowns >= 0] = solved[unknowns[unknowns >= 0]]
    return values

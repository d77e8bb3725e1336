"""Which blocks the normal equations of a pose graph have, and where."""

import numpy as np
import pytest
from scipy.sparse import coo_array, csc_array
from scipy.sparse.csgraph import connected_components

from slam.kernels import block_pattern as layout


def _edges(rng, count, edges):
    """(E, 2) between nodes of which none is its own neighbour; some of them twice, either way round."""
    one = rng.integers(0, count, edges)
    ends = np.column_stack([one, (one + rng.integers(1, count, edges)) % count])
    return np.concatenate([ends, ends[::3], ends[::4, ::-1]])


def _unknowns(rng, count, fixed):
    """(N,) numbers of the nodes in any order, -1 of so many of them."""
    numbers = np.concatenate([np.full(fixed, -1), rng.permutation(count - fixed)])
    return rng.permutation(numbers)


@pytest.mark.parametrize("fixed", [0, 1, 5])
def test_each_block_has_its_place(fixed):
    rng = np.random.default_rng(23)
    for count, edges in ((7, 4), (30, 60), (60, 40)):
        free = count - fixed
        ends = _unknowns(rng, count, fixed)[_edges(rng, count, edges)]
        indptr, indices = layout.pattern_of(ends, free)
        is_there = np.eye(free, dtype=bool)
        for a, b in ends[(ends >= 0).all(axis=1)]:
            is_there[a, b] = is_there[b, a] = True
        np.testing.assert_array_equal(np.diff(indptr), is_there.sum(axis=0))
        np.testing.assert_array_equal(indices, np.nonzero(is_there.T)[1])

        slots, diagonal = np.empty((len(ends), 4), np.int64), np.empty(3 * free, np.int64)
        csc_indptr = np.empty(3 * free + 1, np.int32)
        csc_indices = np.empty(9 * len(indices), np.int32)
        layout.lay_out(ends, indptr, indices, slots, diagonal, csc_indptr, csc_indices)
        values = np.arange(9.0 * len(indices))
        dense = csc_array((values, csc_indices, csc_indptr), shape=(3 * free, 3 * free)).toarray()
        np.testing.assert_array_equal(dense[np.diag_indices(3 * free)], diagonal)
        is_entry = np.kron(is_there, np.ones((3, 3))) > 0
        np.testing.assert_array_equal(np.sort(dense[is_entry]), values)
        assert not dense[~is_entry].any()
        for (a, b), firsts in zip(ends, slots, strict=True):
            blocks = ((a, a), (b, b), (a, b), (b, a))
            for (row, column), first in zip(blocks, firsts, strict=True):
                there = row >= 0 and column >= 0
                assert first == (dense[3 * row, 3 * column] if there else 0)


@pytest.mark.parametrize("edges", [0, 5, 30, 80])
def test_what_edges_join_to_a_fixed_node_is_held(edges):
    rng = np.random.default_rng(29)
    for _ in range(20):
        is_fixed = rng.random(50) < 0.06
        ends = _edges(rng, 50, edges)
        held = np.empty(50, dtype=np.bool_)
        layout.held_into(is_fixed, ends, held)
        _, parts = connected_components(
            coo_array((np.ones(len(ends)), tuple(ends.T)), shape=(50, 50)), directed=False
        )
        np.testing.assert_array_equal(held, np.isin(parts, parts[is_fixed]))

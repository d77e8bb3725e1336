"""Small matrices solved by hand, against NumPy."""

import numpy as np
import pytest

from slam.kernels.normal_equations import (
    LEAST_PIVOT,
    carry_into,
    inverse_of,
    lower_root_into,
    solve_by_root,
    squared_innovation,
)
from slam.se2 import SE2


def definite(rng: np.random.Generator, spread: float) -> np.ndarray:
    """A random (3, 3), its axes up to so many decades apart in length."""
    axes = np.linalg.qr(rng.normal(size=(3, 3)))[0]
    return (axes * 10.0 ** rng.uniform(-spread, spread, 3)) @ axes.T


@pytest.mark.parametrize("spread", [0.5, 3.0])
@pytest.mark.parametrize("seed", range(5))
def test_inverse_and_solution_are_those_of_numpy(seed, spread):
    rng = np.random.default_rng(seed)
    matrix, vector, root = definite(rng, spread), rng.normal(size=3), np.empty((3, 3))
    rounding = 1e-12 * np.linalg.cond(matrix)
    assert lower_root_into(matrix, LEAST_PIVOT, root)
    np.testing.assert_allclose(root, np.linalg.cholesky(matrix), atol=rounding * root.max())
    expected = np.linalg.inv(matrix)
    np.testing.assert_allclose(inverse_of(matrix), expected, atol=rounding * expected.max())
    expected = np.linalg.solve(matrix, vector)
    solve_by_root(root, vector, vector)
    np.testing.assert_allclose(vector, expected, atol=rounding * abs(expected).max())


def test_singular_matrix_has_no_root_and_a_pull_of_nothing_makes_no_step():
    root = np.empty((3, 3))
    assert not lower_root_into(np.diag([1.0, 0.0, 1.0]), LEAST_PIVOT, root)
    step = np.zeros(3)
    solve_by_root(root, step, step)
    assert not step.any()


@pytest.mark.parametrize("seed", range(5))
def test_covariance_is_carried_by_the_adjoint_of_the_way_back(seed):
    rng = np.random.default_rng(seed)
    covariance, way = definite(rng, 1.0), SE2(*rng.normal(size=3))
    carry = way.inverse().adjoint()
    found = np.full((3, 3), np.nan)
    carry_into(covariance, way.x, way.y, way.theta, found)
    np.testing.assert_allclose(found, carry @ covariance @ carry.T, rtol=1e-9, atol=1e-9)


@pytest.mark.parametrize("turn_rad", [0.0, 1e-9, 1e-5, 0.3, -2.5, 6.0])
def test_innovation_squared_is_that_of_the_twist(turn_rad):
    known = definite(np.random.default_rng(3), 1.0)
    told = SE2(3.0, -1.0, 2.0)
    found = told @ SE2(0.3, -0.2, turn_rad)
    twist = told.between(found).log()
    squared = squared_innovation(told.x, told.y, told.theta, found.x, found.y, found.theta, known)
    assert squared == pytest.approx(twist @ known @ twist, rel=1e-9)

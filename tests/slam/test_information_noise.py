"""What noise makes of a scan's information."""

import numpy as np
import pytest

from slam.kernels.information_noise import take_off


def _information(rng, scale):
    rows = rng.normal(size=(6, 3)) * scale
    return rows.T @ rows


def _less_by_directions(information, noise):
    """Along each direction of both, a tenth is left at least."""
    root = np.linalg.cholesky(information)
    scaled = np.linalg.solve(root, np.linalg.solve(root, noise).T)
    shares, directions = np.linalg.eigh(scaled)
    along = root @ directions
    return information - (along * np.minimum(shares, 0.9)) @ along.T


@pytest.mark.parametrize("noise_scale", [0.1, 0.6, 1.5, 20.0])
def test_what_noise_makes_is_taken_off_and_a_tenth_is_left(noise_scale):
    rng = np.random.default_rng(17)
    for _ in range(50):
        information, noise = _information(rng, 30.0), _information(rng, 30.0 * noise_scale)
        less = information.copy()
        take_off(less, noise)
        expected = _less_by_directions(information, noise)
        np.testing.assert_allclose(less, expected, atol=1e-9 * information.max())
        # never less than a tenth along any direction
        assert np.linalg.eigvalsh(less - (0.1 - 1e-9) * information).min() > 0.0


def test_a_scan_that_tells_nothing_of_a_direction_has_nothing_taken_off():
    wall = np.array([3.0, 0.0, 1.0])
    information = np.outer(wall, wall)
    less = information.copy()
    take_off(less, 0.5 * np.eye(3))
    np.testing.assert_array_equal(less, information)

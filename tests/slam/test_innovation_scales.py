"""Covariances are widened where innovations say so, and not by chance."""

import numpy as np
import pytest

from slam.innovation_scales import InnovationScales


def learnt(match: float, motion: float, share: float, count: int = 2000) -> np.ndarray:
    """(count, 2) scales of matches and motions whose covariances truly are so many times wider."""
    rng, scales, said = np.random.default_rng(0), InnovationScales(10.0), []
    for _ in range(count):
        width = share * match / scales.match + (1.0 - share) * motion / scales.motion
        scales.learn(width * rng.chisquare(3) / 3.0, share)
        said.append((scales.match, scales.motion))
    return np.array(said)


@pytest.mark.parametrize("share", [0.1, 0.5, 0.9])
def test_covariances_that_are_true_are_left_as_they_are(share):
    # kept at 1 and above by cutting off each downward step, they were 4 % too wide on average
    assert learnt(1.0, 1.0, share).mean(axis=0) == pytest.approx(1.0, abs=0.01)


def test_covariances_that_are_too_wide_are_not_narrowed():
    assert (learnt(0.5, 0.5, 0.5) == 1.0).all()


@pytest.mark.parametrize("true", [2.0, 4.0])
def test_matches_that_tell_too_much_are_widened_by_as_much(true):
    assert learnt(true, 1.0, 0.95)[500:, 0].mean() == pytest.approx(true, rel=0.1)


def test_motions_that_tell_too_much_are_widened_by_as_much():
    assert learnt(1.0, 3.0, 0.05)[500:, 1].mean() == pytest.approx(3.0, rel=0.1)


def test_no_scale_is_beyond_the_most():
    assert learnt(50.0, 50.0, 0.5).max() == 10.0

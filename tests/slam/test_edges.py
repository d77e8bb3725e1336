"""Expectation propagation over what beams beside an edge tell."""

import numpy as np
import pytest

from slam.beams import Beams
from slam.kernels.edge_moments import moments_about
from slam.kernels.edges import (
    doubt,
    edge_likelihoods,
    propagate,
    ranges_beside,
    share_absent,
)
from slam.kernels.mixed_pixels import density_beside, mixing_shares, slope_and_bend
from slam.kernels.smooth_beams import keep_smooth
from slam.se2 import SE2
from slam.surface.normal_points import standard_normal_points
from slam.surface.segment_map import SegmentMap
from tests.slam.synthetic import ANGLES_RAD, ROOM_CENTRE, ROOM_SEGMENTS, scan_of

NODES = np.linspace(-3.5, 3.5, 33)
INFORMATION = np.linalg.inv(
    np.array([[4e-6, 1e-6, 2e-7], [1e-6, 9e-6, -5e-7], [2e-7, -5e-7, 1e-6]])
)


def propagated(
    axes: np.ndarray, shifts: np.ndarray, likelihoods: np.ndarray, sweeps: int = 20
) -> tuple[np.ndarray, np.ndarray]:
    mean, covariance = np.zeros(3), np.zeros((3, 3))
    propagate(INFORMATION.copy(), axes, shifts, likelihoods, sweeps, mean, covariance)
    return mean, covariance


def nodes_along(axes: np.ndarray) -> np.ndarray:
    """(E, K) shifts at the nodes of the Gaussian given."""
    covariance = np.linalg.inv(INFORMATION)
    sigmas = np.sqrt(np.einsum("ei,ij,ej->e", axes, covariance, axes))
    return sigmas[:, np.newaxis] * NODES


@pytest.mark.parametrize("seed", range(6))
def test_gaussian_edges_give_the_product_of_gaussians(seed):
    rng = np.random.default_rng(seed)
    turns = rng.uniform(-np.pi, np.pi, 4)
    axes = np.column_stack([-np.sin(turns), np.cos(turns), rng.uniform(0.5, 4.0, 4)])
    shifts = nodes_along(axes)
    widths = shifts[:, -1] / 3.5 * rng.uniform(0.8, 2.0, 4)
    middles = 0.5 * widths * rng.uniform(-1.0, 1.0, 4)
    likelihoods = np.exp(-0.5 * ((shifts - middles[:, None]) / widths[:, None]) ** 2)
    mean, covariance = propagated(axes, shifts, likelihoods)
    total = INFORMATION + (axes / widths[:, None] ** 2).T @ axes
    expected = np.linalg.solve(total, axes.T @ (middles / widths**2))
    # nodes end at 3.5 sigma: what lies beyond is 5e-4 of the mass and 1 % of the variance
    sigmas = np.sqrt(np.diag(np.linalg.inv(total)))
    np.testing.assert_allclose(mean / sigmas, expected / sigmas, atol=0.02)
    np.testing.assert_allclose(covariance @ total, np.eye(3), atol=0.03)


def test_without_edges_the_gaussian_stays():
    mean, covariance = propagated(np.empty((0, 3)), np.empty((0, 33)), np.empty((0, 33)))
    assert not mean.any()
    np.testing.assert_allclose(covariance @ INFORMATION, np.eye(3), atol=1e-9)


def test_edge_that_says_the_same_everywhere_changes_next_to_nothing():
    axes = np.array([[0.0, 1.0, 2.0]])
    mean, covariance = propagated(axes, nodes_along(axes), np.full((1, 33), 0.7))
    # nodes end at 3.5 sigma: 1 % of the variance along it
    sigmas = np.sqrt(np.diag(np.linalg.inv(INFORMATION)))
    assert np.abs(mean / sigmas).max() < 1e-6
    np.testing.assert_allclose(covariance @ INFORMATION, np.eye(3), atol=0.02)


def test_edge_that_leaves_one_side_gives_the_half_of_a_gaussian():
    # a normal cut at its middle has the mean sigma sqrt(2 / pi) and variance sigma^2 (1 - 2 / pi)
    axes = np.array([[0.0, 1.0, 0.0]])
    shifts = nodes_along(axes)
    likelihoods = np.where(shifts > 0.0, 1.0, np.where(shifts == 0.0, 0.5, 0.0))
    mean, covariance = propagated(axes, shifts, likelihoods)
    sigma = 3e-3
    # a step is known to a node, 0.22 sigma: a twentieth of that in the mean
    assert mean[1] / sigma == pytest.approx(np.sqrt(2.0 / np.pi), abs=0.02)
    assert covariance[1, 1] / sigma**2 == pytest.approx(1.0 - 2.0 / np.pi, abs=0.03)
    # x and heading follow by their correlation
    assert mean[0] / mean[1] == pytest.approx(1.0 / 9.0, rel=1e-6)


def test_edge_that_nothing_explains_is_left_out():
    axes = np.array([[0.0, 1.0, 2.0]])
    mean, covariance = propagated(axes, nodes_along(axes), np.zeros((1, 33)))
    assert not mean.any()
    np.testing.assert_allclose(covariance @ INFORMATION, np.eye(3), atol=1e-9)


@pytest.mark.parametrize(("agreeing", "others"), [(2, 1), (4, 2)])
def test_edges_that_contradict_the_rest_leave_the_pose_as_unsure_as_it_is(agreeing, others):
    likelihoods = np.exp(-0.5 * (np.tile(NODES, (agreeing + others, 1)) / 0.8) ** 2) + 1e-3
    likelihoods[agreeing:] = np.exp(-0.5 * ((NODES - 1.5) / 0.25) ** 2) + 0.2
    axes = np.tile([0.0, 1.0, 0.0], (agreeing + others, 1))
    _, covariance = propagated(axes, nodes_along(axes), likelihoods, sweeps=4)
    posterior = np.exp(-0.5 * NODES**2) * likelihoods.prod(axis=0)
    mean, square = (np.average(NODES**power, weights=posterior) for power in (1, 2))
    # contradictions taken for agreement of no weight left 0.80 and 0.59 of the variance
    assert covariance[1, 1] / 9e-6 == pytest.approx(square - mean**2, rel=0.12)


NOISE = np.array([[10.0, 0.02]])
PLATEAUS_M = np.repeat(np.where(np.arange(40) % 2 == 0, 2.0, 3.0), 10)
"""400 beams, a jump of a metre every ten."""


def shares_of(measured_m: np.ndarray) -> np.ndarray:
    shares, odds = np.empty(2), 0.25
    kept = np.ones(len(measured_m), dtype=np.bool_)
    mixing_shares(PLATEAUS_M, measured_m, NOISE, kept, odds, shares)
    return shares


@pytest.mark.parametrize("side", [0, 1])
def test_scan_tells_on_which_side_of_an_edge_light_is_mixed(side):
    beside = np.arange(9, 390, 10) + side  # the last beam before a jump has the edge to its left
    measured_m = PLATEAUS_M.copy()
    measured_m[beside[::3]] = 2.5
    shares = shares_of(measured_m)
    # 13 of 39 edges, of which margins of three sigmas hide an eighth, and three of which a fifth
    assert shares[side] == pytest.approx((13 + 0.6) / (39 * 0.88 + 3), rel=1e-6)
    assert shares[1 - side] == pytest.approx(0.6 / (39 * 0.88 + 3), rel=1e-6)


def test_beam_that_measures_its_wall_says_that_it_is_on_the_side_where_none_is_mixed():
    # beam 9 sees 2 m, or from the other side of the edge 3 m: no light is mixed there
    ranges_m = np.array([[2.0, 3.0]])
    likelihoods = np.empty((1, 2))
    edge_likelihoods(
        ranges_m, np.array([9]), np.where(np.arange(400) == 9, 2.4, PLATEAUS_M), NOISE,
        np.array([0.0, 10.0]), np.array([1e-3, 0.25]), np.array([0.3, 0.01]),
        np.array([0.05]), PLATEAUS_M, likelihoods,
    )  # fmt: skip
    # mixed, it has the edge to its left, where thirty times as many are: but for the outliers' floor
    assert likelihoods[0, 0] / likelihoods[0, 1] > 20.0


@pytest.mark.parametrize("jump_m", [0.11, -0.3, 2.0])
def test_density_beside_an_edge_is_one_however_small_the_jump(jump_m):
    h, noise, shares = 3.0, np.array([[10.0, 0.05]]), np.array([0.3, 0.1])
    z_m = np.linspace(-1.0, 7.0, 8001)
    clean = np.exp(-0.5 * ((z_m - h) / 0.05) ** 2) / 0.05
    densities = [
        density_beside(z, h, here, h + jump_m, h, noise, shares)
        for z, here in zip(z_m, clean, strict=True)
    ]
    assert np.sum(densities) * 1e-3 / np.sqrt(2.0 * np.pi) == pytest.approx(1.0, abs=1e-4)


@pytest.mark.parametrize("jumps_m", [(0.2, -0.15), (1.0, 0.05), (-0.4, np.inf)])
@pytest.mark.parametrize("residual_m", [-0.12, 0.0, 0.07])
def test_slope_and_bend_are_the_derivatives_of_the_density(jumps_m, residual_m):
    h, sigma, outlier, shares = 3.0, 0.05, 0.01, np.array([0.3, 0.1])
    noise, z = np.array([[10.0, sigma]]), h + residual_m

    def log_likelihood(h: float) -> float:
        clean = np.exp(-0.5 * ((z - h) / sigma) ** 2) / sigma
        left, right = h + jumps_m[0], h + jumps_m[1]
        told = density_beside(z, h, clean, left, right, noise, shares)
        return float(np.log(told + outlier * np.sqrt(2.0 * np.pi)))

    step = 1e-4
    before, here, after = (log_likelihood(h + k * step) for k in (-1, 0, 1))
    slope, bend, weight = slope_and_bend(
        z, h, h + jumps_m[0], h + jumps_m[1], sigma, shares, outlier
    )
    assert slope == pytest.approx((after - before) / (2.0 * step), rel=1e-3, abs=1e-3)
    assert bend == pytest.approx((2.0 * here - before - after) / step**2, rel=1e-3, abs=0.1)
    assert 0.0 < weight <= 1.0


def test_flat_wall_seen_by_beams_close_together_tells_all_that_its_noise_leaves():
    # 5 cm from beam to beam, as along any wall: taken for mixed, a tenth and more was lost
    found = slope_and_bend(3.01, 3.0, 3.05, 2.95, 0.02, np.array([0.2, 0.2]), 0.01)
    assert found[1] == pytest.approx(1.0 / 0.02**2, rel=0.01)
    assert found[2] > 0.99


@pytest.mark.parametrize(
    ("off_m", "absent"), [(0.01, 0.02), (0.5, 1.0), (-0.5, 0.05)], ids=["met", "through", "hidden"]
)
def test_thing_on_which_a_beam_beside_ends_is_there(off_m, absent):
    # beams 10 to 19 see a thing at 3 m in front of nothing; beam 20 passes its edge
    predicted_m = np.where(np.arange(40) // 10 == 1, 3.0, np.inf)
    measured_m = predicted_m + off_m
    kept_beams = np.ones(40, dtype=np.bool_)
    assert share_absent(20, 3.0, predicted_m, measured_m, NOISE, kept_beams) == absent


@pytest.mark.parametrize("seed", range(4))
def test_ranges_beside_are_those_from_the_shifted_origins(seed):
    rng = np.random.default_rng(seed)
    segment_map = SegmentMap(ROOM_SEGMENTS)
    pose = ROOM_CENTRE @ SE2(*rng.uniform(-0.5, 0.5, 2), rng.uniform(-3.0, 3.0))
    origins_m = rng.normal(0.0, 0.05, (len(ANGLES_RAD), 2))
    beams = Beams(origins_m, ANGLES_RAD, np.full(len(ANGLES_RAD), np.nan))
    chosen = np.sort(rng.choice(len(beams), 40, replace=False))
    shifts = np.tile(np.linspace(-0.2, 0.2, 33), (40, 1)) * rng.uniform(0.1, 1.0, (40, 1))
    found_m = np.empty_like(shifts)
    vertices = pose.inverse() @ segment_map.vertices
    ranges_beside(
        vertices, segment_map.walls, chosen, beams.origins_m, beams.directions, shifts,
        np.ones(40, dtype=np.bool_), 30.0, found_m,
    )  # fmt: skip
    left = np.column_stack([-beams.directions[:, 1], beams.directions[:, 0]])
    differences = []
    for k in range(33):
        moved = origins_m.copy()
        moved[chosen] += shifts[:, k, np.newaxis] * left[chosen]
        expected_m, _ = segment_map.ranges(Beams(moved, ANGLES_RAD, beams.ranges_m), pose, 30.0)
        differences.append(np.abs(found_m[:, k] - expected_m[chosen]))
    # exact but for rounding; no node here lies within that of an edge
    assert np.max(differences) < 1e-9


def test_nothing_beside_is_infinite():
    segment_map = SegmentMap([[[2.0, 0.1], [2.0, 1.0]]])
    found_m = np.empty((1, 3))
    ranges_beside(
        segment_map.vertices, segment_map.walls, np.zeros(1, dtype=np.int64), np.zeros((1, 2)),
        np.array([[1.0, 0.0]]), np.array([[-0.2, 0.0, 0.2]]), np.ones(1, dtype=np.bool_), 30.0, found_m,
    )  # fmt: skip
    assert found_m.tolist() == [[np.inf, np.inf, 2.0]]


def kept(
    segments: np.ndarray,
    pose: SE2,
    covariance: np.ndarray,
    sigmas: float = 2.0,
    sigma_m: float = 1e-4,
    blur_m: float = 1.0,
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Which beams `keep_smooth` keeps, the walls they hit (-1: none) and their ranges; (N,) each."""
    segment_map, beams = SegmentMap(segments), Beams.of(scan_of(segments, pose), SE2.identity())
    ranges_m, hit_walls = segment_map.ranges(beams, pose, 30.0)
    predicted_m, is_kept = ranges_m.copy(), np.zeros(len(beams), dtype=np.bool_)
    vertices = pose.inverse() @ segment_map.vertices
    keep_smooth(
        vertices, segment_map.walls, beams.origins_m, beams.directions, beams.angles_rad,
        beams.middle_m, beams.spread_m, 30.0, np.array([[1.0, sigma_m]]), covariance, sigmas, 1.0,
        blur_m, np.empty_like(vertices), predicted_m, hit_walls, is_kept,
    )  # fmt: skip
    return is_kept, hit_walls, ranges_m


@pytest.mark.parametrize("heading_rad", [0.0, 0.8, 2.0, -2.9])
def test_straight_wall_is_smooth_however_flat_the_beam_and_wide_the_pose(heading_rad):
    # 5 mm aside, a beam at 20 degrees to the wall is 14 mm longer: 140 sigmas, and no edge
    is_kept, hit_walls, ranges_m = kept(
        np.array([[[60.0, 1.0], [-60.0, 1.0]], [[-60.0, -1.0], [60.0, -1.0]]]),
        SE2(0.0, 0.2, heading_rad),
        np.diag([25e-6, 25e-6, 1e-6]),
    )
    is_near = hit_walls >= 0
    # the flattest of all, 25 m off, may leave the 30 m that are looked at
    is_near[is_near] = ranges_m[is_near] < 25.0
    assert is_near.sum() > 400
    assert is_kept[is_near].all()


def test_beams_that_pass_an_edge_and_no_others_are_not_smooth():
    pose, deviation_m, sigmas = ROOM_CENTRE, 3e-3, 2.0
    is_kept, _, _ = kept(
        ROOM_SEGMENTS, pose, np.diag([deviation_m**2, deviation_m**2, 1e-12]), sigmas
    )
    # the obvious way: is it the same wall from either side?
    segment_map, beams = (
        SegmentMap(ROOM_SEGMENTS),
        Beams.of(scan_of(ROOM_SEGMENTS, pose), SE2.identity()),
    )
    left = np.column_stack([-beams.directions[:, 1], beams.directions[:, 0]])
    walls = []
    for shift in (-1.0, 0.0, 1.0):
        origins_m = shift * sigmas * deviation_m * left
        seen_from = Beams(origins_m, beams.angles_rad, beams.ranges_m)
        walls.append(segment_map.ranges(seen_from, pose, 30.0)[1])
    is_same = (walls[0] == walls[1]) & (walls[1] == walls[2])
    assert (~is_same).sum() >= 5
    np.testing.assert_array_equal(is_kept, is_same)


def test_beam_that_vouches_for_itself_is_not_smooth_beside_a_jump():
    # down a corridor, the farther a beam hits, the more it says of the heading, and of itself
    pose = SE2(0.0, 0.2, 0.0)
    segments = np.array([[[60.0, 1.0], [-60.0, 1.0]], [[-60.0, -1.0], [60.0, -1.0]]])
    sure, unsure = (np.diag([1e-8, 1e-8, variance]) for variance in (1e-10, 1e-4))
    is_kept, _, ranges_m = kept(segments, pose, sure, sigma_m=0.05, blur_m=0.0)
    is_steep, is_flat = ranges_m < 1.2, (ranges_m > 10.0) & (ranges_m < 20.0)
    assert is_kept[is_steep].all()
    assert is_kept[is_flat].all()
    # 10 mrad make a beam of 10 m a metre longer, one of 1.2 m a quarter of the noise at most
    is_kept, _, _ = kept(segments, pose, unsure, sigma_m=0.05, blur_m=0.0)
    assert is_kept[is_steep].all()
    assert not is_kept[is_flat].any()


def moments(axes, shifts, likelihoods, count=64):
    """Second moments about the mean that `propagate` finds; those of many random points; what
    `propagate` says they are."""
    mean, covariance = np.zeros(3), np.zeros((3, 3))
    information = INFORMATION.copy()
    propagate(information, axes, shifts, likelihoods, 4, mean, covariance)
    found = np.empty((3, 3))
    points = standard_normal_points(count)
    moments_about(INFORMATION, axes, shifts, likelihoods, points, mean, information, found)
    drawn = np.random.default_rng(0).multivariate_normal(
        np.zeros(3), np.linalg.inv(INFORMATION), 200_000
    )
    weights = np.ones(len(drawn))
    for axis, at_m, likelihood in zip(axes, shifts, likelihoods, strict=True):
        weights *= np.exp(np.interp(drawn @ axis, at_m, np.log(likelihood)))
    off = drawn - mean
    return found, (off.T * weights) @ off / weights.sum(), np.linalg.inv(information)


def test_moments_are_those_of_all_that_smooth_beams_and_edges_say():
    rng = np.random.default_rng(3)
    turns = rng.uniform(-np.pi, np.pi, 5)
    axes = np.column_stack([-np.sin(turns), np.cos(turns), rng.uniform(0.5, 4.0, 5)])
    shifts = nodes_along(axes)
    # an edge each, somewhere: the beam ends before it on one side
    likelihoods = np.where(shifts > shifts[:, [12]], 1.0, 0.02)
    found, expected, _ = moments(axes, shifts, likelihoods, count=4096)
    np.testing.assert_allclose(found, expected, atol=0.1 * np.abs(expected).max())
    few, _, _ = moments(axes, shifts, likelihoods)
    np.testing.assert_allclose(few, expected, atol=0.4 * np.abs(expected).max())


def test_moments_tell_of_the_answer_that_expectation_propagation_leaves_out():
    axes = np.array([[0.0, 1.0, 0.0], [0.0, 1.0, 0.0]])
    shifts = nodes_along(axes)
    # two places fit, one three times as well: the Gaussian found is that of the one
    peaks = np.exp(-0.5 * ((shifts - shifts[:, [22]]) / 8e-4) ** 2)
    peaks += 0.55 * np.exp(-0.5 * ((shifts - shifts[:, [9]]) / 8e-4) ** 2)
    found, expected, told = moments(axes, shifts, peaks + 1e-6)
    assert expected[1, 1] > 10.0 * told[1, 1]
    assert found[1, 1] == pytest.approx(expected[1, 1], rel=0.3)


@pytest.mark.parametrize("stretch", [slice(0, 64), slice(0, 32), slice(32, 64), slice(100, 228)])
def test_points_fill_a_normal_distribution_and_so_does_any_stretch_of_them(stretch):
    points = standard_normal_points(256)[stretch]
    assert np.abs(points.mean(axis=0)).max() < 0.16
    assert np.cov(points.T) == pytest.approx(np.eye(3), abs=0.2)


def test_one_beam_makes_no_place_less_likely_than_an_eighth_of_its_best():
    likelihoods = np.array([[1e-9, 0.5, 40.0], [0.2, 0.3, 0.25]])
    doubt(likelihoods)
    np.testing.assert_allclose(likelihoods, [[40.0 * np.exp(-2.0)] * 2 + [40.0], [0.2, 0.3, 0.25]])

"""The beam likelihood: its gradients, its bound, and the estimator that reaches it."""

import math

import numpy as np
import pytest
from scipy.optimize import minimize

from slam.beam_likelihood import (
    BeamConfig,
    BeamMatch,
    _widen,
    covariance_of,
    cramer_rao_bound,
    fisher_information,
    match_beams,
)
from slam.beams import Beams
from slam.kernels.beam_likelihood import OFFSET_INFORMATION, SUM_COUNT
from slam.kernels.smooth_beams import look_smooth
from slam.laser_model import LaserModel
from slam.range_noise import RangeNoise
from slam.se2 import SE2
from slam.surface.segment_map import SegmentMap
from tests.slam.slow_twins import cast_all, gradients
from tests.slam.synthetic import ANGLES_RAD, ROOM_CENTRE, ROOM_SEGMENTS, round_wall, scan_of

LASER = SE2(0.12, 0.03, 0.1)
SIGMA_M = 0.01
MODEL = LaserModel(RangeNoise(((1.0, SIGMA_M),)), 0.02, 10.0)
ROOM = SegmentMap(ROOM_SEGMENTS)
# no two beams of a convex room look past an edge: there the likelihood is smooth
BARE = np.array(
    [
        [[0.0, 0.0], [5.0, -0.4]],
        [[5.0, -0.4], [6.0, 3.0]],
        [[6.0, 3.0], [2.0, 4.5]],
        [[2.0, 4.5], [-0.5, 2.0]],
        [[-0.5, 2.0], [0.0, 0.0]],
    ]
)


def fan(angles_rad: np.ndarray) -> Beams:
    return Beams(np.zeros((len(angles_rad), 2)), angles_rad, np.full(len(angles_rad), np.nan))


def box(half_m: float) -> np.ndarray:
    corners = half_m * np.array([[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]])
    return np.stack([corners, np.roll(corners, -1, axis=0)], axis=1)


def beams_at(
    pose: SE2,
    rng: np.random.Generator | None = None,
    sigma_m: float = SIGMA_M,
    segments: np.ndarray = ROOM_SEGMENTS,
    bias_m: float = 0.0,
) -> Beams:
    scan = scan_of(segments, pose @ LASER, rng, sigma_m)
    beams = Beams.of(scan, LASER)
    return Beams(beams.origins_m, beams.angles_rad, beams.ranges_m + bias_m)


def drawn_pose(rng: np.random.Generator) -> SE2:
    """In the middle of the room, half a metre from all walls."""
    return SE2(rng.uniform(1.5, 3.6), rng.uniform(0.7, 2.5), rng.uniform(-math.pi, math.pi))


def nees(match: BeamMatch, true: SE2) -> float:
    off = (match.T_map_base.inverse() @ true).log()
    return float(off @ match.information @ off)


def distance_m(a: SE2, b: SE2) -> float:
    change = a.inverse() @ b
    return math.hypot(change.x, change.y)


# gradient, information and bound


def test_information_of_one_beam_is_its_squared_gradient_by_finite_differences():
    beams = beams_at(ROOM_CENTRE)
    ranges_m, walls = ROOM.ranges(beams, ROOM_CENTRE)
    slopes = gradients(ROOM, beams, ROOM_CENTRE)
    # beams that a micrometre takes past an edge have no gradient there
    is_smooth = np.abs(slopes).max(axis=1) < 100.0
    checked = np.flatnonzero(is_smooth)[::12]
    assert len(checked) > 35
    for i in checked:
        only = np.arange(len(beams)) == i
        information = fisher_information(beams, ROOM, MODEL, ROOM_CENTRE, only)
        expected = np.outer(slopes[i], slopes[i]) / SIGMA_M**2
        # a central difference of a micrometre: ranges rounded at 1e-15 make 1e-9 of it
        np.testing.assert_allclose(information, expected, rtol=1e-6, atol=1e-6 * expected.max())
        assert walls[i] >= 0
        assert np.isfinite(ranges_m[i])


def test_information_agrees_with_the_obvious_sum():
    noise = RangeNoise(((1.0, 0.01), (4.0, 0.05)))
    model = LaserModel(noise, 0.5, 3.0)
    for pose in (ROOM_CENTRE, SE2(1.6, 2.2, -2.0), SE2(5.2, 1.5, 3.0)):
        beams = beams_at(pose)
        ranges_m, _ = cast_all(ROOM.segments, beams, pose)
        slopes = gradients(ROOM, beams, pose)
        sigmas_m = noise.sigma_m(ranges_m)
        tells = (ranges_m > 0.5) & (ranges_m < 3.0)  # what the laser can measure
        assert 0.1 < tells.mean() < 0.95
        expected = np.zeros((3, 3))
        for slope, sigma_m in zip(slopes[tells], sigmas_m[tells], strict=True):
            expected += np.outer(slope, slope) / sigma_m**2
        information = fisher_information(beams, ROOM, model, pose)
        np.testing.assert_allclose(information, expected, rtol=1e-5, atol=1e-5 * expected.max())


def test_bound_in_the_middle_of_a_square_is_the_closed_form():
    # a wall at a, seen at phi: h = a / cos phi, dh/dx = -1 / cos phi, dh/dtheta = a tan phi / cos
    # phi. Two walls in x, integrals from -45 to 45 degrees of sec^2 = 2 and tan^2 sec^2 = 2/3:
    # I_xx = 2 N / (pi sigma^2), I_tt = 4 N a^2 / (3 pi sigma^2), none of x with y or theta
    count, half_m = 7200, 2.0
    step = 2.0 * math.pi / count
    bound = cramer_rao_bound(
        fan(-math.pi + step * (np.arange(count) + 0.5)),
        SegmentMap(box(half_m), is_one_sided=True),
        MODEL,
        SE2.identity(),
    )
    along = math.pi * SIGMA_M**2 / (2.0 * count)
    turn = 3.0 * math.pi * SIGMA_M**2 / (4.0 * count * half_m**2)
    # the middle rule over steps of 0.05 degrees: 1e-6
    np.testing.assert_allclose(np.diag(bound), [along, along, turn], rtol=1e-5)
    off = bound - np.diag(np.diag(bound))
    np.testing.assert_allclose(off, 0.0, atol=1e-6 * turn)


def test_bound_is_that_of_the_base_whichever_way_it_looks():
    # 720 beams to a turn, so that a quarter turn gives the same beams again
    beams = fan(np.arange(720) * (math.pi / 360.0) + 0.001)
    room = SegmentMap(box(2.0) * [2.0, 0.5])
    ahead = cramer_rao_bound(beams, room, MODEL, SE2.identity())
    aside = cramer_rao_bound(beams, room, MODEL, SE2(0.0, 0.0, math.pi / 2))
    assert aside[1, 1] == pytest.approx(ahead[0, 0], rel=1e-9)
    assert aside[0, 0] == pytest.approx(ahead[1, 1], rel=1e-9)
    # two walls of 8 m at 1 m are seen by most beams, two of 2 m at 4 m by few
    assert ahead[0, 0] > 2.0 * ahead[1, 1]


def test_two_perpendicular_walls_seen_head_on_tell_position_and_no_heading():
    corner = SegmentMap([[[3.0, -4.0], [3.0, 4.0]], [[4.0, 2.0], [-4.0, 2.0]]])
    beams = fan(np.array([0.0, math.pi / 2]))
    information = fisher_information(beams, corner, MODEL, SE2.identity())
    np.testing.assert_allclose(information, np.diag([1e4, 1e4, 0.0]), atol=1e-6)
    assert np.isinf(np.diag(cramer_rao_bound(beams, corner, MODEL, SE2.identity()))).all()


def test_bound_along_an_endless_corridor_is_infinite():
    corridor = SegmentMap([[[-30.0, 1.0], [30.0, 1.0]], [[-30.0, -1.0], [30.0, -1.0]]])
    beams = fan(ANGLES_RAD)
    information = fisher_information(beams, corridor, MODEL, SE2(0.0, 0.2, 0.0))
    assert abs(information[0]).max() < 1e-6 * information[1, 1]
    assert np.isinf(np.diag(cramer_rao_bound(beams, corridor, MODEL, SE2(0.0, 0.2, 0.3)))).all()


def test_bound_inside_a_circle_leaves_the_heading_open():
    segment_map = SegmentMap(round_wall(2.0, 720))
    # a facet's direction is off the circle's by 2 mrad on average: of 629 beams at 2 m, 10 mm wide,
    # that tells the heading to 10 mm / (2 m * 2 mrad * sqrt(629)) = 0.1 rad
    bound = cramer_rao_bound(
        fan(np.arange(-math.pi, 3.14, 0.01)), segment_map, MODEL, SE2.identity()
    )
    assert math.sqrt(bound[2, 2]) > 0.05


def test_wall_that_is_known_less_well_tells_less():
    beams = beams_at(ROOM_CENTRE)
    exact = fisher_information(beams, SegmentMap(ROOM_SEGMENTS), MODEL, ROOM_CENTRE)
    vague = fisher_information(
        beams, SegmentMap(ROOM_SEGMENTS, np.full(10, SIGMA_M)), MODEL, ROOM_CENTRE
    )
    # variance sigma^2 (1 + 1 / cos^2): at most a half of the information is left
    assert (np.diag(vague) < 0.5 * np.diag(exact)).all()
    assert (np.linalg.eigvalsh(vague) > 0.0).all()


def test_covariance_is_the_inverse_or_infinite():
    information = np.array([[4.0, 1.0, 0.5], [1.0, 3.0, 0.2], [0.5, 0.2, 1e8]])
    np.testing.assert_allclose(covariance_of(information) @ information, np.eye(3), atol=1e-9)
    for singular in (np.zeros((3, 3)), np.diag([1.0, 0.0, 1.0]), np.full((3, 3), np.nan)):
        assert np.isinf(np.diag(covariance_of(singular))).all()


# the estimator


def test_match_is_the_minimum_that_a_plain_search_finds():
    rng = np.random.default_rng(0)
    laser = LaserModel(RangeNoise(((1.0, SIGMA_M),)), 0.0, 20.0, 0.05, 0.0)
    density = laser.outliers[0] * math.sqrt(2.0 * math.pi) * SIGMA_M
    # as good as exact; edges are looked into in exact maps alone
    segment_map = SegmentMap(BARE, np.full(len(BARE), 1e-7))
    for true in (SE2(2.0, 2.0, 0.5), SE2(4.0, 1.5, -2.0), SE2(1.0, 1.2, 2.5)):
        beams = beams_at(true, rng, SIGMA_M, BARE)
        ranges_m = beams.ranges_m.copy()
        ranges_m[rng.choice(len(beams), 20, replace=False)] = rng.uniform(0.2, 3.0, 20)
        beams = Beams(beams.origins_m, beams.angles_rad, ranges_m)

        def cost(twist: np.ndarray, beams: Beams = beams, true: SE2 = true) -> float:
            h, _ = cast_all(segment_map.segments, beams, true @ SE2.exp(twist * 1e-3))
            bells = np.exp(-0.5 * ((beams.ranges_m - h) / SIGMA_M) ** 2)
            return -float(np.sum(np.log(bells + density)))

        corners = np.concatenate([np.zeros((1, 3)), np.eye(3)])  # a millimetre, a milliradian
        options = {"xatol": 1e-3, "fatol": 1e-6, "initial_simplex": corners}
        found = minimize(cost, np.zeros(3), method="Nelder-Mead", options=options)
        expected = true @ SE2.exp(found.x * 1e-3)
        match = match_beams(beams, segment_map, laser, true @ SE2(0.01, -0.01, 0.01))
        off = (expected.inverse() @ match.T_map_base).log()
        # a tenth of a standard deviation, in every direction
        assert off @ match.information @ off < 0.1**2
        assert match.is_settled


@pytest.mark.parametrize("seed", range(8))
def test_scan_without_noise_gives_the_pose_to_a_twentieth_of_a_millimetre(seed):
    rng = np.random.default_rng(seed)
    true = drawn_pose(rng)
    start = true @ SE2(*rng.uniform(-0.02, 0.02, 2), rng.uniform(-0.01, 0.01))
    for segments in (BARE, ROOM_SEGMENTS):
        match = match_beams(beams_at(true, segments=segments), SegmentMap(segments), MODEL, start)
        assert distance_m(match.T_map_base, true) < 0.05e-3
        assert abs((true.inverse() @ match.T_map_base).theta) < 0.05e-3
        assert match.is_settled
        assert match.inlier_ratio > 0.99


@pytest.fixture(scope="module")
def trials() -> list[tuple[SE2, Beams, BeamMatch]]:
    """Matches of 400 scans, all as assumed."""
    rng, drawn = np.random.default_rng(12), []
    for _ in range(400):
        true = drawn_pose(rng)
        beams = beams_at(true, rng)
        start = true @ SE2(*rng.normal(0.0, 0.01, 2), rng.normal(0.0, 0.005))
        drawn.append((true, beams, match_beams(beams, ROOM, MODEL, start)))
    return drawn


def test_covariance_tells_the_truth(trials):
    values = np.array([nees(match, true) for true, _, match in trials])
    # 95 % of such means lie within 0.24 of 3; edges are no Gaussians, so twice that and more
    assert 2.3 < values.mean() < 3.8
    # chi-square(3) exceeds 25 once in 65 000
    assert values.max() < 30.0


def test_smooth_beams_alone_err_anew_in_every_scan_from_one_pose():
    rng, means = np.random.default_rng(21), []
    for _ in range(8):
        true, offs, claimed = drawn_pose(rng), [], []
        for _ in range(25):
            smooth = match_beams(beams_at(true, rng), ROOM, MODEL, true).smooth
            assert smooth is not None
            offs.append((smooth.T_map_base.inverse() @ true).log())
            claimed.append(smooth.information)
        mean = np.mean(offs, axis=0)
        means.append(25.0 * mean @ np.mean(claimed, axis=0) @ mean)
    # 8 draws of chi-square(3): a mean of 3 to 0.9, three of these; in room_fig4 it is 35 with edges
    assert np.mean(means) < 5.7


def test_curved_information_is_the_second_derivative_of_the_log_likelihood():
    # a wall seen head on, its ranges straight in x: nothing but the weights bends the likelihood
    rng, density = np.random.default_rng(4), 0.5
    segment_map = SegmentMap([[[2.0, -1.0], [2.0, 1.0]]])
    angles_rad = np.radians(np.arange(-20.0, 20.5, 0.5))
    true_m = 2.0 / np.cos(angles_rad)
    measured_m = true_m + SIGMA_M * 1.5 * rng.standard_normal(len(true_m))
    beams = Beams(np.zeros((len(true_m), 2)), angles_rad, measured_m)
    off_m = [2e-5 * k for k in (-1, 0, 1)]
    likelihoods = []
    for x in off_m:
        z = (measured_m - (2.0 - x) / np.cos(angles_rad)) / SIGMA_M
        bells = np.exp(-0.5 * z**2) / (SIGMA_M * math.sqrt(2.0 * math.pi))
        likelihoods.append(np.log(bells + density).sum())
    assert np.abs(measured_m - true_m).max() < 4.0 * SIGMA_M
    expected = -(likelihoods[0] - 2.0 * likelihoods[1] + likelihoods[2]) / 2e-5**2
    information, curved, pull, sums = (
        np.zeros((3, 3)),
        np.zeros((3, 3)),
        np.zeros(3),
        np.zeros(SUM_COUNT),
    )
    ranges_m, hit_walls = segment_map.ranges(beams, SE2.identity(), 10.0)
    look_smooth(
        segment_map.normals, beams.origins_m, beams.directions, measured_m,
        np.array([[1.0, SIGMA_M]]), np.array([0.0, 10.0]), np.array([density, 0.0]), np.zeros(2),
        0.0, ranges_m, hit_walls, np.ones(len(beams), dtype=np.bool_), information, curved, pull,
        sums,
    )  # fmt: skip
    slope = (likelihoods[2] - likelihoods[0]) / 4e-5
    assert pull[0] == pytest.approx(slope, rel=1e-4)
    assert curved[0, 0] == pytest.approx(expected, rel=1e-4)
    assert sums[OFFSET_INFORMATION] <= information[0, 0]
    assert information[0, 0] > 1.02 * expected


def test_side_walls_of_a_corridor_tell_nothing_along_it():
    # the far wall at the end of the laser's reach: along the corridor the pose is so wide that a
    # beam on a side wall changes by more than its noise, straight as the wall is
    corridor = np.array([[0.0, 0.0], [30.0, 0.0], [30.0, 2.0], [0.0, 2.0]])
    segments = np.stack([corridor, np.roll(corridor, -1, axis=0)], axis=1)
    laser = LaserModel(RangeNoise(((1.0, 0.01), (5.6, 0.056))), 0.02, 5.6)
    for seed, before_end_m in enumerate((4.6, 5.0, 5.2)):
        true = SE2(30.0 - before_end_m, 1.1, 0.05)
        scan = scan_of(segments, true @ LASER, np.random.default_rng(seed), 0.01, range_max_m=5.6)
        beams = Beams.of(scan, LASER)
        match = match_beams(beams, SegmentMap(segments), laser, true)
        bound = cramer_rao_bound(beams, SegmentMap(segments), laser, true)
        # without edges nothing beats the bound: seen from the estimate, it is the same to a tenth
        assert match.covariance[0, 0] > 0.9 * bound[0, 0]


def test_error_reaches_the_cramer_rao_bound(trials):
    ratios = []
    for true, beams, match in trials:
        bound = cramer_rao_bound(beams, ROOM, MODEL, true)
        off = (true.inverse() @ match.T_map_base).log()
        ratios.append(off @ np.linalg.solve(bound, off) / 3.0)
    # edges of an exact map tell more than the slopes do, so below is possible; 400 trials tell a
    # mean square to 4 %
    assert 0.5 < np.mean(ratios) < 1.2


def test_residuals_of_a_scan_as_assumed_scatter_as_assumed(trials):
    # 481 beams tell a median magnitude to 5 %, and it is believed to the noise's own width
    scales = np.array([match.scale for _, _, match in trials])
    assert abs(scales.mean() - 1.0) < 0.02
    assert (scales < 1.3).all()


def test_offset_of_none_is_seldom_seen(trials):
    pulls = np.array([match.offset_m / match.offset_sigma_m for _, _, match in trials])
    # standard normal: 400 draws tell its deviation to 4 %; edges are left out of it
    assert 0.8 < pulls.std() < 1.25
    assert abs(pulls.mean()) < 0.25
    assert (np.abs(pulls) < 4.5).all()


def occluded(beams: Beams, pose: SE2, rng: np.random.Generator) -> tuple[Beams, int]:
    """The same beams in front of which two legs stand, with mixed pixels at their edges."""
    middle = pose @ SE2(rng.uniform(0.4, 0.8), rng.uniform(-0.3, 0.3), 0.0)
    at = np.array([middle.x, middle.y])
    legs = [round_wall(0.06, 40) + at + np.array([0.0, off]) for off in (-0.12, 0.12)]
    before, _ = cast_all(np.concatenate([*legs, *(leg[:, ::-1] for leg in legs)]), beams, pose)
    is_leg = before < beams.ranges_m
    ranges_m = np.where(is_leg, before + rng.normal(0.0, SIGMA_M, len(beams)), beams.ranges_m)
    edges = np.flatnonzero(np.abs(np.diff(ranges_m)) > 0.1)
    mixed = edges[rng.random(len(edges)) < 0.5]
    share = rng.random(len(mixed))
    mixed_m = ranges_m[mixed] + share * (ranges_m[mixed + 1] - ranges_m[mixed])
    ranges_m[mixed] = mixed_m
    return Beams(beams.origins_m, beams.angles_rad, ranges_m), int(is_leg.sum())


def test_legs_and_mixed_pixels_do_not_pull_the_pose():
    rng = np.random.default_rng(5)
    values, hidden, ratios = [], [], []
    for _ in range(150):
        true = drawn_pose(rng)
        free = beams_at(true, rng)
        beams, count = occluded(free, true, rng)
        match = match_beams(beams, ROOM, MODEL, true @ SE2(0.01, -0.01, 0.005))
        ranges_m, _ = ROOM.ranges(beams, true)
        is_free = np.abs(beams.ranges_m - ranges_m) < 5.0 * SIGMA_M
        off = (true.inverse() @ match.T_map_base).log()
        bound = cramer_rao_bound(beams, ROOM, MODEL, true, is_free)
        ratios.append(off @ np.linalg.solve(bound, off) / 3.0)
        values.append(nees(match, true))
        hidden.append(count)
    assert np.mean(hidden) > 40  # of 481: without them this test would show nothing
    # 150 trials tell a mean square of 3 to 7 %, and the claim knows nothing of what was hidden
    assert np.mean(ratios) < 1.4
    assert np.mean(values) < 4.0


def test_offset_common_to_all_ranges_is_recognised_and_undone():
    rng = np.random.default_rng(6)
    found, values = [], []
    for _ in range(60):
        true = drawn_pose(rng)
        match = match_beams(beams_at(true, rng, bias_m=0.005), ROOM, MODEL, true)
        found.append(match.offset_m)
        assert abs(match.offset_m - 0.005) < 5.0 * match.offset_sigma_m
        values.append(nees(match, true))
    # one scan tells it to 0.5 mm, 60 to 0.1 mm
    assert abs(np.mean(found) - 0.005) < 0.0005
    assert np.mean(values) < 5.0


def test_noise_twice_as_wide_is_seen_and_the_covariance_grows_fourfold():
    rng = np.random.default_rng(8)
    scales, growths, values = [], [], []
    for _ in range(60):
        true = drawn_pose(rng)
        wide = match_beams(beams_at(true, rng, 2.0 * SIGMA_M), ROOM, MODEL, true)
        plain = match_beams(beams_at(true, rng), ROOM, MODEL, true)
        scales.append(wide.scale)
        growths.append(np.linalg.det(wide.covariance) / np.linalg.det(plain.covariance))
        values.append(nees(wide, true))
    assert abs(np.mean(scales) - 2.0) < 0.1
    # determinants grow by 4^3; edges tell less sharply and may add to it
    assert 3.0 < np.exp(np.mean(np.log(growths)) / 3.0) < 5.5
    assert np.mean(values) < 5.0


def test_scan_of_nothing_leaves_the_start_and_claims_nothing():
    angles = ANGLES_RAD
    for ranges_m in (np.full(len(angles), np.inf), np.full(len(angles), np.nan)):
        beams = Beams(np.zeros((len(angles), 2)), angles, ranges_m)
        match = match_beams(beams, ROOM, MODEL, ROOM_CENTRE)
        assert match.used == 0
        assert match.inlier_ratio == 0.0
        assert distance_m(match.T_map_base, ROOM_CENTRE) < 1e-12
        assert np.isinf(np.diag(match.covariance)).all()


CORRIDOR = np.array([[[-15.0, 1.0], [15.0, 1.0]], [[-15.0, -1.0], [15.0, -1.0]]])
WALL = np.array([[[2.0, -9.0], [2.0, 9.0]]])


@pytest.mark.parametrize("sigma_m", [0.0, SIGMA_M])
@pytest.mark.parametrize("segments", [CORRIDOR, WALL])
def test_open_direction_has_no_information_and_is_left_alone(segments, sigma_m):
    true, rng = SE2(0.3, 0.2, 0.0), np.random.default_rng(1)
    scan = scan_of(segments, true, rng, sigma_m, range_max_m=5.6)
    match = match_beams(Beams.of(scan, SE2.identity()), SegmentMap(segments), MODEL, true)
    np.testing.assert_allclose(match.information, match.information.T, rtol=1e-6, atol=1e-3)
    values = np.linalg.eigvalsh(match.information)
    assert abs(values[0]) < 1e-3 * values[1]
    # ten sigmas of what 481 beams tell in the others
    assert distance_m(match.T_map_base, true) < 0.01
    assert abs(match.T_map_base.theta) < 0.01


@pytest.mark.parametrize(
    ("wrong", "said"),
    [
        ({"blurs_m": ()}, "blurs_m"),
        ({"blurs_m": (0.0,)}, "blurs_m"),
        ({"max_steps": 0}, "1 step"),
        ({"edge_nodes": 2}, "3 nodes"),
        ({"edge_sweeps": 0}, "1 sweep"),
    ],
)
def test_search_that_cannot_be_is_refused(wrong, said):
    with pytest.raises(ValueError, match=said):
        BeamConfig(**wrong)


@pytest.mark.parametrize(
    ("wrong", "said"),
    [
        ({"range_min_m": 5.0, "range_max_m": 5.0}, "range_min_m"),
        ({"range_max_m": math.inf}, "finite"),
        ({"outlier_ratio": 0.0}, "outlier_ratio"),
        ({"mixed_ratio": 1.0}, "mixed_ratio"),
    ],
)
def test_laser_that_cannot_be_is_refused(wrong, said):
    with pytest.raises(ValueError, match=said):
        LaserModel(RangeNoise(((1.0, 0.01),)), **wrong)


def test_widened_information_keeps_what_the_smooth_beams_tell():
    smooth, told = np.diag([1e6, 2e6, 4e6]), np.diag([3e6, 8e6, 5e7])
    information = told.copy()
    _widen(told, np.diag([1.0, 1.0, 1.0]), smooth, information)
    np.testing.assert_allclose(information, smooth, rtol=1e-9)
    # what samples confirm stays, along one way as along another
    information = told.copy()
    _widen(told, np.linalg.inv(told) * np.diag([1.0, 1.0, 2.5]), smooth, information)
    np.testing.assert_allclose(information, np.diag([3e6, 8e6, 2e7]), rtol=1e-9)

"""Matches that now and then err more than they say, and wheels that slip."""

import numpy as np
import pytest

from slam import LaserScan, Localizer, Measurement
from slam.fusion import PoseFilter
from slam.heavy_tails import EDGES, SLIPS_M, SMOOTH, WHOLE, SlipOdds, Tails, corrected
from slam.scan_match import MatchStatus, PoseInformation, ScanMatch
from slam.se2 import SE2

STEP, STEP_S = SE2.exp([0.02, 0.0, 0.05]), 0.1
STEP_COVARIANCE = np.diag([2e-5, 2e-5, 2e-5]) ** 2
SIGMAS = np.array([1e-3, 1e-3, 5e-4])
"""Of what beams tell that pass no edge; those that do tell three times as much."""
SURE = np.diag(SIGMAS**-2.0)


def of_matches(true: SE2, off: np.ndarray, edges_off: np.ndarray) -> ScanMatch:
    """A match whose smooth part and whose edges err by so many standard deviations of the former."""
    smooth = PoseInformation(true @ SE2.exp(-off * SIGMAS), SURE)
    both = (off + 9.0 * edges_off) / 10.0
    whole = true @ SE2.exp(-both * SIGMAS)
    return ScanMatch(whole, MatchStatus.MATCHED, information=10.0 * SURE, smooth=smooth)


def followed(rng: np.random.Generator, scans: int) -> tuple[PoseFilter, SE2]:
    """A filter that has followed a robot for a while, all as assumed, and where the robot is."""
    true = SE2.identity()
    pose_filter = PoseFilter(true, np.eye(3) * 1e-2)
    for _ in range(scans):
        true = true @ STEP
        pose_filter.predict(STEP, STEP_S, STEP_COVARIANCE)
        off, edges = rng.normal(size=3), rng.normal(size=3) / 3.0
        pose_filter.take(of_matches(true, off, edges))
    return pose_filter, true


def nees_of(pose_filter: PoseFilter, true: SE2) -> float:
    error = (pose_filter.T_map_base.inverse() @ true).log()
    return float(error @ np.linalg.solve(pose_filter.covariance, error))


def test_one_explanation_is_the_kalman_filter_s():
    rng = np.random.default_rng(0)
    spread = 0.01 * rng.normal(size=(9, 9))
    P, innovation = spread @ spread.T, 0.01 * rng.normal(size=3)
    information = np.diag([2e4, 1e4, 3e4])
    mean, covariance, slips = corrected(
        P, information @ innovation, information, Tails((1.0,), (1.0,))
    )
    gain = P[:, :3] @ np.linalg.inv(P[:3, :3] + np.linalg.inv(information))
    np.testing.assert_allclose(mean, gain @ innovation, rtol=1e-4)
    np.testing.assert_allclose(covariance, P - gain @ P[:3, :], rtol=1e-4, atol=1e-10)
    assert len(slips) == 0


@pytest.mark.parametrize("off", [0.5, 4.0, 9.0])
def test_mean_and_covariance_are_those_of_all_explanations(off):
    # along x alone: density of prediction and match multiplied on a grid
    P, R = 0.02**2, 0.03**2
    odds, innovation = SlipOdds(0.01).odds * 300.0, off * 0.03
    x = np.linspace(-1.5, 1.5, 300_001)

    def mixed(centre: float, variances: np.ndarray, shares: np.ndarray) -> np.ndarray:
        told = [
            share * np.exp(-0.5 * (x - centre) ** 2 / variance) / np.sqrt(variance)
            for variance, share in zip(variances, shares, strict=True)
        ]
        return np.sum(told, axis=0)

    before = mixed(0.0, P + np.square([0.0, *SLIPS_M]), np.array([1.0 - odds.sum(), *odds]))
    density = before * mixed(innovation, R * np.array(WHOLE.factors), np.array(WHOLE.odds))
    density /= density.sum()
    expected = density @ x
    # nothing is known of the rest, before or after: as wide as a filter of first order goes
    information = np.diag([1.0 / R, 0.0, 0.0])
    covariance = np.diag([P, 1e4, 10.0])
    pull = information @ [innovation, 0.0, 0.0]
    mean, found, _ = corrected(covariance, pull, information, WHOLE, odds)
    assert mean[0] == pytest.approx(expected, rel=1e-3)
    assert found[0, 0] == pytest.approx(density @ (x - expected) ** 2, rel=1e-3)


def test_edges_that_lead_astray_leave_the_pose_where_it_was():
    pose_filter, true = followed(np.random.default_rng(1), 100)
    before = pose_filter.covariance
    true = true @ STEP
    pose_filter.predict(STEP, STEP_S, STEP_COVARIANCE)
    match = of_matches(true, np.zeros(3), np.array([4.0, -3.0, 2.0]))
    # a dozen standard deviations of the edges; a filter that takes wheels for what has slipped goes
    # 2 mm along with them
    assert pose_filter.innovation(match.T_map_base, match.information) > 100.0
    pose_filter.take(match)
    error = (pose_filter.T_map_base.inverse() @ true).log()
    assert np.hypot(*error[:2]) < 0.0003
    assert nees_of(pose_filter, true) < 11.3
    assert np.trace(pose_filter.covariance[:2, :2]) < 1.5 * np.trace(before[:2, :2])


@pytest.mark.parametrize(("slip_m", "scans"), [(0.008, 8), (0.03, 3)])
def test_wheels_that_slipped_are_found_out_by_scans_that_agree(slip_m, scans):
    rng = np.random.default_rng(2)
    pose_filter, true = followed(rng, 100)
    true = true @ SE2(-slip_m, 0.0, 0.0)
    for _ in range(scans):
        true = true @ STEP
        pose_filter.predict(STEP, STEP_S, STEP_COVARIANCE)
        pose_filter.take(of_matches(true, rng.normal(size=3), rng.normal(size=3) / 3.0))
    error = (pose_filter.T_map_base.inverse() @ true).log()
    assert np.hypot(*error[:2]) < 0.0015


def test_longer_way_makes_a_slip_likelier():
    slips, told = SlipOdds(0.01), []
    for way_m in (0.0, 0.02, 0.98):
        slips.move(np.array([way_m, 0.0, 0.0]))
        told.append(slips.odds.sum())
    np.testing.assert_allclose(told, [3e-5, 23e-5, 1003e-5])
    slips.take(np.zeros(len(SLIPS_M)))
    assert slips.odds.sum() == pytest.approx(3e-5)


@pytest.mark.parametrize("is_open", [False, True])
def test_wheels_worse_than_thought_leave_the_matches_their_say(is_open):
    # a scan each half metre, as in old logs; the wheels three times as wrong as assumed
    rng, errors, own = np.random.default_rng(4), [], []
    noise, sigmas = np.diag([4e-4, 4e-4, 1e-4]), np.array([0.01, 0.01, 0.003])
    true = SE2.identity()

    def matcher(beams, T_start):
        own.append(sigmas * rng.normal(size=3))
        found = true @ SE2.exp(own[-1])
        known = sigmas**-2.0 * [not is_open, 1.0, 1.0]  # along a corridor nothing
        status = MatchStatus.DEGENERATE if is_open else MatchStatus.MATCHED
        return ScanMatch(found, status, information=np.diag(known))

    localizer = Localizer(matcher, true, SE2.identity())
    step = SE2(0.5, 0.0, 0.0)
    for k in range(200):
        true = true @ step @ SE2.exp(3.0 * np.sqrt(np.diag(noise)) * rng.normal(size=3))
        scan = LaserScan(float(k), np.linspace(-1.0, 1.0, 5), rng.uniform(1.0, 2.0, 5))
        estimate = localizer.update(Measurement(float(k), step, scan, noise))
        errors.append((estimate.T_map_base.inverse() @ true).log())
    rms, of_matches_alone = (np.sqrt(np.mean(np.square(x), axis=0)) for x in (errors, own))
    held = slice(1, 3) if is_open else slice(0, 3)
    assert (rms < 1.5 * of_matches_alone)[held].all()
    # neither are they less believed for it, nor is the robot surer than they are
    told = np.sqrt(np.diag(estimate.covariance))[1:]
    assert (told > sigmas[1:]).all()
    assert (told < 1.25 * sigmas[1:]).all()


@pytest.mark.slow
def test_robot_whose_edges_err_as_fitted_knows_how_sure_it_is():
    rng, nees = np.random.default_rng(3), []
    for _ in range(8):
        true = SE2.identity()
        pose_filter = PoseFilter(true, np.eye(3) * 1e-2)
        for i in range(150):
            true = true @ STEP
            pose_filter.predict(STEP, STEP_S, STEP_COVARIANCE)
            smooth, edges = (
                np.sqrt(rng.choice(tails.factors, p=tails.odds)) * rng.normal(size=3)
                for tails in (SMOOTH, EDGES)
            )
            pose_filter.take(of_matches(true, smooth, edges / 3.0))
            if i >= 20:
                nees.append(nees_of(pose_filter, true))
    # 3, 2.37 and a thousandth; the wheels, which did not err, were assumed to
    assert 1.6 < np.mean(nees) < 3.6
    assert 1.3 < np.median(nees) < 2.9
    assert np.mean(np.array(nees) > 16.27) < 0.005


def test_prediction_that_knows_next_to_nothing_takes_a_match_by_its_word():
    pose_filter = PoseFilter(SE2.identity(), np.eye(3) * 1e-2)
    match = of_matches(SE2(0.05, 0.02, 0.03), np.ones(3), -np.ones(3) / 3.0)
    pose_filter.take(match)
    np.testing.assert_allclose(
        pose_filter.covariance, np.linalg.inv(match.information), rtol=2e-4, atol=1e-12
    )
    assert (pose_filter.T_map_base.inverse() @ match.T_map_base).is_near(SE2.identity(), 1e-5, 1e-5)

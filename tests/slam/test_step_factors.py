"""Steps between keyframes as what wheels told and what scans add: together they say what the step says."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.optimize import least_squares

from slam.beams import Beams
from slam.frontend.keyframes import Keyframe
from slam.frontend.told_steps import ToldStep
from slam.pose_graph import PoseGraph
from slam.se2 import SE2
from slam.slam_map import add_steps
from slam.step_factors import step_factors

SPREAD = np.diag(np.square([0.003, 0.003, 0.001]))
STEP = SE2(0.5, 0.02, 0.1)
WHEELS = np.diag(np.square([0.03, 0.01, 0.02]))


def keyframe(told: ToldStep, T_before: SE2 = STEP, covariance: np.ndarray = WHEELS) -> Keyframe:
    nothing = Beams(np.empty((0, 2)), np.empty(0), np.empty(0))
    return Keyframe(
        0.0, SE2.identity(), T_before, covariance, np.empty((0, 2)), nothing, False, told=told
    )


def fused(told: ToldStep, seen: SE2, information: np.ndarray) -> Keyframe:
    """The step that a Kalman filter makes of the wheels' way and of what a scan saw."""
    by_wheels = np.linalg.inv(told.covariance)
    covariance = np.linalg.inv(by_wheels + information)
    off = (told.motion.inverse() @ seen).log()
    return keyframe(told, told.motion @ SE2.exp(covariance @ information @ off), covariance)


def solved(*keyframes: Keyframe) -> tuple[np.ndarray, np.ndarray]:
    """Poses and covariances of the ways of a chain."""
    graph = PoseGraph()
    for _ in range(len(keyframes) + 1):
        graph.add_node(SE2.identity())
    add_steps(graph, 1, keyframes, tuple(np.sqrt(np.diag(SPREAD))))
    solution = graph.solve()
    ways = np.array([(k, k + 1) for k in range(len(keyframes))])
    return solution.poses, solution.relative_covariances(ways)


def test_both_factors_together_are_the_step_and_each_says_what_it_told():
    # a corridor: the scan says nothing of how far along it the robot went
    told, seen = ToldStep(SE2(0.52, 0.0, 0.0), WHEELS), SE2(0.4, 0.01, 0.01)
    information = np.diag([0.0, 1e6, 1e6])
    step = fused(told, seen, information)
    ((by_wheels, by_scans),) = step_factors([step], 0.0 * SPREAD)
    assert by_wheels[0] == told.motion
    assert np.allclose(by_wheels[1], np.linalg.inv(WHEELS), rtol=1e-2, atol=1.0)
    assert by_scans[1][0, 0] < 0.01 * by_wheels[1][0, 0]
    assert np.allclose(np.diag(by_scans[1])[1:], 1e6, rtol=0.02)
    off = (by_scans[0].inverse() @ seen).log()
    assert np.abs(off[1:]).max() < 1e-3
    poses, covariances = solved(step)
    assert np.allclose(poses[1], step.T_before.as_array(), atol=1e-7)
    assert np.allclose(covariances[0], step.covariance + SPREAD, rtol=1e-5, atol=1e-10)


def test_wheels_count_for_no_more_than_the_step_is_sure():
    # loops shall say where it led: scan and wheels are half a metre apart
    apart = SE2(0.5, 0.0, 0.0)
    off = apart.log()
    loose = keyframe(ToldStep(STEP @ apart, WHEELS), covariance=WHEELS + np.outer(off, off))
    poses, covariances = solved(loose)
    assert np.allclose(poses[1], STEP.as_array(), atol=1e-7)
    assert np.allclose(covariances[0], loose.covariance + SPREAD, rtol=1e-5, atol=1e-9)


def test_wheels_that_a_sure_step_denies_draw_it_nowhere():
    denied = keyframe(ToldStep(STEP @ SE2(1.0, 0.3, 0.4), WHEELS), covariance=0.01 * WHEELS)
    poses, covariances = solved(denied)
    assert np.hypot(*(poses[1] - STEP.as_array())[:2]) < 1e-7
    assert np.allclose(covariances[0], denied.covariance + SPREAD, rtol=1e-5, atol=1e-10)


def g2o_optimum(factors: tuple[tuple[SE2, np.ndarray], ...], start: SE2) -> SE2:
    """Where a solver leads that has errors as (x, y, theta), not as a logarithm."""
    roots = [np.linalg.cholesky(information).T for _, information in factors]

    def errors(pose: np.ndarray) -> np.ndarray:
        T = SE2.from_array(pose)
        of = [way.between(T).as_array() for way, _ in factors]
        return np.concatenate([root @ one for root, one in zip(roots, of, strict=True)])

    return SE2.from_array(least_squares(errors, start.as_array(), xtol=1e-12, ftol=1e-12).x)


@pytest.mark.parametrize("seed", range(40))
def test_solvers_that_tell_errors_otherwise_lead_to_the_same_place(seed):
    """aces, keyframe 168: scans were 0.8 m and 0.6 rad from where both led, and g2o's optimum 0.09 m off."""
    rng = np.random.default_rng(seed)
    off = rng.normal(0.0, [0.1, 0.1, 0.05]) * rng.choice([0.1, 1.0, 3.0])
    loose = rng.normal(0.0, [0.2, 0.2, 0.15]) * rng.choice([0.0, 0.3, 1.0])
    sure = np.diag(np.square([0.005, 0.005, 0.002]))
    step = keyframe(ToldStep(STEP @ SE2.exp(off), WHEELS), covariance=sure + np.outer(loose, loose))
    (factors,) = step_factors([step], SPREAD)
    off = (STEP.inverse() @ g2o_optimum(factors, STEP)).log()
    squared = off @ np.linalg.inv(step.covariance + SPREAD) @ off
    assert squared < 0.3**2
    assert np.hypot(off[0], off[1]) < 0.01
    # and neither says that the other is wrong for sure, for which robust ones would leave it out
    chi_squares = [
        (way.inverse() @ STEP).log() @ information @ (way.inverse() @ STEP).log()
        for way, information in factors
    ]
    assert sum(chi_squares) < 12.5


def test_covariance_too_uneven_to_be_divided_makes_one_factor():
    lever = np.array([4e3, 0.0, 1.0])
    uneven = keyframe(ToldStep(STEP, WHEELS), covariance=WHEELS + np.outer(lever, lever))
    ((factor,),) = step_factors([uneven], 1e-6 * SPREAD)
    assert factor[0] == STEP
    # nor are two that are metres and a radian apart, along what the step leaves open
    off = np.array([2.0, 1.0, 1.0])
    bent = keyframe(ToldStep(STEP @ SE2.exp(off), WHEELS), covariance=WHEELS + np.outer(off, off))
    assert len(next(step_factors([bent], SPREAD))) == 1


def test_step_by_wheels_alone_or_by_scans_alone_is_one_factor():
    by_wheels, by_scans = keyframe(ToldStep(STEP, WHEELS)), keyframe(ToldStep.unknown())
    factors = list(step_factors([by_wheels, by_scans], SPREAD))
    assert [len(one) for one in factors] == [1, 1]
    for ((way, information),) in factors:
        assert way == STEP
        assert np.allclose(information, np.linalg.inv(WHEELS + SPREAD), rtol=1e-9)
    # over a break the wheels' way is taken for less sure than they said
    broken = replace(by_wheels, covariance=WHEELS + 0.25 * np.eye(3), is_break=True)
    (((way, information),),) = step_factors([broken], SPREAD)
    assert np.allclose(information, np.linalg.inv(broken.covariance + SPREAD), rtol=1e-9)


@pytest.mark.parametrize("seed", range(5))
def test_chain_of_steps_ends_where_they_lead(seed):
    rng = np.random.default_rng(seed)
    steps = []
    for _ in range(30):
        told = ToldStep(SE2.exp(rng.normal([0.4, 0.0, 0.0], [0.2, 0.02, 0.3])), WHEELS)
        seen = told.motion @ SE2.exp(rng.multivariate_normal(np.zeros(3), WHEELS))
        root = rng.normal(size=(3, 3)) * rng.choice([1.0, 30.0, 1000.0], 3)[:, None]
        steps.append(fused(told, seen, root.T @ root))
    poses, _ = solved(*steps)
    T = SE2.identity()
    for step in steps:
        T = T @ step.T_before
    assert np.abs((T.inverse() @ SE2.from_array(poses[-1])).log()).max() < 1e-6

"""Experiment 1, and the starts at which ICP once stayed centimetres off."""

import numpy as np
import pytest

from experiments.localization import make_localizers, run_trial, start_poses, update_all
from experiments.methods import KnownPlace
from experiments.sources import MeasurementSource
from experiments.trials import Outcome, TrialConfig, generator
from kitasap_sim import Simulation
from slam import SE2, Beams, CoarseToFineConfig, Estimate, MatchStatus, Open3dMatcher, ScanMatch
from slam.verdict import Status

PLAIN = CoarseToFineConfig(coarse_spacing_m=1e-6, start_headings_rad=(0.0,))
"""All beams alike, one start: what the three starts below were found with."""

# A wall near by has so many beams on it that their pairs hold the scan along that wall; along the
# round wall the scan slides into a local minimum. Place, true pose, belief minus true pose.
HARD_STARTS = [
    ("room_fig4", (5.304, 4.458, -0.411), (0.065, 0.085, -0.003)),
    ("room_fig4", (5.522, 4.109, 0.552), (0.091, -0.024, 0.020)),
    ("round_room", (3.62, 1.87, 2.31), (-0.076, 0.087, 0.075)),
]


def matched(
    known: KnownPlace, pose: tuple, offset: tuple, config: CoarseToFineConfig
) -> tuple[ScanMatch, float]:
    """What `open3d` finds at a pose, and how far off [m]. The scan is the same at each call."""
    simulation = Simulation(known.place, known.laser, "as_built", rng=np.random.default_rng(0))
    simulation.reset(np.array(pose))
    source = MeasurementSource(known.laser, simulation.wheel_ticks())
    scan = source.measurement(simulation.next_frame()).scan
    believed = SE2.from_array(np.array(pose) + np.array(offset))
    matcher = Open3dMatcher(known.point_map, config, known.laser_model.noise)
    match = matcher(Beams.of(scan, known.T_base_laser), believed)
    error = match.T_map_base.as_array() - simulation.truth().pose
    return match, float(np.hypot(*error[:2]))


@pytest.mark.slow
@pytest.mark.parametrize(("place", "pose", "offset"), HARD_STARTS)
def test_open3d_finds_back_from_the_hard_starts(place, pose, offset):
    known = TrialConfig(place=place).known_place
    match, error_m = matched(known, pose, offset, CoarseToFineConfig())
    # over six other scans at each the largest was 4 mm
    assert error_m < 0.01
    assert match.status is MatchStatus.MATCHED


@pytest.mark.slow
@pytest.mark.parametrize(("place", "pose", "offset"), HARD_STARTS)
def test_hard_starts_are_hard(place, pose, offset):
    # 7 to 8 cm off, and sure of it: without this the test above would prove nothing
    match, error_m = matched(TrialConfig(place=place).known_place, pose, offset, PLAIN)
    assert error_m > 0.05
    assert match.status is MatchStatus.MATCHED


def test_round_walls_at_one_side_leave_no_direction_open():
    # the curvature's form, sampled to one side of each diagonal only, once bent below zero here
    config = TrialConfig(poses="random", place="round_room", methods=("open3d",))
    outcome = run_trial(config, generator("localization", 0, 40)).outcomes["open3d"]
    assert outcome.match.status is MatchStatus.MATCHED
    assert outcome.is_success


@pytest.mark.slow
def test_round_room_has_no_lines_and_open3d_needs_none():
    config = TrialConfig(poses="random", place="round_room", methods=("line", "open3d"))
    for index in range(3):
        outcomes = run_trial(config, generator("localization", 0, index)).outcomes
        assert outcomes["line"].match.status is MatchStatus.LOST
        assert not outcomes["line"].is_success
        # what the issue asks of single trials: 3 cm and 0.01 rad
        assert np.hypot(*outcomes["open3d"].error[:2]) < 0.03
        assert abs(outcomes["open3d"].error[2]) < 0.01
        assert outcomes["open3d"].is_success


@pytest.mark.slow
def test_open3d_is_within_millimetres_in_the_laboratory():
    config = TrialConfig(poses="random", methods=("odometry", "open3d"))
    for index in range(3):
        outcomes = run_trial(config, generator("localization", 0, index)).outcomes
        # the root mean square over 100 trials is to be 3 mm; 10 mm is more than three of those
        assert np.hypot(*outcomes["open3d"].error[:2]) < 0.01
        assert abs(outcomes["open3d"].error[2]) < 0.01


def test_belief_is_off_by_as_much_as_asked_and_odometry_keeps_it(quick_config):
    errors, place = [], quick_config.known_place.place
    for index in range(20):
        # the belief is drawn before the simulation takes anything
        pose_rng, _ = generator("localization", 0, index).spawn(2)
        pose, believed = start_poses(quick_config, place, pose_rng)
        errors.append(believed - pose)
        if index < 3:
            result = run_trial(quick_config, generator("localization", 0, index))
            np.testing.assert_allclose(result.outcomes["odometry"].error, errors[-1], atol=1e-4)
    largest = np.abs(errors).max(axis=0)
    limits = [0.10, 0.10, np.radians(5)]
    assert (largest <= limits).all()
    # of 20 uniform draws the largest is below half the limit once in a million
    assert (largest > np.array(limits) / 2).all()


def test_paper_poses_repeat_the_start_within_the_operators_inaccuracy():
    config = TrialConfig(poses="paper", methods=("odometry",))
    start = config.known_place.place.start
    results = [run_trial(config, generator("localization", 0, index)) for index in range(4)]
    offsets = np.array([result.true_poses[0] - start for result in results])
    # five standard deviations of 1 cm and 0.02 rad; no two alike
    assert (np.abs(offsets) < [0.05, 0.05, 0.1]).all()
    assert len({tuple(offset) for offset in offsets}) == 4
    for result in results:
        believed = result.outcomes["odometry"].T_map_base.as_array()
        np.testing.assert_allclose(believed, start, atol=1e-9)


@pytest.mark.parametrize(
    ("status", "offset_m", "is_success"),
    [
        (MatchStatus.MATCHED, 0.049, True),
        (MatchStatus.MATCHED, 0.051, False),  # success is within 5 cm
        (MatchStatus.LOST, 0.0, False),
        (MatchStatus.NOT_CONVERGED, 0.0, False),
        (MatchStatus.DEGENERATE, 0.0, False),
        (MatchStatus.NOT_ATTEMPTED, 0.0, True),  # dead reckoning says nothing of itself
    ],
)
def test_pose_that_the_method_disowns_is_no_success(status, offset_m, is_success):
    pose = SE2(1.0 + offset_m, 2.0, 3.0)
    estimate = Estimate(0.0, pose, pose, ScanMatch(pose, status))
    outcome = Outcome.of(estimate, np.array([1.0, 2.0, 3.0]), TrialConfig(), is_guarded=False)
    assert outcome.is_success is is_success


@pytest.mark.parametrize("method", ["open3d", "fast", "limit"])
def test_frozen_laser_is_no_success_of_a_guarded_method_however_near_it_stands(method, box_room):
    config = TrialConfig(place=box_room, methods=(method,))
    simulation = config.simulation(np.random.default_rng(0))
    source = MeasurementSource(config.known_place.laser, simulation.wheel_ticks())
    measurement, true = source.measurement(simulation.next_frame()), simulation.truth().pose
    localizers = make_localizers(config, true, may_be_lost=True)
    at_first, frozen = (
        update_all(config, localizers, measurement, true)[0][method] for _ in range(2)
    )
    assert at_first.is_success
    # near, since the robot does not move; but it says that it does not know
    assert frozen.is_near
    assert frozen.match.status is MatchStatus.NOT_ATTEMPTED
    assert frozen.verdict.status is Status.UNSURE
    assert not frozen.is_success


def test_methods_do_not_change_the_measurements_of_each_other(quick_config):
    alone = TrialConfig(**{**vars(quick_config), "methods": ("line",)})
    first = run_trial(quick_config, generator("localization", 0, 0))
    second = run_trial(alone, generator("localization", 0, 0))
    assert first.scans[0].ranges_m.tobytes() == second.scans[0].ranges_m.tobytes()
    assert first.outcomes["line"].record() == second.outcomes["line"].record()


# light that an edge split, at these places, for that of the wall it did not come from
MISLED = [(3103, 364), (3103, 531), (3003, 680), (3003, 343)]


@pytest.mark.parametrize(("seed", "index"), MISLED)
def test_beam_that_is_wrong_about_an_edge_leaves_the_covariance_honest(seed, index):
    config = TrialConfig(poses="random", methods=("limit",))
    outcome = run_trial(config, generator("localization", seed, index)).outcomes["limit"]
    # 106, 82, 60 and 48 where one beam may outweigh all others
    assert outcome.nees < 38.0
    assert outcome.match.is_matched

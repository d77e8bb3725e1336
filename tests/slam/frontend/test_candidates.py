"""Which poses of a scan are believed rather than where the wheels lead."""

import numpy as np
import pytest

from slam.frontend.candidates import Candidates
from slam.frontend.front_end_config import FrontEndConfig
from slam.frontend.prediction import Prediction
from slam.frontend.seen_before import LastSeen
from slam.se2 import SE2
from slam.surface.surface_map import SurfaceMap
from slam.surface.surface_match import SurfaceMatch

NOWHERE = np.zeros((0, 3))


def match(x_m: float, cost: float) -> SurfaceMatch:
    nothing = np.zeros((3, 3))
    return SurfaceMatch(SE2(x_m, 0.0, 0.0), nothing, nothing, 1.0, 0.9, cost, 1.0)


@pytest.mark.parametrize(
    ("off_m", "sigma_m", "is_coasting", "is_believed"),
    [
        (1.0, 0.1, False, True),  # odometry that jumped a little, or late
        # aces, a third of its scans lost: 4.4 m on, the other end of a corridor fitted, and was good
        (3.6, 0.35, False, False),
        (3.6, 1.6, False, True),  # odometry that may have jumped
        (3.6, 0.35, True, True),  # nobody measured the way
        (3.6, 0.1, False, False),
    ],
)
def test_wheels_that_are_a_guess_know_how_far_off_they_may_be(
    monkeypatch, off_m, sigma_m, is_coasting, is_believed
):
    candidates = Candidates(LastSeen(SurfaceMap(), [], FrontEndConfig()))
    # where wheels lead the last keyframes deny a scan, at the other place they do not
    denied = {0.0: (100, 32), off_m: (100, 4)}
    monkeypatch.setattr(candidates, "denied", lambda pose, *_: denied[pose.x])
    P = np.eye(3) * sigma_m**2
    here = SE2.identity()
    told = Prediction(SE2(off_m, 0.0, 0.0), here, P, np.linalg.inv(P), 1.0, is_coasting)
    found, led = match(off_m, 0.2), match(0.0, 0.6)
    beams = None  # nobody asks these
    assert candidates.is_better(found, led, told, NOWHERE, beams, None) is is_believed


@pytest.mark.parametrize(
    ("usual_m", "sigma_m", "is_believed"), [(1.1, 1.5, True), (0.0, 1.5, False), (1.1, 0.2, False)]
)
def test_wheels_that_hardly_know_are_no_better_than_that_the_robot_goes_on(
    monkeypatch, usual_m, sigma_m, is_believed
):
    candidates = Candidates(LastSeen(SurfaceMap(), [], FrontEndConfig()))
    monkeypatch.setattr(candidates, "denied", lambda *_: (100, 4))
    P, here = np.eye(3) * sigma_m**2, SE2.identity()
    told = Prediction(here, here, P, np.linalg.inv(P), 1.0, is_coasting=False)
    found, led = match(1.0, 0.19), match(0.0, 0.2)  # as little better as two places of a corridor
    usual, beams = SE2(usual_m, 0.0, 0.0), None  # nobody asks these
    assert candidates.is_better(found, led, told, NOWHERE, beams, usual) is is_believed


@pytest.mark.parametrize(
    ("off_m", "other_m", "found_m"),
    [
        (0.9, None, 0.9),
        (1.8, None, 1.8),  # nothing tells where it is instead
        # mit-csail backwards, ranges up to 8 m: 1.6 m beside both ways that it may have gone
        (1.8, 0.4, 0.1),
        (1.8, 1.2, 1.8),
        (0.9, 0.4, 0.9),
    ],
)
def test_robot_went_as_odometry_told_or_as_before_and_nowhere_else(
    monkeypatch, off_m, other_m, found_m
):
    candidates = Candidates(LastSeen(SurfaceMap(), [], FrontEndConfig()))

    def matched(points, start, prior, odometry, trust=None, *, pull=None):
        return match(0.1, 0.5) if pull is not None else match(off_m, 0.1)

    monkeypatch.setattr(candidates._surfaces, "match", matched)
    P, here = np.eye(3) * 0.5**2, SE2.identity()
    other = None if other_m is None else SE2(other_m, 0.0, 0.0)
    told = Prediction(here, here, P, np.linalg.inv(P), 1.0, is_coasting=False, other=other)
    beams = None  # nobody asks these
    assert candidates.led(NOWHERE, beams, told).T_map_base.x == found_m

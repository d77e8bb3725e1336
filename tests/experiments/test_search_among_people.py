"""The search of a whole map with people about: near ties are never missing."""

import math

import numpy as np
import pytest

from experiments.trials import TrialConfig
from slam.beams import Beams
from slam.se2 import SE2
from tests.slam.synthetic import box, scan_of

HALF_TURN = SE2(6.0, 4.0, math.pi)
"""Maps the symmetric room to itself, but for one box."""


@pytest.fixture(scope="module")
def known():
    return TrialConfig(place="symmetric_room").known_place


@pytest.mark.parametrize(
    ("pose", "legs_m"),
    [
        ((1.340, 1.031, 1.814), [(0.45, 0.55), (0.70, 0.67), (1.91, 2.44), (1.33, 2.59)]),
        ((2.389, 1.900, 1.048), [(1.18, 3.20), (1.13, 3.40), (2.13, 2.98), (1.93, 2.97)]),
        ((2.490, 2.076, -2.668), [(1.32, 2.46), (1.12, 2.42), (2.12, 3.05), (1.92, 3.06)]),
    ],
)
@pytest.mark.parametrize("seed", range(8))
def test_neither_of_two_ends_is_missing_among_people(known, pose, legs_m, seed):
    # legs led the refining of sixty points astray, and the other end alone was left: wrong and sure
    relocalizer, T_true = known.relocalizer, SE2(*pose)
    legs = [box(x - 0.06, y - 0.06, x + 0.06, y + 0.06) for x, y in legs_m]
    walls = np.concatenate([relocalizer.segment_map.segments, *legs])
    rng = np.random.default_rng(seed)
    angles_rad = known.laser.angles_rad
    scan = scan_of(walls, T_true @ known.T_base_laser, rng, 0.02, angles_rad, 5.6)
    found = relocalizer(Beams.of(scan, known.T_base_laser))
    for end in (T_true, HALF_TURN @ T_true):
        assert any(one.T_map_base.is_near(end, 0.05, 0.05) for one in found)

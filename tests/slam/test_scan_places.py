"""A map that holds together, of which nobody knows where some scans were taken, is called failed."""

from dataclasses import replace

import numpy as np
import pytest

from slam.mapper_config import MapperConfig
from slam.mapping import Mapper
from slam.measurements import Measurement
from slam.se2 import SE2
from slam.slam_map import SlamMap
from tests.slam import ring


def mapped(measurements: list[Measurement], config: MapperConfig | None = None) -> SlamMap:
    mapper = Mapper(ring.T_BASE_LASER, config)
    for measurement in measurements:
        mapper.update(measurement)
    return mapper.finish()


@pytest.mark.parametrize("is_unsure", [False, True])
def test_way_driven_blind_has_to_be_told_by_the_wheels(is_unsure):
    drive = ring.drive(ring.way(0.7)[:200], np.random.default_rng(2), 1.0, 1.0)
    drive = ring.blinded(drive, 100, 125)
    if is_unsure:
        spread = np.diag(np.square([0.12, 0.12, 0.02]))
        drive[100:126] = [replace(one, motion_covariance=spread) for one in drive[100:126]]
    verdict = mapped(drive).verdict
    assert verdict.is_good is not is_unsure
    if is_unsure:
        assert verdict.reasons[0].startswith("from 19.80 to 25.00 s no scan tells where")


@pytest.mark.slow
def test_doubted_wheels_are_as_noisy_as_they_show():
    """Off by 0.07 m a scan, where 0.01 m was told: a second look was called good, 0.4 m off while blind."""
    at, count, rng = 100, 60, np.random.default_rng(9)
    way = ring.way(1.15)
    there_and_back = [
        way[at] @ SE2(0.02 * (k if k <= count // 2 else count - k), 0.0, 0.0)
        for k in range(1, count)
    ]
    first, *drive = ring.drive([*way[: at + 1], *there_and_back, *way[at + 1 :]], rng, 1.0, 1.0)
    noisy = [
        replace(one, motion=one.motion @ SE2(*rng.normal(0.0, [0.07, 0.07, 0.03]))) for one in drive
    ]
    found = mapped(
        ring.blinded([first, *noisy], at + 1, at + count), MapperConfig(is_odometry_doubted=True)
    )
    assert "no scan tells where the robot is" in found.verdict.reasons[0]

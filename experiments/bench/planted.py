"""Regressions planted on purpose, to see whether the gate finds them."""

from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager, nullcontext
from dataclasses import replace
from typing import Any

import numpy as np

from experiments import methods, sources, worlds
from experiments.paper import PAPER_ICP
from kitasap_sim.laser import LaserSpec
from kitasap_sim.simulation import SensorFrame
from slam.measurements import Measurement

NOISE = 1.2
RADIUS = 1.01
ONE_IN = 10
FEW_ITERATIONS = 5


@contextmanager
def _instead(owner: Any, name: str, value: Any) -> Iterator[None]:
    before = getattr(owner, name)
    setattr(owner, name, value)
    try:
        yield
    finally:
        setattr(owner, name, before)


def noisier_laser() -> AbstractContextManager[None]:
    """The laser's sigma is a fifth larger than it was, and than anybody assumes."""
    true_laser = worlds.true_laser

    def noisier(name: str, mismatch: str) -> LaserSpec:
        spec = true_laser(name, mismatch)
        return replace(spec, sigma_at_m=tuple((at, NOISE * s) for at, s in spec.sigma_at_m))

    return _instead(worlds, "true_laser", noisier)


def larger_wheels() -> AbstractContextManager[None]:
    """The robot believes in wheels whose radius is 1 % larger."""
    drive = sources.DRIVE
    left_m, right_m = drive.wheel_radius_m
    larger = replace(drive, wheel_radius_m=(RADIUS * left_m, RADIUS * right_m))
    return _instead(sources, "DRIVE", larger)


def dropped_beams() -> AbstractContextManager[None]:
    """Each tenth beam of a scan never reaches the methods."""
    measurement = sources.MeasurementSource.measurement

    def thinned(self: sources.MeasurementSource, frame: SensorFrame) -> Measurement:
        whole = measurement(self, frame)
        ranges_m = np.array(whole.scan.ranges_m)
        ranges_m[::ONE_IN] = np.nan
        return replace(whole, scan=replace(whole.scan, ranges_m=ranges_m))

    return _instead(sources.MeasurementSource, "measurement", thinned)


def early_icp() -> AbstractContextManager[None]:
    """The paper's ICP gives up after five iterations, and hands on what it has."""
    short = replace(PAPER_ICP, max_iterations=FEW_ITERATIONS)
    return _instead(methods, "PAPER_ICP", short)


PLANTS: dict[str, Callable[[], AbstractContextManager[None]]] = {
    "laser noise +20 %": noisier_laser,
    "wheel radius +1 %": larger_wheels,
    "one beam in ten dropped": dropped_beams,
    "ICP stopped after 5 iterations": early_icp,
}
NOTHING = nullcontext

"""`kitasap view`: a robot driven by hand that finds itself meanwhile, in MuJoCo's own viewer."""

import math
from dataclasses import dataclass

import numpy as np

from experiments.methods import METHODS, KnownPlace
from experiments.sources import MeasurementSource
from kitasap_sim.hand import kidnap
from kitasap_sim.laser import laser
from kitasap_sim.overlay import Overlay, Wanted
from kitasap_sim.places import Place
from kitasap_sim.simulation import SensorFrame, Simulation
from kitasap_sim.viewer import Viewer, ViewerClosedError, has_display, shown
from slam.localization import Estimate
from slam.se2 import SE2
from slam.verdict import Status

_MAP_SPACING_M = 0.01
_METHOD = "limit"
_EVERY = 3
"""So many-th point of a scan is drawn."""
_COLOURS = {
    Status.TRACKING: (0.12, 0.44, 0.82),
    Status.UNSURE: (0.85, 0.55, 0.05),
    Status.LOST: (0.85, 0.10, 0.10),
}
_CANDIDATE = (0.56, 0.27, 0.68)


@dataclass(frozen=True)
class ViewConfig:
    """What is shown. Raises ValueError for what does not exist, when the simulation is made."""

    place: str = "room_fig4"
    laser: str = "urg_04lx"
    odometry: str = "as_built"
    people: int = 0
    seed: int = 0


class Drive:
    """A simulation, and the robot's own idea of where it is."""

    def __init__(self, config: ViewConfig) -> None:
        rng, self._rng = np.random.default_rng(config.seed).spawn(2)
        known = KnownPlace(Place(config.place), laser(config.laser), _MAP_SPACING_M)
        self.simulation = Simulation(
            known.place, config.laser, config.odometry, rng=rng, people=config.people
        )
        self._known = known
        self._source = MeasurementSource(known.laser, self.simulation.wheel_ticks())
        start = SE2.from_array(known.place.start)
        self._localizer = METHODS[_METHOD].localizer(
            known, start, is_tracking=True, may_be_lost=True
        )
        self._kidnaps = 0

    def run(self, viewer: Viewer) -> None:
        """Drives as the keys ask until the window is closed."""
        for frame in self.simulation.frames():
            viewer.show(self.looked(frame))
            self.obey(viewer.wanted)

    def looked(self, frame: SensorFrame) -> Overlay:
        """What the robot makes of a sweep, to be drawn."""
        measurement = self._source.measurement(frame)
        estimate = self._localizer.update(measurement)
        points_m = estimate.T_map_base @ measurement.scan.points(self._known.T_base_laser)
        colour = _COLOURS[estimate.verdict.status]
        marks = [(point, colour) for point in points_m[::_EVERY]]
        if estimate.verdict.status is not Status.TRACKING:
            places = [place.T_map_base.as_array() for place in estimate.verdict.hypotheses]
            marks += [(place, _CANDIDATE) for place in places]
        marks.append((estimate.T_map_base.as_array(), colour))
        return Overlay(marks, frame.ranges_m, self._words(estimate))

    def obey(self, wanted: Wanted) -> None:
        """Drives so; carries the robot off, anywhere, if one more kidnap is asked for."""
        self.simulation.drive(wanted.speed_mps, wanted.turn_radps)
        if wanted.kidnaps > self._kidnaps:
            self._kidnaps = wanted.kidnaps
            kidnap(self.simulation, self.simulation.world.draw_free_pose(self._rng))

    def _words(self, estimate: Estimate) -> list[str]:
        error = self.simulation.pose() - estimate.T_map_base.as_array()
        off_mm = 1000 * math.hypot(error[0], error[1])
        off_deg = abs(math.degrees(math.remainder(error[2], math.tau)))
        says = ", ".join((estimate.verdict.status.value.upper(), *estimate.verdict.reasons[:1]))
        return [
            f"The robot says: {says}",
            f"off by {off_mm:.1f} mm, {off_deg:.2f} degrees   t = {estimate.time_s:.1f} s",
        ]


def view(config: ViewConfig, *, in_browser: bool, port: int) -> None:
    """Shows it until the window is closed, or for ever in the browser."""
    drive = Drive(config)
    in_browser = in_browser or not has_display()
    with shown(drive.simulation, in_browser=in_browser, port=port) as viewer:
        try:
            drive.run(viewer)
        except ViewerClosedError:
            return

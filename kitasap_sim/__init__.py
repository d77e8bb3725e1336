"""Kitasap2 in MuJoCo: the robot, its places, its sensors, and the truth about all of them.

Begin with `Simulation`, the robot in a place with a laser of `LASERS` and wheels of
`ODOMETRY_PRESETS`: it drives, and tells a `SensorFrame` for each for each sweep; `Truth` is beside it. A `Pilot` follows a track. `Place`
reads your own MJCF file; `kidnap` lifts the robot and sets it down elsewhere.

Nothing heavy is imported with the package: MuJoCo comes with `Simulation` and `Place`. The driving
tasks (`kitasap_sim.env`) are registered with Gymnasium: `gymnasium.make("Kitasap2/GoTo-v0")`.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

from kitasap_sim.env import register_envs

if TYPE_CHECKING:
    from kitasap_sim.drive import Driver, Pilot
    from kitasap_sim.hand import Kidnap, Operator, kidnap
    from kitasap_sim.laser import LASERS, LaserSpec
    from kitasap_sim.place_map import PlaceMap
    from kitasap_sim.places import Place
    from kitasap_sim.robot import KITASAP2, ODOMETRY_PRESETS, OdometryPreset
    from kitasap_sim.simulation import SensorFrame, Simulation, Truth

_HOMES = {
    "Driver": "drive",
    "Pilot": "drive",
    "Kidnap": "hand",
    "Operator": "hand",
    "kidnap": "hand",
    "LASERS": "laser",
    "LaserSpec": "laser",
    "Place": "places",
    "PlaceMap": "places",
    "KITASAP2": "robot",
    "ODOMETRY_PRESETS": "robot",
    "OdometryPreset": "robot",
    "SensorFrame": "simulation",
    "Simulation": "simulation",
    "Truth": "simulation",
}

__all__ = [
    "KITASAP2",
    "LASERS",
    "ODOMETRY_PRESETS",
    "Driver",
    "Kidnap",
    "LaserSpec",
    "OdometryPreset",
    "Operator",
    "Pilot",
    "Place",
    "PlaceMap",
    "SensorFrame",
    "Simulation",
    "Truth",
    "kidnap",
]


def __getattr__(name: str) -> Any:
    """The public names, each imported when it is first asked for, and kept."""
    if name not in _HOMES:
        raise AttributeError(f"module 'kitasap_sim' has no attribute '{name}'")
    value = globals()[name] = getattr(import_module(f"kitasap_sim.{_HOMES[name]}"), name)
    return value


register_envs()

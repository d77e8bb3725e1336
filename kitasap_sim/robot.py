"""Kitasap2 as it is meant to be, and as it was built: nominal geometry and odometry errors."""

from dataclasses import dataclass, replace
from importlib.resources import files

import mujoco
import numpy as np

from kitasap_sim import names
from kitasap_sim.fan import with_fan
from kitasap_sim.laser import LaserSpec

ROBOT_XML = files("models") / "kitasap2" / "kitasap2.xml"


@dataclass(frozen=True)
class RobotSpec:
    """What the robot's own computer believes of its wheels; sources in models/kitasap2/README.md."""

    wheel_radius_m: float = 0.075
    track_m: float = 0.36
    ticks_per_turn: int = 132_000
    axle_height_m: float = 0.075
    radius_m: float = 0.30
    """Of the upright cylinder around the middle of the axle that holds the whole robot."""
    height_m: float = 0.36
    max_speed_mps: float = 0.6
    max_turn_rate_radps: float = 2.0

    def wheel_speeds_radps(self, v_mps: float, w_radps: float) -> np.ndarray:
        """(2,) left and right wheel speeds for a forward speed and a turn rate [rad/s]."""
        half_m = w_radps * self.track_m / 2
        return np.array([v_mps - half_m, v_mps + half_m]) / self.wheel_radius_m


KITASAP2 = RobotSpec()

SWEPT_HEIGHTS_M = (0.01, 0.45)
"""Between these the robot and whatever laser it carries may touch something."""


@dataclass(frozen=True)
class OdometryPreset:
    """How the robot that was built differs from the one it believes to be.

    radius_error: mean of the true wheel radii over nominal, minus one.
    radius_mismatch: (left - right) / mean of the true wheel radii; UMBmark's unequal diameters,
        type B, which turn a square the same way whichever way round it is driven.
    track_error: true track over nominal, minus one; UMBmark's uncertain wheelbase,
        type A, which mirrors the error of a square driven the other way round.
    scrub: MuJoCo's torsional friction of the tires [m]: a turning patch slips sideways.
    bumps_per_m2, bump_height_m: half-buried capsules at random spots of the floor, unseen by beams.
    """

    name: str
    radius_error: float = 0.0
    radius_mismatch: float = 0.0
    track_error: float = 0.0
    scrub: float = 0.001
    bumps_per_m2: float = 0.0
    bump_height_m: float = 0.0015


# Chosen: a robot whose wheel pair was matched but whose track was measured with a ruler, so that
# type A outweighs type B in UMBmark (Borenstein and Feng, 1996) and a 10 m square ends
# some centimetres off.
_AS_BUILT = OdometryPreset(
    "as_built", radius_error=-0.001, radius_mismatch=0.0001, track_error=0.004, scrub=0.003
)

ODOMETRY_PRESETS: dict[str, OdometryPreset] = {
    preset.name: preset
    for preset in (
        OdometryPreset("ideal"),
        _AS_BUILT,
        replace(_AS_BUILT, name="rough_floor", bumps_per_m2=3.0),
    )
}


@dataclass(frozen=True)
class OdometrySpread:
    """How far robots built to one preset differ from it: standard deviations of its constants.

    Chosen: tires of 15 cm that are worn or soft by a millimetre and a half, alike to a third of a
    millimetre, and a contact that wanders by 7 mm on a track of 36 cm.
    """

    radius_error: float = 0.01
    radius_mismatch: float = 0.002
    track_error: float = 0.02

    def drawn(self, preset: OdometryPreset, rng: np.random.Generator) -> OdometryPreset:
        """One robot around the preset."""
        radius, mismatch, track = rng.standard_normal(3)
        return replace(
            preset,
            radius_error=preset.radius_error + self.radius_error * float(radius),
            radius_mismatch=preset.radius_mismatch + self.radius_mismatch * float(mismatch),
            track_error=preset.track_error + self.track_error * float(track),
        )


def odometry_preset(name: str) -> OdometryPreset:
    """The preset of that name. Raises ValueError, naming those there are, if there is none."""
    if name not in ODOMETRY_PRESETS:
        raise ValueError(
            f"no odometry preset called '{name}'; there are: {', '.join(ODOMETRY_PRESETS)}"
        )
    return ODOMETRY_PRESETS[name]


def robot_mjcf(laser_spec: LaserSpec | None, odometry: OdometryPreset) -> mujoco.MjSpec:
    """The robot as built, carrying this laser (None: no beams at all), ready to be attached."""
    xml = with_fan(ROBOT_XML.read_text(), laser_spec, KITASAP2.axle_height_m)
    spec = mujoco.MjSpec.from_string(xml)
    signs = (1, -1)  # left, right
    for name, sign in zip(names.WHEELS, signs, strict=True):
        body = spec.body(name.removeprefix(names.PREFIX))
        body.pos = [0.0, sign * KITASAP2.track_m * (1 + odometry.track_error) / 2, 0.0]
    for name, sign in zip(names.TIRES, signs, strict=True):
        tire = spec.geom(name.removeprefix(names.PREFIX))
        radius_m = KITASAP2.wheel_radius_m * (
            1 + odometry.radius_error + sign * odometry.radius_mismatch / 2
        )
        tire.size = [radius_m, tire.size[1], radius_m]
        tire.friction = [tire.friction[0], odometry.scrub, tire.friction[2]]
    return spec


def add_bumps(
    world: mujoco.MjSpec,
    odometry: OdometryPreset,
    bounds_m: np.ndarray,
    rng: np.random.Generator,
) -> None:
    """Puts the preset's bumps on the floor within bounds ((2, 2): lower and upper corner) [m]."""
    width_m, depth_m = bounds_m[1] - bounds_m[0]
    radius_m = 0.01
    for _ in range(round(odometry.bumps_per_m2 * width_m * depth_m)):
        x, y = rng.uniform(bounds_m[0], bounds_m[1])
        heading = rng.uniform(0, np.pi)
        world.worldbody.add_geom(
            type=mujoco.mjtGeom.mjGEOM_CAPSULE,
            fromto=[
                *(x - 0.05 * np.cos(heading), y - 0.05 * np.sin(heading)),
                odometry.bump_height_m - radius_m,
                *(x + 0.05 * np.cos(heading), y + 0.05 * np.sin(heading)),
                odometry.bump_height_m - radius_m,
            ],
            size=[radius_m, 0, 0],
            rgba=[0, 0, 0, 0],  # rays pass over what has no alpha
        )

"""The simulated world as one MJCF: a place with a floor, the robot as built, and people."""

from importlib.resources import files

import mujoco
import numpy as np

from kitasap_sim import names
from kitasap_sim.laser import LaserSpec
from kitasap_sim.places import Place
from kitasap_sim.robot import OdometryPreset, add_bumps, robot_mjcf

PERSON_XML = files("models") / "person" / "person.xml"


def compiled(
    place: Place,
    laser: LaserSpec | None,
    odometry: OdometryPreset,
    people: int,
    bumps_within_m: np.ndarray,
    rng: np.random.Generator,
) -> mujoco.MjModel:
    """The place with a floor, the floor's bumps, the robot as built and people in it.

    bumps_within_m: (2, 2) lower and upper corner [m]. rng: where the bumps lie.
    Raises ValueError, in one line, if the place bears no robot.
    """
    world = place.mjcf()
    if not place.has_floor:
        _add_floor(world)
    if odometry.bumps_per_m2 > 0:
        add_bumps(world, odometry, bumps_within_m, rng)
    robot = robot_mjcf(laser, odometry)
    # the robot's physics, whatever the place was made for: gravity, solver and flags as well
    world.option = robot.option
    try:
        world.attach(robot, prefix=names.PREFIX, frame=world.worldbody.add_frame())
        for index in range(people):
            person = mujoco.MjSpec.from_string(PERSON_XML.read_text())
            frame = world.worldbody.add_frame()
            world.attach(person, prefix=names.person(index), frame=frame)
        return world.compile()
    except ValueError as error:
        reason = " ".join(str(error).split())
        raise ValueError(f"place {place.name} with the robot in it: {reason}") from None


def _add_floor(world: mujoco.MjSpec) -> None:
    # said in full: a place's defaults may make its geoms untouchable, or thick
    world.worldbody.add_geom(
        type=mujoco.mjtGeom.mjGEOM_PLANE,
        size=[0, 0, 0.1],
        contype=1,
        conaffinity=1,
        margin=0,
        gap=0,
    )

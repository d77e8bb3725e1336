"""Rooms drawn at random: four walls, partitions with doors, and things that stand about."""

import math

import mujoco
import numpy as np

from kitasap_sim import names
from kitasap_sim.place_look import ASSETS_XML, LIGHTS_XML, OPTION_XML, VISUAL_XML
from kitasap_sim.places import Place
from kitasap_sim.robot import KITASAP2

_SIDES_M = (5.0, 7.0)
_WALL_HEIGHT_M, _WALL_M = 0.8, 0.1
_DOORS_M = (1.1, 1.5)
_THINGS_PER_M2 = 0.3
_WIDTHS_M, _RADII_M = (0.15, 0.8), (0.08, 0.35)
_HEIGHTS_M = (0.45, 0.7)
"""All chosen: a furnished room of a flat; every thing is seen by lasers from 0.10 to 0.40 m height."""
_INSIDE_M = 0.3
"""From the walls to the middles of things: they may stand against a wall, not outside."""
_LEAST_FREE = 0.25
"""Of a room's floor, that a robot can reach; else another room is drawn."""
_SPOTS = 30
_TILT_RAD = math.atan(0.5)
_TRIES = 50

_WALL_RGBA = (0.93, 0.91, 0.86, 1.0)
_THING_RGBA = ((0.80, 0.64, 0.44, 1.0), (0.36, 0.46, 0.56, 1.0), (0.78, 0.30, 0.20, 1.0))
_FRAME_XML = f"""
<mujoco>
{OPTION_XML}{VISUAL_XML}{ASSETS_XML}  <worldbody>
{LIGHTS_XML}    <geom name="floor" type="plane" size="10 10 .1" pos="3 3 0" material="floor"/>
  </worldbody>
</mujoco>
"""


def random_room(
    rng: np.random.Generator, difficulty: float = 0.5, *, is_twofold: bool = False
) -> Place:
    """A room of 5 to 7 m by as much; its lower left inner corner is the origin.

    is_twofold: each thing and partition stands there twice, turned by half a turn about the room's
    middle, but for one more thing: who does not see that one, or where it is not, cannot tell the
    room's ends apart.

    difficulty: 0, four bare walls, to 1: three things on 10 m2, and up to two partitions with doors of
    1.1 to 1.5 m. A quarter of the floor at least can be reached. The name tells nothing of the
    draws. Raises ValueError for another difficulty.
    """
    if not 0.0 <= difficulty <= 1.0:
        raise ValueError(f"a difficulty lies between 0 and 1, not {difficulty}")
    for _ in range(_TRIES):
        size_m = rng.uniform(*_SIDES_M, 2)
        spec = _furnished(size_m, difficulty, rng, is_twofold)
        if not _add_start(spec, size_m, rng):
            continue
        place = Place.of_mjcf(_as_read(spec), "twofold" if is_twofold else "random")
        free_m2 = len(place.free_centres_m) * place.free_cell_m**2
        if free_m2 >= _LEAST_FREE * float(np.prod(size_m)):
            return place
    raise RuntimeError(f"{_TRIES} random rooms of difficulty {difficulty} had no room for a robot")


def _as_read(spec: mujoco.MjSpec) -> mujoco.MjSpec:
    """The same with the digits of a file, from which it is read to the bit: in another process a room
    is the one that was sent. Angles lose a little each time they are written, a few times at most."""
    text = spec.to_xml()
    for _ in range(_TRIES):
        read = mujoco.MjSpec.from_string(text)
        before, text = text, read.to_xml()
        if text == before:
            break
    return read


def _furnished(
    size_m: np.ndarray, difficulty: float, rng: np.random.Generator, is_twofold: bool
) -> mujoco.MjSpec:
    spec = mujoco.MjSpec.from_string(_FRAME_XML)
    spec.modelname = "random_room"
    width_m, depth_m = size_m.tolist()
    far_m = 1.1 * max(width_m, depth_m)
    spec.worldbody.add_camera(
        name="overview", pos=[width_m / 2, depth_m / 2 - 0.5 * far_m, far_m],
        quat=[math.cos(_TILT_RAD / 2), math.sin(_TILT_RAD / 2), 0.0, 0.0],
    )  # fmt: skip
    spec.stat.center, spec.stat.extent = (
        [width_m / 2, depth_m / 2, 0.4],
        max(width_m, depth_m) * 0.8,
    )
    for x, y, half_x, half_y in (
        (width_m / 2, -_WALL_M / 2, width_m / 2 + _WALL_M, _WALL_M / 2),
        (width_m / 2, depth_m + _WALL_M / 2, width_m / 2 + _WALL_M, _WALL_M / 2),
        (-_WALL_M / 2, depth_m / 2, _WALL_M / 2, depth_m / 2),
        (width_m + _WALL_M / 2, depth_m / 2, _WALL_M / 2, depth_m / 2),
    ):
        _add_wall(spec, x, y, half_x, half_y)
    walls, times = len(spec.worldbody.geoms), 2 if is_twofold else 1
    for _ in range(rng.binomial(2 // times, difficulty / 2)):
        _add_partition(spec, size_m, rng)
    for _ in range(round(difficulty * _THINGS_PER_M2 * width_m * depth_m / times)):
        _add_thing(spec, size_m, rng)
    if is_twofold:
        for geom in spec.worldbody.geoms[walls:]:
            (x, y, z), kind = geom.pos, geom.type
            spec.worldbody.add_geom(
                type=kind, pos=[width_m - x, depth_m - y, z], quat=geom.quat, size=geom.size,
                rgba=geom.rgba,
            )  # fmt: skip
        # beside all else, else it may be hidden and nothing tells the ends apart
        spots_m = rng.uniform(_INSIDE_M, size_m - _INSIDE_M, (_SPOTS, 2))
        _add_thing(spec, size_m, rng, spots_m[_room_m(spec, spots_m, size_m).argmax()])
    return spec


def _add_wall(spec: mujoco.MjSpec, x: float, y: float, half_x: float, half_y: float) -> None:
    spec.worldbody.add_geom(
        type=mujoco.mjtGeom.mjGEOM_BOX,
        pos=[x, y, _WALL_HEIGHT_M / 2],
        size=[half_x, half_y, _WALL_HEIGHT_M / 2],
        rgba=_WALL_RGBA,
    )


def _add_partition(spec: mujoco.MjSpec, size_m: np.ndarray, rng: np.random.Generator) -> None:
    """A wall across the room, but for a door."""
    axis = int(rng.integers(2))
    at_m = float(rng.uniform(0.3, 0.7) * size_m[axis])
    length_m, door_m = float(size_m[1 - axis]), float(rng.uniform(*_DOORS_M))
    door_at_m = float(rng.uniform(0.0, length_m - door_m))
    for low_m, high_m in ((0.0, door_at_m), (door_at_m + door_m, length_m)):
        if high_m - low_m > 0.05:
            middle, half = (low_m + high_m) / 2, (high_m - low_m) / 2
            place = (at_m, middle, _WALL_M / 2, half)
            _add_wall(spec, *(place if axis == 0 else (middle, at_m, half, _WALL_M / 2)))


def _add_thing(
    spec: mujoco.MjSpec,
    size_m: np.ndarray,
    rng: np.random.Generator,
    at_m: np.ndarray | None = None,
) -> None:
    """A box or a pillar at a spot (2,), or anywhere, turned anyhow."""
    x, y = rng.uniform(_INSIDE_M, size_m - _INSIDE_M) if at_m is None else at_m
    heading, is_round = rng.uniform(-math.pi, math.pi), rng.random() < 0.3
    half_x, half_y = rng.uniform(*_WIDTHS_M, 2) / 2
    radius_m, height_m = rng.uniform(*_RADII_M), rng.uniform(*_HEIGHTS_M)
    rgba = _THING_RGBA[int(rng.integers(len(_THING_RGBA)))]
    kind = mujoco.mjtGeom.mjGEOM_CYLINDER if is_round else mujoco.mjtGeom.mjGEOM_BOX
    half_z = height_m / 2
    size = [radius_m, half_z, 0.0] if is_round else [half_x, half_y, half_z]
    spec.worldbody.add_geom(
        type=kind,
        pos=[x, y, half_z],
        quat=[math.cos(heading / 2), 0.0, 0.0, math.sin(heading / 2)],
        size=size,
        rgba=rgba,
    )


def _add_start(spec: mujoco.MjSpec, size_m: np.ndarray, rng: np.random.Generator) -> bool:
    """A site where the robot has most room, of some spots that are drawn; whether it has any."""
    spots_m = rng.uniform(0.0, size_m, (_SPOTS, 2))
    room_m = _room_m(spec, spots_m, size_m)
    best = int(room_m.argmax())
    spec.worldbody.add_site(name=names.START, pos=[*spots_m[best], 0.0], size=[0.02] * 3)
    return bool(room_m[best] > KITASAP2.radius_m + 0.1)


def _room_m(spec: mujoco.MjSpec, spots_m: np.ndarray, size_m: np.ndarray) -> np.ndarray:
    """(K,) how far spots (K, 2) are from all that stands in the room, 0 and less within it."""
    room_m: np.ndarray = np.minimum(spots_m, size_m - spots_m).min(axis=1)
    for geom in spec.worldbody.geoms[1:]:  # without the floor
        away_m, (c, _, _, s) = spots_m - geom.pos[:2], geom.quat
        cos, sin = c * c - s * s, 2.0 * c * s
        across_m = np.abs(away_m @ np.array([[cos, -sin], [sin, cos]]))
        if geom.type == mujoco.mjtGeom.mjGEOM_CYLINDER:
            off_m = np.hypot(*away_m.T) - geom.size[0]
        else:
            off_m = np.hypot(*np.maximum(across_m - geom.size[:2], 0.0).T)
        room_m = np.minimum(room_m, off_m)
    return room_m

"""Pictures of a simulation. Physics needs no OpenGL: without it only these are missing."""

import ctypes
import os
import sys
from collections.abc import Sequence
from typing import Any

import mujoco
import numpy as np

from kitasap_sim import names
from kitasap_sim.simulation import Simulation

_BEAM_STRIDE = 6
"""Every sixth beam is drawn: more hide the floor, fewer look like a toy's."""

_HELP = (
    "no OpenGL to draw with, so there are no pictures (physics and lasers need none): install it "
    "with `apt-get install libegl1 libgl1` on Debian or Ubuntu"
)


class RenderingError(RuntimeError):
    """There is no OpenGL on this machine; the message says what to install."""


def render(
    simulation: Simulation,
    camera: str | None = None,
    size_px: tuple[int, int] = (960, 720),
    beams_m: np.ndarray | None = None,
) -> np.ndarray:
    """(height, width, 3) uint8 picture of the place with the robot in it.

    camera: name of a camera of the place; None takes `overview` where there is one, or else a
    view of the whole place from above. beams_m: (N,) ranges to draw as rays, unless not finite.
    Raises RenderingError if there is no OpenGL.
    """
    width, height = size_px
    model, data = simulation.model, simulation.data
    model.vis.global_.offwidth, model.vis.global_.offheight = size_px
    mujoco.mj_forward(model, data)
    context = _gl_context(width, height)
    try:
        gpu = mujoco.MjrContext(model, mujoco.mjtFontScale.mjFONTSCALE_150.value)
        mujoco.mjr_setBuffer(mujoco.mjtFramebuffer.mjFB_OFFSCREEN.value, gpu)
        option = mujoco.MjvOption()
        # MuJoCo's own drawing of 682 rays would cover the floor
        option.flags[mujoco.mjtVisFlag.mjVIS_RANGEFINDER.value] = 0
        scene = mujoco.MjvScene(model, maxgeom=model.ngeom + 2000)
        mujoco.mjv_updateScene(
            model, data, option, None, _camera(simulation, camera),
            mujoco.mjtCatBit.mjCAT_ALL.value, scene,
        )  # fmt: skip
        if beams_m is not None:
            _add_beams(scene, simulation, beams_m)
        pixels = np.zeros((height, width, 3), dtype=np.uint8)
        view = mujoco.MjrRect(0, 0, width, height)
        mujoco.mjr_render(view, scene, gpu)
        mujoco.mjr_readPixels(pixels, None, view, gpu)
        gpu.free()
    finally:
        context.free()
    return np.flipud(pixels)  # OpenGL's first row is the lowest


def _gl_context(width: int, height: int) -> Any:
    """A current OpenGL context: EGL where nothing was asked for and no display is there."""
    try:
        if _wants_egl():
            from mujoco.egl import GLContext
        else:
            from mujoco.gl_context import GLContext
        context = GLContext(width, height)
        context.make_current()
    except (ImportError, AttributeError, OSError, RuntimeError, mujoco.FatalError) as error:
        raise RenderingError(f"{_HELP} ({type(error).__name__}: {error})") from error
    return context


def _wants_egl() -> bool:
    if os.environ.get("MUJOCO_GL") or sys.platform != "linux" or os.environ.get("DISPLAY"):
        return False
    try:
        ctypes.CDLL("libEGL.so.1")  # PyOpenGL's own message about a missing one helps nobody
    except OSError as error:
        raise RenderingError(f"{_HELP} ({error})") from error
    os.environ.setdefault("PYOPENGL_PLATFORM", "egl")
    return True


def _camera(simulation: Simulation, name: str | None) -> mujoco.MjvCamera:
    model, camera = simulation.model, mujoco.MjvCamera()
    cameras = [model.camera(i).name for i in range(model.ncam)]
    if name is not None and name not in cameras:
        raise ValueError(f"no camera called '{name}'; there are: {', '.join(cameras) or 'none'}")
    name = name or ("overview" if "overview" in cameras else None)
    if name is not None:
        camera.type = mujoco.mjtCamera.mjCAMERA_FIXED.value
        camera.fixedcamid = cameras.index(name)
        return camera
    lower, upper = simulation.place.bounds_m
    camera.lookat = [*(lower + upper) / 2, 0.0]
    camera.distance = 1.3 * float(np.hypot(*(upper - lower)))
    camera.azimuth, camera.elevation = 90.0, -60.0
    return camera


def _add_beams(scene: mujoco.MjvScene, simulation: Simulation, beams_m: np.ndarray) -> None:
    """Thin rays from the laser to where each beam ended."""
    if simulation.laser is None:
        raise ValueError("this simulation was built without a laser: there are no beams to draw")
    site = simulation.data.site(names.LASER)
    is_hit = np.isfinite(beams_m) & (np.arange(beams_m.size) % _BEAM_STRIDE == 0)
    angles, ranges_m = simulation.laser.angles_rad[is_hit], beams_m[is_hit]
    local = np.stack([np.cos(angles), np.sin(angles), np.zeros(angles.size)], axis=1)
    for end in site.xpos + (ranges_m[:, None] * local) @ site.xmat.reshape(3, 3).T:
        if scene.ngeom >= scene.maxgeom:
            return
        _add_ray(scene, site.xpos, end)


def _add_ray(scene: mujoco.MjvScene, start: Sequence[float], end: Sequence[float]) -> None:
    geom = scene.geoms[scene.ngeom]
    mujoco.mjv_initGeom(
        geom, mujoco.mjtGeom.mjGEOM_LINE.value, np.zeros(3), np.zeros(3), np.zeros(9),
        np.array([1.0, 0.25, 0.1, 0.35], dtype=np.float32),
    )  # fmt: skip
    mujoco.mjv_connector(geom, mujoco.mjtGeom.mjGEOM_LINE.value, 1.5, start, end)
    scene.ngeom += 1

"""Pictures of a simulation. Physics needs no OpenGL: without it only these are missing."""

import ctypes
import os
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import mujoco
import numpy as np

from kitasap_sim import names
from kitasap_sim.moments import Moment
from kitasap_sim.places import Place
from kitasap_sim.simulation import Simulation

_BEAM_STRIDE = 6
"""Every sixth beam is drawn: more hide the floor, fewer look like a toy's."""

_QUICK = 1024, 2
"""Pixels of the shadows' map, and samples per pixel: 0.1 s instead of 0.2 s a picture on a CPU."""

_ARM_M = np.array([[0.0, 0.0, 0.22], [0.0, 0.03, 0.32], [0.15, 0.5, 0.85]])
"""From the robot's axle to a hand that holds it, and along its arm."""
_SKIN = (0.87, 0.67, 0.53, 1.0)

_FLAG_M = 0.85
"""Height of a mark's arrow: above walls and furniture."""

_HELP = (
    "no OpenGL to draw with, so there are no pictures (physics and lasers need none): install it "
    "with `apt-get install libegl1 libgl1` on Debian or Ubuntu"
)


_MOST_QUALITY = {
    **{"shadowsize": 8192, "offsamples": 16},
    **{"numslices": 128, "numstacks": 128, "numquads": 16},
}
"""Chosen: twice what the places that ship ask for, and more; a place of a stranger's may ask for all
memory."""


class RenderingError(RuntimeError):
    """There is no OpenGL on this machine; the message says what to install."""


Mark = tuple[np.ndarray, tuple[float, float, float]]
"""A spot on the floor, (2,) x, y or (3,) with a heading, and the colour to draw it in."""


@dataclass(frozen=True)
class View:
    """From where to look: at a spot (3,) [m], from so far [m], so high above and from so far round."""

    spot_m: tuple[float, float, float]
    distance_m: float
    azimuth_deg: float = 90.0
    elevation_deg: float = -50.0


def check_rendering() -> str:
    """By which way to OpenGL pictures are drawn here: EGL, GLFW or OSMESA.

    Raises RenderingError, which says what to install, if there is none.
    """
    model = mujoco.MjModel.from_xml_string("<mujoco/>")
    context, gpu = _gl_context(16, 16, model)
    gpu.free()
    context.free()
    return type(context).__module__.split(".")[1].upper()


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
    with Renderer(simulation, camera, size_px) as renderer:
        return renderer.drawn(beams_m)


class Renderer:
    """Pictures of one simulation, many of them: OpenGL is asked for once.

    It draws a copy of the state, so that pictures change nothing of what comes after. camera,
    size_px: as in `render`, or a `View`. is_quick: half the time without a GPU, for a little less
    beauty. Raises RenderingError if there is no OpenGL, ValueError for an unknown camera.
    """

    def __init__(
        self,
        simulation: Simulation,
        camera: str | View | None = None,
        size_px: tuple[int, int] = (960, 720),
        beam_stride: int = _BEAM_STRIDE,
        *,
        is_quick: bool = False,
    ) -> None:
        width, height = size_px
        model = simulation.model
        model.vis.global_.offwidth, model.vis.global_.offheight = size_px
        for name, most in _MOST_QUALITY.items():
            setattr(model.vis.quality, name, min(getattr(model.vis.quality, name), most))
        if is_quick:
            model.vis.quality.shadowsize, model.vis.quality.offsamples = _QUICK
        self._simulation, self._stride = simulation, beam_stride
        self._camera = _camera(simulation, camera)
        self._data = mujoco.MjData(model)
        self._context, self._gpu = _gl_context(width, height, model)
        mujoco.mjr_setBuffer(mujoco.mjtFramebuffer.mjFB_OFFSCREEN.value, self._gpu)
        self._option = mujoco.MjvOption()
        # MuJoCo's own drawing of 682 rays would cover the floor
        self._option.flags[mujoco.mjtVisFlag.mjVIS_RANGEFINDER.value] = 0
        self._scene = mujoco.MjvScene(model, maxgeom=model.ngeom + 2000)
        self._view = mujoco.MjrRect(0, 0, width, height)

    def __enter__(self) -> "Renderer":
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def drawn(
        self,
        beams_m: np.ndarray | None = None,
        marks: Sequence[Mark] = (),
        moment: Moment | None = None,
    ) -> np.ndarray:
        """(height, width, 3) uint8 picture of the state now, or of another moment of the simulation,
        with beams (N,) [m] and marks in it."""
        model, data = self._simulation.model, self._data
        if moment is None:
            mujoco.mj_copyState(
                model, self._simulation.data, data, mujoco.mjtState.mjSTATE_INTEGRATION.value
            )
            mujoco.mj_forward(model, data)
        else:
            moment.put(self._simulation, data)
        self._context.make_current()
        mujoco.mjv_updateScene(
            model, data, self._option, None, self._camera,
            mujoco.mjtCatBit.mjCAT_ALL.value, self._scene,
        )  # fmt: skip
        decorate(self._scene, self._simulation, data, beams_m, marks, self._stride)
        if moment is not None and moment.is_held:
            _add_hand(self._scene, data)
        pixels = np.zeros((self._view.height, self._view.width, 3), dtype=np.uint8)
        mujoco.mjr_render(self._view, self._scene, self._gpu)
        mujoco.mjr_readPixels(pixels, None, self._view, self._gpu)
        return np.flipud(pixels).copy()  # OpenGL's first row is the lowest

    def close(self) -> None:
        """Gives the graphics memory back; again does nothing."""
        if self._context is not None:
            self._context.make_current()
            self._gpu.free()
            self._context.free()
            self._context = None


def decorate(
    scene: mujoco.MjvScene,
    simulation: Simulation,
    data: mujoco.MjData,
    beams_m: np.ndarray | None,
    marks: Sequence[Mark],
    beam_stride: int = _BEAM_STRIDE,
) -> None:
    """Adds marks and every so many-th beam (N,) [m] to a scene, as the state `data` has them."""
    for spot, colour in marks:
        _add_mark(scene, spot, colour)
    if beams_m is not None:
        _add_beams(scene, simulation, data, beams_m, beam_stride)


def _gl_context(width: int, height: int, model: mujoco.MjModel) -> tuple[Any, mujoco.MjrContext]:
    """A current OpenGL context: EGL where nothing was asked for and no display is there; and what
    MuJoCo draws a model with."""
    try:
        if _wants_egl():
            from mujoco.egl import GLContext
        else:
            from mujoco.gl_context import GLContext
        context = GLContext(width, height)
        context.make_current()
        gpu = mujoco.MjrContext(model, mujoco.mjtFontScale.mjFONTSCALE_150.value)
    except (ImportError, AttributeError, OSError, RuntimeError, mujoco.FatalError) as error:
        raise RenderingError(f"{_HELP} ({type(error).__name__}: {error})") from error
    return context, gpu


def _wants_egl() -> bool:
    if os.environ.get("MUJOCO_GL") or sys.platform != "linux" or os.environ.get("DISPLAY"):
        return False
    try:
        ctypes.CDLL("libEGL.so.1")  # PyOpenGL's own message about a missing one helps nobody
    except OSError as error:
        raise RenderingError(f"{_HELP} ({error})") from error
    os.environ.setdefault("PYOPENGL_PLATFORM", "egl")
    return True


def _camera(simulation: Simulation, name: str | View | None) -> mujoco.MjvCamera:
    model, camera = simulation.model, mujoco.MjvCamera()
    if isinstance(name, View):
        camera.lookat, camera.distance = name.spot_m, name.distance_m
        camera.azimuth, camera.elevation = name.azimuth_deg, name.elevation_deg
        return camera
    cameras = [model.camera(i).name for i in range(model.ncam)]
    if name is not None and name not in cameras:
        raise ValueError(f"no camera called '{name}'; there are: {', '.join(cameras) or 'none'}")
    name = name or ("overview" if "overview" in cameras else None)
    if name is not None:
        camera.type = mujoco.mjtCamera.mjCAMERA_FIXED.value
        camera.fixedcamid = cameras.index(name)
        return camera
    look_from_above(camera, simulation.place)
    return camera


def look_from_above(camera: mujoco.MjvCamera, place: Place) -> None:
    """Sets a camera so that it sees the whole place, over its walls."""
    lower, upper = place.bounds_m
    camera.lookat = [*(lower + upper) / 2, 0.0]
    camera.distance = 1.3 * float(np.hypot(*(upper - lower)))
    camera.azimuth, camera.elevation = 90.0, -60.0


def _add_beams(
    scene: mujoco.MjvScene,
    simulation: Simulation,
    data: mujoco.MjData,
    beams_m: np.ndarray,
    stride: int,
) -> None:
    """Thin rays from the laser to where each beam ended."""
    if simulation.laser is None:
        raise ValueError("this simulation was built without a laser: there are no beams to draw")
    site = data.site(names.LASER)
    is_hit = np.isfinite(beams_m) & (np.arange(beams_m.size) % stride == 0)
    angles, ranges_m = simulation.laser.angles_rad[is_hit], beams_m[is_hit]
    local = np.stack([np.cos(angles), np.sin(angles), np.zeros(angles.size)], axis=1)
    for end in site.xpos + (ranges_m[:, None] * local) @ site.xmat.reshape(3, 3).T:
        _add_line(scene, mujoco.mjtGeom.mjGEOM_LINE, 1.5, site.xpos, end, (1.0, 0.25, 0.1, 0.35))


def _add_mark(scene: mujoco.MjvScene, spot: np.ndarray, colour: Sequence[float]) -> None:
    """A disc on the floor; with a flag that points along its heading where it has one."""
    x, y = float(spot[0]), float(spot[1])
    radius_m = 0.04 if len(spot) == 2 else 0.15
    if scene.ngeom >= scene.maxgeom:
        return
    mujoco.mjv_initGeom(
        scene.geoms[scene.ngeom], mujoco.mjtGeom.mjGEOM_CYLINDER.value,
        np.array([radius_m, 0.004, 0.0]), np.array([x, y, 0.005]), np.eye(3).ravel(),
        np.array([*colour, 0.8], dtype=np.float32),
    )  # fmt: skip
    scene.ngeom += 1
    if len(spot) == 3:
        c, s = np.cos(spot[2]), np.sin(spot[2])
        # above what stands before it
        start, end = np.array([x, y, _FLAG_M]), np.array([x + 0.4 * c, y + 0.4 * s, _FLAG_M])
        _add_line(
            scene, mujoco.mjtGeom.mjGEOM_CAPSULE, 0.01, np.array([x, y, 0.0]), start, (*colour, 1.0)
        )
        _add_line(scene, mujoco.mjtGeom.mjGEOM_ARROW, 0.03, start, end, (*colour, 1.0))


def _add_hand(scene: mujoco.MjvScene, data: mujoco.MjData) -> None:
    """What holds the robot: a fist on its deck, and an arm."""
    deck, fist, shoulder = data.body(names.BASE).xpos + _ARM_M
    _add_line(scene, mujoco.mjtGeom.mjGEOM_CAPSULE, 0.07, deck, fist, _SKIN)
    _add_line(scene, mujoco.mjtGeom.mjGEOM_CAPSULE, 0.045, fist, shoulder, _SKIN)


def _add_line(
    scene: mujoco.MjvScene,
    kind: mujoco.mjtGeom,
    width: float,
    start: np.ndarray,
    end: np.ndarray,
    rgba: Sequence[float],
) -> None:
    if scene.ngeom >= scene.maxgeom:
        return
    geom = scene.geoms[scene.ngeom]
    mujoco.mjv_initGeom(
        geom, kind.value, np.zeros(3), np.zeros(3), np.zeros(9), np.array(rgba, dtype=np.float32)
    )
    mujoco.mjv_connector(geom, kind.value, width, start, end)
    scene.ngeom += 1

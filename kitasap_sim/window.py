"""MuJoCo's window, which draws the overlay and reads the keys.

Studio's own window needs Python 3.12; this one is told of keys pressed, and not of keys let go.
"""

import atexit
import threading
import warnings
from collections.abc import Callable
from dataclasses import replace

import glfw
import mujoco
import mujoco.viewer

from kitasap_sim.overlay import Overlay, Wanted
from kitasap_sim.rendering import decorate, look_from_above
from kitasap_sim.simulation import Simulation

KEYS = "arrow keys: faster, slower, left, right    Enter: stop    K: kidnap"
_SPEED_MPS, _TURN_RADPS = 0.1, 0.2
"""What each press adds."""
_MOST_MPS, _MOST_RADPS = 0.3, 0.8
_CLOSING_S = 5.0
"""Chosen: a window that takes longer to close is given up."""


class Window:
    """A window on a simulation. Raises RuntimeError if none can be opened."""

    def __init__(self, simulation: Simulation) -> None:
        _check_display()
        self.wanted = Wanted()
        self._simulation, self._overlay = simulation, Overlay()
        self._viewer = Viewer(simulation, simulation.data, self.press)
        self._handle = self._viewer.handle

    def is_running(self) -> bool:
        """Until it is closed."""
        return bool(self._handle.is_running())

    def send_to_viewer(self, overlay: Overlay) -> None:
        """Draws it from now on."""
        self._overlay = overlay

    def sync(self) -> None:
        """Shows how things are now."""
        overlay = self._overlay
        with self._handle.lock():
            scene = self._handle.user_scn
            scene.ngeom = 0
            simulation = self._simulation
            decorate(scene, simulation, simulation.data, overlay.beams_m, overlay.marks)
        self._handle.set_texts([(None, None, "\n".join((*overlay.words, KEYS)), None)])
        self._handle.sync()

    def close(self) -> None:
        """Closes it; again does nothing."""
        self._viewer.close()

    def press(self, key: int) -> None:
        """Takes a key that was pressed, a number of GLFW's."""
        now = self.wanted
        ahead = {glfw.KEY_UP: 1, glfw.KEY_DOWN: -1}.get(key, 0)
        left = {glfw.KEY_LEFT: 1, glfw.KEY_RIGHT: -1}.get(key, 0)
        if key == glfw.KEY_ENTER:
            now = replace(now, speed_mps=0.0, turn_radps=0.0)
        self.wanted = Wanted(
            _held(now.speed_mps + _SPEED_MPS * ahead, _MOST_MPS),
            _held(now.turn_radps + _TURN_RADPS * left, _MOST_RADPS),
            now.kidnaps + (key == glfw.KEY_K),
        )


def _held(value: float, most: float) -> float:
    return round(min(max(value, -most), most), 6)


class Viewer:
    """MuJoCo's viewer in a window, on the whole of a simulation's place from above, without panels
    and its own drawing of the beams. data: of the simulation, or a copy; on_key: told of each key.

    handle: MuJoCo's own.
    """

    def __init__(
        self,
        simulation: Simulation,
        data: mujoco.MjData,
        on_key: Callable[[int], None] | None = None,
    ) -> None:
        before = threading.enumerate()
        self.handle = mujoco.viewer.launch_passive(
            simulation.model, data, key_callback=on_key, show_left_ui=False, show_right_ui=False
        )
        self._threads = [one for one in threading.enumerate() if one not in before]
        # who ends without closing it: before MuJoCo's own, which does not wait
        atexit.register(self.close)
        with self.handle.lock():
            self.handle.opt.flags[mujoco.mjtVisFlag.mjVIS_RANGEFINDER.value] = 0
            look_from_above(self.handle.cam, simulation.place)

    def close(self) -> None:
        """Closes it; again does nothing."""
        atexit.unregister(self.close)
        self.handle.close()
        # what still draws while Python ends, ends it by a fault
        for thread in self._threads:
            thread.join(_CLOSING_S)


def why_not() -> str | None:
    """Why no window can be opened, None if one can. The viewer itself would not say: it waits for
    ever, or ends the whole process."""
    with warnings.catch_warnings(record=True) as said:
        warnings.simplefilter("always")
        is_there = bool(glfw.init())
    return None if is_there else "; ".join(str(one.message) for one in said[:1])


def _check_display() -> None:
    why = why_not()
    if why is not None:
        raise RuntimeError(f"no window can be opened ({why}): add --browser to see it there")

"""Pictures of an episode: drawn only for who asks, and without changing what comes next."""

import copy
import math
import time
from collections.abc import Sequence
from typing import Any

import gymnasium
import mujoco
import numpy as np

from kitasap_sim.env.motors import CONTROL_S
from kitasap_sim.rendering import Mark, Renderer, decorate
from kitasap_sim.simulation import Simulation

SIZE_PX = (640, 480)


class Picture:
    """The place with robot, beams and the task's marks, as an array or in a window.

    Where there is no display a window is left out, with a warning. Raises RenderingError where
    there is no OpenGL for an array.
    """

    def __init__(self, simulation: Simulation, *, is_shown: bool) -> None:
        self._simulation = simulation
        self._shown_s = -math.inf
        self._viewer: Any = None
        self._renderer: Renderer | None = None
        if is_shown:
            # of its own: who drags the robot by the mouse does not move it, and opening the window
            # computes anew what the next step begins with
            self._shown = copy.copy(simulation.data)
            self._viewer = _window(simulation, self._shown)
        else:
            self._renderer = Renderer(simulation, size_px=SIZE_PX, beam_stride=1)

    def drawn(self, beams_m: np.ndarray, marks: Sequence[Mark]) -> np.ndarray | None:
        """(480, 640, 3) uint8; None where it is shown."""
        if self._renderer is not None:
            return self._renderer.drawn(beams_m, marks)
        if self._viewer is not None:
            handle, simulation = self._viewer.handle, self._simulation
            with handle.lock():
                mujoco.mj_copyData(self._shown, simulation.model, simulation.data)
                handle.user_scn.ngeom = 0
                decorate(handle.user_scn, simulation, self._shown, beams_m, marks, 1)
            handle.sync()
            self._wait()
        return None

    def _wait(self) -> None:
        """Until a control period has passed since it was shown last: people watch it drive."""
        left_s = self._shown_s + CONTROL_S - time.perf_counter()
        if left_s > 0.0:
            time.sleep(left_s)
        self._shown_s = time.perf_counter()

    def close(self) -> None:
        """Gives back window or graphics memory."""
        if self._renderer is not None:
            self._renderer.close()
        if self._viewer is not None:
            self._viewer.close()


def _window(simulation: Simulation, data: mujoco.MjData) -> Any:
    """MuJoCo's viewer; None, with a warning, where no window can be opened."""
    # loads the viewer, which nobody needs who looks at no window
    from kitasap_sim.window import Viewer, why_not

    why = why_not()
    if why is not None:
        gymnasium.logger.warn(
            f"render_mode='human' needs a display ({why}): nothing is shown; 'rgb_array' needs none"
        )
        return None
    return Viewer(simulation, data)

"""Pictures of an episode: drawn only for who asks, and without changing what comes next."""

import math
import os
import sys
import time
from collections.abc import Sequence
from typing import Any

import gymnasium
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
            self._viewer = _window(simulation)
        else:
            self._renderer = Renderer(simulation, size_px=SIZE_PX, beam_stride=1)

    def drawn(self, beams_m: np.ndarray, marks: Sequence[Mark]) -> np.ndarray | None:
        """(480, 640, 3) uint8; None where it is shown."""
        if self._renderer is not None:
            return self._renderer.drawn(beams_m, marks)
        if self._viewer is not None:
            scene = self._viewer.user_scn
            with self._viewer.lock():
                scene.ngeom = 0
                decorate(scene, self._simulation, self._simulation.data, beams_m, marks, 1)
            self._viewer.sync()
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


def _window(simulation: Simulation) -> Any:
    """MuJoCo's viewer; None, with a warning, where there is no display."""
    # without one, the viewer would end the whole process
    if sys.platform == "linux" and not (
        os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY")
    ):
        gymnasium.logger.warn(
            "render_mode='human' needs a display, and there is none: nothing is shown; 'rgb_array'"
            " needs none"
        )
        return None
    from mujoco import viewer

    return viewer.launch_passive(
        simulation.model, simulation.data, show_left_ui=False, show_right_ui=False
    )

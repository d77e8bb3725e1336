"""A simulation watched and driven by hand, by MuJoCo's viewers: in a window, or in a browser.

The browser's server asks nobody for a password, so it listens on the loopback interface alone.
"""

from __future__ import annotations

import os
import sys
import time
from collections.abc import Iterator
from contextlib import closing, contextmanager
from dataclasses import dataclass, field
from typing import Any

import mujoco
from mujoco.studio import launch_thread, messages, plugin, web_viewer
from mujoco.studio.dear_imgui import dear_imgui as imgui
from mujoco.studio.viewer_protocol import ViewerConfig, run_viewer_loop

from kitasap_sim.overlay import Overlay, Wanted
from kitasap_sim.rendering import decorate, look_from_above
from kitasap_sim.simulation import Simulation
from kitasap_sim.window import Window

LOOPBACK = "127.0.0.1"
_SPEED_MPS, _TURN_RADPS = 0.3, 0.8
_SYNC_S = 1.0 / 50.0
_MOST_GEOMS = 900
_KEYS = "arrow keys: drive    K: kidnap    mouse: look around"


class ViewerClosedError(Exception):
    """The window was closed."""


class Panel(plugin.ViewerPlugin):
    """Draws the overlay, and reads the keys."""

    def __init__(self, simulation: Simulation) -> None:
        self._simulation = simulation
        self._overlay = Overlay()
        self._wanted = Wanted()
        self._scene: mujoco.MjvScene | None = None

    @messages.handler
    def on_overlay(self, overlay: Overlay) -> None:
        """Keeps what is to be drawn."""
        self._overlay = overlay

    @messages.handler
    def on_model(self, event: messages.PostModelEvent) -> None:
        """Looks at the whole place from above, at first."""
        viewer = self.viewer
        viewer.vis_options.flags[mujoco.mjtVisFlag.mjVIS_RANGEFINDER.value] = 0
        look_from_above(viewer.camera, self._simulation.place)
        self._scene = mujoco.MjvScene(event.model, maxgeom=_MOST_GEOMS)

    @messages.handler
    def on_update(self, _: messages.UpdateEvent) -> None:
        """One more picture."""
        viewer, scene = self.viewer, self._scene
        viewer.extra_geoms.clear()
        if scene is not None:
            scene.ngeom = 0
            overlay = self._overlay
            decorate(scene, self._simulation, viewer.data, overlay.beams_m, overlay.marks)
            viewer.extra_geoms.extend(scene.geoms[: scene.ngeom])
        self._read_keys()

    @messages.handler
    def on_build_gui(self, _: messages.BuildGuiEvent) -> None:
        """The words."""
        imgui.SetNextWindowPos(imgui.Vec2(12, 12), int(imgui.Cond.FirstUseEver))
        imgui.Begin("Kitasap", flags=int(imgui.WindowFlags.AlwaysAutoResize))
        for words in (*self._overlay.words, _KEYS):
            imgui.TextUnformatted(words)
        imgui.End()

    def _read_keys(self) -> None:
        key, is_down = imgui.Key, imgui.IsKeyDown
        ahead = is_down(key.UpArrow) - is_down(key.DownArrow)
        left = is_down(key.LeftArrow) - is_down(key.RightArrow)
        kidnaps = self._wanted.kidnaps + bool(imgui.IsKeyPressed(key.K, False))
        wanted = Wanted(_SPEED_MPS * ahead, _TURN_RADPS * left, kidnaps)
        if wanted != self._wanted:
            self._wanted = wanted
            self.viewer.send_to_sim(wanted)


class _Receiver(plugin.SimPlugin):
    """Keeps what the keys ask for. A model dropped on the page is not taken."""

    def __init__(self) -> None:
        self.wanted = Wanted()

    @messages.handler
    def on_wanted(self, wanted: Wanted) -> None:
        self.wanted = wanted

    @messages.handler
    def on_load_model(self, event: messages.LoadModelEvent) -> bool:
        return True


class _LoopbackViewer(web_viewer.WebViewer):
    """MuJoCo's viewer in the browser, which by itself listens on all interfaces."""

    @property
    def _host(self) -> str:
        return LOOPBACK

    @_host.setter
    def _host(self, host: str) -> None:
        pass

    @property
    def is_local(self) -> bool:
        """Whether only this machine can reach it; False where that cannot be told."""
        listening = getattr(self, "_http_sock", None)
        return listening is not None and listening.getsockname()[0] == LOOPBACK


def _serve(config: ViewerConfig, endpoint: Any, panel: Panel) -> None:
    served = _LoopbackViewer(config, endpoint, plugins=[panel])
    # another MuJoCo may have another way to choose where it listens
    if not served.is_local:
        served.close()
        raise RuntimeError(
            f"MuJoCo {mujoco.__version__} serves its viewer to the whole network: it was stopped"
        )
    run_viewer_loop(served)


@dataclass
class Viewer:
    """A simulation that is shown. `simulation.frames` and all else that steps it runs in real time."""

    simulation: Simulation
    _handle: Any
    _keys: Any
    _due_s: float = field(default_factory=time.monotonic)
    _shown_s: float = 0.0

    @property
    def wanted(self) -> Wanted:
        """What the keys ask for."""
        wanted: Wanted = self._keys.wanted
        return wanted

    def show(self, overlay: Overlay) -> None:
        """Draws it from now on."""
        self._handle.send_to_viewer(overlay)

    def keep_up(self, simulation: Simulation) -> None:
        """Shows how things are now, and waits until it is time for more. Raises ViewerClosedError,
        or what ended the viewer."""
        if simulation.time_s < self._shown_s + _SYNC_S:
            return
        self._due_s += simulation.time_s - self._shown_s
        self._shown_s = simulation.time_s
        if not self._handle.is_running():
            raise ViewerClosedError
        self._handle.sync()
        behind_s = time.monotonic() - self._due_s
        if behind_s > 0.5:  # a search of the map, or a slow machine: what is late stays late
            self._due_s += behind_s
        elif behind_s < 0.0:
            time.sleep(-behind_s)


def has_display() -> bool:
    """Whether there is a screen for a window."""
    if sys.platform == "linux":
        return bool(os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY"))
    # on macOS MuJoCo's window needs another interpreter, mjpython
    return sys.platform == "win32"


@contextmanager
def shown(simulation: Simulation, *, in_browser: bool, port: int = 0) -> Iterator[Viewer]:
    """The simulation in a window, or served to browsers on this machine; port: 0 is the first free
    one from 8080. Raises RuntimeError if the port is taken, or no window can be opened."""
    if not in_browser:
        window = Window(simulation)
        with closing(window), _watched(Viewer(simulation, window, window)) as viewer:
            yield viewer
        return
    config = ViewerConfig(title="Kitasap", gfx="web", http_port=port)
    panel, receiver = Panel(simulation), _Receiver()
    handle = launch_thread.launch_thread(
        lambda endpoint: _serve(config, endpoint, panel), sim_plugins=[receiver]
    )
    with handle:
        handle.set_model(simulation.model, data=simulation.data)
        with _watched(Viewer(simulation, handle, receiver)) as viewer:
            yield viewer


@contextmanager
def _watched(viewer: Viewer) -> Iterator[Viewer]:
    viewer.simulation.watch(viewer.keep_up)
    try:
        yield viewer
    finally:
        viewer.simulation.watch(None)

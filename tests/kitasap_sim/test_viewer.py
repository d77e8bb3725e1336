"""The viewer in the browser: whom it serves, that it keeps time, and how it ends. Needs no display.

Each in a process of its own: Studio keeps its windows' state in globals, and leaves connections to
the interpreter to close.
"""

import os
import subprocess
import sys
from contextlib import nullcontext

import glfw
import mujoco.viewer
import numpy as np
import pytest

from kitasap_sim import viewer, window
from kitasap_sim.overlay import Overlay, Wanted

PRELUDE = """
import socket, sys, time, urllib.request
from pathlib import Path
import numpy as np
from kitasap_sim import Simulation, viewer
from kitasap_sim.overlay import Overlay
from kitasap_sim.viewer import LOOPBACK, ViewerClosedError, shown

LISTENS = "0A"

class Clock:
    def __init__(self, now_s):
        self.now_s, self.slept_s = now_s, 0.0

    def monotonic(self):
        return self.now_s

    def sleep(self, time_s):
        self.now_s, self.slept_s = self.now_s + time_s, self.slept_s + time_s

def listening():
    own = {path.readlink().name for path in Path("/proc/self/fd").iterdir() if path.is_symlink()}
    found = set()
    for table in ("/proc/net/tcp", "/proc/net/tcp6"):
        for line in Path(table).read_text().splitlines()[1:]:
            parts = line.split()
            if parts[3] == LISTENS and f"socket:[{parts[9]}]" in own:
                address, port = parts[1].split(":")
                found.add((address, int(port, 16)))
    return found

def free_port():
    with socket.socket() as one:
        one.bind((LOOPBACK, 0))
        return one.getsockname()[1]

simulation = Simulation(sys.argv[1], odometry="ideal", rng=np.random.default_rng(0))
"""

SERVES = """
# what listens everywhere would be seen
with socket.create_server(("", 0)) as everywhere:
    assert ("00000000", everywhere.getsockname()[1]) in listening()
port = free_port()
with shown(simulation, in_browser=True, port=port) as view:
    for _ in range(100):
        try:
            with urllib.request.urlopen(f"http://{LOOPBACK}:{port}/", timeout=1) as answer:
                assert answer.status == 200
            break
        except OSError:
            time.sleep(0.05)
    opened = listening()
    assert port in {one for _, one in opened}, opened
    assert {address for address, _ in opened} == {"0100007F"}, opened  # 127.0.0.1
    view.show(Overlay(words=("here",)))
    clock = viewer.time = Clock(time.monotonic())
    simulation.run(1.0)
    assert 0.4 < clock.slept_s < 1.1  # real time, but for what it may have been late before
slept_s = clock.slept_s
simulation.run(2.0)
assert clock.slept_s == slept_s  # nobody watches any more
assert not listening()
print("done")
"""

STOPPED = """
viewer._LoopbackViewer._host = "0.0.0.0"
try:
    with shown(simulation, in_browser=True, port=free_port()):
        simulation.run(30.0)
except RuntimeError as error:
    print(error)
assert not listening()
"""

CLOSED = """
with shown(simulation, in_browser=True, port=free_port()) as view:
    view._handle.close()
    try:
        simulation.run(5.0)
    except ViewerClosedError:
        print("done")
"""


@pytest.mark.skipif(sys.platform != "linux", reason="reads /proc")
@pytest.mark.parametrize(
    ("code", "said"),
    [
        pytest.param(SERVES, "done", id="serves this machine alone", marks=pytest.mark.slow),
        pytest.param(
            STOPPED,
            "to the whole network: it was stopped",
            id="stops when it would serve all",
            marks=pytest.mark.slow,
        ),
        pytest.param(CLOSED, "done", id="ends when closed", marks=pytest.mark.slow),
    ],
)
def test_the_page_is_served_on_the_loopback_interface_alone(code, said, box_room):
    done = subprocess.run(
        [sys.executable, "-c", PRELUDE + code, str(box_room.path)],
        capture_output=True, text=True, env={**os.environ, "OMP_NUM_THREADS": "1"}, timeout=60,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    assert done.stdout.strip().endswith(said)


@pytest.mark.parametrize(
    ("variables", "there_is"),
    [({}, False), ({"DISPLAY": ":0"}, True), ({"WAYLAND_DISPLAY": "wayland-0"}, True)],
)
def test_a_display_is_told_by_the_environment(variables, there_is, monkeypatch):
    monkeypatch.setattr(viewer.sys, "platform", "linux")
    for name in ("DISPLAY", "WAYLAND_DISPLAY"):
        monkeypatch.delenv(name, raising=False)
    for name, value in variables.items():
        monkeypatch.setenv(name, value)
    assert viewer.has_display() is there_is


class FakeHandle:
    """What MuJoCo gives to whoever opens its window; a real one needs a display."""

    def __init__(self, model, data, key_callback, **_):
        self.opt, self.user_scn = mujoco.MjvOption(), mujoco.MjvScene(model, 1000)
        self.cam = mujoco.MjvCamera()
        self.press, self.texts, self.is_open, self.synced = key_callback, [], True, 0

    def lock(self):
        return nullcontext()

    def is_running(self):
        return self.is_open

    def set_texts(self, texts):
        self.texts = texts

    def sync(self):
        self.synced += 1

    def close(self):
        self.is_open = False


def test_the_window_draws_the_overlay_and_its_keys_drive(box_room, make, monkeypatch):
    opened = []

    def launched(*arguments, **keywords):
        opened.append(FakeHandle(*arguments, **keywords))
        return opened[-1]

    monkeypatch.setattr(window, "_check_display", lambda: None)
    monkeypatch.setattr(mujoco.viewer, "launch_passive", launched)
    simulation = make(box_room)
    with viewer.shown(simulation, in_browser=False) as view:
        (handle,) = opened
        flag = np.array([1.0, 1.0, 0.5]), (0.0, 0.0, 1.0)
        view.show(Overlay([flag], None, ["The robot says: TRACKING"]))
        simulation.run(0.1)
        assert handle.synced > 0
        assert handle.user_scn.ngeom == 3  # disc, pole and arrow
        assert "The robot says: TRACKING" in handle.texts[0][2]
        for key in (glfw.KEY_UP, glfw.KEY_UP, glfw.KEY_LEFT, glfw.KEY_K):
            handle.press(key)
        assert view.wanted == Wanted(0.2, 0.2, 1)
        for _ in range(9):
            handle.press(glfw.KEY_DOWN)
        assert view.wanted.speed_mps == -0.3
        handle.press(glfw.KEY_ENTER)
        assert view.wanted == Wanted(0.0, 0.0, 1)
        handle.is_open = False
        with pytest.raises(viewer.ViewerClosedError):
            simulation.run(1.0)


def test_a_display_that_cannot_be_opened_is_refused_not_waited_for(box_room, make, monkeypatch):
    monkeypatch.setattr(window.glfw, "init", lambda: False)
    with (
        pytest.raises(RuntimeError, match=r"no window can be opened .* add --browser"),
        viewer.shown(make(box_room), in_browser=False),
    ):
        pass

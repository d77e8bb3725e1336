import os
import subprocess
import sys

import numpy as np
import pytest

from kitasap_sim import rendering
from kitasap_sim.rendering import RenderingError, render
from tests.egl import needs_egl


@needs_egl
def test_a_picture_shows_the_robot_and_its_beams(box_room, make, monkeypatch):
    for variable in ("MUJOCO_GL", "DISPLAY"):
        monkeypatch.delenv(variable, raising=False)
    simulation = make(box_room)
    plain = render(simulation, size_px=(160, 120))
    with_beams = render(simulation, size_px=(160, 120), beams_m=simulation.next_frame().ranges_m)
    assert plain.shape == (120, 160, 3)
    assert plain.std() > 10  # not one colour
    is_redder = with_beams[..., 0].astype(int) - plain[..., 0] > 10
    assert is_redder.mean() > 0.02


@needs_egl
def test_an_unknown_camera_names_those_there_are(make):
    with pytest.raises(ValueError, match=r"no camera called 'top'; there are: overview, plan"):
        render(make("room_fig4"), camera="top")


def test_without_opengl_only_pictures_are_missing_and_the_message_says_what_to_install(
    box_room, make, monkeypatch
):
    def missing(name, *_):
        raise OSError(f"{name}: cannot open shared object file")

    for variable in ("MUJOCO_GL", "DISPLAY"):
        monkeypatch.delenv(variable, raising=False)
    simulation = make(box_room)
    monkeypatch.setattr(rendering.ctypes, "CDLL", missing)
    with pytest.raises(RenderingError, match="apt-get install libegl1 libgl1"):
        render(simulation)
    assert np.isfinite(simulation.next_frame().ranges_m).sum() > 600


@pytest.mark.slow
def test_physics_needs_no_opengl():
    code = (
        "import sys, numpy as np\n"
        "sys.modules['OpenGL'] = None\n"  # any import of it now fails
        "from kitasap_sim import Simulation\n"
        "robot = Simulation('symmetric_room', rng=np.random.default_rng(0))\n"
        "print(len(robot.run(1.0)))\n"
    )
    environment = {**os.environ, "MUJOCO_GL": "disable"}
    done = subprocess.run(
        [sys.executable, "-c", code], env=environment, capture_output=True, text=True, check=True
    )
    assert done.stdout.strip() == "10"

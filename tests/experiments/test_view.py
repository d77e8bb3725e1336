"""`kitasap view`: what it refuses, what it draws, and that the robot does as the keys ask."""

import os
import signal
import socket
import subprocess
import sys
import time

import numpy as np
import pytest

from experiments.view import Drive, ViewConfig
from kitasap_sim.overlay import Wanted
from kitasap_sim.viewer import LOOPBACK
from tests.experiments.refusals import refusal


def test_a_port_in_use_is_refused_in_one_line(box_room, capsys):
    with socket.create_server((LOOPBACK, 0)) as taken:
        port = taken.getsockname()[1]
        line = refusal(capsys, "view", box_room, "--browser", "--port", port)
    assert line.startswith(f"Port {port} is already in use")


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["moon"], "no place called 'moon'"),
        (["--laser", "x"], "no laser called 'x'"),
        (["--port", "70000"], "Invalid value for '--port'"),
        (["--people", "-1"], "Invalid value for '--people'"),
    ],
)
def test_wrong_input_is_refused_in_one_line(arguments, said, capsys):
    assert said in refusal(capsys, "view", "--browser", *arguments)


@pytest.mark.slow
def test_keys_drive_and_kidnap_and_the_robot_finds_itself(box_room):
    drive = Drive(ViewConfig(box_room))
    simulation = drive.simulation
    start = simulation.pose()
    said = []
    for frame in simulation.frames(2.0):
        said.append(drive.looked(frame).words[0])
        drive.obey(Wanted(speed_mps=0.2, turn_radps=0.4))
    assert np.hypot(*(simulation.pose() - start)[:2]) > 0.2
    assert said[-1] == "The robot says: TRACKING"
    drive.obey(Wanted(kidnaps=1))
    looks = [drive.looked(frame) for frame in simulation.frames(1.0)]
    assert looks[0].words[0].startswith("The robot says: LOST")
    assert looks[-1].words[0] == "The robot says: TRACKING"
    assert looks[-1].words[1].startswith("off by ")
    assert np.hypot(*(looks[-1].marks[-1][0] - simulation.pose())[:2]) < 0.02
    # one more press, one more kidnap; none without
    drive.obey(Wanted(kidnaps=1))
    before = simulation.time_s
    drive.obey(Wanted(kidnaps=1))
    assert simulation.time_s == before


@pytest.mark.slow
@pytest.mark.skipif(sys.platform == "win32", reason="Ctrl-C is another thing there")
def test_ctrl_c_ends_it_cleanly(box_room):
    done = subprocess.Popen(
        [sys.executable, "-m", "experiments.cli", "view", box_room, "--browser"],
        stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
        env={**os.environ, "PYTHONUNBUFFERED": "1"},
    )  # fmt: skip
    assert done.stdout is not None
    for line in done.stdout:
        if "Model changed" in line:
            break
    time.sleep(2.0)
    done.send_signal(signal.SIGINT)
    _, said = done.communicate(timeout=20)
    assert done.returncode == 130
    assert "Traceback" not in said
    assert said.strip().endswith("kitasap: interrupted")

"""SIGTERM: what Ctrl-C leaves behind, under a status of its own."""

import signal
import subprocess
import sys
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor

import pytest

from experiments.termination import interrupt_when_terminated
from tests.experiments.test_online_poses import LOG, OLD, WITHOUT_POSES, fill, there

MAPPED = """
import os, signal
from experiments import cli, progress
progress.SlamProgress.update = lambda *_: os.kill(os.getpid(), signal.SIGTERM)
cli.entry()
"""
"""The command, terminated at the first scan."""

WORKER = """
import multiprocessing, signal, sys, time
from experiments.termination import interrupt_when_terminated
interrupt_when_terminated()
process = multiprocessing.get_context("spawn").Process(target=time.sleep, args=(60,))
process.start()
process.terminate()
process.join(30)
sys.exit(-process.exitcode)
"""


@pytest.fixture
def restored() -> Iterator[None]:
    before = signal.getsignal(signal.SIGTERM)
    yield
    signal.signal(signal.SIGTERM, before)


@pytest.mark.parametrize("before", [OLD, WITHOUT_POSES])
def test_terminated_command_leaves_the_results_before(tmp_path, before):
    fill(tmp_path, before)
    command = [sys.executable, "-c", MAPPED, "slam", str(LOG), "--out", str(tmp_path)]
    done = subprocess.run(command, check=False, capture_output=True, text=True)
    assert done.returncode == 143
    assert done.stderr.splitlines()[-1] == "kitasap: terminated"
    assert "Traceback" not in done.stderr
    assert there(tmp_path) == before


@pytest.mark.usefixtures("restored")
@pytest.mark.parametrize("handler", [signal.SIG_IGN, lambda *_: None])
def test_handler_that_somebody_set_stays(handler):
    signal.signal(signal.SIGTERM, handler)
    interrupt_when_terminated()
    assert signal.getsignal(signal.SIGTERM) is handler


@pytest.mark.usefixtures("restored")
def test_thread_sets_no_handler():
    signal.signal(signal.SIGTERM, signal.SIG_DFL)
    with ThreadPoolExecutor(1) as threads:
        threads.submit(interrupt_when_terminated).result()
    assert signal.getsignal(signal.SIGTERM) is signal.SIG_DFL


@pytest.mark.usefixtures("restored")
def test_termination_interrupts(monkeypatch):
    monkeypatch.setattr("experiments.termination._heard", [])
    signal.signal(signal.SIGTERM, signal.SIG_DFL)
    interrupt_when_terminated()
    with pytest.raises(KeyboardInterrupt):
        signal.raise_signal(signal.SIGTERM)


def test_process_that_it_starts_is_ended_at_once_as_ever():
    done = subprocess.run([sys.executable, "-c", WORKER], check=False, timeout=60)
    assert done.returncode == signal.SIGTERM

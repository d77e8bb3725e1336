"""Commands whose output nobody reads any more end as they would have."""

import os
import select
import subprocess
import sys
import time
from pathlib import Path

import pytest

SAYS = """
import sys
from experiments.standard_streams import outlive_readers
outlive_readers()
for line in range(20000):
    print("line", line)
    print("progress", line, file=sys.stderr)
sys.exit(7)
"""


FULL_PIPE = """
import os, select, sys
from experiments.standard_streams import outlive_readers
reader, writer = os.pipe()
os.set_blocking(writer, False)
os.dup2(writer, sys.stdout.fileno())
select.select = lambda *_: os.read(reader, 1 << 20)
outlive_readers()
print("x" * 300_000, flush=True)
sys.exit(7)
"""
"""Nobody reads, but whoever waits for the pipe; who only tries again does so for ever."""

FAILING = """
import errno, io
class Failing(io.FileIO):
    def write(self, content):
        raise OSError(errno.EIO, "input/output error")
io.FileIO = Failing
"""


def run(code: str, **options: object) -> int:
    return subprocess.run([sys.executable, "-c", code], check=False, **options).returncode


def told(code: str, stdout: int, **more_env: str) -> subprocess.CompletedProcess[bytes]:
    """What comes of code that stops at once, with nothing flushed by the interpreter's end."""
    env = {name: value for name, value in os.environ.items() if name != "PYTHONUNBUFFERED"}
    code = f"import os, sys\nfrom experiments.standard_streams import outlive_readers\n{code}"
    command = [sys.executable, "-c", f"{code}\nos._exit(7)"]
    done = subprocess.run(
        command, check=False, stdout=stdout, stderr=subprocess.PIPE, env=env | more_env
    )
    assert done.returncode == 7
    return done


def unread() -> int:
    """The end of a pipe that nobody reads."""
    reader, writer = os.pipe()
    os.close(reader)
    return writer


@pytest.mark.parametrize("stream", ["stdout", "stderr"])
def test_status_is_that_of_the_work_though_nobody_reads(stream):
    streams = {"stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL}
    assert run(SAYS, **(streams | {stream: unread()})) == 7


def test_progress_that_no_disk_takes_stops_nothing():
    with Path("/dev/full").open("w") as full:
        assert run(SAYS, stdout=subprocess.DEVNULL, stderr=full) == 7
        # results are another matter
        assert run(SAYS, stdout=full, stderr=subprocess.DEVNULL) != 7


def test_streams_that_were_closed_go_nowhere():
    command = f"exec {sys.executable} -c '{SAYS}' >&- 2>&-"
    assert subprocess.run(command, shell=True, check=False).returncode == 7


def test_lines_come_in_time_and_whole():
    code = SAYS.replace("20000", "3")
    done = subprocess.run([sys.executable, "-c", code], check=False, capture_output=True, text=True)
    assert done.stdout == "line 0\nline 1\nline 2\n"
    assert done.stderr.splitlines()[-1] == "progress 2"


@pytest.mark.parametrize("stream", ["stdout", "stderr"])
def test_status_is_that_of_the_work_though_the_terminal_went_away(stream):
    ours, terminal = os.openpty()
    streams = {"stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL} | {stream: terminal}
    code = f"import sys\nprint('here', file=sys.{stream}, flush=True)\nsys.stdin.read()\n{SAYS}"
    with subprocess.Popen([sys.executable, "-c", code], stdin=subprocess.PIPE, **streams) as work:
        os.close(terminal)
        with open(ours, "rb") as screen:
            screen.readline()
        work.stdin.close()
        assert work.wait() == 7


def test_disk_that_fails_is_no_reader_that_went_away(tmp_path):
    code = FAILING + SAYS
    with (tmp_path / "results").open("w") as file:
        assert run(code, stdout=file, stderr=subprocess.DEVNULL) != 7
    # as a terminal, no file of a disk
    assert run(code, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL) == 7


def test_full_pipe_that_does_not_block_is_waited_for():
    assert run(FULL_PIPE, stdout=subprocess.DEVNULL, timeout=60) == 7


def test_all_comes_through_a_pipe_that_does_not_block():
    reader, writer = os.pipe()
    os.set_blocking(writer, False)
    # stopped, should it wait for what never comes
    command = [sys.executable, "-c", f"import signal\nsignal.alarm(60)\n{SAYS}"]
    with subprocess.Popen(command, stdout=writer, stderr=subprocess.DEVNULL) as work:
        while select.select([], [writer], [], 0.0)[1] and work.poll() is None:
            time.sleep(0.01)  # until it is full
        os.close(writer)
        with open(reader, encoding="utf-8") as lines:
            assert lines.read() == "".join(f"line {number}\n" for number in range(20000))
        assert work.wait() == 7


def test_what_was_said_before_comes_first():
    code = "sys.stdout.write('one ')\noutlive_readers()\nprint('two', flush=True)"
    assert told(code, stdout=subprocess.PIPE).stdout == b"one two\n"


def test_progress_comes_line_by_line_and_results_to_a_file_in_blocks():
    code = "outlive_readers()\nprint('progress', file=sys.stderr)\nprint('result')"
    done = told(code, stdout=subprocess.PIPE)
    assert done.stderr == b"progress\n"
    assert done.stdout == b""


def test_results_come_line_by_line_to_a_terminal():
    ours, terminal = os.openpty()
    told("outlive_readers()\nprint('result')", stdout=terminal)
    os.set_blocking(ours, False)
    with open(ours, "rb") as screen:
        assert screen.readline() == b"result\r\n"
    os.close(terminal)


def test_signs_are_written_as_the_streams_were_told_to():
    code = "outlive_readers()\nfor one in sys.stdout, sys.stderr: print('ä☃', file=one, flush=True)"
    done = told(code, stdout=subprocess.PIPE, PYTHONIOENCODING="latin-1:xmlcharrefreplace")
    assert done.stdout == b"\xe4&#9731;\n"
    # what cannot be written to standard error is always escaped
    assert done.stderr == b"\xe4\\u2603\n"


def said_to_a_full_disk(code: str) -> subprocess.CompletedProcess[str]:
    """The command `say` of a program, whose results no disk takes."""
    with Path("/dev/full").open("w") as full:
        return subprocess.run(
            [sys.executable, "-c", code, "say"],
            check=False, stdout=full, stderr=subprocess.PIPE, text=True,
        )  # fmt: skip


@pytest.mark.parametrize("lines", [1, 20000])
def test_results_that_no_disk_takes_are_said_in_one_line(lines):
    code = (
        "import experiments.cli as cli\n"
        f"cli.app.command('say')(lambda: print(*range({lines}), sep='\\n'))\n"
        "cli.entry()"
    )
    done = said_to_a_full_disk(code)
    assert done.stderr == "kitasap: standard output: No space left on device\n"
    assert done.returncode == 2


def test_refusal_stays_the_only_line_though_no_disk_takes_what_was_said_before():
    code = (
        "import experiments.cli as cli\n"
        "@cli.app.command('say')\n"
        "def say():\n"
        "    print('said')\n"
        "    raise ValueError('wrong')\n"
        "cli.entry()"
    )
    done = said_to_a_full_disk(code)
    assert (done.returncode, done.stderr) == (2, "kitasap: wrong\n")

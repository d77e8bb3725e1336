"""Commands whose output nobody reads any more end as they would have."""

import os
import subprocess
import sys
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


def run(code: str, **streams: object) -> int:
    return subprocess.run([sys.executable, "-c", code], check=False, **streams).returncode


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

"""What the command says when it refuses: one line, and the status is 2."""

import pytest

from experiments.cli import main


def refusal(capsys: pytest.CaptureFixture[str], *arguments: object) -> str:
    """The line, without the command's name in front."""
    return line_of_refusal(capsys, main([str(argument) for argument in arguments]))


def line_of_refusal(capsys: pytest.CaptureFixture[str], status: int) -> str:
    """The same of a command that was run already, and printed nothing else."""
    assert status == 2
    printed = capsys.readouterr()
    assert printed.out == ""
    (line,) = printed.err.splitlines()
    assert line.startswith("kitasap: ")
    return line.removeprefix("kitasap: ")

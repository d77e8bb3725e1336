"""What is said where no more can be written: of which folder or file, in one line."""

import errno
import os
from pathlib import Path

import numpy as np
import pytest

from experiments.figures import image_file
from experiments.outputs import results_of_one
from tests.experiments.refusals import refusal

FULL = [errno.ENOSPC, errno.EDQUOT, errno.EFBIG]
PIXELS = np.zeros((4, 4, 3), np.uint8)


def full_of(number: int) -> OSError:
    """As a file says that is being written."""
    return OSError(number, os.strerror(number))


@pytest.mark.parametrize("number", [*FULL, errno.EIO])
def test_full_disk_says_of_which_folder(tmp_path, number):
    with pytest.raises(OSError, match="Errno") as caught, results_of_one(tmp_path, "slam"):
        raise full_of(number)
    assert (str(tmp_path) in str(caught.value)) is (number in FULL)


@pytest.mark.parametrize("number", FULL)
def test_picture_that_no_disk_takes_is_named_and_the_one_before_stays(
    tmp_path, capsys, monkeypatch, number
):
    def full(path: Path, content: bytes) -> None:
        path.touch()
        raise full_of(number)

    picture = tmp_path / "x.png"
    picture.write_text("before")
    monkeypatch.setattr("kitasap_sim.rendering.render", lambda *_, **__: PIXELS)
    monkeypatch.setattr(Path, "write_bytes", full)
    assert refusal(capsys, "picture", "--out", picture) == f"{picture}: {os.strerror(number)}"
    assert [path.name for path in tmp_path.iterdir()] == ["x.png"]
    assert picture.read_text() == "before"


def test_picture_takes_the_place_of_the_one_before(tmp_path):
    (tmp_path / "x.png").write_text("before")
    assert image_file(tmp_path / "x.png", PIXELS).read_bytes()[:4] == b"\x89PNG"

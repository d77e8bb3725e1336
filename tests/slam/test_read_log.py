"""Which reader a file belongs to."""

import gzip
from pathlib import Path

import pytest

from slam.readers.recognition import read_log
from slam.se2 import SE2
from tests.slam.test_carmen import EXCERPT, flaser
from tests.slam.test_carmen_lasers import raw_laser
from tests.slam.test_ticks import line

DATA = Path(__file__).parents[1] / "data"


@pytest.mark.parametrize(
    "text",
    [
        flaser([1.0] * 180, SE2.identity(), 1.0) + "\n",
        "# CARMEN\nSYNC a 1 b 2\n" + raw_laser(1.0) + "\n",
        line(0, 0, 0) + "\n\n",
    ],
)
def test_format_is_told_from_the_content_whatever_the_name(tmp_path, text):
    (tmp_path / "a.gz").write_text(text)
    (tmp_path / "b").write_bytes(gzip.compress(text.encode()))
    assert read_log(tmp_path / "a.gz").scan_count == 1
    assert read_log(tmp_path / "b").scan_count == 1


@pytest.mark.parametrize(
    ("content", "said"),
    [
        (b"", "is empty"),
        (b"\n# only comments\n", "has comments alone"),
        (b"# a log\rFLASER 0 0 0 0 0 0 0 1 n 1\r", "line 1 has carriage returns in it"),
        (b"# a log\r\n\r\nhello there\r\n", "line 3 begins 'hello there'"),
        (b"1 2 3 0 0 0 0 1\n", "line 1 begins '1 2 3 0 0 0 0 1'"),
        (b"hello there\n" * 2000, "line 1 begins 'hello there'"),
        (b"\x89PNG\r\n\x1a\n\0\0", "line 1: binary, not"),
        (b"\x1f\x8b", "the gzip file is cut or damaged after line 0"),
    ],
)
def test_foreign_or_empty_file_is_named_with_what_was_expected(tmp_path, content, said):
    (tmp_path / "a.x").write_bytes(content)
    with pytest.raises(ValueError, match=r"/a\.x") as caught:
        read_log(tmp_path / "a.x")
    assert said in str(caught.value)
    assert "\n" not in str(caught.value)


def test_trajectory_is_no_log():
    with pytest.raises(ValueError, match=r"expected a CARMEN log .* or encoder ticks"):
        read_log(DATA / "fr101-excerpt.reference.tum")


def test_cut_log_is_refused_before_any_scan_is_handed_out(tmp_path):
    (tmp_path / "a.gz").write_bytes(EXCERPT.read_bytes()[:-100])
    with pytest.raises(ValueError, match="cut or damaged"):
        read_log(tmp_path / "a.gz")


def test_messages_name_a_log_by_the_path_that_was_typed(tmp_path, monkeypatch):
    """Whoever has a robot.clf in each folder could not tell which one it was."""
    monkeypatch.chdir(tmp_path)
    Path("monday").mkdir()
    Path("monday/robot.clf").write_text("FLASER 2 1.0\n")
    with pytest.raises(ValueError, match=r"^monday/robot\.clf line 1: FLASER announces 2 ranges"):
        read_log("monday/robot.clf")
    blind = " ".join(["FLASER", "180", *["81.83"] * 180, *["0"] * 7, "host", "0"])
    Path("monday/robot.clf").write_text(f"{blind}\n")
    log = read_log("monday/robot.clf")
    with pytest.raises(ValueError, match=r"^monday/robot\.clf: none of the 1 scans has a beam"):
        log.check_sees()
    # in results it is called by its name, wherever it lies
    assert log.name == "robot.clf"

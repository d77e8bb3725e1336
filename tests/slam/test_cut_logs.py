"""Text logs cut in their last line: the line that names it says what to do."""

import pytest

from slam.readers.recognition import read_log

TOLD = r"; it is the last line and has no line end, as if cut: take it out"
FLASER = " ".join(["FLASER", "180", *["1.0"] * 180, *["0"] * 6, "1.0", "nohost", "1.0"])
ODOM = "ODOM 0 0 0 0 0 0 1.0 nohost 1.0"
TICKS = " ".join(["0", "0", "5", "5", *["0"] * 20, *["1000"] * 6])
CUTS = [
    (FLASER, ODOM[:12], "ODOM has 10 fields, found 5"),
    (FLASER, FLASER[:60], "FLASER announces 180 ranges, found 4"),
    (FLASER, "FLAS", "cut within its first word"),
    (TICKS, TICKS[:-5], "a line of ticks and ranges has 30 fields, found 29"),
]


@pytest.mark.parametrize(("whole", "cut", "said"), CUTS)
def test_last_line_that_is_cut_is_to_be_taken_out(tmp_path, whole, cut, said):
    path = tmp_path / "cut.log"
    path.write_text(f"{whole}\n{cut}")
    with pytest.raises(ValueError, match=rf"/cut\.log line 2: {said}{TOLD}$"):
        read_log(path)
    path.write_text(f"{whole}\n")
    assert read_log(path).scan_count == 1


@pytest.mark.parametrize(("whole", "cut", "said"), [c for c in CUTS if c[1] != "FLAS"])
def test_short_line_with_an_end_is_not_said_to_be_cut(tmp_path, whole, cut, said):
    for behind in ("\n", f"\n{whole}", f"\n{whole}\n"):
        (tmp_path / "short.log").write_text(f"{whole}\n{cut}{behind}")
        with pytest.raises(ValueError, match=rf"/short\.log line 2: {said}$"):
            read_log(tmp_path / "short.log")


def test_last_line_that_is_whole_needs_no_end(tmp_path):
    for whole in (FLASER, TICKS):
        (tmp_path / "a.log").write_text(f"{whole}\n{whole}")
        assert read_log(tmp_path / "a.log").scan_count == 2

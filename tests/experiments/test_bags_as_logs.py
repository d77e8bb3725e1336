"""ROS bags on the command line: mapped, localised on, and refused in one line."""

import sys
from pathlib import Path

import pytest

from experiments.cli import main
from tests.slam.turtlebot import Recording, write_bag

LOG = Path(__file__).parents[1] / "data" / "fr101-excerpt.clf.gz"


@pytest.mark.slow
def test_bag_is_mapped_and_localised_on_its_map(tmp_path, capsys):
    write_bag(tmp_path / "my_bag", Recording(duration_s=5.0))
    out = tmp_path / "slam"
    bag = str(tmp_path / "my_bag")
    assert (
        main(["slam", bag, "--scan-topic", "/scan", "--odom-topic", "/odom", "--out", str(out)])
        == 0
    )
    said = capsys.readouterr().out.splitlines()
    assert said[0].startswith(
        "scans of /scan, odometry of /odom; base_scan on base_footprint: x -0.0"
    )
    assert "25 scans" in said[1]
    options = ["--start", "0", "0", "0", "--mount", "-0.03", "0.01", "3.14159"]
    known = str(out / "map.kitasap")
    assert main(["localize", known, bag, *options, "--out", str(tmp_path / "there")]) == 0
    assert "180.0 degrees" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["slam", LOG, "--scan-topic", "/scan"], "are of ROS bags, and this is none"),
        (["localize", "map.yaml", LOG, "--mount", "nan", "0", "0"], "--mount takes three finite"),
        (
            ["slam", LOG, "--mount", "-120", "0", "0"],
            "--mount takes metres, and -120 0 is more than 10 m from the base",
        ),
        (
            ["localize", "map.yaml", LOG, "--mount", "0", "0", "180"],
            "--mount takes radians, and 180",
        ),
    ],
)
def test_option_that_does_not_serve_is_refused(tmp_path, capsys, arguments, said):
    assert main([*map(str, arguments), "--out", str(tmp_path)]) == 2
    err = capsys.readouterr().err
    assert said in err
    assert len(err.strip().splitlines()) == 1


def test_missing_library_is_named_with_the_extra(tmp_path, capsys, monkeypatch):
    (tmp_path / "b.mcap").write_bytes(b"\x89MCAP0\r\n")
    for name in [name for name in sys.modules if name.startswith("slam.readers.")]:
        if name.rsplit(".", maxsplit=1)[-1] in ("ros_bag", "bag_files"):
            monkeypatch.delitem(sys.modules, name)
    monkeypatch.setitem(sys.modules, "rosbags", None)
    assert main(["slam", str(tmp_path / "b.mcap"), "--out", str(tmp_path / "o")]) == 2
    assert "to read it rosbags is missing: pip install 'kitasap[ros]'" in capsys.readouterr().err

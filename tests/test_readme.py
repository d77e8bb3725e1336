"""The README's snippets do what they show."""

import re
import shutil
import subprocess
from pathlib import Path

import numpy as np
import pytest

from slam import Status, read_log

README = Path(__file__).resolve().parents[1] / "README.md"


def test_the_snippets_run_and_find_the_robot(capsys, tmp_path, monkeypatch):
    shutil.copy(README.parent / "tests/data/fr101-excerpt.clf.gz", tmp_path / "robot.clf.gz")
    monkeypatch.chdir(tmp_path)
    snippets = re.findall(r"```python\n(.*?)```", README.read_text(), flags=re.DOTALL)
    assert len(snippets) == 4
    names: dict = {}
    for snippet in snippets[:2]:
        exec(compile(snippet, str(README), "exec"), names)
    error = names["estimate"].T_map_base.as_array() - names["robot"].truth().pose
    assert names["estimate"].is_matched
    assert np.hypot(*error[:2]) < 0.01
    assert "SE2" in capsys.readouterr().out
    exec(compile(snippets[2], str(README), "exec"), names)
    assert [step.is_joined for step in (names["steps"][0], names["steps"][-1])] == [False, True]
    assert names["slam_map"].verdict.is_good
    assert names["estimates"][-1].verdict.status is Status.TRACKING
    # both sessions and the localizer went the same way
    there = names["slam_map"].trajectory_of(0).poses[-1]
    assert np.hypot(*(names["estimates"][-1].T_map_base.as_array() - there)[:2]) < 0.05
    exec(compile(snippets[3], str(README), "exec"), names)
    assert names["env"].observation_space.contains(names["observation"])
    assert names["many"].num_envs == 64
    names["many"].close()


def test_the_lines_that_cut_a_log_keep_every_scan_once_and_the_parameters_twice(tmp_path):
    log = README.parent / "tests/data/fr101-excerpt.clf.gz"
    shutil.copy(log, tmp_path / "robot.clf.gz")
    lines = [line for line in README.read_text().splitlines() if line.startswith("zcat robot")]
    assert [line.split()[-1] for line in lines] == ["first.clf", "second.clf"]
    # the excerpt has twenty scans
    script = "\n".join(lines).replace("146", "12")
    subprocess.run(["sh", "-ec", script], cwd=tmp_path, check=True)
    whole, *halves = (
        read_log(path) for path in (log, tmp_path / "first.clf", tmp_path / "second.clf")
    )
    assert [half.scan_count for half in halves] == [12, 8]
    assert [half.T_base_laser for half in halves] == [whole.T_base_laser] * 2
    stamps = [[record.time_s for record in one.records] for one in (whole, *halves)]
    assert stamps[0] == stamps[1] + stamps[2]


@pytest.mark.parametrize(
    "term", ["Right", "wrong", "Good", "failed", "right and good", "wrong and good"]
)
def test_what_the_table_of_map_ends_is_of_is_said_before_it(term):
    before, _ = README.read_text().split("| maps | of | right and good |")
    assert f"*{term}*" in before.split("#### How maps end")[1]


def test_the_links_and_pictures_are_there():
    for target in re.findall(r"\]\(([^)#:]+)\)", README.read_text()):
        assert (README.parent / target).is_file(), target


def test_the_tests_that_it_names_are_where_it_says():
    """It once named those of `tests/slam` without their folders."""
    tests = README.parent / "tests"
    named = re.findall(r"`([\w/]*test_\w+\.py)`", README.read_text())
    assert len(named) >= 30  # or the pattern finds no table
    for path in named:
        # the tables say above them that theirs are below tests/slam
        assert any((folder / path).is_file() for folder in (README.parent, tests / "slam")), path

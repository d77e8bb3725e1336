"""The README's snippets do what they show."""

import re
import shutil
from pathlib import Path

import numpy as np

from slam import Status

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


def test_the_links_and_pictures_are_there():
    for target in re.findall(r"\]\(([^)#:]+)\)", README.read_text()):
        assert (README.parent / target).is_file(), target

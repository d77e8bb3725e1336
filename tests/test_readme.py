"""The README's snippets do what they show."""

import re
from pathlib import Path

import numpy as np

README = Path(__file__).resolve().parents[1] / "README.md"


def test_the_snippets_run_and_find_the_robot(capsys):
    snippets = re.findall(r"```python\n(.*?)```", README.read_text(), flags=re.DOTALL)
    assert len(snippets) == 2
    names: dict = {}
    for snippet in snippets:
        exec(compile(snippet, str(README), "exec"), names)
    error = names["estimate"].T_map_base.as_array() - names["robot"].truth().pose
    assert names["estimate"].is_matched
    assert np.hypot(*error[:2]) < 0.01
    assert "SE2" in capsys.readouterr().out


def test_the_links_and_pictures_are_there():
    for target in re.findall(r"\]\(([^)#:]+)\)", README.read_text()):
        assert (README.parent / target).is_file(), target

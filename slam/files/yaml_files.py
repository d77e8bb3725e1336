"""YAML files of strangers: text and lists of text, nothing made of them, nothing repeated."""

from __future__ import annotations

from pathlib import Path

import yaml

from slam.files.whole_files import read_at_most

_MOST_BYTES = 500_000
"""Chosen: a map's has 200, a floor plan of a hundred rooms 20 000."""
_SHOWN = 80


class _TextLoader(yaml.BaseLoader):
    """Scalars stay text, as in the readers of ROS: YAML 1.1 takes 1e-3 for a word, and yes for 1.

    Tags are passed over: none makes an object. Aliases are refused: a few lines of them make a
    billion words.
    """

    def compose_node(self, parent: yaml.Node | None, index: int) -> yaml.Node | None:
        if self.check_event(yaml.AliasEvent):
            mark = self.peek_event().start_mark
            raise yaml.YAMLError(f"an alias in line {mark.line + 1}, which is not read here")
        node: yaml.Node | None = super().compose_node(parent, index)
        return node


def read_yaml(path: Path) -> object:
    """What a YAML file says, of text, lists and dicts alone.

    Raises ValueError, one line that names the file, for one that is none, is longer than half a
    megabyte or has aliases; OSError when it cannot be opened.
    """
    content = read_at_most(path, _MOST_BYTES)
    try:
        return yaml.load(content, Loader=_TextLoader)
    except (yaml.YAMLError, RecursionError, ValueError) as error:
        reason = " ".join(str(error).split())
        raise ValueError(f"{path}: not a YAML file ({reason})") from error


def shown(value: object) -> str:
    """A value in a message: the beginning of what is long."""
    text = repr(value)
    return text if len(text) <= _SHOWN else f"{text[:_SHOWN]}..."

"""`kitasap localize` in a line: what was found, and what was never lost."""

import pytest

from experiments.localize import table

START = [0.0, 0.0, 0.0]


@pytest.mark.parametrize(
    ("start", "lost", "recoveries_s", "said"),
    [
        (None, 3, [], "never found"),
        (None, 0, [2.5], "found once, after 2.5 s"),
        (None, 5, [2.5, 1.0], "found 2 times, after 2.5 s at most"),
        # this once was "never found", of a robot that followed itself from its start to the end
        (START, 0, [], "never lost since the start that was given"),
        (START, 4, [], "not found again"),
        (START, 4, [2.0], "lost and found again once, after 2.0 s"),
    ],
)
def test_line_tells_recoveries_only_where_something_was_lost(start, lost, recoveries_s, said):
    counts = {"scans": 9, "tracking": 9 - lost, "unsure": 0, "lost": lost}
    line = table({"log": "a", "map": "b", "start": start, "recoveries_s": recoveries_s} | counts)
    assert line.endswith(f" {lost} lost; {said}")

"""A start that was typed, and whether it is on a map."""

from __future__ import annotations

from slam.se2 import SE2


def check_start(start: SE2, off_m: float, reach_m: float, of: str) -> None:
    """Raises ValueError for a start farther off what a map shows than that is seen from: nothing that is seen
    there can be on it. of: whose reach that is, in a word."""
    if reach_m < off_m:
        raise ValueError(
            f"--start {start.x:g} {start.y:g} lies {off_m:.0f} m off the map, whose {of}"
            f" {reach_m:.0f} m: give a pose on it, or none to have it searched for"
        )

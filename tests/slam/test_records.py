"""Dataclasses that are made for each scan."""

from dataclasses import fields, replace

import numpy as np

from slam.records import record


@record
class Seen:
    pose: np.ndarray
    count: int = 0

    @property
    def has_any(self) -> bool:
        """Whether something was seen."""
        return self.count > 0


def test_a_record_is_a_dataclass():
    seen = Seen(np.zeros(3), count=2)
    assert [one.name for one in fields(seen)] == ["pose", "count"]
    assert seen.has_any
    assert not replace(seen, count=0).has_any


def test_records_are_told_apart_by_what_they_are_not_by_what_they_hold():
    pose = np.zeros(3)
    one, other = Seen(pose), Seen(pose)
    assert one != other
    assert len({one, other, one}) == 2

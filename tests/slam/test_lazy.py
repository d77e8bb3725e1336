"""What is computed once, when somebody first asks."""

from dataclasses import dataclass, replace

from slam.lazy import lazy


@dataclass(frozen=True)
class Doubled:
    number: int

    @lazy
    def twice(self) -> list[int]:
        """Twice the number."""
        return [2 * self.number]


def test_it_is_computed_once_and_anew_for_another():
    one = Doubled(3)
    assert one.twice == [6]
    assert one.twice is one.twice
    assert replace(one, number=4).twice == [8]


def test_the_class_shows_what_it_is():
    assert Doubled.twice.__doc__ == "Twice the number."

"""Runs cut into shards: which trials are whose."""

from dataclasses import dataclass


@dataclass(frozen=True)
class Shard:
    """One of so many parts of a run: every count-th trial, from the number-th on."""

    number: int = 1
    count: int = 1

    @classmethod
    def parsed(cls, text: str) -> "Shard":
        """Of "2/4". Raises ValueError for anything else."""
        number, slash, count = text.partition("/")
        is_whole = slash and number.isascii() and count.isascii()
        if not (is_whole and number.isdigit() and count.isdigit()):
            raise ValueError(f"a shard is given as 2/4, the second of four, not as '{text}'")
        if not 1 <= int(number) <= int(count):
            raise ValueError(f"there is no shard {text}: the first of four is 1/4, the last 4/4")
        return cls(int(number), int(count))

    def indices(self, trials: int) -> range:
        """Whose trials these are, of so many."""
        return range(self.number - 1, trials, self.count)

    @property
    def words(self) -> str:
        """As messages call it."""
        return "all trials" if self == WHOLE else f"shard {self}"

    def __str__(self) -> str:
        return f"{self.number}/{self.count}"


WHOLE = Shard()
"""A run that is not cut."""

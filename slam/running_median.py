"""The median of the last of many values."""

from bisect import bisect_left, insort
from collections import deque


class RunningMedian:
    """Of the last `most` values; kept in order, so that a value more costs no sorting."""

    def __init__(self, most: int) -> None:
        self._most = most
        self._last: deque[float] = deque()
        self._in_order: list[float] = []

    def __len__(self) -> int:
        return len(self._last)

    def take(self, value: float) -> None:
        """Another value, which is a number and no NaN: that has no place in an order."""
        if len(self._last) == self._most:
            del self._in_order[bisect_left(self._in_order, self._last.popleft())]
        self._last.append(value)
        insort(self._in_order, value)

    @property
    def median(self) -> float:
        """The mean of the two in the middle of an even number. Raises IndexError: there is no value."""
        half, is_odd = divmod(len(self._in_order), 2)
        if is_odd:
            return self._in_order[half]
        return (self._in_order[half - 1] + self._in_order[half]) / 2.0

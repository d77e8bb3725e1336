"""Intervals that hold however often one looks, and stopping by them.

An interval of 95 % for a fixed number of trials does not hold 95 % of the time for somebody who
looks again and again and stops when he likes what he sees. A confidence sequence does: with a
probability of 95 % the true rate lies in all of its intervals at once (Robbins, Ann. Math. Stat.
41, 1970), so in the one at which it is stopped too. The price is their width, some two thirds more.
"""

import math
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

_ALPHA = 0.05
_HALF = 0.5
"""Of the mixture, Beta(1/2, 1/2): narrow where rates are near 0 or 1, as ours are."""
_BISECTIONS = 50
_LOOK = 20
"""Chosen: trials from one look to the next, and a tenth of them from 200 on."""


def rate_interval(successes: int, trials: int) -> tuple[float, float]:
    """95 % confidence sequence of a success rate, at so many independent trials.

    Those rates at which the trials so far are no less than a twentieth as likely as on average over
    Beta(1/2, 1/2): that quotient is a martingale at the true rate, and Ville's inequality says that
    it ever exceeds 20 with a probability of 5 % at most.
    """
    if trials == 0:
        return 0.0, 1.0
    mixed = _log_beta(successes + _HALF, trials - successes + _HALF) - _log_beta(_HALF, _HALF)
    least = mixed + math.log(_ALPHA)
    rate = successes / trials

    def is_inside(p: float) -> bool:
        return _log_likelihood(p, successes, trials) >= least

    low = 0.0 if successes == 0 else _boundary(is_inside, rate, 0.0)
    high = 1.0 if successes == trials else _boundary(is_inside, rate, 1.0)
    return low, high


@dataclass(frozen=True)
class RatesKnown:
    """Enough are the first trials at which every method's interval is narrow.

    half_width: of it, at most; methods: whose success is counted.
    Raises ValueError for one that no interval can have.
    """

    half_width: float
    methods: tuple[str, ...]

    def __post_init__(self) -> None:
        if not 0.001 <= self.half_width < 0.5:
            raise ValueError(f"--until-ci lies from 0.001 to below 0.5, not at {self.half_width}")

    @property
    def looks(self) -> list[int]:
        """After how many trials it is asked: the same however they are spread over processes."""
        looks, most = [_LOOK], 4.0 / self.half_width**2
        while looks[-1] < most:  # by then the widest of all is narrow
            looks.append(max(looks[-1] + _LOOK, int(1.1 * looks[-1])))
        return looks

    def __call__(self, records: Iterable[dict[str, Any]]) -> bool:
        """Whether each method's success rate is known so well by these trials."""
        trials, won = 0, dict.fromkeys(self.methods, 0)
        for record in records:
            trials += 1
            for name in self.methods:
                won[name] += record["status"] == "ok" and record["methods"][name]["success"]
        intervals = [rate_interval(count, trials) for count in won.values()]
        return all((high - low) / 2 <= self.half_width for low, high in intervals)


def _boundary(is_inside: Any, inside: float, outside: float) -> float:
    for _ in range(_BISECTIONS):
        middle = (inside + outside) / 2
        inside, outside = (middle, outside) if is_inside(middle) else (inside, middle)
    return outside


def _log_likelihood(p: float, successes: int, trials: int) -> float:
    """Of so many successes, at a rate; the order in which they came is given."""
    told = 0.0
    for count, chance in ((successes, p), (trials - successes, 1.0 - p)):
        if count:
            told += count * math.log(chance) if chance > 0.0 else -math.inf
    return told


def _log_beta(a: float, b: float) -> float:
    return math.lgamma(a) + math.lgamma(b) - math.lgamma(a + b)

"""Whether a map holds together: what its scans say against one another, and where it is torn."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from slam.arrays import BoolArray, FloatArray, IntArray
from slam.frontend.kept_keyframes import has_scan
from slam.frontend.keyframes import Keyframe
from slam.frontend.witnesses import Witnesses
from slam.kernels.near_keyframes import pairs_near
from slam.loop_closing import Loop, without_ties
from slam.map_checks.driven_through import driven_through
from slam.map_checks.pieces import Pieces

_FEW = 20
"""Chosen: points in view, of two scans together, that say nothing of them."""


@dataclass(frozen=True)
class ConsistencyConfig:
    """When a map is called failed.

    radius_m: keyframes so near to one another should agree; apart: unless so few lie between them.
    most_pairs: looked at. most_passed: share of the points in view, over all pairs, that another
    scan's beams went through, by margins [m] and as a share, and aside_m to either side: see
    `Witnesses`; 0.021 and less on 100 right maps, some with a third of their beams lost. bad_pair:
    a pair in which so many were; from a share of doubtful_pairs on, more loops may help; most_bad_pairs:
    share of those that scans beside either bear out, 0.0053 and less of 44 right maps of simulated
    buildings and 0 of aces, fr101, mit-csail and mines-exp2; most_bad_alone: of all bad pairs, whether borne out or
    not: scans that lie wrong one by one have none beside them that say so. most_through, most_walls: scans that saw
    something on the way that the robot drove, and those in which it was no closed door; two at most on
    four real logs, ten and more on wrong maps. beside: so few
    keyframes off, one loop says what another does. most_rejected: share of the loops that the others
    contradict. most_across: pairs looked at of which one was taken before the scans broke off and one
    after; more_passed: by which more points may be passed there than twice as many as elsewhere: at
    most -0.02 where a piece lay right, 0.02 and more where it had been tied to a place that looks the
    same. Chosen on maps of five buildings and on the same maps with errors put in.
    """

    radius_m: float = 3.0
    apart: int = 10
    most_pairs: int = 1500
    most_passed: float = 0.04
    bad_pair: float = 0.25
    most_bad_pairs: float = 0.01
    most_bad_alone: float = 0.04
    doubtful_pairs: float = 0.0075
    most_through: int = 14
    most_walls: int = 5
    beside: int = 10
    most_rejected: float = 0.35
    margins: tuple[float, float] = (0.25, 0.03)
    aside_m: float = 0.1
    most_across: int = 300
    more_passed: float = 0.015


@dataclass(frozen=True)
class MapVerdict:
    """Whether a map is to be used. passed_ratio, bad_pairs: what its scans say against it; pairs:
    how many could be asked. reasons: in words, why not."""

    is_good: bool
    passed_ratio: float
    bad_pairs: float
    pairs: int
    reasons: tuple[str, ...] = ()

    def with_reasons(self, reasons: Sequence[str]) -> MapVerdict:
        """The verdict with more to be said against the map; the same, if there is none."""
        said = tuple(dict.fromkeys((*self.reasons, *reasons)))
        return replace(self, is_good=self.is_good and not reasons, reasons=said)

    @property
    def doubt(self) -> tuple[bool, float]:
        """Less is better: first whether it is good, then what its scans say against it."""
        return not self.is_good, self.passed_ratio + self.bad_pairs


def judged(
    keyframes: Sequence[Keyframe],
    poses: FloatArray,
    loops: Sequence[Loop],
    rejected: Sequence[Loop],
    config: ConsistencyConfig | None = None,
) -> MapVerdict:
    """The verdict on a map of keyframes at poses (K, 3), with the loops that were kept and not."""
    config = config or ConsistencyConfig()
    near = _NearScans(keyframes, poses, config)
    said = _contradicted(near.witnesses, near.pairs(config.most_pairs), config)
    reasons = [*_torn(keyframes, loops, poses), *_drove_through(keyframes, poses, config)]
    reasons += _misplaced(keyframes, near, config)
    if said.passed_ratio > config.most_passed:
        reasons.append(
            f"{100 * said.passed_ratio:.0f} % of what scans saw is where others saw nothing"
        )
    are_alone = said.bad_pairs > config.most_bad_alone
    if are_alone or said.borne_out > config.most_bad_pairs:
        share = said.bad_pairs if are_alone else said.borne_out
        reasons.append(
            f"{100 * share:.0f} % of {said.pairs} pairs of scans of one place contradict each other"
        )
    bad, count = (len(without_ties(found)) for found in (rejected, (*loops, *rejected)))
    if count >= 10 and bad > config.most_rejected * count:
        reasons.append(f"{bad} of {count} loops contradict the others")
    return MapVerdict(not reasons, said.passed_ratio, said.bad_pairs, said.pairs, tuple(reasons))


def leaves_no_doubt(verdict: MapVerdict, config: ConsistencyConfig | None = None) -> bool:
    """Whether a map is to be used though the same scans made one before that had failed: who looks
    twice is wrong twice as often, so that far less than usual may speak against it."""
    config = config or ConsistencyConfig()
    is_quiet = verdict.passed_ratio <= 0.5 * config.most_passed
    return verdict.is_good and is_quiet and verdict.bad_pairs <= config.doubtful_pairs


def acquitted(
    verdict: MapVerdict,
    keyframes: Sequence[Keyframe],
    loops: Sequence[Loop],
    rejected: Sequence[Loop],
    config: ConsistencyConfig,
) -> MapVerdict:
    """The verdict on a map that had failed, and is content with loops of which less was asked.

    A wrong map may be content as well: it is good only if it leaves no doubt, and if beside each loop
    that was rejected another was kept. One that stands alone may be right, and the map open there.
    """
    reasons = []
    if verdict.is_good and verdict.bad_pairs > config.doubtful_pairs:
        reasons.append(
            f"more than {100 * config.doubtful_pairs:g} % of pairs of scans of one place contradict"
            " each other still, with loops of which less was asked"
        )
    for one in rejected:
        ends = (one.earlier, one.later)
        if not one.is_tie and all(
            _apart(ends, (loop.earlier, loop.later)) > config.beside for loop in without_ties(loops)
        ):
            reasons.append(
                f"the scans at {keyframes[one.earlier].time_s:.2f} s and"
                f" {keyframes[one.later].time_s:.2f} s may show one place, which the map has twice"
            )
            break
    return verdict.with_reasons(reasons)


def _apart(one: tuple[int, int], other: tuple[int, int]) -> int:
    """Keyframes between two loops, at the ends where there are more."""
    return max(abs(a - b) for a, b in zip(one, other, strict=True))


def do_contradict(
    keyframes: Sequence[Keyframe], poses: FloatArray, first: int, config: ConsistencyConfig
) -> bool:
    """Whether keyframes from the first of a session on cannot be where they are, by those before; all bad pairs
    count, whether others bear them out or not."""
    near = _NearScans(keyframes, poses, config)
    sides = np.arange(len(keyframes)) >= first
    pairs = near.pairs(config.most_pairs, sides, is_within=False)
    said = _contradicted(near.witnesses, pairs, config)
    return said.passed_ratio > config.most_passed or said.bad_pairs > config.most_bad_pairs


def unjoined_sessions(keyframes: Sequence[Keyframe], loops: Sequence[Loop]) -> tuple[int, ...]:
    """Sessions, from 0, that no loop ties to any before."""
    pieces = Pieces(keyframes, loops)
    first = keyframes[0].session if keyframes else 0
    sessions = [first, *(keyframes[k].session for k in pieces.breaks)]
    return tuple(
        session
        for session in sorted(set(sessions))[1:]
        if min(pieces.joined[k] for k, other in enumerate(sessions) if other == session)
        >= sessions.index(session)
    )


def _torn(keyframes: Sequence[Keyframe], loops: Sequence[Loop], poses: FloatArray) -> list[str]:
    """Where the scans broke off, and loops do not tie what came after to what was before."""
    pieces = Pieces(keyframes, loops, poses)
    unjoined, reasons = unjoined_sessions(keyframes, loops), []
    for piece in sorted(set(pieces.joined) - {0}):
        begun = pieces.breaks[piece - 1]
        before, after = keyframes[begun - 1], keyframes[begun]
        if after.session > before.session and after.session in unjoined:
            reasons.append(
                f"session {after.session + 1}, from {after.time_s:.2f} s on, was never joined with"
                " the map before it"
            )
        else:
            reasons.append(
                f"the scans broke off at {after.time_s:.2f} s, and no two loops tie what came after"
                " to what was before"
            )
    return reasons


def _misplaced(
    keyframes: Sequence[Keyframe], near: _NearScans, config: ConsistencyConfig
) -> list[str]:
    """Where the scans broke off, and those after are at odds with those before, more than others."""
    numbers = np.arange(len(keyframes))
    breaks = [
        k
        for k in range(1, len(keyframes))
        if keyframes[k].is_break and keyframes[k].session == keyframes[k - 1].session
    ]
    if not breaks:
        return []
    pieces = np.searchsorted(breaks, numbers, side="right")
    within = near.pairs(config.most_pairs, pieces)
    usual = _contradicted(near.witnesses, within, config).passed_ratio
    reasons = []
    for k in breaks:
        across = near.pairs(config.most_across, numbers >= k, is_within=False)
        passed_ratio = _contradicted(near.witnesses, across, config).passed_ratio
        if passed_ratio > 2.0 * usual + config.more_passed:
            reasons.append(
                f"the scans broke off at {keyframes[k].time_s:.2f} s, and {100 * passed_ratio:.1f} %"
                " of what was seen on one side of that is where the other saw nothing, of the rest"
                f" {100 * usual:.1f} %: the place may be another that looks the same"
            )
    return reasons


def _drove_through(
    keyframes: Sequence[Keyframe], poses: FloatArray, config: ConsistencyConfig
) -> list[str]:
    """Where the robot drove through what many scans saw."""
    found = [
        one
        for one in driven_through(keyframes, poses, config.margins)
        if one.scans > config.most_through or one.walls > config.most_walls
    ]
    if not found:
        return []
    worst = max(found, key=lambda one: (one.scans, one.walls))
    return [
        f"the robot drove through a wall at {keyframes[worst.keyframe].time_s:.2f} s, which"
        f" {worst.scans} scans saw there"
    ]


class _NearScans:
    """Scans of a map that should agree with one another, two and two: those of which more than the place is
    kept, so that there are as many as there is to see, however long the drive was."""

    def __init__(
        self, keyframes: Sequence[Keyframe], poses: FloatArray, config: ConsistencyConfig
    ) -> None:
        """poses: (K, 3) of the keyframes."""
        self.witnesses = Witnesses(keyframes, poses, config.margins, config.aside_m)
        self._asked = np.flatnonzero([has_scan(keyframes, k) for k in range(len(keyframes))])
        # a copy: to a kernel, arrays that may be written to are another type than those that may not
        self._poses, self._near = np.array(poses, order="C"), (config.radius_m, config.apart)

    def pairs(
        self, most: int, pieces: IntArray | BoolArray | None = None, *, is_within: bool = True
    ) -> IntArray:
        """(P, 2) so many of the pairs at most, evenly among all, in the order of their numbers; is_within: both of one
        of pieces (K,), which never decrease, else of two."""
        of_asked = np.zeros(len(self._asked), np.int64)
        if pieces is not None:
            of_asked[:] = pieces[self._asked]

        def every(step: int, found: IntArray) -> int:
            scans = self._poses, self._asked, of_asked
            return int(pairs_near(*scans, is_within, *self._near, step, found))

        count = every(1, np.empty((0, 2), np.int64))
        step = max(1, math.ceil(count / most))
        found = np.empty((math.ceil(count / step), 2), np.int64)
        every(step, found)
        return found


class _Contradictions(NamedTuple):
    """Shares of points in view that were passed, of bad pairs, and of those that scans beside bear out; pairs
    asked."""

    passed_ratio: float
    bad_pairs: float
    borne_out: float
    pairs: int


def _contradicted(
    witnesses: Witnesses, pairs: IntArray, config: ConsistencyConfig
) -> _Contradictions:
    """What pairs (P, 2) of keyframes say."""
    seen_all = passed_all = bad = borne_out = asked = 0
    for one, other in pairs.tolist():
        seen, through = witnesses.passed(one, other)
        if seen < _FEW:
            continue
        asked += 1
        if _is_bad(seen, through, config):
            bad += 1
            borne_out += _is_borne_out(witnesses, one, other, config)
        seen_all, passed_all = seen_all + seen, passed_all + through
    most = max(asked, 1)
    return _Contradictions(passed_all / max(seen_all, 1), bad / most, borne_out / most, asked)


def _is_bad(seen: int, through: int, config: ConsistencyConfig) -> bool:
    return seen >= _FEW and through > config.bad_pair * seen


def _is_borne_out(witnesses: Witnesses, one: int, other: int, config: ConsistencyConfig) -> bool:
    """Whether scans beside either of a bad pair say so too: what all but one of them deny, as of somebody who
    stood before the laser, is wrong with that scan and not with where the map has it."""
    return all(
        any(_is_bad(*witnesses.passed(next_to, across), config) for next_to in witnesses.next_to(k))
        for k, across in ((one, other), (other, one))
    )

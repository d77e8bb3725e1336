"""A run held against its baseline: what is tested, how, and what came out."""

from dataclasses import dataclass
from typing import Any, Literal

import numpy as np

from experiments.gate.baseline import RunValues
from experiments.gate.columns import Columns, compared_columns, usual
from experiments.gate.permutation import Scores, adjusted_p
from experiments.gate.quantities import QUANTITIES, Quantity
from slam.arrays import FloatArray

ALPHA = 0.01
MARGIN = 0.05
_MANY = 64
"""Chosen: as many questions that tell different things are about what a check asks."""
_SHARES = {True: 0.25, False: 0.75}
"""Of the error rate, for events and for all else; chosen. Of many sizes one or the other is always far
off by chance: asked along with these, a robot that no longer localises at all was nothing special."""
Verdict = Literal["equal", "no worse", "worse", "better"]


@dataclass(frozen=True)
class Finding:
    """One quantity of one method.

    old, new: how often an event happened, and of how many; of others the median. change: of
    others, by what factor: of pairs the median of their ratios. p: of being worse, corrected for
    all that is tested. newly: trials of pairs in which the event is new.
    """

    experiment: str
    method: str
    quantity: Quantity
    old: float
    new: float
    counts: tuple[int, int]
    change: float | None
    p: float
    verdict: Verdict
    newly: tuple[int, ...] = ()


@dataclass(frozen=True)
class RunCheck:
    """One run of a check. paired: by how many trials, None where the seeds are others; same: the
    results are, to the byte."""

    old: RunValues
    new: RunValues
    paired: int | None
    same: bool
    findings: list[Finding]


@dataclass(frozen=True)
class Check:
    """All runs, and the error rate of all tests together."""

    runs: list[RunCheck]
    alpha: float
    margin: float
    tests: int

    @property
    def findings(self) -> list[Finding]:
        """Of all runs."""
        return [finding for run in self.runs for finding in run.findings]

    @property
    def worse(self) -> list[Finding]:
        """The regressions."""
        return [finding for finding in self.findings if finding.verdict == "worse"]


@dataclass(frozen=True, eq=False)
class _Compared:
    """Two runs, with the columns of all their quantities, one set for each way of shuffling.

    A few pairs leave swapping too few ways to tell anything that many questions asked would not: ten
    have 1024. They are asked as if they were no pairs, too: of trials that are alike, that finds too
    little rather than too much.
    """

    old: RunValues
    new: RunValues
    columns: list[list[Columns]]
    new_counts: list[int | None]

    @classmethod
    def of(cls, old: RunValues, new: RunValues, alpha: float, margin: float) -> "_Compared":
        """Raises ValueError where the trials are too few to ever show anything."""
        pairs = min(old.trials, new.trials) if old.seed == new.seed else None
        ways: list[int | None] = [pairs]
        if pairs is not None and 0.5**pairs > ALPHA / _MANY:
            ways.append(None)
        columns = [
            [
                compared_columns(old, new, method, name, margin, way)
                for method in new.methods
                for name in QUANTITIES
                if name in new.values[method] or name in old.values[method]
            ]
            for way in ways
        ]
        if len(columns) > 1:
            columns[1] = [usual(one) for one in columns[1]]
        new_counts = [new.trials if way is None else None for way in ways]
        _check_can_show(old, new, alpha)
        return cls(old, new, columns, new_counts)

    @property
    def is_paired(self) -> bool:
        """Whether the trials of both have the same random numbers."""
        return self.new_counts[0] is None

    def scores(self, side: str, of_events: bool) -> list[Scores]:
        """Of being worse, or of being better."""
        asked = [
            [getattr(one, side) for one in columns if one.quantity.is_event is of_events]
            for columns in self.columns
        ]
        return [
            Scores(np.concatenate(scores, axis=1), count)
            for scores, count in zip(asked, self.new_counts, strict=True)
            if scores
        ]


def _check_can_show(old: RunValues, new: RunValues, alpha: float) -> None:
    """Raises ValueError where the trials are too few to ever show anything: even an event that never
    was and now is in all of them."""
    if _least_p(old.trials, new.trials) <= _SHARES[True] * alpha:
        return
    needed = 1
    while _least_p(needed, needed) > _SHARES[True] * alpha:
        needed += 1
    short = "run" if new.trials < old.trials else "baseline"
    short = "both" if new.trials == old.trials else f"the {short}"
    raise ValueError(
        f"{new.trials} trials of {new.experiment}, held against {old.trials}, can never show a"
        f" regression at alpha {alpha}, whatever they hold: make {short} anew with --trials"
        f" {needed} or more, or choose a larger --alpha"
    )


def _least_p(old: int, new: int) -> float:
    """What p is where all trials of one run have an event, and none of the other."""
    return Scores(np.zeros((old + new, 1)), new).least_p


def checked(
    pairs: list[tuple[RunValues, RunValues]],
    alpha: float = ALPHA,
    margin: float = MARGIN,
    *,
    allowed: tuple[str, ...] = (),
) -> Check:
    """Holds runs against their baselines, (old, new) each.

    alpha: how often one or more quantities come out as worse, if none is. margin: by what share
    errors may grow before they are worse. allowed: settings that may differ.
    Raises ValueError where two runs cannot be compared, or are too short to ever show anything.
    """
    if not (0.001 <= alpha <= 0.5 and 0.0 <= margin <= 1.0):
        raise ValueError(
            f"an alpha from 0.001 to 0.5 and a margin from 0 to 1 are needed, not {alpha} and {margin}"
        )
    for old, new in pairs:
        check_comparable(old, new, allowed)
    compared = [_Compared.of(old, new, alpha, margin) for old, new in pairs]
    p_worse, tests = _adjusted(compared, "worse")
    p_better, _ = _adjusted(compared, "better")
    runs = []
    for each, worse, better in zip(compared, p_worse, p_better, strict=True):
        findings = [
            _finding(each, one, p, p_other, alpha)
            for one, p, p_other in zip(each.columns[0], worse, better, strict=True)
        ]
        paired = min(each.old.trials, each.new.trials) if each.is_paired else None
        same = each.old.results == each.new.results
        runs.append(RunCheck(each.old, each.new, paired, same, findings))
    return Check(runs, alpha, margin, tests)


def check_comparable(old: RunValues, new: RunValues, allowed: tuple[str, ...] = ()) -> None:
    """Raises ValueError, naming what differs, where two runs are of other things."""
    if old.experiment != new.experiment:
        raise ValueError(f"the baseline is of {old.experiment}, the run of {new.experiment}")
    differing = [name for name in differences(old, new) if name not in allowed]
    if differing:
        told = "; ".join(
            f"{name} is {_word(old.config[name])} in the baseline and {_word(new.config[name])} in the run"
            for name in differing
        )
        how = (
            "--method compares some methods alone"
            if "methods" in differing
            else f"--allow {','.join(differing)} compares them all the same"
        )
        raise ValueError(f"{new.experiment} cannot be compared: {told}; {how}")
    if _has_changed(old, new) and "place" not in allowed:
        raise ValueError(
            f"{new.experiment} cannot be compared: {_word(new.config['place'])}, or a file that it"
            " includes, has changed since the baseline was made; make the baseline anew, or --allow"
            " place compares them all the same"
        )


def _has_changed(old: RunValues, new: RunValues) -> bool:
    """Whether something else stands in the place now; another MuJoCo may compile it to other numbers."""
    shapes = old.inputs.get("shape"), new.inputs.get("shape")
    if None in shapes or shapes[0] == shapes[1]:
        return False
    return bool(old.inputs["versions"].get("mujoco") == new.inputs["versions"].get("mujoco"))


def differences(old: RunValues, new: RunValues) -> list[str]:
    """The settings that are not the same; of methods the order is nothing."""
    return [
        name
        for name in new.config
        if (
            set(old.config[name]) != set(new.config[name])
            if name == "methods"
            else old.config[name] != new.config[name]
        )
    ]


def _word(value: Any) -> str:
    return ",".join(map(str, value)) if isinstance(value, list) else str(value)


def _adjusted(compared: list[_Compared], side: str) -> tuple[list[list[float]], int]:
    """The least corrected p of each quantity's questions, by run; and how many were asked."""
    by_run, asked = [np.ones(len(each.columns[0])) for each in compared], 0
    for of_events, share in _SHARES.items():
        _, adjusted = adjusted_p(
            [scores for each in compared for scores in each.scores(side, of_events)]
        )
        adjusted, at = adjusted / share, 0
        for each, least in zip(compared, by_run, strict=True):
            for columns in each.columns:
                for number, one in enumerate(columns):
                    if one.quantity.is_event is of_events:
                        width = getattr(one, side).shape[1]
                        least[number] = adjusted[at : at + width].min(initial=least[number])
                        at += width
        asked += at
    return [least.tolist() for least in by_run], asked


def _finding(each: _Compared, one: Columns, p: float, p_better: float, alpha: float) -> Finding:
    run, is_paired = each.new, each.is_paired
    quantity = one.quantity
    told = (int(np.isfinite(one.old).sum()), int(np.isfinite(one.new).sum()))
    if p <= alpha:
        verdict: Verdict = "worse"
    elif p_better <= alpha:
        verdict = "better"
    elif is_paired and _is_equal(one):
        verdict = "equal"
    else:
        verdict = "no worse"
    if quantity.is_event:
        is_new = (one.new == 1.0) & (one.old == 0.0)
        newly = tuple(np.nonzero(is_new)[0].tolist()) if is_paired else ()
        old, new = float(np.nansum(one.old)), float(np.nansum(one.new))
        return Finding(
            run.experiment, one.method, quantity, old, new, told, None, p, verdict, newly
        )
    old, new = _median(one.old), _median(one.new)
    change = _factor(one, is_paired)
    return Finding(run.experiment, one.method, quantity, old, new, told, change, p, verdict)


def _is_equal(one: Columns) -> bool:
    """Whether no trial differs by more than rounding does, wherever it was run."""
    both = np.isfinite(one.old) == np.isfinite(one.new)
    off = np.abs(one.new - one.old)
    return bool(both.all() and (off[np.isfinite(off)] <= one.quantity.floor).all())


def _factor(one: Columns, is_paired: bool) -> float | None:
    old, new = (np.maximum(values, one.quantity.floor) for values in (one.old, one.new))
    if is_paired:
        ratios = new / old
        ratios = ratios[np.isfinite(ratios)]
        return float(np.median(ratios)) if ratios.size else None
    before = _median(old)
    return _median(new) / before if before > 0.0 else None


def _median(values: FloatArray) -> float:
    told = values[np.isfinite(values)]
    return float(np.median(told)) if told.size else float("nan")


def matched(
    old: list[RunValues], new: list[RunValues], allowed: tuple[str, ...] = ()
) -> list[tuple[RunValues, RunValues]]:
    """Each run with the one of the baseline that is of the same.

    Raises ValueError where one of either has no counterpart, or two.
    """
    known = new[0].config
    if odd := [name for name in allowed if name not in known or name == "methods"]:
        raise ValueError(f"--allow takes settings of a run, not '{odd[0]}': {', '.join(known)}")
    pairs, free = [], list(old)
    for run in new:
        same = [one for one in free if one.experiment == run.experiment]
        if not same:
            raise ValueError(
                f"the baseline has no {run.experiment} (more) to hold the run against; it has"
                f" {', '.join(one.experiment for one in old)}"
            )
        # where settings differ, the nearest one tells best in what
        best = min(same, key=lambda one: len(set(differences(one, run)) - set(allowed)))
        free.remove(best)
        pairs.append((best, run))
    if free:
        raise ValueError(
            f"the baseline has {free[0].experiment} too, and there is no such run: run it as well"
        )
    return pairs

"""What a check says: a table for people, and JUnit's XML for CI systems."""

import xml.etree.ElementTree as ET
from pathlib import Path

from rich import box
from rich.markup import escape
from rich.table import Table

from experiments.gate.baseline import RunValues
from experiments.gate.check import Check, Finding, RunCheck, differences
from experiments.tables import wide_console
from experiments.trial_log import write_atomically

_STYLES = {"worse": "bold red", "better": "green", "equal": "dim", "no worse": ""}
_MOST_NAMED = 10


def check_table(check: Check) -> Table:
    """One row for each quantity of each method that is not equal in every trial."""
    table = Table(box=box.SIMPLE_HEAD, caption=_caption(check), caption_justify="left")
    for column in ("experiment", "method", "tested", "baseline", "now", "change", "p", "verdict"):
        is_number = column in ("baseline", "now", "change", "p")
        table.add_column(column, justify="right" if is_number else "left")
    for one in check.findings:
        if one.verdict == "equal":
            continue
        table.add_row(
            one.experiment, one.method, escape(one.quantity.title), _shown(one, one.old, 0),
            _shown(one, one.new, 1), _change(one), _p(one), one.verdict,
            style=_STYLES[one.verdict],
        )  # fmt: skip
    return table


def how_compared(run: RunCheck) -> str:
    """In a sentence, how the trials of a run were held against those of the baseline."""
    old, new = run.old, run.new
    if run.paired is None:
        told = (
            f"{new.trials} trials of seed {new.seed} against {old.trials} of seed {old.seed}: not"
            " paired; the baseline's own seed would show far smaller differences"
        )
    else:
        told = f"{run.paired} trials paired with the baseline's, seed {new.seed}"
        if old.trials != new.trials:
            told += f" (of {new.trials} and {old.trials})"
    if run.same:
        told += "; the results are the same to the byte"
    if differing := differences(old, new):
        told += f"; compared although other: {', '.join(differing)}"
    return f"{new.experiment}: {told}"


def what_changed(old: RunValues, new: RunValues) -> str | None:
    """In what else than the trials a run and its baseline differ: commit and versions."""
    before, now = (run.inputs.get("versions", {}) for run in (old, new))
    changed = [
        f"{name} {before.get(name, '-')} -> {now.get(name, '-')}"
        for name in sorted(set(before) | set(now))
        if before.get(name) != now.get(name)
    ]
    commits = [str(run.inputs.get("commit"))[:10] for run in (old, new)]
    if commits[0] != commits[1]:
        changed.insert(0, f"commit {commits[0]} -> {commits[1]}")
    return ", ".join(changed) or None


def new_failures(check: Check) -> list[str]:
    """The trials of pairs in which something happened that did not before."""
    return [
        f"{one.experiment}, {one.method}, {one.quantity.title} now: "
        + ", ".join(map(str, one.newly[:_MOST_NAMED]))
        + (f" and {len(one.newly) - _MOST_NAMED} more" if len(one.newly) > _MOST_NAMED else "")
        for one in check.findings
        if one.newly
    ]


def write_junit(path: Path, check: Check) -> None:
    """One test case for each finding, one suite for each run."""
    root = ET.Element("testsuites", _counted(check.findings))
    for run in check.runs:
        name = f"kitasap.{run.new.experiment}"
        suite = ET.SubElement(root, "testsuite", {"name": name} | _counted(run.findings))
        for one in run.findings:
            named = {"classname": f"{name}.{one.method}", "name": one.quantity.title, "time": "0"}
            case = ET.SubElement(suite, "testcase", named)
            told = described(one)
            if one.verdict == "worse":
                failure = ET.SubElement(case, "failure", {"message": told, "type": "regression"})
                failure.text = f"{how_compared(run)}\n{told}"
            ET.SubElement(case, "system-out").text = told
    ET.indent(root)
    text = ET.tostring(root, encoding="unicode", xml_declaration=False)
    write_atomically(path, f'<?xml version="1.0" encoding="utf-8"?>\n{text}\n')


def described(one: Finding) -> str:
    """A finding in a line."""
    change = "" if one.change is None else f" ({_change(one)})"
    return (
        f"{one.quantity.title}: {_shown(one, one.old, 0)} -> {_shown(one, one.new, 1)}{change},"
        f" p = {_p(one)}: {one.verdict}"
    )


def _counted(findings: list[Finding]) -> dict[str, str]:
    failures = sum(one.verdict == "worse" for one in findings)
    return {"tests": str(len(findings)), "failures": str(failures), "errors": "0", "time": "0"}


def _shown(one: Finding, value: float, which: int) -> str:
    if one.quantity.is_event:
        return f"{value:.0f} of {one.counts[which]}"
    if not one.counts[which]:
        return "-"
    unit = f" {one.quantity.unit}" if one.quantity.unit else ""
    scaled = one.quantity.scale * value
    return (f"{scaled:.0f}" if scaled >= 1000.0 else f"{scaled:.3g}") + unit


def _change(one: Finding) -> str:
    return "" if one.change is None else f"x {one.change:.3f}"


def _p(one: Finding) -> str:
    if one.verdict == "equal":
        return "-"
    return f"{one.p:.4f}" if one.p >= 1e-4 else "< 0.0001"


def _caption(check: Check) -> str:
    return (
        f"p: of being worse, corrected for {check.tests} tests; a run that is not is called worse in"
        f" {check.alpha:.1%} of checks at most.\nWorse: happens more often, or has grown by more than"
        f" {check.margin:.0%}, usually or on average (of pairs: fewer; of NEES: away from the truth)."
    )


def print_check(check: Check) -> None:
    """Prints how it was compared, the table, and what is to be done about it."""
    console = wide_console()
    for run in check.runs:
        console.print(escape(how_compared(run)))
    for changed in dict.fromkeys(what_changed(run.old, run.new) for run in check.runs):
        if changed:
            console.print(escape(changed), style="dim")
    equal = sum(one.verdict == "equal" for one in check.findings)
    if equal < len(check.findings):
        console.print(check_table(check))
    for line in new_failures(check):
        console.print(escape(line))
    tested = f"{len(check.findings)} tested" + (f", {equal} equal in every trial" if equal else "")
    if check.worse:
        console.print(f"worse than the baseline: {len(check.worse)} of {tested}")
    else:
        console.print(f"no worse than the baseline: {tested}")

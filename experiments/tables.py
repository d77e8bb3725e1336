"""Tables 1 and 2 of the paper beside ours, as text for a terminal."""

import sys
from collections.abc import Callable
from typing import Any

from rich import box
from rich.console import Console
from rich.markup import escape
from rich.table import Table

TITLES = {
    "localization": "Experiment 1, the robot stands (paper, Table 1)",
    "tracking": "Tracking: driving through a known place",
    "kidnap": "Experiment 2, lifted, moved -1 m in y, turned by 90 degrees (paper, Table 2)",
    "mapping": "Experiment 3, an unknown place driven through and mapped (paper, Section 4.2)",
    "kidnap anywhere": "Experiment 2, carried to anywhere, any heading",
}


_WIDE = 180
"""Columns where no terminal says how many it has: of a file nobody's 80 are to be kept."""


def wide_console() -> Console:
    """Where tables are printed, as wide as the terminal, or as every table needs."""
    return Console(width=None if sys.stdout.isatty() else _WIDE)


def title_of(experiment: str, poses: str) -> str:
    """What an experiment is, as it stands above its tables and figures."""
    if experiment == "localization" and poses != "paper":
        return "The robot stands, anywhere in the free space"
    return TITLES.get(f"{experiment} {poses}", TITLES[experiment])


def summary_table(summary: dict[str, Any], poses: str, where: str) -> Table:
    """Ours beside the paper's: errors over the successes, success over all trials.

    where: the place and the laser, in words.
    """
    if summary["experiment"] == "mapping":
        return _mapping_table(summary, poses, where)
    methods, trials = summary["methods"], summary["samples"]
    raised = next(iter(methods.values()))["raised"]
    trials += raised  # they count as failures of all methods
    table = Table(
        title=f"{title_of(summary['experiment'], poses)}\n{where}, {_counted(summary)}, {poses} poses",
        caption="X | Y. Success: within 5 cm and 2 degrees, and not disowned by the method. "
        "Errors over the successes.",
        box=box.SIMPLE_HEAD,
    )
    table.add_column("")
    # what was printed is of its own pair of poses; there is a method of that name too
    paper = summary["paper_values"] if poses == "paper" else None
    if paper:
        table.add_column("paper's table", justify="right", style="dim")
    for name in methods:
        table.add_column(name, justify="right")
    said = {"Heading max [rad]": "0.01 (text)", "Within 3 cm, 0.01 rad": "100 of 100 (text)"}
    for label, key in (
        ("Average [cm]", "mean"),
        ("Maximum [cm]", "max"),
        ("Std. dev. [cm]", "std"),
    ):
        columns = [*([paper] if paper else []), *methods.values()]
        table.add_row(escape(label), *(_pair(one, key) for one in columns))
    rows = {
        "RMSE [mm]": lambda m: _number(m["rmse_mm"], 2),
        "Heading max [rad]": lambda m: _number(m["theta_rad"]["max"], 4),
        "Success": lambda m: f"{trials - m['failures']} of {trials}",
        "  95 % interval": lambda m: "{:.1%} to {:.1%}".format(*m["success_ci95"]),
        "Within 3 cm, 0.01 rad": lambda m: f"{m['within_paper_margins']} of {trials}",
        "Cramer-Rao bound [mm]": lambda m: _number(m["crlb_mm"], 2),
        "RMSE / bound, x y | heading": lambda m: (
            f"{_number(m['crlb_ratio'], 2)} | {_number(m['crlb_ratio_theta'], 2)}"
        ),
        "NEES (3 is honest)": _nees,
        "  median | beyond 16.27": _nees_tail,
        **({"  NEES of all scans": _nees_all} if summary["experiment"] == "tracking" else {}),
        "Believed, but wrong": lambda m: f"{m['confident_wrong']} of {trials}",
        **_of_verdicts(summary["experiment"]),
    }
    for label, shown in rows.items():
        first = [said.get(label, "-")] if paper else []
        table.add_row(escape(label), *first, *(shown(m) for m in methods.values()))
    return table


def _mapping_table(summary: dict[str, Any], poses: str, where: str) -> Table:
    methods, trials = summary["methods"], summary["trials"]
    table = Table(
        title=f"{title_of('mapping', poses)}\n{where}, {_count_of(trials, 'trial')}, {poses} way",
        caption="Success: ATE at most 5 cm, precision and recall at least 0.99 at 5 cm, and not called"
        " failed. The paper: it 'occasionally failed in mapping'.",
        box=box.SIMPLE_HEAD,
    )
    table.add_column("")
    for name in methods:
        table.add_column(name, justify="right")
    rows: dict[str, Callable[[dict[str, Any]], str]] = {
        "Success": lambda m: f"{trials - m['failures']} of {trials}",
        "  95 % interval": lambda m: "{:.1%} to {:.1%}".format(*m["success_ci95"]),
        "ATE [mm]: median, most": lambda m: _numbers(m["ate_mm"]),
        "Map off true surfaces, RMS [mm]": lambda m: _number(m["map_rmse_mm"], 1),
        "Precision: median, least": lambda m: _shares(m, "map_precision"),
        "Recall: median, least": lambda m: _shares(m, "map_recall"),
        "Called failed": lambda m: str(m["reported_failures"]),
        "Failed, and not called so": lambda m: str(m["confident_wrong"]),
        "End of the drive off, RMS [mm]": lambda m: _number(m["rmse_mm"], 1),
    }
    for label, shown in rows.items():
        table.add_row(escape(label), *(shown(m) for m in methods.values()))
    return table


def _shares(method: dict[str, Any], key: str) -> str:
    return f"{_number(method[key], 4)}, {_number(method[key + '_min'], 4)}"


def _of_verdicts(experiment: str) -> dict[str, Callable[[dict[str, Any]], str]]:
    """Rows that tell what methods say of themselves, where they do; of older runs, nothing."""
    if experiment == "tracking":
        return {"False alarms, scans unsure": _alarms}
    if experiment != "kidnap":
        return {}
    return {
        "Kidnap seen by the first scan": lambda m: _percent(m.get("detected_rate")),
        "Not sure in the end": lambda m: _percent(m.get("unsure_rate")),
        "Scans to recover: median, most": lambda m: _numbers(m.get("scans_to_recover")),
        "CPU of a query: median, p99 [ms]": lambda m: _numbers(m.get("query_cpu_ms")),
    }


def _alarms(method: dict[str, Any]) -> str:
    if "scans" not in method:
        return "-"
    return f"{method['false_alarms']} of {method['scans']}, {_percent(method['unsure_rate'])}"


def _numbers(values: dict[str, Any] | None) -> str:
    if values is None or None in values.values():
        return "-"
    return ", ".join(f"{value:.0f}" for value in values.values())


def _percent(rate: float | None) -> str:
    return "-" if rate is None else f"{rate:.1%}"


def _counted(summary: dict[str, Any]) -> str:
    trials, samples = summary["trials"], summary["samples"]
    if summary["experiment"] != "tracking":
        return _count_of(trials, "trial")
    return f"{_count_of(trials, 'drive')}, {samples} samples, one each 2 s"


def _count_of(count: int, noun: str) -> str:
    return f"1 {noun}" if count == 1 else f"{count} {noun}s"


def _nees(method: dict[str, Any]) -> str:
    if method["nees"] is None:
        return "-"
    low, high = method["nees_band95"]
    return f"{method['nees']:.2f} (95 %: {low:.2f} to {high:.2f})"


def _nees_tail(method: dict[str, Any]) -> str:
    if method["nees"] is None:
        return "-"
    return f"{method['nees_median']:.2f} | {method['nees_beyond']:.1%}"


def _nees_all(method: dict[str, Any]) -> str:
    if method.get("nees_all_scans") is None:
        return "-"
    return f"{method['nees_all_scans']:.2f} ({method['nees_all_scans_beyond']:.1%} beyond)"


def _pair(values: dict[str, Any], key: str) -> str:
    return f"{_number(values['x_cm'][key], 2)} | {_number(values['y_cm'][key], 2)}"


def _number(value: float | None, digits: int) -> str:
    return "-" if value is None else f"{value:.{digits}f}"


def sweep_table(told: dict[str, Any], rows: list[dict[str, Any]]) -> Table:
    """What came out for each combination. told: what the sweep is."""
    table = Table(
        title=f"{told['experiment']}, seed {told['seed']}: what is varied",
        caption=f"{told['interval']}. Equal seeds in all rows: the same random numbers.",
        box=box.SIMPLE_HEAD,
    )
    for name in told["varied"]:
        table.add_column(escape(name), justify="right")
    table.add_column("method")
    for name in ("found", "95 %", "RMSE [mm]", "95 %", "wrong, believed"):
        table.add_column(escape(name), justify="right")
    for one in rows:
        for method, figures in one["methods"].items():
            table.add_row(*map(escape, one["values"].values()), method, *_sweep_cells(figures))
    return table


def _sweep_cells(figures: dict[str, Any]) -> list[str]:
    trials, rate, rmse_mm = figures["trials"], figures["success_rate"], figures["rmse_mm"]
    return [
        f"{rate * 100:.1f} % of {trials}",
        f"{figures['success_low'] * 100:.1f} to {figures['success_high'] * 100:.1f}",
        "-" if rmse_mm is None else f"{rmse_mm:.2f}",
        _band(figures["rmse_mm_low"], figures["rmse_mm_high"]),
        str(figures["confident_wrong"]),
    ]


def _band(low: float | None, high: float | None) -> str:
    return "" if low is None or high is None else f"{low:.2f} to {high:.2f}"

"""Tables 1 and 2 of the paper beside ours, as text for a terminal."""

from typing import Any

from rich import box
from rich.markup import escape
from rich.table import Table

TITLES = {
    "localization": "Experiment 1, the robot stands (paper, Table 1)",
    "kidnap": "Experiment 2, lifted, moved -1 m in y, turned by 90 degrees (paper, Table 2)",
}


def summary_table(summary: dict[str, Any], poses: str) -> Table:
    """Ours beside the paper's: errors over the successes, success over all trials."""
    methods, trials = summary["methods"], summary["trials"]
    table = Table(
        title=f"{TITLES[summary['experiment']]}\n{trials} trials, {poses} poses",
        caption="X | Y. Success: within 5 cm and 2 degrees, and not disowned by the method. "
        "Errors over the successes.",
        box=box.SIMPLE_HEAD,
    )
    table.add_column("")
    table.add_column("paper", justify="right", style="dim")
    for name in methods:
        table.add_column(name, justify="right")
    paper = summary["paper_values"]
    for label, key in (
        ("Average [cm]", "mean"),
        ("Maximum [cm]", "max"),
        ("Std. dev. [cm]", "std"),
    ):
        table.add_row(escape(label), _pair(paper, key), *(_pair(m, key) for m in methods.values()))
    rows = {
        "RMSE [mm]": lambda m: _number(m["rmse_mm"], 2),
        "Heading max [rad]": lambda m: _number(m["theta_rad"]["max"], 4),
        "Success": lambda m: f"{trials - m['failures']} of {trials}",
        "  95 % interval": lambda m: "{:.0%} to {:.0%}".format(*m["success_ci95"]),
        "Within 3 cm, 0.01 rad": lambda m: f"{m['within_paper_margins']} of {trials}",
        "Believed, but wrong": lambda m: f"{m['confident_wrong']} of {trials}",
    }
    said = {"Heading max [rad]": "0.01 (text)", "Within 3 cm, 0.01 rad": "100 of 100 (text)"}
    for label, shown in rows.items():
        table.add_row(escape(label), said.get(label, "-"), *(shown(m) for m in methods.values()))
    return table


def _pair(values: dict[str, Any], key: str) -> str:
    return f"{_number(values['x_cm'][key], 2)} | {_number(values['y_cm'][key], 2)}"


def _number(value: float | None, digits: int) -> str:
    return "-" if value is None else f"{value:.{digits}f}"

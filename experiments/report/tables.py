"""The tables of a report: the paper's two beside ours, and all else that a summary tells."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from experiments.report.numbers import NOTHING, Cell, interval, number

_AXES = (("X", "x_cm"), ("Y", "y_cm"))
_PAPER_ROWS = (("Average", "mean"), ("Maximum", "max"), ("Standard deviation", "std"))
_OF_EXPERIMENT = {"localization": "Table 1", "kidnap": "Table 2"}


@dataclass(frozen=True)
class Table:
    """Rows of a label and cells, below a title and the names of the columns."""

    title: str
    columns: list[str]
    rows: list[tuple[str, list[Cell]]]
    note: str = ""


_Row = tuple[str, Callable[[dict[str, Any], str], Cell]]


def paper_table(summary: dict[str, Any], poses: str) -> Table | None:
    """Table 1 or 2 with ours beside it; None of what is in neither.

    The paper's column is there where its own pair of poses was repeated, of which alone it tells.
    """
    experiment = summary["experiment"]
    if experiment not in _OF_EXPERIMENT:
        return None
    methods = list(summary["methods"])
    has_paper = poses == "paper" and summary.get("paper_values") is not None
    rows: list[tuple[str, list[Cell]]] = []
    for label, key in _PAPER_ROWS:
        for axis, axis_key in _AXES:
            paper = [number(summary, f"paper_values.{axis_key}.{key}")] if has_paper else []
            ours = [_with_interval(summary, f"methods.{m}", axis_key, key) for m in methods]
            rows.append((f"{label} {axis} [cm]", [*paper, *ours]))
    for label, key in _PAPER_ROWS:
        said: list[Cell] = [["±0.01 (text)" if key == "max" else NOTHING]] * has_paper
        ours = [_with_interval(summary, f"methods.{m}", "theta_rad", key, 4) for m in methods]
        rows.append((f"{label} heading [rad]", [*said, *ours]))
    title = f"{_OF_EXPERIMENT[experiment]}: the paper's and ours"
    if not has_paper:
        title = f"As the paper's {_OF_EXPERIMENT[experiment]}, but of other poses than its own"
    return Table(
        title,
        ["", *(["paper's table"] if has_paper else []), *methods],
        rows,
        "Errors of the successes alone. Maximum: of largest magnitude, with its sign, as the paper"
        " has it; resampling gives no interval for it. In brackets 95 % by the bootstrap over the"
        " trials, where at least ten succeeded.",
    )


def figures_table(summary: dict[str, Any]) -> Table:
    """Everything else that the summary says of each method."""
    methods = list(summary["methods"])
    rows: list[tuple[str, list[Cell]]] = []
    for label, shown in _ROWS_OF[summary["experiment"]]:
        cells = [shown(summary, f"methods.{name}.") for name in methods]
        if any(cell and cell != [NOTHING] for cell in cells):
            rows.append((label, cells))
    return Table(
        "What this run says of each method", ["", *methods], rows, _NOTES[summary["experiment"]]
    )


def overview(summary: dict[str, Any], method: str) -> list[Cell]:
    """Success, RMSE and what was wrong and believed, of one method in one line."""
    at = f"methods.{method}."
    return [_success(summary, at), _rmse(summary, at), number(summary, at + "confident_wrong", 0)]


def _with_interval(summary: dict[str, Any], at: str, axis: str, key: str, digits: int = 2) -> Cell:
    shown = number(summary, f"{at}.{axis}.{key}", digits)
    return [*shown, *interval(summary, f"{at}.ci95.{axis}.{key}", digits)]


def _success(s: dict[str, Any], at: str) -> Cell:
    return [
        *number(s, at + "success_rate", 1, 100.0, " %"),
        *interval(s, at + "success_ci95", 1, 100.0),
    ]


def _rmse(s: dict[str, Any], at: str) -> Cell:
    return [*number(s, at + "rmse_mm", 2), *interval(s, at + "ci95.rmse_mm", 2)]


def _heading_rmse(s: dict[str, Any], at: str) -> Cell:
    return [*number(s, at + "rmse_mrad", 2), *interval(s, at + "ci95.rmse_mrad", 2)]


def _nees(s: dict[str, Any], at: str) -> Cell:
    return [*number(s, at + "nees", 2), *interval(s, at + "nees_band95", 2)]


def _plain(key: str, digits: int = 0, scale: float = 1.0, unit: str = "") -> Callable[..., Cell]:
    return lambda s, at: number(s, at + key, digits, scale, unit)


def _pair(
    first: str, second: str, digits: int = 0, scale: float = 1.0, unit: str = ""
) -> Callable[..., Cell]:
    return lambda s, at: _joined(
        number(s, at + first, digits, scale, unit), number(s, at + second, digits, scale, unit)
    )


def _nees_tail(s: dict[str, Any], at: str) -> Cell:
    share = number(s, at + "nees_beyond", 1, 100.0, " %")
    return _joined(number(s, at + "nees_median", 2), share)


def _joined(first: Cell, second: Cell) -> Cell:
    return first if first == second == [NOTHING] else [*first, ", ", *second]


def _ate(s: dict[str, Any], at: str) -> Cell:
    return [
        *number(s, at + "ate_mm.median", 1),
        *interval(s, at + "ci95.ate_mm.median", 1),
        ", ",
        *number(s, at + "ate_mm.max", 1),
    ]


def _map_rmse(s: dict[str, Any], at: str) -> Cell:
    return [*number(s, at + "map_rmse_mm", 1), *interval(s, at + "ci95.map_rmse_mm", 1)]


_FIRST: tuple[_Row, ...] = (
    ("Success [95 % by Wilson]", _success),
    ("Failures", _plain("failures")),
    ("Trials that raised an error", _plain("raised")),
)
_FOUND: tuple[_Row, ...] = (
    *_FIRST,
    ("Wrong, and believed", _plain("confident_wrong")),
    ("Within the paper's 3 cm and 0.01 rad", _plain("within_paper_margins")),
    ("Position RMSE [mm]", _rmse),
    ("Heading RMSE [mrad]", _heading_rmse),
    ("Cramér-Rao bound [mm], [mrad]", _pair("crlb_mm", "crlb_mrad", 2)),
    ("RMSE in bounds: position, heading", _pair("crlb_ratio", "crlb_ratio_theta", 2)),
    ("NEES, 3 is honest [band of 95 %]", _nees),
    ("NEES: median (2.37), beyond 16.27 (0.1 %)", _nees_tail),
    ("Ended with a warning", _plain("warned")),
)
_ROWS_OF: dict[str, tuple[_Row, ...]] = {
    "localization": _FOUND,
    "tracking": (
        *_FOUND,
        ("NEES of all scans", _plain("nees_all_scans", 2)),
        ("Scans", _plain("scans")),
        ("Called lost, and never was", _plain("false_alarms")),
        ("Scans not sure", _plain("unsure_rate", 1, 100.0, " %")),
    ),
    "kidnap": (
        *_FOUND,
        ("Kidnap seen by the first scan", _plain("detected_rate", 1, 100.0, " %")),
        ("False alarms before it", _plain("false_alarms")),
        ("Not sure in the end", _plain("unsure_rate", 1, 100.0, " %")),
        (
            "Scans to recover: median, most",
            _pair("scans_to_recover.median", "scans_to_recover.max"),
        ),
        ("CPU of a query [ms]: median, p99", _pair("query_cpu_ms.median", "query_cpu_ms.p99", 1)),
    ),
    "mapping": (
        *_FIRST,
        ("Called failed by the method", _plain("reported_failures")),
        ("Failed, and not called so", _plain("confident_wrong")),
        ("Trajectory error (ATE) [mm]: median, most", _ate),
        ("Map off the true surfaces, RMS [mm]", _map_rmse),
        ("Precision: median, least", _pair("map_precision", "map_precision_min", 4)),
        ("Recall: median, least", _pair("map_recall", "map_recall_min", 4)),
        ("End of the drive off, RMS [mm]", _rmse),
    ),
}
_SUCCESS = (
    "Success: within 5 cm and 2 degrees of the truth, and not disowned by the method. RMSE, bound and"
    " NEES tell how well, the success rate how often."
)
_NOTES = {
    "localization": _SUCCESS,
    "tracking": _SUCCESS + " Of samples, one each two seconds of a drive.",
    "kidnap": _SUCCESS,
    "mapping": "Success: trajectory within 5 cm (RMS), and 0.99 of the map's points within 5 cm of a"
    " true surface and the other way round, and not called failed. The paper has no figures; it says"
    " “this experiment occasionally failed in mapping”.",
}

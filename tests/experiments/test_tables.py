"""The tables on the terminal: ours beside the paper's."""

import pytest
from rich.console import Console

from experiments.paper import PAPER_VALUES
from experiments.statistics import summarised
from experiments.tables import summary_table, title_of
from tests.experiments.test_statistics import RAISED, trial


def rendered(experiment: str, records: list[dict], poses: str = "paper") -> list[str]:
    summary = {
        "experiment": experiment,
        "trials": len(records),
        "samples": sum(record["status"] == "ok" for record in records),
        "methods": summarised(records, ("line",)),
        "paper_values": PAPER_VALUES[experiment],
    }
    console = Console(width=140)
    with console.capture() as capture:
        console.print(summary_table(summary, poses, "room_fig4, urg_04lx"))
    return capture.get().splitlines()


def cells(lines: list[str], label: str) -> list[str]:
    """What stands behind a label, column by column."""
    (line,) = [line for line in lines if line.strip().startswith(label + " ")]
    return line.strip().removeprefix(label).replace(" | ", "|").split()


@pytest.mark.parametrize(
    ("experiment", "average", "maximum", "deviation"),
    [
        ("localization", "1.40|-1.00", "2.70|-1.90", "0.40|0.30"),
        ("kidnap", "0.10|-1.20", "0.70|-3.10", "0.30|0.40"),
    ],
)
def test_papers_own_values_stand_beside_ours(experiment, average, maximum, deviation):
    # Tables 1 and 2 of the paper; the units in brackets are no markup
    lines = rendered(experiment, [trial(1.0, -2.0, 0.001), trial(2.0, 1.0, 0.0)])
    assert cells(lines, "Average [cm]") == [average, "1.50|-0.50"]
    assert cells(lines, "Maximum [cm]") == [maximum, "2.00|-2.00"]
    assert cells(lines, "Std. dev. [cm]") == [deviation, "0.71|2.12"]
    assert cells(lines, "RMSE [mm]") == ["-", "22.36"]


def test_paper_column_keeps_its_bars_and_signs():
    (line,) = [line for line in rendered("localization", [RAISED]) if "Average [cm]" in line]
    assert "1.40 | -1.00" in line
    assert line.split()[-3:] == ["-", "|", "-"]  # no success, no number


def test_paper_s_own_values_are_of_its_own_poses_alone():
    records = [trial(1.0, -2.0, 0.001)]
    assert any("paper's table" in line for line in rendered("kidnap", records))
    lines = rendered("kidnap", records, "random")
    assert not any("paper's table" in line or "(text)" in line for line in lines)
    assert cells(lines, "Average [cm]") == ["1.00|-2.00"]


def test_success_is_out_of_all_trials():
    lines = rendered("kidnap", [trial(1, 1, 0), RAISED, trial(9, 9, 0, success=False), RAISED])
    assert cells(lines, "Success") == ["-", "1", "of", "4"]
    assert cells(lines, "Believed, but wrong") == ["-", "1", "of", "4"]


def test_nearly_all_is_not_called_all():
    lines = rendered("kidnap", [trial(1, 1, 0)] * 199 + [RAISED])
    # Wilson's interval of 199 in 200; whole percent would say 97 % to 100 %
    assert cells(lines, "95 % interval") == ["-", "97.2%", "to", "99.9%"]


def test_table_says_where_its_trials_were():
    for count, words in ((1, "1 trial,"), (2, "2 trials,")):
        lines = rendered("kidnap", [RAISED] * count)
        assert any(f"room_fig4, urg_04lx, {words}" in line for line in lines)


def test_title_says_what_was_done():
    assert "(paper, Table 1)" in title_of("localization", "paper")
    assert "(paper" not in title_of("localization", "random")
    assert "moved -1 m in y" in title_of("kidnap", "paper")
    assert "anywhere, any heading" in title_of("kidnap", "anywhere")

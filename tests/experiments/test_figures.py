"""The figures are there, say what the files say, and equal runs draw equal ones."""

import json
import math
import re
from dataclasses import replace

import matplotlib.pyplot as plt
import numpy as np
import pytest
from scipy.spatial import cKDTree

from experiments import localization, tracking
from experiments.bench import mismatch
from experiments.figures import (
    bound_figure,
    convergence_figure,
    image_file,
    mismatch_figure,
    run_figures,
    scatter,
    trial_picture,
)
from experiments.figures.against_bound import _within_heading, _within_position
from experiments.figures.one_trial import _search_figure
from experiments.figures.over_time import _aligned
from experiments.figures.paper_scatter import scatter_drawn
from experiments.kidnap import run_trial
from experiments.runs import Run
from experiments.trials import TrialConfig, generator
from slam.se2 import SE2

PNG = b"\x89PNG\r\n\x1a\n"


def comments(path) -> list[str]:
    """The texts in an SVG: Matplotlib writes each into a comment beside its outlines."""
    return re.findall(r"<!-- (.*?) -->", path.read_text())


@pytest.fixture
def drive_config(quick_config):
    """Drives of five seconds round a small circle."""
    return replace(quick_config, turn_rate_radps=1.0, duration_s=5.0)


@pytest.fixture
def drives(tmp_path, drive_config):
    """The folder of two drives of it."""
    folder = tmp_path / "tracking"
    Run("tracking", drive_config, 0, 2, folder).execute(1, lambda index, record: None)
    return folder


@pytest.mark.slow
def test_run_leaves_its_figures_and_equal_runs_equal_ones(tmp_path, run_trials):
    for name in ("first", "second"):
        assert run_trials(tmp_path / name, 2) == 0
    first, second = tmp_path / "first/localization", tmp_path / "second/localization"
    for name in ("scatter", "bound", "trial_0"):
        assert (first / f"{name}.png").read_bytes()[:8] == PNG
        svg = (first / f"{name}.svg").read_bytes()
        assert b"<svg" in svg
        assert svg == (second / f"{name}.svg").read_bytes()


@pytest.mark.slow
def test_scatter_counts_what_lies_outside(tmp_path, run_trials):
    assert run_trials(tmp_path, 2) == 0
    folder = tmp_path / "localization"
    lines = (folder / "trials.csv").read_text().splitlines()
    # one trial of `odometry` 5 cm off in x, the other 1 cm: the picture ends at 4 cm
    fields = lines[0].split(",")
    x, y = fields.index("x_error_m"), fields.index("y_error_m")
    rows = [line.split(",") for line in lines[1:]]
    for row, error_m in zip([r for r in rows if "odometry" in r], ("0.05", "0.01"), strict=True):
        row[x], row[y] = error_m, "0.0"
    (folder / "trials.csv").write_text("\n".join([lines[0], *(",".join(r) for r in rows)]) + "\n")
    scatter(folder)
    assert "of 2 succeed, 1 off this picture" in (folder / "scatter.svg").read_text()


def scatter_of_no_trial(folder, experiment, names, poses):
    values = {"x_cm": {"mean": 1.0, "std": 1.0}, "y_cm": {"mean": 1.0, "std": 1.0}}
    methods = {name: {"failures": 0} for name in names}
    summary = {"experiment": experiment, "trials": 0, "methods": methods}
    (folder / "summary.json").write_text(json.dumps(summary | {"paper_values": values}))
    (folder / "config.json").write_text(json.dumps({"config": {"poses": poses}}))
    (folder / "trials.csv").write_text("method,status,x_error_m,y_error_m\n")
    return scatter_drawn(folder)


def test_panels_of_five_methods_stand_in_two_rows(tmp_path):
    names = ("odometry", "line", "paper", "open3d", "limit")
    figure = scatter_of_no_trial(tmp_path, "localization", names, "paper")
    width_in, height_in = figure.get_size_inches()
    # side by side they were four times as wide as high, and shrunk to that on a page
    assert width_in < 1.5 * height_in
    shown = [axis for axis in figure.axes if axis.get_visible()]
    assert [axis.get_title().split("\n")[0] for axis in shown] == list(names)
    plt.close(figure)


@pytest.mark.parametrize("names", [("limit",), ("open3d", "limit")])
def test_title_of_few_panels_lies_in_the_picture(tmp_path, names):
    # `run kidnap --method limit` cut it off at both ends
    figure = scatter_of_no_trial(tmp_path, "kidnap", names, "anywhere")
    figure.draw_without_rendering()
    title_px, legend_px = (
        figure._suptitle.get_window_extent(),
        figure.legends[0].get_window_extent(),
    )
    assert title_px.x0 > 0.0
    assert title_px.x1 < figure.bbox.x1
    for axis in figure.axes:
        assert axis.title.get_window_extent().y1 < title_px.y0
        assert axis.xaxis.label.get_window_extent().y0 > legend_px.y1
    plt.close(figure)


@pytest.mark.slow
def test_bound_figure_shows_every_method_with_its_numbers(tmp_path, run_trials):
    assert run_trials(tmp_path, 2) == 0
    folder = tmp_path / "localization"
    assert bound_figure(folder) == folder / "bound.png"
    methods = json.loads((folder / "summary.json").read_text())["methods"]
    texts = comments(folder / "bound.svg")
    assert any(text.startswith("Cramer-Rao bound: what an efficient") for text in texts)
    for name, result in methods.items():
        (row,) = (text for text in texts if text.startswith(f"{name} "))
        assert row.endswith(f"{result['failures']} of 2")
        for key in ("rmse_mm", "crlb_ratio", "rmse_mrad", "crlb_ratio_theta"):
            assert result[key] is None or f"{result[key]:.2f}" in row


@pytest.mark.slow
def test_figures_are_titled_by_what_was_done(tmp_path, run_trials):
    assert run_trials(tmp_path, 2) == 0
    folder = tmp_path / "localization"
    summary, config = (
        json.loads((folder / f"{name}.json").read_text()) for name in ("summary", "config")
    )
    summary["experiment"], config["config"]["poses"] = "kidnap", "anywhere"
    (folder / "summary.json").write_text(json.dumps(summary))
    (folder / "config.json").write_text(json.dumps(config))
    for path in (scatter(folder), bound_figure(folder)):
        assert "carried to anywhere, any heading" in " ".join(comments(path.with_suffix(".svg")))


@pytest.mark.slow
def test_passes_of_a_search_are_kept_and_drawn(tmp_path, quick_config):
    config = replace(quick_config, methods=("odometry", "paper"))
    Run("localization", config, 0, 3, tmp_path).execute(1, lambda index, record: None)
    for line in (tmp_path / "trials.jsonl").read_text().splitlines():
        methods = json.loads(line)["methods"]
        assert methods["odometry"]["steps"] is None
        paper, steps = methods["paper"], methods["paper"]["steps"]
        assert len(steps["error_m2"]) == len(steps["position_error_m"]) == paper["iterations"]
        # to four digits, the last pass is what the trial ended with
        assert steps["error_m2"][-1] == pytest.approx(paper["error_m2"], rel=5e-4)
        off_m = math.hypot(paper["x_error_m"], paper["y_error_m"])
        assert steps["position_error_m"][-1] == pytest.approx(off_m, rel=5e-4)
    assert tmp_path / "convergence.png" in run_figures(tmp_path)
    texts = comments(tmp_path / "convergence.svg")
    assert any("paper: expression (1)" in text for text in texts)
    assert not any("odometry" in text for text in texts)


def test_run_without_passes_has_no_convergence(tmp_path, quick_config):
    Run("localization", quick_config, 0, 1, tmp_path).execute(1, lambda index, record: None)
    assert convergence_figure(tmp_path) is None


def test_bound_is_the_distribution_of_gaussian_errors():
    # against draws: 4e5 of them leave 0.0008 of standard deviation; 5 of these
    rng = np.random.default_rng(0)
    sigma = 0.7
    norms = np.linalg.norm(rng.normal(0, sigma, (400_000, 2)), axis=1)
    angles = np.abs(rng.normal(0, sigma, 400_000))
    for x in (0.1, 0.5, 1.0, 2.0):
        (position,) = _within_position(x, np.array([sigma * math.sqrt(2)]))
        (heading,) = _within_heading(x, np.array([sigma]))
        assert position == pytest.approx((norms < x).mean(), abs=0.004)
        assert heading == pytest.approx((angles < x).mean(), abs=0.004)


def test_blind_scan_promises_nothing():
    blind = np.array([np.inf])
    assert _within_position(100.0, blind) == _within_heading(100.0, blind) == 0.0


@pytest.mark.slow
def test_drives_leave_bound_and_time_and_no_scatter(drives):
    names = [path.name for path in run_figures(drives)]
    assert names == ["bound.png", "over_time.png"]
    assert not (drives / "scatter.png").exists()
    assert any("2 drives" in text for text in comments(drives / "over_time.svg"))
    first = {path.name: path.read_bytes() for path in drives.glob("*.[ps][nv]g")}
    assert set(first) == {"bound.png", "bound.svg", "over_time.png", "over_time.svg"}
    run_figures(drives)
    assert {name: (drives / name).read_bytes() for name in first} == first


@pytest.mark.slow
def test_figures_show_only_the_trials_asked_for(drives, drive_config):
    Run("tracking", drive_config, 0, 1, drives).execute(1, lambda index, record: None)
    run_figures(drives)
    assert not any("2 drives" in text for text in comments(drives / "over_time.svg"))
    assert any("1 drive;" in text for text in comments(drives / "over_time.svg"))


@pytest.mark.slow
def test_drives_without_bound_or_nees_are_drawn(drives):
    lines = (drives / "trials.csv").read_text().splitlines()
    fields = lines[0].split(",")
    rows = [line.split(",") for line in lines[1:]]
    for name in ("crlb_position_m", "crlb_heading_rad", "nees"):
        for row in rows:
            row[fields.index(name)] = ""
    (drives / "trials.csv").write_text("\n".join([lines[0], *map(",".join, rows)]) + "\n")
    records = [json.loads(line) for line in (drives / "trials.jsonl").read_text().splitlines()]
    for record in records:
        series = record["series"]
        nothing = [None] * len(series["time_s"])
        series |= {"crlb_position_m": nothing, "crlb_heading_rad": nothing}
        for method in series["methods"].values():
            method["nees"] = nothing
    (drives / "trials.jsonl").write_text("".join(json.dumps(r) + "\n" for r in records))
    summary = json.loads((drives / "summary.json").read_text())
    for result in summary["methods"].values():
        result |= dict.fromkeys(
            ("crlb_mm", "crlb_mrad", "crlb_ratio", "crlb_ratio_theta", "nees", "nees_band95")
        )
    (drives / "summary.json").write_text(json.dumps(summary))
    run_figures(drives)
    samples = summary["samples"]
    assert any(f"blind in {samples} of {samples}" in t for t in comments(drives / "bound.svg"))


@pytest.mark.slow
@pytest.mark.parametrize("experiment", ["localization", "tracking"])
@pytest.mark.parametrize("failure", ["raises", "misses"])
def test_run_in_which_everything_failed_is_drawn(
    tmp_path, drive_config, experiment, failure, monkeypatch
):
    config = replace(drive_config, duration_s=2.5)
    if failure == "misses":
        config = replace(config, success_m=0.0)
    else:
        monkeypatch.setattr(f"experiments.{experiment}.run_trial", lambda config, rng: 1 / 0)
    folder = tmp_path / experiment
    Run(experiment, config, 0, 1, folder).execute(1, lambda index, record: None)
    for path in run_figures(folder):
        assert path.read_bytes()[:8] == PNG
    assert sum("1 of 1" in text for text in comments(folder / "bound.svg")) == 2


def test_series_are_aligned_by_their_stamps():
    times_s = np.array([0.1, 0.2, 0.3, 0.4])
    late, early = {"time_s": [0.22, 0.31]}, {"time_s": [0.1, 0.2, 0.3, 0.4, 0.7]}
    table = _aligned(times_s, [late, early], [[-0.001, None], [0.001, 0.002, 0.003, 0.004, 0.9]])
    # magnitudes, in thousandths; what lies a scan or more off belongs to none
    np.testing.assert_allclose(table, [[np.nan, 1, np.nan, np.nan], [1, 2, 3, 4]])


def test_kidnap_picture_tells_truth_from_belief(tmp_path, quick_config):
    result = run_trial(quick_config, generator("kidnap", 0, 0))
    assert trial_picture(tmp_path, quick_config, result, 7) == tmp_path / "trial_7.png"
    assert (tmp_path / "trial_7.png").read_bytes()[:8] == PNG
    svg = (tmp_path / "trial_7.svg").read_text()
    for words in (
        "trial 7 in box_room: lifted from (1) and set down at (2)",
        "scan before, at (1)",
        "robot at (2): truth",
        "robot at (2): pose found",
    ):
        assert f"<!-- {words} -->" in svg


def test_titles_of_a_high_place_stand_apart(quick_config, monkeypatch):
    # in one of 60 m by 56 m the title stood on that of the middle panel
    result = localization.run_trial(quick_config, generator("localization", 0, 0))
    known, bounds_m = quick_config.known_place, np.array([[0.0, 0.0], [56.0, 60.0]])
    monkeypatch.setattr(type(known.place), "bounds_m", property(lambda _: bounds_m))
    methods = ("limit", "fast", "open3d")
    searched = next(one for one in result.outcomes.values() if len(one.match.history) > 0)
    outcomes = dict.fromkeys(methods, searched)
    figure = _search_figure(
        replace(quick_config, methods=methods), replace(result, outcomes=outcomes), 0
    )
    figure.draw_without_rendering()
    title_px, legend_px = (
        figure._suptitle.get_window_extent(),
        figure.legends[0].get_window_extent(),
    )
    assert len(figure.axes) == 3
    for axis in figure.axes:
        assert axis.title.get_window_extent().y1 < title_px.y0
        assert axis.xaxis.label.get_window_extent().y0 > legend_px.y1


@pytest.mark.slow
def test_kidnap_picture_shows_each_method_what_it_saw_last(tmp_path, quick_config):
    result = run_trial(quick_config, generator("kidnap", 0, 0))
    picture = trial_picture(tmp_path, quick_config, result, 0)
    as_it_was = picture.with_suffix(".svg").read_text()
    # another method was not sure, and the robot turned for it
    turned = result.true_poses[-1] + [0.0, 0.0, 1.0]
    later = replace(result, true_poses=[result.true_poses[0], turned], scans=[result.scans[0]] * 2)
    trial_picture(tmp_path, quick_config, later, 0)
    assert picture.with_suffix(".svg").read_text() == as_it_was


@pytest.mark.slow
@pytest.mark.parametrize(("duration_s", "samples"), [(5.0, 2), (1.0, 0)])
def test_picture_of_a_drive_has_a_panel_for_each_method(
    tmp_path, drive_config, duration_s, samples
):
    config = replace(drive_config, duration_s=duration_s)
    result = tracking.run_trial(config, generator("tracking", 0, 0))
    assert trial_picture(tmp_path, config, result, 3) == tmp_path / "trial_3.png"
    texts = comments(tmp_path / "trial_3.svg")
    assert f"trial 3 in box_room: a drive of {duration_s:.0f} s, true and estimated path" in texts
    for name in config.methods:
        right = sum(sample["methods"][name]["success"] for sample in result.samples)
        assert f"{name}: right at {right} of {samples} samples" in texts
    assert "last scan, straightened" in texts
    # on the walls: as it came it lay up to 0.2 m off
    points = SE2.from_array(result.true_poses[-1]) @ result.points_base
    walls, _ = config.known_place.segment_map.sampled(0.005)
    assert len(points) > 100
    assert np.median(cKDTree(walls).query(points)[0]) < 0.02


def test_mismatches_are_told_with_their_numbers(tmp_path):
    measured = {"rmse_mm": 4.25, "crlb_mm": 1.25, "crlb_ratio": 3.4, "nees": 31.44}
    nothing = dict.fromkeys(measured)
    counts = {"failures": 2, "trials": 60, "warned": 57}
    rows = [
        {"mismatch": "none", "still": measured | counts, "moving": nothing | counts},
        {"mismatch": "offset", "still": nothing | counts, "moving": measured | counts},
    ]
    path = tmp_path / "mismatch.png"
    assert mismatch_figure(path, rows) == path
    assert path.read_bytes()[:8] == PNG
    svg = path.with_suffix(".svg").read_bytes()
    texts = comments(path.with_suffix(".svg"))
    for text in ("4.25 mm", "3.40", "31.4", "57 of 60", "2 of 60", "ranges 5 mm too long"):
        assert text in texts, texts
    mismatch_figure(path, rows)
    assert path.with_suffix(".svg").read_bytes() == svg


def test_mismatch_counts_and_names_the_warnings_at_the_end_of_trials(monkeypatch):
    told = [["b", "a"], [], ["a"], ["of a trial that failed"], ["c", "d"]]

    def recorded_trial(experiment, config, seed, index):
        status = "error" if index == 3 else "ok"
        return index, {"status": status, "methods": {"limit": {"warnings": told[index]}}}, {}

    keys = ("rmse_mm", "rmse_mrad", "crlb_mm", "crlb_ratio", "crlb_ratio_theta", "nees")
    counts = {"nees_band95": None, "failures": 0, "confident_wrong": 0}
    summary = {"limit": dict.fromkeys(keys) | counts}
    monkeypatch.setattr(mismatch, "recorded_trial", recorded_trial)
    monkeypatch.setattr(mismatch, "summarised", lambda samples, methods: summary)
    found = mismatch._figures("localization", TrialConfig(), 0, 5)
    assert (found["warned"], found["warnings"]) == (3, ["a", "b", "c"])


def test_picture_is_png_whatever_its_name(tmp_path):
    # the name once chose the format, and an unknown one ended in a traceback
    pixels = np.zeros((2, 3, 3), dtype=np.uint8)
    assert image_file(tmp_path / "robot.picture", pixels).read_bytes()[:8] == PNG

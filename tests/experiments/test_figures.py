"""The figures are there, say what the files say, and equal runs draw equal ones."""

import numpy as np

from experiments.figures import image_file, scatter, trial_picture
from experiments.kidnap import run_trial
from experiments.trials import generator

PNG = b"\x89PNG\r\n\x1a\n"


def test_run_leaves_its_figures_and_equal_runs_equal_ones(tmp_path, run_trials):
    for name in ("first", "second"):
        assert run_trials(tmp_path / name, 2) == 0
    first, second = tmp_path / "first/localization", tmp_path / "second/localization"
    for name in ("scatter", "trial_0"):
        assert (first / f"{name}.png").read_bytes()[:8] == PNG
        svg = (first / f"{name}.svg").read_bytes()
        assert b"<svg" in svg
        assert svg == (second / f"{name}.svg").read_bytes()


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


def test_picture_is_png_whatever_its_name(tmp_path):
    # the name once chose the format, and an unknown one ended in a traceback
    pixels = np.zeros((2, 3, 3), dtype=np.uint8)
    assert image_file(tmp_path / "robot.picture", pixels).read_bytes()[:8] == PNG

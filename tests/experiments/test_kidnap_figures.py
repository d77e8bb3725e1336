"""The figures of a kidnap's trials say what the records say; older records do not trouble them."""

import json
import math
import re

import numpy as np
import pytest

from experiments.figures import hypotheses_figure, kidnap_map, lost_roc, run_figures
from experiments.figures.hypotheses import _right, _searches, _title
from experiments.figures.kidnaps import Ending, Kidnaps, ending, set_down
from experiments.figures.lost_roc import _panels, _scores, area_under, roc

STATISTICS = ("inlier_ratio", "log_likelihood", "violation_ratio", "error_m2")
SET_DOWN = [1.0, 1.2, 0.5]
RIVAL = [3.0, 1.8, 0.5 - math.pi]
TURN_RAD = math.radians(40)


def comments(path) -> list[str]:
    """The texts in an SVG: Matplotlib writes each into a comment beside its outlines."""
    return re.findall(r"<!-- (.*?) -->", path.read_text())


def outcome(pose, true, success=True, verdict="tracking", status="matched", **more):
    """One method's part of a record, at a true pose of its last look."""
    error = np.subtract(pose, true)
    return {
        "status": status, "verdict": verdict, "reasons": [], "success": success,
        "x_m": pose[0], "y_m": pose[1], "theta_rad": pose[2],
        "x_error_m": error[0], "y_error_m": error[1], "theta_error_rad": error[2], **more,
    }  # fmt: skip


def look(verdict, is_near, *places):
    return {
        "verdict": verdict,
        "reasons": [],
        "is_near": is_near,
        "places": [[*pose, log_likelihood] for pose, log_likelihood in places],
    }


def turned(pose, count):
    return [*pose[:2], pose[2] + count * TURN_RAD]


def searching(looks, success=True):
    """`limit`, sure at the last of some looks; the robot turned in between."""
    rest = [
        look("lost", True, (turned(SET_DOWN, number), -80.0), (turned(RIVAL, number), -81.0 - number))
        for number in range(looks - 1)
    ]  # fmt: skip
    end = turned(SET_DOWN, looks - 1)
    found = turned(SET_DOWN if success else RIVAL, looks - 1)
    rest.append(look("tracking", success, (found, -80.0 * looks)))
    return outcome(found, end, success, detected=True, false_alarm=False, looks=rest)


def trial(index, looks=2, success=True, **more):
    """A kidnap found by `limit` with so many looks, believed elsewhere by `paper`."""
    wrong = outcome([2.0, 2.0, 0.0], SET_DOWN, success=False)
    return {
        "index": index, "status": "ok", "true_poses": [[2.0, 1.2, 0.0], turned(SET_DOWN, looks - 1)],
        "methods": {"paper": wrong, "limit": searching(looks, success) | more},
    }  # fmt: skip


def scores(inlier_ratio, error_m2=None):
    return dict(zip(STATISTICS, (inlier_ratio, -50.0, 0.1, error_m2), strict=True))


@pytest.fixture
def written(tmp_path, box_room):
    """Writes records as a finished run's files; their folder."""

    def write(records, poses="anywhere", methods=("paper", "limit")):
        config = {"place": box_room, "laser": "urg_04lx", "poses": poses, "methods": methods}
        content = {"experiment": "kidnap", "config": config, "trials": len(records)}
        (tmp_path / "config.json").write_text(json.dumps(content))
        lines = [json.dumps(record) + "\n" for record in records]
        (tmp_path / "trials.jsonl").write_text("".join(lines))
        return tmp_path

    return write


def test_map_counts_how_the_trials_ended_and_those_that_raised(written):
    unsure = trial(1)
    unsure["methods"]["limit"] |= {"success": False, "verdict": "unsure"}
    raised = {"index": 2, "status": "error"}
    folder = written([trial(0), unsure, raised])
    assert kidnap_map(folder) == folder / "kidnap_map.png"
    texts = comments(folder / "kidnap_map.svg")
    assert "limit: found in 1 of 3 (33.3%)" in texts
    assert "1 lost and said so, 0 wrong but believed, 1 raised" in texts
    assert "0 lost and said so, 2 wrong but believed, 1 raised" in texts
    # carried by 1 m and turned by 0.5 rad, 29 degrees, both of them
    assert {"0.8-1", "0-30", "(2)"} <= set(texts)
    assert texts.count("(2)") == 2


@pytest.mark.slow
def test_map_of_many_trials_is_of_their_rates(written):
    records = [trial(index) for index in range(200)]
    folder = written(records, poses="random")
    kidnap_map(folder)
    texts = comments(folder / "kidnap_map.svg")
    assert "found (number: trials there)" in texts
    assert texts.count("200") == 2  # all in one cell, of each method


def test_repeated_pair_of_poses_has_no_map(written):
    assert kidnap_map(written([trial(0)], poses="paper")) is None


def test_unsure_or_disowned_pose_is_not_believed():
    assert ending(outcome(SET_DOWN, SET_DOWN)) is Ending.FOUND
    assert ending(outcome(RIVAL, SET_DOWN, success=False)) is Ending.BELIEVED
    assert ending(outcome(RIVAL, SET_DOWN, success=False, verdict="unsure")) is Ending.SAID
    assert ending(outcome(RIVAL, SET_DOWN, success=False, status="degenerate")) is Ending.SAID
    old = outcome(RIVAL, SET_DOWN, success=False)
    del old["verdict"]
    assert ending(old) is Ending.BELIEVED


def test_heading_where_set_down_is_that_of_the_first_look():
    record = trial(0, looks=4)
    np.testing.assert_allclose(set_down(record), SET_DOWN)
    del record["methods"]["paper"]  # which looked once: the right first place tells it too
    np.testing.assert_allclose(set_down(record), SET_DOWN)
    record["methods"]["limit"]["looks"][0]["is_near"] = False
    assert math.isnan(set_down(record)[2])


def test_roc_agrees_with_counting():
    rng = np.random.default_rng(0)
    negatives, positives = rng.integers(0, 9, 40) / 10, rng.integers(3, 12, 50) / 10
    alarms, noticed = roc(negatives, positives)
    assert (alarms[0], noticed[0], alarms[-1], noticed[-1]) == (0.0, 0.0, 1.0, 1.0)
    thresholds = sorted({*negatives, *positives}, reverse=True)
    np.testing.assert_allclose(alarms[1:], [(negatives >= t).mean() for t in thresholds])
    np.testing.assert_allclose(noticed[1:], [(positives >= t).mean() for t in thresholds])
    pairs = [(p > n) + 0.5 * (p == n) for p in positives for n in negatives]
    assert area_under(negatives, positives) == pytest.approx(np.mean(pairs))
    # the trapezoids under the curve are the same number
    trapezoids = np.diff(alarms) * (noticed[1:] + noticed[:-1]) / 2
    assert area_under(negatives, positives) == pytest.approx(trapezoids.sum())


def test_roc_knows_which_way_each_statistic_says_lost(written):
    told = [
        {"before": scores(0.9, 0.01), "after": scores(0.2, 0.5)},
        {"before": scores(0.8), "after": scores(0.3, 0.4)},
    ]
    records = [trial(i, lost_scores=one, false_alarm=i == 1) for i, one in enumerate(told)]
    folder = written(records)
    assert lost_roc(folder) == folder / "lost_roc.png"
    texts = comments(folder / "lost_roc.svg")
    assert "beams that fit the map: area 1.000" in texts
    assert "log-likelihood: area 0.500" in texts
    assert "mean squared distance: area 1.000 (1 without)" in texts
    assert "the verdict: 2 noticed, 1 false, of 2" in texts


def test_methods_of_equal_scores_share_a_panel_and_nulls_are_left_out(written):
    nothing = dict.fromkeys(STATISTICS)
    records = [trial(0, lost_scores={"before": scores(0.9), "after": nothing})]
    records[0]["methods"]["fast"] = records[0]["methods"]["limit"]
    ((names, outcomes),) = _panels(Kidnaps.read(written(records, methods=("fast", "limit"))))
    assert names == "fast, limit"
    assert _scores(outcomes, "before", "inlier_ratio").tolist() == [0.9]
    assert _scores(outcomes, "after", "inlier_ratio").size == 0


def test_hypotheses_are_of_the_trials_that_needed_most_looks(written):
    records = [trial(index, looks=2 + index % 5, success=index != 4) for index in range(8)]
    records[3]["methods"]["limit"]["looks"][-1]["verdict"] = "unsure"
    searches = _searches(Kidnaps.read(written(records)), "limit")
    assert [_title(search) for search in searches] == [
        "trial 4: sure at look 6, and wrong", "trial 3: not sure after 5 looks",
        "trial 2: sure at look 4", "trial 7: sure at look 4",
        "trial 1: sure at look 3", "trial 6: sure at look 3",
    ]  # fmt: skip


def test_run_without_an_ambiguous_trial_has_no_hypotheses(written):
    alone = trial(0)
    del alone["methods"]["limit"]["looks"][0]["places"][1]
    far = trial(1)
    far["methods"]["limit"]["looks"][0]["places"][1][3] -= 100.0
    assert hypotheses_figure(written([alone, far, trial(2, looks=1)])) is None


def test_right_place_is_told_by_its_spot_and_then_its_heading():
    true_m, back = np.array(SET_DOWN[:2]), turned(SET_DOWN, 4.5)
    two = look("lost", False, (RIVAL, -1.0), (SET_DOWN, -2.0))
    assert _right(two, true_m, None) == 1
    same_spot = look("lost", False, (back, -1.0), (SET_DOWN, -2.0))
    assert _right(same_spot, true_m, None) is None
    assert _right(same_spot, true_m, SET_DOWN[2]) == 1
    assert _right(same_spot | {"is_near": True}, true_m, None) == 0
    assert _right(look("lost", False, (RIVAL, -1.0)), true_m, None) is None


@pytest.mark.slow
def test_records_of_older_logs_give_the_map_alone(written):
    record = trial(0)
    for method in record["methods"].values():
        for key in ("looks", "detected", "false_alarm", "verdict", "reasons"):
            method.pop(key, None)
    folder = written([record], poses="random")
    assert kidnap_map(folder) is not None
    # a motion that is the same in all trials: no rates by it
    assert not any("turned by" in text for text in comments(folder / "kidnap_map.svg"))
    assert lost_roc(folder) is None
    assert hypotheses_figure(folder) is None


def test_run_in_which_every_trial_raised_has_none_of_them(written):
    folder = written([{"index": 0, "status": "error"}])
    assert [kidnap_map(folder), lost_roc(folder), hypotheses_figure(folder)] == [None] * 3


@pytest.mark.slow
def test_finished_kidnaps_leave_their_figures_and_equal_ones_each_time(written, monkeypatch):
    # it needs a table that has no part in these
    monkeypatch.setattr("experiments.figures.bound_figure", lambda folder: folder / "bound.png")
    told = {"before": scores(0.9), "after": dict.fromkeys(STATISTICS)}
    folder = written([trial(0, lost_scores=told)], poses="random", methods=("limit",))
    summary = {"experiment": "kidnap", "paper_values": None}
    (folder / "summary.json").write_text(json.dumps(summary))
    names = ["bound", "kidnap_map", "lost_roc", "hypotheses"]
    assert run_figures(folder) == [folder / f"{name}.png" for name in names]
    first = (folder / "lost_roc.svg").read_bytes()
    lost_roc(folder)
    assert (folder / "lost_roc.svg").read_bytes() == first

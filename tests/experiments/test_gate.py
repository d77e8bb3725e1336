"""The gate's command line: three exit statuses, and refusals in one line."""

import json
import shutil
import xml.etree.ElementTree as ET

import pytest

from experiments.cli import main
from experiments.gate import baseline
from tests.experiments.refusals import refusal


@pytest.fixture(scope="module")
def finished(box_room, tmp_path_factory):
    """A folder of one run of ten quick trials, and its baseline."""
    out = tmp_path_factory.mktemp("gate")
    options = ["--trials", "10", "--poses", "random", "--place", box_room, "--jobs", "1"]
    options += ["--method", "odometry,line", "--no-figures", "--out", str(out)]
    assert main(["run", "localization", *options]) == 0
    assert main(["baseline", str(out)]) == 0
    return out


@pytest.fixture
def out(finished, tmp_path):
    """A copy that may be spoiled."""
    return shutil.copytree(finished, tmp_path / "results")


def check(out, *more):
    return main(["check", str(out), str(out / "baseline.json"), *map(str, more)])


def spoiled(out, **changes):
    """The baseline with some of its run changed, and a digest that says that it is meant."""
    path = out / "baseline.json"
    content = json.loads(path.read_text())
    content["runs"][0] |= changes
    content["digest"] = baseline._digest(content["runs"])
    path.write_text(json.dumps(content))


def values_of(out):
    return json.loads((out / "baseline.json").read_text())["runs"][0]["values"]


def test_a_run_is_no_worse_than_itself(out, capsys, tmp_path):
    junit = tmp_path / "junit.xml"
    assert check(out, "--junit", junit) == 0
    printed = capsys.readouterr().out
    assert "paired with the baseline's" in printed
    assert "the results are the same to the byte" in printed
    assert "no worse than the baseline: 11 tested, 11 equal in every trial" in printed
    root = ET.parse(junit).getroot()
    assert root.get("failures") == "0"
    assert int(root.get("tests")) == len(root.findall("testsuite/testcase")) > 5


@pytest.mark.parametrize("given", [["--out", "there"], ["--out=there"]])
def test_a_baseline_keeps_no_folder_of_the_machine(out, given):
    path = next(out.rglob("config.json"))
    config = json.loads(path.read_text())
    config["command"] = ["cli.py", "run", *given, "--trials", "10"]
    path.write_text(json.dumps(config))
    assert main(["baseline", str(out), "--force"]) == 0
    kept = json.loads((out / "baseline.json").read_text())["runs"][0]["inputs"]["command"]
    assert kept == ["cli.py", "run", "--trials", "10"]


def test_a_run_without_figures_has_none(out):
    assert not list((out / "localization").glob("*.png"))


def test_a_worse_run_ends_with_status_1_and_says_what_is_worse(out, capsys, tmp_path):
    values = values_of(out)
    # the baseline was twice as good in each trial, and failed in none
    line = values["line"]
    line["position_error_m"] = [0.5 * one for one in line["position_error_m"]]
    spoiled(out, values=values, results="another")
    assert check(out, "--junit", tmp_path / "junit.xml") == 1
    printed = capsys.readouterr().out
    assert "worse than the baseline: 1 of" in printed
    root = ET.parse(tmp_path / "junit.xml").getroot()
    (failed,) = [case for case in root.iter("testcase") if case.find("failure") is not None]
    assert (failed.get("classname"), failed.get("name")) == (
        "kitasap.localization.line",
        "position error",
    )
    assert "x 2.000" in failed.find("failure").get("message")


def test_a_better_run_is_no_regression(out, capsys):
    values = values_of(out)
    line = values["line"]
    line["position_error_m"] = [2.0 * one for one in line["position_error_m"]]
    spoiled(out, values=values)
    assert check(out) == 0
    assert "better" in capsys.readouterr().out


def test_differences_as_of_other_machines_are_equal(out, capsys):
    values = values_of(out)
    for told in values.values():
        told["position_error_m"] = [one + 9e-6 for one in told["position_error_m"]]
    spoiled(out, values=values, results="another")
    assert check(out) == 0
    assert "equal in every trial" in capsys.readouterr().out


def test_trials_that_fail_now_are_named(out, capsys):
    values = values_of(out)
    failed = values["odometry"]["failed"]
    assert failed[3] == 1
    values["odometry"]["failed"] = [0 if at == 3 else one for at, one in enumerate(failed)]
    spoiled(out, values=values)
    assert check(out) == 0  # one trial of ten decides nothing
    assert "localization, odometry, failed now: 3" in capsys.readouterr().out


def test_another_seed_is_compared_unpaired(out, capsys):
    spoiled(out, seed=77)
    assert check(out) == 0
    assert "10 trials of seed 0 against 10 of seed 77: not paired" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("setting", "value"), [("laser", "lms200"), ("people", 2), ("odometry", "ideal")]
)
def test_runs_of_other_settings_are_compared_only_if_asked(out, capsys, setting, value):
    config = json.loads((out / "baseline.json").read_text())["runs"][0]["config"]
    spoiled(out, config=config | {setting: value})
    told = refusal(capsys, "check", out, out / "baseline.json")
    assert f"{setting} is {value} in the baseline" in told
    assert f"--allow {setting}" in told
    assert check(out, "--allow", setting) == 0
    assert f"compared although other: {setting}" in capsys.readouterr().out


def test_a_setting_that_came_later_had_its_default(out):
    config = json.loads((out / "baseline.json").read_text())["runs"][0]["config"]
    del config["mismatch"]
    spoiled(out, config=config)
    assert check(out) == 0


def test_methods_are_compared_one_by_one_if_asked(out, capsys):
    values = values_of(out)
    config = json.loads((out / "baseline.json").read_text())["runs"][0]["config"]
    spoiled(out, values={"line": values["line"]}, config=config | {"methods": ["line"]})
    told = refusal(capsys, "check", out, out / "baseline.json")
    assert "methods is line in the baseline and odometry,line in the run" in told
    assert "--method" in told
    assert check(out, "--method", "line") == 0
    capsys.readouterr()
    assert "no method 'limit'" in refusal(
        capsys, "check", out, out / "baseline.json", "--method", "limit"
    )


def test_a_longer_run_is_compared_by_the_trials_that_both_have(out, capsys):
    values = {
        method: {name: told[:8] for name, told in one.items()}
        for method, one in values_of(out).items()
    }
    spoiled(out, values=values, trials=8)
    assert check(out) == 0
    assert "8 trials paired with the baseline's, seed 0 (of 10 and 8)" in capsys.readouterr().out


def test_too_few_trials_are_refused_since_they_could_never_fail(out, capsys):
    values = {
        method: {name: told[:3] for name, told in one.items()}
        for method, one in values_of(out).items()
    }
    spoiled(out, values=values, trials=3)
    told = refusal(capsys, "check", out, out / "baseline.json")
    assert "can never show a regression at alpha 0.01" in told
    # the run is long enough
    assert "make the baseline anew with --trials 6" in told
    assert check(out, "--alpha", "0.05") == 0


@pytest.mark.parametrize("seed", [0, 77])
def test_ten_trials_are_enough_for_a_robot_that_no_longer_localises(out, seed):
    values = values_of(out)
    assert sum(values["odometry"]["failed"]) > 7
    values["odometry"]["failed"] = [0] * 10
    spoiled(out, values=values, results="another", seed=seed)
    assert check(out) == 1


def test_place_that_has_changed_is_another_place(out, capsys):
    inputs = json.loads((out / "baseline.json").read_text())["runs"][0]["inputs"]
    assert len(inputs["shape"]) == 64
    other = inputs | {"shape": "0" * 64}
    spoiled(out, inputs=other)
    told = refusal(capsys, "check", out, out / "baseline.json")
    assert "has changed since the baseline was made" in told
    assert check(out, "--allow", "place") == 0
    # another MuJoCo may compile it to other numbers
    spoiled(out, inputs=other | {"versions": inputs["versions"] | {"mujoco": "3.9.9"}})
    assert check(out) == 0
    # baselines of before do not tell
    spoiled(out, inputs={name: one for name, one in inputs.items() if name != "shape"})
    assert check(out) == 0


def test_shard_is_to_be_merged_first(out, capsys):
    path = next(out.rglob("config.json"))
    path.write_text(json.dumps(json.loads(path.read_text()) | {"shard": "1/2"}))
    assert "kitasap merge" in refusal(capsys, "baseline", out, "--force")


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("", "damaged, or no baseline"),
        ("[]", "no baseline"),
        ("\x00\x01", "damaged, or no baseline"),
        ('{"kitasap_baseline": 2, "runs": []}', "of version 2"),
        ('{"kitasap_baseline": true, "runs": []}', "of version True"),
        ('{"kitasap_baseline": 1, "runs": []}', "it holds no runs"),
        ('{"kitasap_baseline": 1, "runs": [3]}', "it is a int"),
        ('{"kitasap_baseline": 1, "runs": [{}]}', "'experiment' is missing"),
        ('{"kitasap_baseline": NaN}', "NaN, which is no number"),
        ("[" * 100_000, "damaged, or no baseline"),
    ],
    ids=range(10),
)
def test_what_is_no_baseline_is_refused(finished, capsys, tmp_path, text, said):
    path = tmp_path / "other.json"
    path.write_text(text)
    assert said in refusal(capsys, "check", finished, path)


@pytest.mark.parametrize("share", [0.2, 0.5, 0.9, 0.999])
def test_a_truncated_baseline_is_refused(out, capsys, share):
    path = out / "baseline.json"
    path.write_bytes(path.read_bytes()[: int(share * path.stat().st_size)])
    assert "damaged" in refusal(capsys, "check", out, path)


@pytest.mark.parametrize(
    "value", [float("nan"), float("inf"), -1.0, 1e300, 10**400, "0.1", True, [1.0], {}]
)
def test_a_value_that_is_none_is_refused(out, capsys, value):
    values = values_of(out)
    values["line"]["position_error_m"][4] = value
    spoiled(out, values=values)
    refusal(capsys, "check", out, out / "baseline.json")


@pytest.mark.parametrize(
    "changes",
    [
        {"trials": 11},
        {"trials": -1},
        {"trials": True},
        {"seed": "0"},
        {"experiment": "juggling"},
        {"config": {"methods": ["line", "odometry"], "colour": "red"}},
        {"config": {"methods": [["line"], 3]}},
        {"config": {"methods": ["line"]}},
        {"values": {"line": {}, "odometry": {}}},
        {"values": {"line": {"failed": [0] * 10, "beauty": [1] * 10}, "odometry": {}}},
        {"values": []},
    ],
    ids=str,
)
def test_a_run_that_contradicts_itself_is_refused(out, capsys, changes):
    spoiled(out, **changes)
    refusal(capsys, "check", out, out / "baseline.json")


def test_a_baseline_changed_by_hand_is_refused(out, capsys):
    path = out / "baseline.json"
    path.write_text(path.read_text().replace('"seed": 0', '"seed": 1'))
    assert "changed by hand" in refusal(capsys, "check", out, path)


def test_a_run_that_is_not_finished_has_no_baseline(out, capsys):
    (out / "localization" / "summary.json").unlink()
    told = refusal(capsys, "baseline", out, "--out", out / "new.json")
    assert "is not finished, 10 of 10 trials" in told
    assert not (out / "new.json").exists()


def test_a_damaged_run_is_refused(out, capsys):
    path = out / "localization" / "trials.jsonl"
    path.write_text("".join(path.read_text().splitlines(keepends=True)[:5]))
    refusal(capsys, "check", out, out / "baseline.json")


def test_nothing_is_written_over_unasked(out, capsys):
    before = (out / "baseline.json").read_bytes()
    assert "--force" in refusal(capsys, "baseline", out)
    assert main(["baseline", str(out), "--force"]) == 0
    assert (out / "baseline.json").read_bytes() == before


@pytest.mark.parametrize("words", [["--alpha", "0"], ["--alpha", "nan"], ["--margin", "-1"]])
def test_error_rates_that_make_no_sense_are_refused(finished, capsys, words):
    refusal(capsys, "check", finished, finished / "baseline.json", *words)


def test_missing_files_are_refused(finished, capsys, tmp_path):
    assert "there is no baseline" in refusal(capsys, "check", finished, tmp_path / "none.json")
    assert "is no folder" in refusal(capsys, "check", tmp_path / "none", finished / "baseline.json")
    assert "no baseline" in refusal(capsys, "check", finished, tmp_path)


def test_a_check_that_breaks_does_not_say_that_the_robot_got_worse(finished, capsys, monkeypatch):
    def broken(*arguments, **named):
        raise KeyError("a mistake of ours")

    monkeypatch.setattr("experiments.gate.check.checked", broken)
    told = refusal(capsys, "check", finished, finished / "baseline.json")
    assert "the check itself failed: KeyError" in told

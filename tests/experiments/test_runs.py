"""Runs: the same seed gives the same bytes, however it is cut up; nothing finished is lost."""

import json
import os
import signal
import subprocess
import sys
import time
from dataclasses import replace
from pathlib import Path

import pytest

from experiments import localization, runs
from experiments.cli import main
from experiments.runs import Run
from experiments.trial_log import TrialLog, locked
from tests.experiments.processes import group, wait_until
from tests.experiments.refusals import line_of_refusal

REPOSITORY = Path(__file__).parents[2]

# Long enough to be met in the middle: 80 ms each, most of it the hand that carries the robot.
KIDNAPS = 12


@pytest.fixture(scope="module", autouse=True)
def no_figures():
    """Those of a whole run, two seconds each: test_figures looks at them."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("experiments.figures.run_figures", lambda _: None)
        yield


def results(folder: Path) -> tuple[bytes, bytes]:
    return (folder / "trials.jsonl").read_bytes(), (folder / "trials.csv").read_bytes()


def execute(run: Run, jobs: int = 1) -> dict:
    return run.execute(jobs, lambda *_: None)


# of paper, each process loads Open3D
@pytest.mark.parametrize("method", ["line", pytest.param("paper", marks=pytest.mark.slow)])
def test_jobs_and_a_cut_run_give_the_same_bytes(method, tmp_path, quick_config):
    config = replace(quick_config, methods=("odometry", method))
    execute(Run("localization", config, 0, 4, tmp_path / "one"))
    execute(Run("localization", config, 0, 4, tmp_path / "two"), jobs=2)
    whole = results(tmp_path / "one")
    assert len(whole[0].splitlines()) == 4
    assert len(whole[1].splitlines()) == 1 + 4 * 2
    assert results(tmp_path / "two") == whole

    # a crash in the middle of the third line
    lines = whole[0].splitlines(keepends=True)
    (tmp_path / "two/trials.jsonl").write_bytes(b"".join(lines[:2]) + lines[2][:100])
    (tmp_path / "two/trials.csv").unlink()
    TrialLog(tmp_path / "two", "localization", json.loads(lines[0])["config"])
    # cut off at once: the next line must not be written behind it
    assert (tmp_path / "two/trials.jsonl").read_bytes() == b"".join(lines[:2])
    execute(Run("localization", config, 0, 4, tmp_path / "two"))
    assert results(tmp_path / "two") == whole


def test_one_trial_again_prints_its_line_of_the_log(tmp_path, run_trials, box_room, capsys):
    assert run_trials(tmp_path, 3, ["--seed", "5", "--no-figures"]) == 0
    capsys.readouterr()
    arguments = ["trial", "localization", "--seed", "5", "--index", "2", "--poses", "random"]
    arguments += ["--place", box_room, "--method", "odometry,line", "--out", str(tmp_path)]
    assert main(arguments) == 0
    folder = tmp_path / "localization"
    assert capsys.readouterr().out == (folder / "trials.jsonl").read_text().splitlines(True)[2]
    assert (folder / "trial_2.png").read_bytes()[:4] == b"\x89PNG"


@pytest.mark.slow
def test_seeds_and_indices_make_different_trials(tmp_path, run_trials):
    assert run_trials(tmp_path / "a", 2, ["--seed", "0"]) == 0
    assert run_trials(tmp_path / "b", 2, ["--seed", "1"]) == 0
    poses = [
        tuple(json.loads(line)["true_poses"][0])
        for name in "ab"
        for line in (tmp_path / name / "localization/trials.jsonl").read_text().splitlines()
    ]
    assert len(set(poses)) == 4


@pytest.mark.slow
def test_more_trials_do_the_missing_ones_only(tmp_path, run_trials, monkeypatch):
    assert run_trials(tmp_path / "fresh", 4) == 0
    assert run_trials(tmp_path / "grown", 2) == 0
    done, original = [], runs.recorded_trial

    def noted(*job):
        done.append(job[-1])
        return original(*job)

    monkeypatch.setattr(runs, "recorded_trial", noted)
    assert run_trials(tmp_path / "grown", 4) == 0
    assert done == [2, 3]
    assert results(tmp_path / "grown/localization") == results(tmp_path / "fresh/localization")


@pytest.mark.slow
def test_fewer_trials_are_counted_alone_but_none_is_forgotten(tmp_path, run_trials):
    folder = tmp_path / "localization"
    assert run_trials(tmp_path, 3) == 0
    assert run_trials(tmp_path, 1) == 0
    assert json.loads((folder / "summary.json").read_text())["trials"] == 1
    assert len((folder / "trials.csv").read_text().splitlines()) == 1 + 1 * 2
    assert len((folder / "trials.jsonl").read_text().splitlines()) == 3


def test_folder_of_another_configuration_is_refused(tmp_path, run_trials, capsys):
    assert run_trials(tmp_path, more=["--no-figures"]) == 0
    before = results(tmp_path / "localization")
    for other in (["--seed", "1"], ["--laser", "ld06"], ["--odometry", "ideal"]):
        capsys.readouterr()
        line = line_of_refusal(capsys, run_trials(tmp_path, more=other))
        assert line.startswith(f"{tmp_path}/localization holds trials of another config")
    assert results(tmp_path / "localization") == before


def test_folder_of_a_later_experiment_is_refused_before_the_first_is_run(
    tmp_path, run_trials, box_room, capsys
):
    assert run_trials(tmp_path, more=["--no-figures"]) == 0
    options = ["--place", box_room, "--poses", "random", "--method", "odometry", "--seed", "1"]
    options += ["--trials", "1", "--jobs", "1"]
    capsys.readouterr()
    command = ["run", "kidnap", "localization", *options, "--out", str(tmp_path)]
    line = line_of_refusal(capsys, main(command))
    assert line.startswith(f"{tmp_path}/localization holds trials of another config")
    assert not (tmp_path / "kidnap").exists()


def test_folder_at_which_another_run_is_at_work_is_refused(tmp_path, run_trials, capsys):
    folder = tmp_path / "localization"
    with locked(folder):
        line = line_of_refusal(capsys, run_trials(tmp_path))
    assert line == f"another run is at work in {folder}: wait for its end"
    assert list(folder.iterdir()) == []
    assert run_trials(tmp_path, more=["--no-figures"]) == 0


@pytest.mark.parametrize("line", [b"\xff\xfe{}\n", b"[]\n", b"{}\n", b"nonsense\n"])
def test_log_that_is_none_is_refused_and_left_alone(tmp_path, run_trials, capsys, line):
    log = tmp_path / "localization/trials.jsonl"
    log.parent.mkdir()
    log.write_bytes(line)
    said = line_of_refusal(capsys, run_trials(tmp_path))
    assert said.startswith(f"{log} line 1 is not a trial: ")
    assert log.read_bytes() == line


def test_trial_that_raises_is_a_failure_and_not_the_end(tmp_path, run_trials, monkeypatch, capsys):
    original = localization.run_trial

    def broken(config, rng, *observer):
        if rng.bit_generator.seed_seq.spawn_key[-1] == 0:
            raise FloatingPointError("the floor is gone")
        return original(config, rng, *observer)

    monkeypatch.setattr(localization, "run_trial", broken)
    assert run_trials(tmp_path, 3) == 1
    folder = tmp_path / "localization"
    first, *others = map(json.loads, (folder / "trials.jsonl").read_text().splitlines())
    assert (first["status"], first["error"]) == ("error", "FloatingPointError: the floor is gone")
    assert first["traceback"].splitlines()[-1] == first["error"]
    assert "in broken" in first["traceback"]
    assert [record["status"] for record in others] == ["ok", "ok"]
    summary = json.loads((folder / "summary.json").read_text())
    for result in summary["methods"].values():
        assert result["raised"] == 1
        assert result["failures"] >= 1
        assert result["success_rate"] == (3 - result["failures"]) / 3
    row = (folder / "trials.csv").read_text().splitlines()[1]
    assert row.startswith("0,error,")
    assert row.endswith("FloatingPointError: the floor is gone")
    assert "raised: 1" in capsys.readouterr().err
    # the first trial that can be drawn is
    assert [path.name for path in folder.glob("trial_*.png")] == ["trial_1.png"]


COMMON_KEYS = {
    *("success_rate", "success_ci95", "failures", "x_cm", "y_cm", "theta_rad"),
    *("rmse_mm", "rmse_mrad", "crlb_mm", "crlb_ratio", "crlb_ratio_theta", "nees"),
}
KIDNAP_KEYS = {
    *("detected_rate", "false_alarms", "confident_wrong", "unsure_rate"),
    *("scans_to_recover", "query_cpu_ms"),
}


@pytest.mark.parametrize(
    ("experiment", "keys"),
    [("localization", COMMON_KEYS), ("kidnap", COMMON_KEYS | KIDNAP_KEYS)],
)
def test_summary_and_config_have_the_keys_that_scripts_read(
    tmp_path, quick_config, experiment, keys
):
    execute(Run(experiment, quick_config, 3, 2, tmp_path))
    summary = json.loads((tmp_path / "summary.json").read_text())
    assert {"wall_s", "cpu_s", "sim_s", "methods", "paper_values"} <= set(summary)
    assert (summary["experiment"], summary["trials"], summary["seed"]) == (experiment, 2, 3)
    assert set(summary["methods"]) == {"odometry", "line"}
    for result in summary["methods"].values():
        assert keys - set(result) == set()
        for axis in ("x_cm", "y_cm", "theta_rad"):
            assert set(result[axis]) == {"mean", "max", "std", "rmse"}
        # dead reckoning and lines claim no covariance, and no made-up number stands for one
        assert result["nees"] is None
    config = json.loads((tmp_path / "config.json").read_text())
    assert (config["seed"], config["trials"]) == (3, 2)
    assert config["config"]["methods"] == ["odometry", "line"]
    assert {"python", "mujoco", "numpy"} <= set(config["versions"])
    assert {"commit", "command"} <= set(config)
    line = json.loads((tmp_path / "trials.jsonl").read_text().splitlines()[0])
    assert (line["experiment"], line["config"]) == (experiment, config["config_hash"])


@pytest.mark.slow
def test_kidnap_summary_tells_how_long_a_search_takes(tmp_path, quick_config):
    summary = execute(Run("kidnap", quick_config, 0, 2, tmp_path))
    timings = map(json.loads, (tmp_path / "timings.jsonl").read_text().splitlines())
    times_ms = [1000 * timing["methods"]["line"] for timing in timings]
    # of two values the median is the mean
    median_ms = summary["methods"]["line"]["query_cpu_ms"]["median"]
    assert median_ms == pytest.approx(sum(times_ms) / 2)
    assert min(times_ms) > 0.0


# Runs that are ended from outside.


@pytest.fixture(scope="module")
def kidnap_arguments(box_room) -> list[str]:
    options = f"--poses random --method odometry --trials {KIDNAPS}".split()
    return ["run", "kidnap", "--place", box_room, *options]


@pytest.fixture(scope="module")
def whole_run(kidnap_arguments, tmp_path_factory) -> tuple[bytes, bytes]:
    """The results of the run that nobody disturbs."""
    folder = tmp_path_factory.mktemp("whole")
    assert main([*kidnap_arguments, "--jobs", "1", "--out", str(folder)]) == 0
    return results(folder / "kidnap")


def started(arguments: list[str], out: Path) -> subprocess.Popen:
    """The command in a process group of its own, with two workers."""
    command = [sys.executable, "-m", "experiments.cli", *arguments]
    return subprocess.Popen(
        [*command, "--jobs", "2", "--out", str(out)],
        cwd=REPOSITORY, text=True, start_new_session=True,
        stdout=subprocess.PIPE, stderr=subprocess.PIPE,
        # a shell that runs the tests in its background has them ignore interrupts
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.SIG_DFL),
    )  # fmt: skip


def lines_in(log: Path) -> int:
    return log.read_bytes().count(b"\n") if log.exists() else 0


needs_proc = pytest.mark.skipif(
    not Path("/proc/self/stat").exists(), reason="finds the workers by /proc, which Linux has"
)


@pytest.mark.slow
@needs_proc
def test_killed_run_is_finished_by_the_same_command(tmp_path, kidnap_arguments, whole_run):
    log = tmp_path / "kidnap/trials.jsonl"
    process = started(kidnap_arguments, tmp_path)
    try:
        assert wait_until(lambda: lines_in(log) >= 3)
        process.kill()  # the parent alone; its workers have to notice by themselves
        process.communicate(timeout=30)
        assert wait_until(lambda: not group(process.pid)), "workers outlive their parent"
    finally:
        for orphan in group(process.pid):
            os.kill(orphan, signal.SIGKILL)
    assert process.returncode == -signal.SIGKILL
    assert 3 <= lines_in(log) < KIDNAPS
    assert main([*kidnap_arguments, "--jobs", "1", "--out", str(tmp_path)]) == 0
    assert results(tmp_path / "kidnap") == whole_run


@pytest.mark.slow
@needs_proc
@pytest.mark.parametrize(
    ("number", "status", "how"),
    [(signal.SIGINT, 130, "interrupted"), (signal.SIGTERM, 143, "terminated")],
)
def test_interrupted_run_loses_nothing_that_was_finished(
    tmp_path, kidnap_arguments, whole_run, number, status, how
):
    log = tmp_path / "kidnap/trials.jsonl"
    process = started(kidnap_arguments, tmp_path)
    assert wait_until(lambda: lines_in(log) >= 3)
    os.killpg(process.pid, number)  # as a terminal does: to the workers as well
    _, said = process.communicate(timeout=30)
    assert process.returncode == status
    assert said.splitlines()[-1] == f"kitasap: {how}; the same command goes on from here"
    assert "Traceback" not in said
    text = log.read_bytes()
    assert 3 <= text.count(b"\n") < KIDNAPS
    assert text.endswith(b"\n")
    assert set(text.splitlines()) < set(whole_run[0].splitlines())
    assert main([*kidnap_arguments, "--jobs", "1", "--out", str(tmp_path)]) == 0
    assert results(tmp_path / "kidnap") == whole_run


@needs_proc
def test_interrupts_are_held_though_it_is_the_first_process_that_starts():
    code = (
        "import multiprocessing, signal, time\n"
        "from experiments.processes import _interrupts_held\n"
        "context = multiprocessing.get_context('spawn')\n"
        "process = context.Process(target=time.sleep, args=(0,))\n"
        "with _interrupts_held():\n"
        "    process.start()\n"
        "    print(signal.SIGINT in signal.pthread_sigmask(signal.SIG_BLOCK, ()))\n"
        "process.kill()\n"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout == "True\n"


@pytest.mark.slow
@needs_proc
def test_interrupt_while_workers_still_start_is_an_interrupt_too(tmp_path, kidnap_arguments):
    # they once died of it in their imports, and the run ended with status 2 and tracebacks
    process = started(kidnap_arguments, tmp_path)
    # the parent, its resource tracker and two workers
    assert wait_until(lambda: len(group(process.pid)) >= 4)
    time.sleep(0.1)
    os.killpg(process.pid, signal.SIGINT)
    _, said = process.communicate(timeout=30)
    assert process.returncode == 130
    assert "Traceback" not in said

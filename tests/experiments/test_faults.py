"""Faults: nothing finished is lost, nothing counts twice, the same command goes on."""

import errno
import json
import os
import random
import resource
import subprocess
import sys
import time
from dataclasses import replace
from pathlib import Path

import pytest

from experiments import json_lines, localization
from experiments.cli import main
from experiments.json_lines import TrialLines, replaced
from experiments.runs import Run
from experiments.trials import forget_places
from tests.experiments.processes import group, wait_until
from tests.experiments.refusals import line_of_refusal

REPOSITORY = Path(__file__).parents[2]
KEY = {"experiment": "kidnap", "config": "0123"}
KILLS, TRIALS = 50, 200


@pytest.fixture(scope="module", autouse=True)
def no_figures():
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("experiments.commands.execution.draw", lambda _: None)
        yield


def results(folder: Path) -> tuple[bytes, bytes]:
    return (folder / "trials.jsonl").read_bytes(), (folder / "trials.csv").read_bytes()


def lines_in(log: Path) -> int:
    return log.read_bytes().count(b"\n") if log.exists() else 0


def filled(path: Path, *indices: int) -> TrialLines:
    lines = TrialLines(path, KEY)
    for index in indices:
        lines.append_line(index, lines.as_line(index, {"status": "ok", "value": index / 7}))
    return lines


def test_lines_are_found_by_index_and_sorted_once_each(tmp_path):
    lines = filled(tmp_path / "log", 3, 0, 2, 0)
    assert lines.indices == [0, 2, 3]
    assert lines.record(3) == KEY | {"index": 3, "status": "ok", "value": 3 / 7}
    lines.sort()
    told = [json.loads(line)["index"] for line in (tmp_path / "log").read_bytes().splitlines()]
    assert told == [0, 2, 3]
    lines.append_line(1, lines.as_line(1, {"status": "ok"}))
    assert [record["index"] for record in lines.records([1, 3])] == [1, 3]
    lines.sort()
    assert TrialLines(tmp_path / "log", KEY).indices == [0, 1, 2, 3]


@pytest.mark.parametrize(
    "damage",
    [
        b'{"experiment": "kid',
        b"\0\0\0\0\0\0",
        b"nonsense\n",
        b"\xff\xfe\xfd\n",
        b"{}\n",
        b"[1, 2]\n",
    ],
)
def test_damaged_last_line_is_cut_off_and_said(tmp_path, damage):
    path = tmp_path / "log"
    filled(path, 0, 1).close()
    whole = path.read_bytes()
    path.write_bytes(whole + damage)
    kept = TrialLines(path, KEY, is_kept=True)
    assert (kept.indices, path.read_bytes()) == ([0, 1], whole + damage)
    lines = TrialLines(path, KEY)
    assert lines.indices == [0, 1]
    assert path.read_bytes() == whole
    assert lines.mended == f"the last line of {path} was damaged, and is done again"


def test_damaged_line_in_the_middle_is_refused_with_its_number(tmp_path):
    path = tmp_path / "log"
    filled(path, 0, 1, 2).close()
    first, second, third = path.read_bytes().splitlines(keepends=True)
    path.write_bytes(first + second[:20] + b"\n" + third)
    with pytest.raises(ValueError, match=r"log line 2 is not a trial: .* does the trial again"):
        TrialLines(path, KEY)


class NearlyFull:
    """A disk with so many bytes left."""

    def __init__(self, file, left: int) -> None:
        self._file, self._left = file, left

    def write(self, data: bytes) -> int:
        if self._left == 0:
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        taken = min(len(data), self._left)
        self._left -= taken
        return self._file.write(data[:taken])

    def __getattr__(self, name: str):
        return getattr(self._file, name)


def test_line_for_which_the_disk_has_no_room_leaves_nothing(tmp_path):
    path = tmp_path / "log"
    lines = filled(path, 0, 1)
    whole = path.read_bytes()
    assert lines._file is not None
    lines._file = NearlyFull(lines._file, left=25)
    with pytest.raises(OSError, match="No space left") as raised:
        lines.append_line(2, lines.as_line(2, {"status": "ok"}))
    assert raised.value.filename == str(path)
    assert (path.read_bytes(), lines.indices) == (whole, [0, 1])
    lines._file.close()


def test_file_for_which_the_disk_has_no_room_stays_as_it_was(tmp_path):
    path = tmp_path / "summary.json"
    path.write_text("before")

    def fill():
        with replaced(path) as file:
            file.write(b"after")
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    with pytest.raises(OSError, match="No space left") as raised:
        fill()
    assert raised.value.filename == str(path)
    assert [one.name for one in tmp_path.iterdir()] == ["summary.json"]
    assert path.read_text() == "before"


def test_run_on_a_full_disk_ends_in_one_line_and_goes_on_later(
    tmp_path, run_trials, monkeypatch, capsys
):
    assert run_trials(tmp_path / "whole", 4) == 0
    original, written = TrialLines.append_line, []

    def full(lines, index, line):
        written.append(index)
        if len(written) > 5:  # timing and trial of two, timing of the third
            with json_lines.named(lines.path):
                raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        original(lines, index, line)

    capsys.readouterr()
    with monkeypatch.context() as patch:
        patch.setattr(TrialLines, "append_line", full)
        assert run_trials(tmp_path / "full", 4) == 2
    log = tmp_path / "full/localization/trials.jsonl"
    # behind the lines of progress
    last = capsys.readouterr().err.splitlines()[-1]
    assert last == f"kitasap: {log}: No space left on device"
    assert log.read_bytes().count(b"\n") == 2
    assert run_trials(tmp_path / "full", 4) == 0
    assert results(log.parent) == results(tmp_path / "whole/localization")


@pytest.mark.parametrize(
    ("was", "became"),
    [
        (b'"index": 2', b'"index": 1'),
        (b'"index": 2', b'"index": -1'),
        (b'"status"', b'"statuz"'),
        (b'"methods"', b'"nethods"'),
        (b'"success": true', b'"success": null'),
        (b"0.0", b"7.0"),
    ],
)
def test_damage_that_leaves_json_is_told_by_the_checksum(tmp_path, run_trials, capsys, was, became):
    assert run_trials(tmp_path, 3, ["--no-figures"]) == 0
    log = tmp_path / "localization" / "trials.jsonl"
    whole = results(log.parent)
    lines = log.read_bytes().splitlines(keepends=True)
    assert was in lines[2]
    log.write_bytes(b"".join(lines[:2]) + lines[2].replace(was, became, 1))
    capsys.readouterr()
    assert run_trials(tmp_path, 3, ["--no-figures"]) == 0
    assert f"the last line of {log} was damaged" in capsys.readouterr().err
    assert results(log.parent) == whole
    log.write_bytes(lines[0] + lines[1].replace(was, became, 1) + lines[2])
    if was in lines[1]:
        assert "line 2 is not a trial" in line_of_refusal(capsys, run_trials(tmp_path, 3))


def test_log_without_checksums_goes_on(tmp_path, run_trials):
    assert run_trials(tmp_path, 3, ["--no-figures"]) == 0
    log = tmp_path / "localization" / "trials.jsonl"
    whole = results(log.parent)
    timings = log.with_name("timings.jsonl")
    told = [json.loads(line) for line in timings.read_text().splitlines()]
    assert all(one.pop("crc32") for one in told)
    timings.write_text("".join(json.dumps(one) + "\n" for one in told))
    log.write_bytes(b"".join(log.read_bytes().splitlines(keepends=True)[:2]))
    assert run_trials(tmp_path, 3, ["--no-figures"]) == 0
    assert results(log.parent) == whole


def test_damaged_end_is_said_by_the_run_that_mends_it(tmp_path, run_trials, capsys):
    assert run_trials(tmp_path, 3) == 0
    folder = tmp_path / "localization"
    whole = results(folder)
    (folder / "trials.jsonl").write_bytes(whole[0][:-200])
    capsys.readouterr()
    assert run_trials(tmp_path, 3) == 0
    assert f"the last line of {folder}/trials.jsonl was damaged" in capsys.readouterr().err
    assert results(folder) == whole


def test_only_trials_that_raised_are_done_again_when_asked(tmp_path, run_trials, monkeypatch):
    assert run_trials(tmp_path / "whole", 3) == 0
    original, done = localization.run_trial, []

    def run_trial(config, rng, *observer):
        index = rng.bit_generator.seed_seq.spawn_key[-1]
        done.append(index)
        if index == 1 and len(done) == 2:
            raise MemoryError("for once")
        return original(config, rng, *observer)

    monkeypatch.setattr("experiments.runs.rehearse", lambda *_: None)
    monkeypatch.setattr(localization, "run_trial", run_trial)
    assert run_trials(tmp_path / "again", 3) == 1
    assert run_trials(tmp_path / "again", 3) == 1
    assert done == [0, 1, 2]
    assert run_trials(tmp_path / "again", 3, ["--retry-failed"]) == 0
    assert done == [0, 1, 2, 1]
    assert results(tmp_path / "again/localization") == results(tmp_path / "whole/localization")


def test_other_run_in_the_folder_is_refused_with_what_differs(tmp_path, quick_config):
    run = Run("localization", quick_config, 0, 1, tmp_path)
    run.execute(1, lambda *_: None)
    other = replace(run, seed=1, config=replace(quick_config, laser="ld06"))
    with pytest.raises(ValueError, match=r"seed is 0 there, 1 here; laser is urg_04lx there, ld06"):
        other.check()
    config = json.loads((tmp_path / "config.json").read_text())
    config["digests"]["code"] = "of yesterday"
    (tmp_path / "config.json").write_text(json.dumps(config))
    log = (tmp_path / "trials.jsonl").read_text()
    (tmp_path / "trials.jsonl").write_text(log.replace(config["config_hash"], "0" * 16))
    with pytest.raises(ValueError, match=r"version of the code \(the code has changed since\)"):
        run.check()


def test_place_file_that_has_changed_is_named(tmp_path, quick_config):
    place = tmp_path / "place.xml"
    place.write_text(Path(quick_config.place).read_text())
    run = Run("localization", replace(quick_config, place=str(place)), 0, 1, tmp_path / "run")
    run.execute(1, lambda *_: None)
    place.write_text(place.read_text().replace("0.2 0.5", "0.3 0.5"))
    forget_places()  # as in another process
    with pytest.raises(ValueError, match=r"\(the place has changed since\): choose another"):
        run.check()


@pytest.mark.slow
@pytest.mark.skipif(sys.platform == "win32", reason="limits of processes are of POSIX")
def test_file_that_may_not_grow_ends_the_run_and_loses_nothing(tmp_path, run_trials, box_room):
    command = ["run", "localization", "--trials", "20", "--poses", "random", "--jobs", "2"]
    command += ["--method", "odometry,line"]
    command += ["--place", box_room, "--out", str(tmp_path / "small")]
    done = subprocess.run(
        [sys.executable, "-m", "experiments.cli", *command],
        cwd=REPOSITORY, capture_output=True, text=True, check=False,
        preexec_fn=lambda: resource.setrlimit(resource.RLIMIT_FSIZE, (8000, 8000)),
    )  # fmt: skip
    log = tmp_path / "small/localization/trials.jsonl"
    assert done.returncode == 2
    assert done.stderr.splitlines()[-1] == f"kitasap: {log}: File too large"
    assert 0 < log.read_bytes().count(b"\n") < 20
    assert log.read_bytes().endswith(b"\n")
    # what a trial itself could not write, compiled code say, was its failure
    assert run_trials(tmp_path / "small", 20, ["--retry-failed"]) == 0
    assert run_trials(tmp_path / "whole", 20) == 0
    assert results(log.parent) == results(tmp_path / "whole/localization")


@pytest.mark.slow
@pytest.mark.skipif(not Path("/proc/self/stat").exists(), reason="finds the workers by /proc")
def test_run_killed_at_50_random_moments_gives_the_bytes_of_an_undisturbed_one(tmp_path, box_room):
    command = f"run localization --trials {TRIALS} --poses random --method odometry,line".split()
    command += ["--place", box_room, "--jobs", "2", "--out"]
    assert main([*command, str(tmp_path / "whole")]) == 0
    whole = results(tmp_path / "whole/localization")
    moments, folder, counts = random.Random(0), 0, []
    for _ in range(KILLS):
        out = tmp_path / f"killed_{folder}"
        log = out / "localization/trials.jsonl"
        before = lines_in(log)
        process = subprocess.Popen(
            [sys.executable, "-m", "experiments.cli", *command, str(out)],
            cwd=REPOSITORY, start_new_session=True, stderr=subprocess.DEVNULL,
            stdout=subprocess.DEVNULL,
        )  # fmt: skip
        try:
            # anywhere: as it starts, in the middle, and as it writes what came out
            wanted = before + moments.randint(0, 10)
            assert wait_until(
                lambda p=process, log=log, n=wanted: lines_in(log) >= n or p.poll() is not None, 300
            )
            time.sleep(moments.uniform(0.0, 0.1 if wanted > before else 3.0))
        finally:
            process.kill()
            process.communicate()
        assert wait_until(lambda p=process: not group(p.pid)), "workers outlive their parent"
        counts.append(lines_in(log) - before)
        assert counts[-1] >= 0
        if lines_in(log) == TRIALS:
            assert main([*command, str(out)]) == 0
            assert results(log.parent) == whole
            folder += 1
    assert main([*command, str(out)]) == 0
    assert results(log.parent) == whole
    indices = [json.loads(line)["index"] for line in whole[0].splitlines()]
    assert indices == list(range(TRIALS))
    print(f"{KILLS} kills over {folder + 1} runs of {TRIALS}; trials done before each: {counts}")

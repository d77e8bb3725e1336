"""Engines: every trial once, whatever becomes of the processes that do them."""

import subprocess
import sys
import time
from pathlib import Path

import pytest

from experiments import engines
from experiments.engine_names import engine_named
from experiments.processes import ProcessCrew, local_engine
from tests.experiments.processes import group, wait_until
from tests.experiments.small_tasks import (
    DyingTask,
    HangingTask,
    SmallTask,
    UnpreparedTask,
    at_work,
)

REPOSITORY = Path(__file__).parents[2]


def squares(finished) -> dict[int, int]:
    return {index: record["square"] for index, record, _ in finished}


def test_trials_are_done_once_each_and_in_several_batches():
    task = SmallTask()
    with at_work(local_engine(2), task) as work:
        first, second = list(work(range(5))), list(work(range(5, 8)))
    assert sorted(first) == [task(index) for index in range(5)]
    assert sorted(second) == [task(index) for index in range(5, 8)]


def test_trial_whose_process_is_killed_is_done_again(tmp_path):
    told: list[str] = []
    with at_work(local_engine(2), DyingTask(tmp_path, at=2, times=2), told) as work:
        finished = list(work(range(5)))
    assert squares(finished) == {index: index * index for index in range(5)}
    assert len(finished) == 5
    assert told == ["the process at trial 2 died (by signal 9); the trial is done again"] * 2


def test_trial_that_kills_its_process_each_time_is_a_failure_and_the_others_go_on(tmp_path):
    with at_work(local_engine(2), DyingTask(tmp_path, at=1, times=99)) as work:
        finished = {index: record for index, record, _ in work(range(4))}
    assert sorted(finished) == [0, 1, 2, 3]
    assert finished[1]["status"] == "error"
    assert finished[1]["error"] == "process died: 3 times, the last one by signal 9"
    assert {finished[index]["status"] for index in (0, 2, 3)} == {"ok"}
    assert len(list(tmp_path.iterdir())) == 3


def test_trial_that_hangs_is_stopped_at_its_limit_and_the_others_go_on():
    told: list[str] = []
    with at_work(local_engine(1, limit_s=0.5), HangingTask(at=1), told) as work:
        finished = {index: (record, timing) for index, record, timing in work(range(3))}
    record, timing = finished[1]
    assert record["error"] == "timeout: not done within 0.5 s"
    assert 0.5 <= timing["wall_s"] < 5.0
    assert told == ["trial 1 was not done within 0.5 s: stopped"]
    assert [finished[index][0]["status"] for index in (0, 2)] == ["ok", "ok"]


def test_long_trial_without_a_limit_is_told_of_and_a_second_interrupt_ends_it(monkeypatch):
    monkeypatch.setattr(engines, "_LONG_S", 0.2)
    told: list[str] = []
    original = ProcessCrew.events

    def events(crew, timeout_s):
        if told:  # whoever waits has had enough
            raise KeyboardInterrupt
        return original(crew, timeout_s)

    monkeypatch.setattr(ProcessCrew, "events", events)
    with (
        at_work(local_engine(2), HangingTask(at=1), told) as work,
        pytest.raises(KeyboardInterrupt),
    ):
        list(work([1]))
    assert told == [
        "trial 1 has been under way for 0 minutes; --trial-timeout ends such",
        "waiting for the trials under way; another interrupt ends them",
    ]


def test_trial_whose_process_dies_after_an_interrupt_is_not_begun_again(monkeypatch):
    original = ProcessCrew.events
    is_interrupted = False

    def events(crew, timeout_s):
        nonlocal is_interrupted
        if is_interrupted:
            for hand in crew._hands.values():  # as a SIGTERM for all processes of a group
                hand._process.terminate()
        heard = original(crew, timeout_s)
        if not is_interrupted and any(isinstance(event, engines.Ready) for event in heard):
            monkeypatch.setattr(engines._Foreman, "_patience_s", interrupting)
        return heard

    def interrupting(_):
        nonlocal is_interrupted
        if not is_interrupted:
            is_interrupted = True
            monkeypatch.setattr(ProcessCrew, "hire", lambda _: pytest.fail("begun again"))
            raise KeyboardInterrupt

    monkeypatch.setattr(ProcessCrew, "events", events)
    with at_work(local_engine(2), HangingTask(at=1)) as work, pytest.raises(KeyboardInterrupt):
        list(work([1]))


def test_processes_that_never_get_ready_end_the_run():
    with (
        pytest.raises(RuntimeError, match=r"die at once \(with status 3\)"),
        at_work(local_engine(2), UnpreparedTask()) as work,
    ):
        list(work(range(3)))


def test_process_of_another_version_is_refused():
    engine = local_engine(2)
    with (
        pytest.raises(ValueError, match="has another version of the code"),
        engine.at_work(SmallTask(), "of yesterday", lambda _: None) as work,
    ):
        list(work(range(3)))


@pytest.mark.skipif(sys.platform != "linux", reason="of Linux: others have a thread for it")
def test_hanging_process_does_not_outlive_a_parent_that_is_killed():
    parent = subprocess.Popen(
        [sys.executable, "-m", "tests.experiments.small_tasks"],
        cwd=REPOSITORY, start_new_session=True, stdout=subprocess.PIPE,
    )  # fmt: skip
    assert parent.stdout is not None
    assert parent.stdout.readline() == b"0\n"
    time.sleep(0.1)
    parent.kill()
    parent.communicate()
    assert wait_until(lambda: not group(parent.pid), 10.0)


@pytest.mark.parametrize(
    ("asked", "said"),
    [
        (("cloud", None), "no engine called 'cloud'; there are: local, serial, ray"),
        (("local", 2, 0.0), "--trial-timeout takes seconds above 0 and up to 86400, a day, not 0"),
        (("local", 2, float("nan")), "--trial-timeout takes seconds above 0 and"),
        (("local", 2, 4e6), "--trial-timeout takes seconds above 0 and up to 86400"),
        (("local", 2, None, "auto"), "--address is that of a Ray cluster"),
        (("serial", 2), "--engine serial is this process alone"),
        (("serial", None, 5.0), "--engine serial is this process alone"),
    ],
)
def test_engine_that_cannot_be_is_refused(asked, said):
    with pytest.raises(ValueError, match="^" + said.replace("(", r"\(")):
        engine_named(*asked)


def test_ray_that_is_not_installed_is_named_with_its_extra(monkeypatch):
    monkeypatch.setitem(sys.modules, "ray", None)
    with pytest.raises(ImportError, match=r"pip install 'kitasap\[ray\]'"):
        engine_named("ray", 2)


@pytest.mark.slow
def test_ray_does_each_trial_once_also_where_processes_die_or_hang(tmp_path):
    pytest.importorskip("ray")
    told: list[str] = []
    with at_work(engine_named("ray", 2), DyingTask(tmp_path, at=2, times=1), told) as work:
        assert squares(work(range(5))) == {index: index * index for index in range(5)}
    assert told == [
        "the process at trial 2 died (lost by Ray: its process or its node); the trial is done again"
    ]
    with at_work(engine_named("ray", 2, 1.0), HangingTask(at=1)) as work:
        finished = {index: record for index, record, _ in work(range(3))}
    assert finished[1]["error"] == "timeout: not done within 1 s"
    assert [finished[index]["status"] for index in (0, 2)] == ["ok", "ok"]
    nobody = engine_named("ray", 2, None, "127.0.0.1:1")
    with (
        pytest.raises(ValueError, match="no Ray cluster answers at "),
        at_work(nobody, SmallTask()),
    ):
        pass

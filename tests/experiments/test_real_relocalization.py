"""Recorded logs without an idea of the start: what is asked, how it is counted, what is refused."""

import json
import math
from pathlib import Path

import numpy as np
import pytest

from experiments.cli import main
from experiments.real_logs import RealLogConfig
from experiments.real_relocalization import Asked, Relocalized, run, table, teleported
from slam.known_map import KnownMap
from slam.localization import Estimate, Localizer
from slam.measurements import LaserScan, Measurement
from slam.scan_match import MatchStatus, ScanMatch
from slam.se2 import SE2
from slam.surface.segment_map import SegmentMap
from slam.verdict import Status, Verdict
from tests.experiments.refusals import line_of_refusal, refusal

DATA = Path(__file__).parents[1] / "data"
LOG = DATA / "fr101-excerpt.clf.gz"
REFERENCE = DATA / "fr101-excerpt.reference.tum"
COMMON_KEYS = {
    *("experiment", "log", "method", "scans", "right", "sure", "sure_not_right"),
    *("sure_elsewhere", "covered", "query_cpu_ms"),
}
JUMP_KEYS = {"jumps", "noticed", "recovered", "not_recovered_on_the_map", "scans_to_recover"}
STEP = SE2(0.1, 0.02, 0.05)


def real_log(*options) -> int:
    return main(["real-log", str(LOG), "--reference", str(REFERENCE), *map(str, options)])


@pytest.mark.slow
@pytest.mark.parametrize(
    ("protocol", "jumps", "keys"), [("each", (), set()), ("jumps", ("--jumps", 2), JUMP_KEYS)]
)
def test_summary_has_its_keys_and_a_line_for_each_scan(protocol, jumps, keys, tmp_path, capsys):
    options = ("--protocol", protocol, *jumps, "--method", "limit", "--out", tmp_path)
    status = real_log(*options)
    summary = json.loads((tmp_path / "summary.json").read_text())
    lines = [json.loads(line) for line in (tmp_path / "asked.jsonl").read_text().splitlines()]
    assert set(summary) == COMMON_KEYS | keys
    assert summary["experiment"] == f"real_relocalization_{protocol}"
    # half of the 20 scans made the map
    assert summary["scans"] == len(lines) == 10
    assert summary["sure"] == sum(line["status"] == "tracking" for line in lines)
    assert status == (1 if summary["sure_elsewhere"] else 0)
    printed = capsys.readouterr()
    assert "10 scans" in printed.out
    assert ("2 jumps: " in printed.out) == (protocol == "jumps")


def test_first_query_is_not_timed_with_what_it_compiles(monkeypatch):
    done, update = [], Localizer.update
    monkeypatch.setattr(
        Localizer, "update", lambda self, one: done.append("asked") or update(self, one)
    )

    def asked(known, localizer, measurement, T_reference):
        done.append("timed")
        raise InterruptedError

    monkeypatch.setattr("experiments.real_relocalization._asked", asked)
    with pytest.raises(InterruptedError):
        run(LOG, REFERENCE, "each", RealLogConfig(method="fast"))
    assert done == ["asked", "asked", "timed"]


def test_too_many_jumps_are_refused_in_one_line(tmp_path, capsys):
    options = ("--protocol", "jumps", "--jumps", 1000, "--out", tmp_path / "out")
    assert line_of_refusal(capsys, real_log(*options)) == (
        f"{LOG}: 20 scans have a reference pose in {REFERENCE}, this needs 4004"
    )
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize("method", ["limit", "fly"])
def test_unknown_protocol_or_method_is_refused(method, tmp_path, capsys):
    protocol = "fly" if method == "limit" else "each"
    options = ("--protocol", protocol, "--method", method, "--out", tmp_path / "out")
    line = line_of_refusal(capsys, real_log(*options))
    assert "called 'fly'" in line
    assert "there are: " in line
    assert not (tmp_path / "out").exists()


def test_files_that_are_not_there_or_do_not_belong_together_are_refused(tmp_path, capsys):
    other = tmp_path / "other.tum"
    other.write_text("1 0 0 0 0 0 0 1\n")
    for log, reference in (
        (tmp_path / "none.clf", REFERENCE),
        (LOG, tmp_path / "none"),
        (LOG, other),
    ):
        for protocol in ("each", "jumps"):
            arguments = ("real-log", log, "--reference", reference, "--protocol", protocol)
            assert refusal(capsys, *arguments)


# --- the order of the pieces


def rows(count, interval_s=0.5):
    """Scans that can be told apart by their only range, and how the robot came there."""
    T_reference, made = SE2(0.0, 0.0, 0.0), []
    for n in range(count):
        T_reference = T_reference @ STEP
        scan = LaserScan(100.0 + interval_s * n, np.zeros(1), np.array([1.0 + n]))
        noise = np.diag([1e-4, 1e-4, 1e-5])
        made.append((Measurement(100.0 + interval_s * n, STEP, scan, noise), T_reference))
    return made


def numbers(mixed):
    return [round(float(m.scan.ranges_m[0])) - 1 for m, _ in mixed]


@pytest.mark.parametrize("jumps", [1, 2, 3, 10])
@pytest.mark.parametrize("seed", range(5))
def test_no_piece_comes_behind_its_own_predecessor(jumps, seed):
    mixed, starts = teleported(rows(47), jumps, np.random.default_rng(seed))
    order = numbers(mixed)
    assert sorted(order) == list(range(47))
    is_jump = np.flatnonzero(np.diff(order) != 1) + 1
    assert is_jump.tolist() == list(starts)
    assert len(starts) == jumps


def test_the_wheels_are_silent_at_a_jump_and_tell_the_way_elsewhere():
    mixed, starts = teleported(rows(20), 3, np.random.default_rng(0))
    for n, (measurement, _) in enumerate(mixed):
        if n in (0, *starts):
            assert measurement.motion == SE2.identity()
            # wheels that stand are not unsure of a way that they did not go
            assert not measurement.motion_covariance.any()
        else:
            assert measurement.motion == STEP
            assert measurement.motion_covariance[0, 0] == 1e-4
            before, here = mixed[n - 1][1], mixed[n][1]
            told = before.inverse() @ here
            np.testing.assert_allclose(told.as_array(), STEP.as_array(), atol=1e-12)


def test_time_passes_between_scans_as_it_did_in_the_log():
    mixed, starts = teleported(rows(20), 3, np.random.default_rng(0))
    times_s = np.array([measurement.time_s for measurement, _ in mixed])
    assert times_s[0] == 0.0
    took_s = np.diff(times_s)
    is_jump = np.isin(np.arange(1, 20), starts)
    np.testing.assert_allclose(took_s[~is_jump], 0.5)
    np.testing.assert_allclose(took_s[is_jump], 1.0)


def test_stamps_that_go_back_do_not_go_back():
    mixed, _ = teleported(rows(20, interval_s=-0.5), 3, np.random.default_rng(0))
    times_s = [measurement.time_s for measurement, _ in mixed]
    assert (np.diff(times_s) >= 0.0).all()


def test_same_seed_same_order():
    first, again, other = (
        numbers(teleported(rows(44), 10, np.random.default_rng(seed))[0]) for seed in (0, 0, 1)
    )
    assert first == again
    assert first != other


def test_two_pieces_have_one_order_only():
    mixed, starts = teleported(rows(5), 1, np.random.default_rng(0))
    assert numbers(mixed) == [3, 4, 0, 1, 2]
    assert starts == (2,)


def test_fewer_scans_than_pieces_are_refused():
    # an empty piece would be a jump to nowhere
    with pytest.raises(ValueError, match="3 scans cannot be cut into 6 pieces"):
        teleported(rows(3), 5, np.random.default_rng(0))


# --- how it is counted

RIGHT, NEAR, ELSEWHERE = (0.0, 0.0), (0.3, 0.0), (0.6, 0.0)
TURNED = (0.0, math.radians(20.0))


def asked(status: Status, off: tuple[float, float] = RIGHT, *, is_covered: bool = True) -> Asked:
    T_reference = SE2(2.0, 1.0, math.radians(175.0))
    distance_m, turn_rad = off
    # a turn that passes 180 degrees
    found = SE2(2.0 + 0.6 * distance_m, 1.0 - 0.8 * distance_m, T_reference.theta + turn_rad)
    match = ScanMatch(found, MatchStatus.MATCHED)
    estimate = Estimate(0.0, found, found, match, verdict=Verdict(status))
    return Asked(estimate, T_reference, 0.002, is_covered)


def summary_of(rows_asked: list[Asked], jumps: tuple[int, ...]) -> dict:
    walls = SegmentMap(np.array([[[0.0, 0.0], [1.0, 0.0]]]))
    config = RealLogConfig()
    known = KnownMap(np.zeros((1, 2)), config.laser, walls)
    return Relocalized("log", "jumps", config, known, tuple(rows_asked), jumps).summary()


SURE, UNSURE, LOST = Status.TRACKING, Status.UNSURE, Status.LOST


def test_right_sure_and_elsewhere_are_counted_apart():
    summary = summary_of(
        [
            asked(SURE),
            asked(SURE, NEAR),
            asked(SURE, ELSEWHERE),
            asked(SURE, TURNED),
            asked(UNSURE),
            asked(LOST, ELSEWHERE, is_covered=False),
        ],
        (),
    )
    assert (summary["scans"], summary["right"], summary["covered"]) == (6, 2, 5)
    assert (summary["sure"], summary["sure_not_right"], summary["sure_elsewhere"]) == (4, 3, 2)
    assert summary["query_cpu_ms"] == {"median": pytest.approx(2.0), "p99": pytest.approx(2.0)}
    assert not JUMP_KEYS & set(summary)
    assert "sure 4 (66.7%)" in table(summary)


@pytest.mark.parametrize(
    ("piece", "noticed", "recovered", "took"),
    [
        # lost at once, found with the third scan
        ([asked(LOST, ELSEWHERE), asked(UNSURE), asked(SURE)], 1, 1, 3),
        # found itself with the first scan
        ([asked(SURE), asked(SURE), asked(SURE)], 1, 1, 1),
        # the second scan is still in time
        ([asked(SURE, ELSEWHERE), asked(LOST, ELSEWHERE), asked(SURE, NEAR)], 1, 1, 3),
        # the third is not
        ([asked(SURE, ELSEWHERE), asked(SURE, ELSEWHERE), asked(LOST)], 0, 0, 0),
        # sure of another place is no recovery
        ([asked(UNSURE), asked(SURE, ELSEWHERE), asked(SURE, TURNED)], 1, 0, 0),
    ],
)
def test_a_jump_is_noticed_within_two_scans_and_recovered_where_it_is(
    piece, noticed, recovered, took
):
    before = [asked(SURE), asked(SURE)]
    summary = summary_of([*before, *piece], (2,))
    assert (summary["jumps"], summary["noticed"], summary["recovered"]) == (1, noticed, recovered)
    assert summary["scans_to_recover"] == {"median": took, "max": took}
    assert summary["not_recovered_on_the_map"] == 1 - recovered


def test_beside_the_map_nobody_has_to_recover():
    away = [asked(LOST, ELSEWHERE, is_covered=False)] * 3
    summary = summary_of([asked(SURE), *away, asked(UNSURE), asked(SURE)], (1, 4))
    assert (summary["jumps"], summary["noticed"], summary["recovered"]) == (2, 2, 1)
    assert summary["not_recovered_on_the_map"] == 0
    # a piece ends where the next begins: what is found then is not its own
    assert summary["scans_to_recover"] == {"median": 2.0, "max": 2}
    assert "2 jumps: 2 noticed" in table(summary)

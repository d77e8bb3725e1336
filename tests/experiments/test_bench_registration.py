"""`kitasap bench registration`: the same scans and map for all rows; every row finds the robot."""

import json
import os
import sys
import tomllib
from importlib.util import find_spec
from pathlib import Path

import numpy as np
import pytest

from experiments.bench.registration import OURS, MatcherRow, Registration
from experiments.bench.registration_data import drawn
from experiments.bench.registration_peers import PEERS
from experiments.bench.registration_run import measured, one_core, table
from experiments.cli import main
from kitasap_sim.laser import laser
from kitasap_sim.places import Place
from slam.matchers import OdometryMatcher
from slam.se2 import SE2

MODULES = {"small_gicp": "small_gicp", "kiss-icp": "kiss_icp"}
REPOSITORY = Path(__file__).parents[2]


def is_installed(row: Registration) -> bool:
    return row.package is None or find_spec(MODULES[row.package]) is not None


@pytest.fixture(scope="module")
def room_fig4() -> Place:
    return Place("room_fig4")


@pytest.fixture(scope="module")
def clean(room_fig4):
    return drawn(room_fig4, laser("urg_04lx").without_errors(), trials=3, seed=1)


def test_scans_and_map_are_as_large_as_announced(room_fig4):
    data = drawn(room_fig4, "urg_04lx", trials=10, seed=0)
    assert abs(len(data.known.points) - 10_000) <= 100
    # 682 beams, less those beyond 5.6 m and the one in 500 that is lost
    assert 640 <= np.mean(data.scan_sizes) <= 682
    assert min(data.scan_sizes) >= 600
    assert 0.002 < data.map_spacing_m < 0.02


def test_equal_seeds_give_equal_data_and_others_other(box_room):
    place = Place(box_room)
    first, again, other = (drawn(place, "urg_04lx", 2, seed) for seed in (3, 3, 4))
    longer = drawn(place, "urg_04lx", 3, 3)
    for a, b, c, d in zip(first.trials, again.trials, other.trials, longer.trials[:2], strict=True):
        assert a.T_true == b.T_true == d.T_true
        assert a.T_start == b.T_start == d.T_start
        np.testing.assert_array_equal(a.scan.ranges_m, b.scan.ranges_m)
        np.testing.assert_array_equal(a.scan.ranges_m, d.scan.ranges_m)
        assert a.T_true != c.T_true


def test_starts_lie_within_the_limits_and_spread_over_them(box_room):
    trials = drawn(Place(box_room), "urg_04lx", 40, 0).trials
    off = np.array([t.T_start.as_array() - t.T_true.as_array() for t in trials])
    off[:, 2] = np.angle(np.exp(1j * off[:, 2]))
    assert np.abs(off).max() <= 0.05 + 1e-12
    # of 40 uniform numbers the largest is below 0.8 of the limit once in 7000 times
    assert np.abs(off).max(axis=0).min() > 0.04


def test_place_without_anything_in_reach_is_refused(box_room):
    blind = laser("urg_04lx").without_errors()
    blind = type(blind)(**{**vars(blind), "range_max_m": 0.3})
    with pytest.raises(ValueError, match=r"box_room.* urg_04lx .* free poses"):
        drawn(Place(box_room), blind, 1, 0)


@pytest.mark.slow
@pytest.mark.parametrize("row", [*PEERS, *OURS], ids=lambda row: row.name)
def test_every_row_finds_a_shift_without_noise(row, clean):
    if not is_installed(row):
        pytest.skip(f"{row.package} is not installed")
    register = row.prepare(clean.known)
    for trial in clean.trials:
        found = register(trial.points_base, trial.scan, trial.T_start)
        off = trial.T_true.inverse() @ found
        # the stop rules leave up to 4 mm; the starts are 20 to 70 mm off
        assert np.hypot(off.x, off.y) < 0.01
        assert abs(off.theta) < 0.01


@pytest.mark.parametrize("row", [*PEERS, *OURS], ids=lambda row: row.name)
def test_no_row_changes_what_the_others_are_given(row, clean):
    if not is_installed(row):
        pytest.skip(f"{row.package} is not installed")
    trial = clean.trials[0]
    before = clean.known.points.copy(), trial.points_base.copy()
    row.prepare(clean.known)(trial.points_base, trial.scan, trial.T_start)
    np.testing.assert_array_equal(before[0], clean.known.points)
    np.testing.assert_array_equal(before[1], trial.points_base)


@pytest.mark.slow
def test_missing_peers_are_left_out_and_named_with_what_to_install(
    box_room, monkeypatch, capsys, tmp_path
):
    for module in ("small_gicp", "kiss_icp", "kiss_icp.mapping", "kiss_icp.registration"):
        monkeypatch.setitem(sys.modules, module, None)  # an import of it fails
    out = tmp_path / "new" / "table.json"
    options = ["--trials", "1", "--place", box_room, "--out", str(out)]
    assert main(["bench", "registration", *options]) == 0
    printed = capsys.readouterr().out
    assert (
        "6 rows left out, small_gicp and kiss-icp missing: pip install 'kitasap[peers]'" in printed
    )
    result = json.loads(out.read_text())
    names = [row["name"] for row in result["rows"]]
    assert names == [row.name for row in (*PEERS, *OURS) if row.package is None]
    assert [len(rows) for rows in result["missing"].values()] == [5, 1]
    assert not any("small_gicp" in name or "KISS" in name for name in names)


def test_peer_that_is_broken_is_left_out_and_says_why(box_room, capsys):
    class Broken:
        name, note, package = "broken", "", "small_gicp"

        def prepare(self, known):
            raise ImportError("libgomp.so.1: cannot open shared object file")

    methods = [*(row for row in OURS if row.name == "kitasap fast"), Broken()]
    result = measured(Place(box_room), "urg_04lx", 1, 0, methods=methods)
    assert [row.name for row in result.rows] == ["kitasap fast"]
    assert "small_gicp cannot be imported: libgomp" in capsys.readouterr().err


def test_own_rows_library_that_is_missing_is_not_passed_over(box_room, monkeypatch):
    def absent(known):
        raise ModuleNotFoundError("numba")

    row = MatcherRow("ours", "", absent)
    with pytest.raises(ModuleNotFoundError, match="numba"):
        measured(Place(box_room), "urg_04lx", 1, 0, methods=[row])


def test_table_has_all_rows_and_the_bound_that_was_asked_for(box_room):
    still = MatcherRow("stays at the start", "looks at nothing", lambda known: OdometryMatcher())
    chosen = [PEERS[0], still]
    covariance = np.diag([3e-6, 6e-6, 1e-6])
    result = measured(
        Place(box_room), "urg_04lx", 5, 2, methods=chosen, bound=lambda data, trial: covariance
    )
    shown = table(result, "box room")
    assert shown.row_count == 3
    assert list(shown.columns[0].cells) == [PEERS[0].name, still.name, "Cramer-Rao bound"]
    # sqrt(3 + 6) mm and 1 mrad
    assert result.bound == pytest.approx((3.0, 1.0))
    assert list(shown.columns[3].cells)[-1] == "3.00"
    open3d, stays = result.rows
    assert open3d.cpu_us > 100 * stays.cpu_us > 0
    starts = [trial.T_true.inverse() @ trial.T_start for trial in result.data.trials]
    failed = sum(np.hypot(s.x, s.y) > 0.05 or abs(s.theta) > np.radians(2) for s in starts)
    assert stays.failed == failed > 0
    first, second = result.record()["rows"]
    assert first["times_faster"] == 1.0
    assert second["times_faster"] == pytest.approx(open3d.cpu_us / stays.cpu_us)


def test_row_that_always_fails_has_no_error_to_show(box_room):
    class Away:
        name, note, package = "away", "", None

        def prepare(self, known):
            return lambda points_base, scan, T_start: SE2(99.0, 0.0, 0.0)

    result = measured(Place(box_room), "urg_04lx", 2, 0, methods=[Away()])
    (row,) = result.rows
    assert (row.failed, row.position_rmse_mm, row.heading_rmse_mrad) == (2, None, None)
    assert list(table(result, "").columns[3].cells) == ["-"]
    json.dumps(result.record())


@pytest.mark.skipif(not hasattr(os, "sched_setaffinity"), reason="Linux only")
def test_one_core_is_one_core_and_is_undone():
    before = os.sched_getaffinity(0)
    with one_core():
        assert len(os.sched_getaffinity(0)) == 1
    assert os.sched_getaffinity(0) == before


def test_the_extra_names_what_the_rows_need():
    extras = tomllib.loads((REPOSITORY / "pyproject.toml").read_text())["project"]
    peers = {line.split(">")[0] for line in extras["optional-dependencies"]["peers"]}
    assert peers == {row.package for row in PEERS if row.package}


def test_names_of_rows_differ():
    names = [row.name for row in (*PEERS, *OURS)]
    assert len(set(names)) == len(names)


def test_bench_alone_shows_its_help(capsys):
    assert main(["bench"]) == 0
    printed = capsys.readouterr().out
    assert "sim" in printed
    assert "registration" in printed

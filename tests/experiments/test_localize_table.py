"""`kitasap localize` in a line: what was found, and what was never lost."""

import math
import re
from dataclasses import replace

import numpy as np
import pytest

from experiments import localize
from experiments.cli import main
from experiments.known_maps import LogConfig
from experiments.localize import LocalizedLog, table
from slam.consistency import InnovationMonitor
from slam.known_map import KnownMap
from slam.localization import Estimate
from slam.scan_match import IcpStep, RangeFit, ScanMatch
from slam.se2 import SE2
from tests.experiments.refusals import refusal

START = [0.0, 0.0, 0.0]


@pytest.mark.parametrize(
    ("start", "lost", "recoveries_s", "said"),
    [
        (None, 3, [], "never found"),
        (None, 0, [2.5], "found once, after 2.5 s"),
        (None, 5, [2.5, 1.0], "found 2 times, after 2.5 s at most"),
        # this once was "never found", of a robot that followed itself from its start to the end
        (START, 0, [], "never lost since the start that was given"),
        (START, 4, [], "not found again"),
        (START, 4, [2.0], "lost and found again once, after 2.0 s"),
    ],
)
def test_line_tells_recoveries_only_where_something_was_lost(start, lost, recoveries_s, said):
    counts = {"scans": 9, "tracking": 9 - lost, "unsure": 0, "lost": lost}
    line = table(
        {"log": "a", "map": "b", "start": start, "recoveries_s": recoveries_s, "warned": 0} | counts
    )
    assert line.endswith(f" {lost} lost; {said}")


def test_each_kind_of_warning_is_told_once_with_how_many_scans_it_is_of():
    """Those of the last scan once were all that was told, of however many scans they were."""
    said = (("moved at 0.1 m/s",), ("gone 1 %", "moved at -0.25 m/s"), (), ("moved at 3 m/s",))
    pose, match = SE2.identity(), ScanMatch.lost([IcpStep(SE2.identity(), math.inf, 0)])
    estimates = tuple(
        Estimate(0.1 * k, pose, pose, match, warnings=one) for k, one in enumerate(said)
    )
    known = KnownMap(np.zeros((1, 2)), LogConfig().laser)
    result = LocalizedLog("a", "b", LogConfig(), known, estimates, np.empty((0, 2)), pose)
    _, *lines = table(result.summary()).splitlines()
    assert lines == [
        "3 scans came with warnings; the last one of each kind:",
        "  3 scans: moved at 3 m/s",
        "  1 scan: gone 1 %",
    ]


def test_options_that_warnings_name_are_those_of_the_command(capsys):
    """It once was "give it the right sigma", for which there was no option."""
    monitor = InnovationMonitor()
    for _ in range(60):
        monitor.take(50.0, RangeFit(0.9, 2.0, 0.1, 1e-3, 0.5), strain=9.0)
    assert len(monitor.warnings) == 5
    named = set(re.findall(r"--[a-z-]+", " ".join(monitor.warnings)))
    assert named == {"--range-sigma", "--mount"}
    assert main(["localize", "--help"]) == 0
    words = " ".join(capsys.readouterr().out.replace("│", " ").split())
    assert all(option in words for option in named)
    assert f"[m]; default: {LogConfig().range_sigma_m:g}." in words


def test_noise_that_is_typed_is_the_laser_model_s(monkeypatch, capsys, tmp_path):
    told = []

    def run(_map, _log, _start, config, *_):
        told.append(config)
        raise ValueError("enough")

    monkeypatch.setattr(localize, "run", run)
    given = ("localize", "map.yaml", "a.clf", "--out", tmp_path / "out")
    refusal(capsys, *given, "--range-sigma", "0.013")
    refusal(capsys, *given)
    assert told == [replace(LogConfig(), range_sigma_m=0.013), LogConfig()]
    assert told[0].laser.noise.sigma_at_m == ((0.0, 0.013),)
    assert "0" in refusal(capsys, *given, "--range-sigma", "0")

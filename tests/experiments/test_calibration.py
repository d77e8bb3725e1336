"""The simulated robot finds its own mounting and wheels, which it was told wrongly."""

import math

import numpy as np
import pytest

from experiments.calibration import CalibrationConfig, run_calibration
from experiments.cli import main
from tests.experiments.refusals import refusal


@pytest.mark.slow
def test_half_a_minute_in_the_paper_s_room_finds_mounting_and_wheels():
    result = run_calibration(CalibrationConfig(duration_s=30.0), seed=1)
    found, errors = result.found, result.found.values - result.true
    assert found.is_observable
    assert (np.abs(errors) < 3.0 * found.sigmas).all()
    assert np.abs(errors[3:5]).max() < 0.001  # of 3 and 4 mm that the mounting is off
    assert abs(errors[5]) < math.radians(0.1)  # of 0.3 degrees
    # the radii are off by 0.1 %, the track by 0.4 %
    assert np.abs(errors[:2] / result.true[:2]).max() < 0.001
    assert abs(errors[2] / result.true[2]) < 0.002


@pytest.mark.slow  # five drives of a minute take 30 s
def test_a_minute_is_true_to_half_a_millimetre_and_to_its_own_covariance():
    results = [run_calibration(CalibrationConfig(), seed) for seed in range(20, 25)]
    for result in results:
        errors = result.found.values - result.true
        assert np.abs(errors[3:5]).max() < 0.0005
        assert abs(errors[5]) < math.radians(0.03)
        assert np.abs(errors[:2] / result.true[:2]).max() < 0.001
        assert abs(errors[2] / result.true[2]) < 0.002
    # 6 is honest, less is cautious; mean of 5 from chi square of 6 stays below 11 but for 0.1 %
    assert np.mean([result.nees for result in results]) < 11.0


@pytest.mark.slow
def test_command_prints_a_line_for_each_parameter_and_what_to_do(box_room, capsys):
    assert main(["calibrate", "--place", box_room, "--duration", "40"]) == 0
    printed = capsys.readouterr().out
    for label in ("radius left", "radius right", "track", "laser x", "laser y", "laser heading"):
        assert label in printed
    assert "T_base_laser = SE2(" in printed
    assert "DifferentialDrive((" in printed


def test_drive_too_short_to_tell_says_so(box_room, capsys):
    assert main(["calibrate", "--place", box_room, "--duration", "5"]) == 1
    assert "not enough: the drive does not show" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("option", "value", "said"),
    [
        ("--mismatch", "bent", "no mismatch called 'bent'"),
        ("--odometry", "bent", "no odometry preset called 'bent'"),
        ("--duration", "nan", "takes 5 s or more"),
    ],
)
def test_wrong_option_is_refused_in_one_line(capsys, option, value, said):
    assert said in refusal(capsys, "calibrate", option, value)

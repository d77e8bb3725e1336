"""An option that changes nothing of what is run is refused; one that does for some of it is not."""

import pytest

from experiments.cli import main
from tests.experiments.refusals import refusal


@pytest.mark.parametrize(
    ("command", "option", "said"),
    [
        ("run localization", "--poses anywhere", "of localization: it is of kidnap"),
        ("trial localization", "--poses anywhere", "of localization: it is of kidnap"),
        ("run tracking", "--poses anywhere", "of tracking: it is of kidnap"),
        (
            "run localization tracking", "--poses anywhere",
            "of localization and tracking: it is of kidnap",
        ),
        ("run kidnap", "--turn-rate 1", "of kidnap: it is of tracking"),
        # what it is without the option as well
        ("run localization", "--turn-rate 0.5", "of localization: it is of tracking"),
        ("trial kidnap", "--duration 60", "of kidnap: it is of tracking"),
        ("run mapping", "--duration 60", "of mapping: it is of tracking"),
        ("run mapping", "--map made", "of mapping: it is of localization, kidnap, tracking"),
    ],
)  # fmt: skip
def test_option_that_means_nothing_is_refused(command, option, said, box_room, tmp_path, capsys):
    # random: below the box room's start there is no free metre to be kidnapped to
    common = ["--poses", "random", "--place", box_room, "--method", "odometry"]
    arguments = [*command.split(), *common, *option.split(), "--out", tmp_path / "out"]
    line = refusal(capsys, *arguments)
    # of a choice what was chosen is named, of a number the option alone
    named = option if option.split()[1].isalpha() else option.split()[0]
    assert line == f"{named} changes nothing {said}"
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize(
    ("experiments", "options"),
    [
        ("localization kidnap", "--poses anywhere"),
        ("localization tracking", "--poses random --turn-rate 1 --duration 1"),
        # the default, typed
        ("localization", "--poses random --map true"),
        ("localization", "--poses random --people 1"),
    ],
)
def test_option_that_one_of_the_experiments_uses_is_taken(experiments, options, box_room, tmp_path):
    common = ["--place", box_room, "--method", "odometry", "--trials", "1", "--jobs", "1"]
    common.append("--no-figures")
    arguments = ["run", *experiments.split(), *options.split(), *common, "--out", str(tmp_path)]
    assert main(arguments) == 0
    assert {path.name for path in tmp_path.iterdir()} == set(experiments.split())

"""A room for trials that take milliseconds, and short ways to run them."""

from collections.abc import Callable, Sequence
from pathlib import Path

import pytest

from experiments.cli import main
from experiments.trials import TrialConfig

BOX_ROOM = """
<mujoco>
  <worldbody>
    <geom type="box" size="2.1 0.05 0.5" pos="2 -0.05 0.5"/>
    <geom type="box" size="2.1 0.05 0.5" pos="2 3.05 0.5"/>
    <geom type="box" size="0.05 1.6 0.5" pos="-0.05 1.5 0.5"/>
    <geom type="box" size="0.05 1.6 0.5" pos="4.05 1.5 0.5"/>
    <geom type="cylinder" size="0.2 0.5" pos="3 2 0.5"/>
    <site name="start" pos="1.5 0.7 0" euler="0 0 30"/>
  </worldbody>
</mujoco>
"""
"""4 x 3 m with a pillar. Below its start there is no metre of free floor."""


@pytest.fixture(scope="session")
def box_room(tmp_path_factory: pytest.TempPathFactory) -> str:
    """The path of a small place that loads in a tenth of a second."""
    path = tmp_path_factory.mktemp("places") / "box_room.xml"
    path.write_text(BOX_ROOM)
    return str(path)


@pytest.fixture
def own_folder(tmp_path_factory: pytest.TempPathFactory, monkeypatch: pytest.MonkeyPatch) -> None:
    """Has commands that are told of no `--out` write elsewhere than those of other tests at the same time:
    one that works there keeps others out."""
    monkeypatch.chdir(tmp_path_factory.mktemp("here"))


@pytest.fixture
def run_trials(box_room: str) -> Callable[..., int]:
    """Runs a few trials in the box room by the command; the exit status."""

    def run(
        out: Path, trials: int = 2, more: Sequence[str] = (), method: str = "odometry,line"
    ) -> int:
        options = ["--trials", str(trials), "--poses", "random", "--place", box_room]
        options += ["--method", method, "--jobs", "1", "--out", str(out)]
        return main(["run", "localization", *options, *more])

    return run


@pytest.fixture
def quick_config(box_room: str) -> TrialConfig:
    """One trial of it takes 20 ms."""
    return TrialConfig(poses="random", place=box_room, methods=("odometry", "line"))

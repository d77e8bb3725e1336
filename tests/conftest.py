"""What all tests share: compiled code, made once."""

import os
import time
from pathlib import Path

import numpy as np
import pytest

from slam import SE2
from slam.pose_graph import PoseGraph, Start
from slam.warm_up import warm_up
from tests.slam.guarded import START, Robot, made
from tests.slam.synthetic import ROOM_SEGMENTS

_LONGEST_S = 120.0
"""For which a process waits for the other's half; it may have died."""


@pytest.fixture(scope="session", autouse=True)
def compiled(worker_id: str, tmp_path_factory: pytest.TempPathFactory) -> None:
    """On a new machine each of two processes compiles its half, where both would compile it all. It
    waits for the other, since its first tests would compile what the other is at."""
    halves = {"gw0": _localizer, "gw1": _mapper_and_env}
    if worker_id not in halves:
        return
    halves[worker_id]()
    folder = tmp_path_factory.getbasetemp().parent
    (folder / f"compiled-{worker_id}").touch()
    others = list(halves)[: int(os.environ["PYTEST_XDIST_WORKER_COUNT"])]
    _wait_for([folder / f"compiled-{other}" for other in others])


def _localizer() -> None:
    robot = Robot(made(ROOM_SEGMENTS), None, at=START)
    for _ in range(3):
        robot.look(SE2(0.02, 0.0, 0.1))


def _mapper_and_env() -> None:
    warm_up()
    graph = PoseGraph()
    for k in range(3):
        graph.add_node(SE2(float(k), 0.0, 0.0), is_fixed=k == 0)
    for ends in ((0, 1), (1, 2), (0, 2)):
        graph.add_edge(*ends, SE2(float(ends[1] - ends[0]), 0.0, 0.0), np.eye(3))
    graph.solve(Start.STAGES)
    solution = graph.solve()
    solution.covariances(range(3))
    solution.relative_covariances([(1, 2)])
    # not for those who run a test of slam alone
    from kitasap_sim.env.goto import GoToEnv

    env = GoToEnv()
    env.reset(seed=0)
    env.step(env.action_space.sample())
    env.close()


def _wait_for(files: list[Path]) -> None:
    end_s = time.monotonic() + _LONGEST_S
    while time.monotonic() < end_s and not all(file.exists() for file in files):
        time.sleep(0.1)

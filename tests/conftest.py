"""What all tests share: compiled code, made once."""

import pytest

from slam import SE2
from slam.warm_up import warm_up
from tests.slam.guarded import START, Robot, made
from tests.slam.synthetic import ROOM_SEGMENTS


@pytest.fixture(scope="session", autouse=True)
def compiled(worker_id: str) -> None:
    """On a new machine each of two processes compiles its half, where both would compile it all."""
    if worker_id == "gw0":
        robot = Robot(made(ROOM_SEGMENTS), None, at=START)
        for _ in range(3):
            robot.look(SE2(0.02, 0.0, 0.1))
    elif worker_id == "gw1":
        warm_up()

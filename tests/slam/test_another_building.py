"""A robot that was told the wrong map: another building never explains all of its scans."""

import math

import numpy as np
import pytest

from slam import SE2, Status
from tests.slam.guarded import LASER, STILL, Robot, made
from tests.slam.synthetic import ROOM_SEGMENTS, box, scan_of

TURN = SE2(0.0, 0.0, 0.7)


@pytest.fixture(scope="module")
def room():
    return made(ROOM_SEGMENTS)


OTHERS = {
    "smaller": box(0.0, 0.0, 4.2, 2.8),
    "with a table": np.concatenate([box(0, 0, 4.2, 2.8), box(1.8, 0, 2.6, 0.5)]),
    "of the same shape": 0.8 * ROOM_SEGMENTS,
}


@pytest.mark.parametrize(
    "name",
    [
        pytest.param("smaller", marks=pytest.mark.slow),
        pytest.param("with a table", marks=pytest.mark.slow),
        "of the same shape",
    ],
)
def test_another_building_is_never_taken_for_the_map(room, name):
    sure = 0
    for seed, at in enumerate([SE2(1.4, 1.6, 0.3), SE2(3.1, 1.1, 2.0), SE2(2.2, 2.0, -1.0)]):
        robot = Robot(room, None, at=at, seed=seed)
        for _ in range(9):
            robot.at = robot.at @ TURN
            scan = scan_of(OTHERS[name], robot.at @ LASER, robot.rng, 0.01)
            estimate = robot.look(STILL, told=TURN, scan=scan)
            sure += estimate.verdict.status is Status.TRACKING
    assert sure == 0


def test_robot_in_a_crowd_is_sure_after_a_look_around(room):
    rng = np.random.default_rng(3)
    for seed in range(5):
        robot = Robot(room, None, at=SE2(2.0, 1.8, seed), seed=seed)
        statuses = []
        for _ in range(6):
            robot.at = robot.at @ TURN
            away = rng.uniform(0.5, 1.4, 5), rng.uniform(-math.pi, math.pi, 5)
            people = [
                box(x - 0.12, y - 0.12, x + 0.12, y + 0.12)
                for x, y in zip(
                    robot.at.x + away[0] * np.cos(away[1]),
                    robot.at.y + away[0] * np.sin(away[1]),
                    strict=True,
                )
            ]
            seen = np.concatenate([ROOM_SEGMENTS, *people])
            estimate = robot.look(
                STILL, told=TURN, scan=scan_of(seen, robot.at @ LASER, robot.rng, 0.01)
            )
            statuses.append(estimate.verdict.status)
            if estimate.verdict.status is Status.TRACKING:
                assert robot.is_right(estimate)
            elif Status.TRACKING not in statuses:
                assert robot.localizer.telling_turn_rad() != 0.0
        assert Status.TRACKING in statuses

"""Things along bare walls that lie elsewhere after a stretch over which nothing but wheels told of the way."""

from collections.abc import Callable
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from slam.frontend.keyframes import FrontEndStep, StepStatus
from slam.loop_closing import Loop
from slam.map_checks.moved_things import is_all_that_is_said, moved_things
from slam.se2 import SE2
from tests.slam.corridors import PILLARS, mapped, person, spun
from tests.slam.frontend.test_open_runs import kept
from tests.slam.synthetic import box, room

STEP_M, AT_M = 0.2, 5.6
BARE = np.concatenate([room(-6.0, -1.0, 22.0, 1.0), box(-3.0, 0.4, -2.2, 1.0)])
ONE_PILLAR = np.concatenate([BARE, box(9.0, 0.5, 9.5, 1.0)])
SAID = "what stood along a bare way until"


def hidden_at(walls: np.ndarray) -> Callable[[float], np.ndarray]:
    """A board stands before the robot about where its wheels spin, and hides all that is ahead."""

    def seen(x: float) -> np.ndarray:
        is_hidden = abs(x - AT_M) < 1.5 * STEP_M
        return np.concatenate([walls, box(x + 0.7, -0.3, x + 0.8, 1.0)]) if is_hidden else walls

    return seen


def spinning(far_m: float) -> tuple[np.ndarray, np.ndarray]:
    """A drive by 14 m, and what its wheels tell, that spin by so much behind the board."""
    true_m = np.arange(0.0, 14.0, STEP_M)
    if far_m == 0.0:
        return true_m, np.append(0.0, np.diff(true_m))
    return spun(true_m, round(AT_M / STEP_M) + 1, far_m)


@pytest.mark.parametrize("seed", range(2))
def test_wheels_that_spin_while_all_is_hidden_fail_a_map_by_where_things_are_after(seed):
    # told to be sure to 1 cm after a metre: 0.6 m off and good
    slam_map, off_m = mapped(*spinning(1.0), 0.01, hidden_at(ONE_PILLAR), seed=seed)
    assert off_m > 0.5
    assert any(SAID in reason for reason in slam_map.verdict.reasons), slam_map.verdict


def walks_on(x: float) -> np.ndarray:
    """Somebody who stood until the board was there, and walks ahead then."""
    at_m = 8.0 if x < AT_M else 8.0 + 1.2 * (x - AT_M)
    return np.concatenate([hidden_at(ONE_PILLAR)(x), person(at_m, 0.0)])


@pytest.mark.parametrize(
    "walls", [hidden_at(ONE_PILLAR), hidden_at(PILLARS), walks_on], ids=["one", "alike", "person"]
)
def test_wheels_that_are_right_do_not(walls):
    slam_map, off_m = mapped(*spinning(0.0), 0.01, walls)
    assert off_m < 0.3
    assert slam_map.verdict.is_good, slam_map.verdict


BEFORE_M, HIDDEN_M, AFTER_M = np.arange(4.0, 6.4, 0.3), (6.4, 6.7), np.arange(7.0, 8.4, 0.3)


def said(
    walls: np.ndarray = ONE_PILLAR,
    off_m: float = 0.6,
    *,
    after: Callable[[int], np.ndarray] | None = None,
    before_m: np.ndarray = BEFORE_M,
    hidden_m: tuple[float, ...] = HIDDEN_M,
    after_m: np.ndarray = AFTER_M,
    is_kept: bool = True,
    session_from: int = 0,
    break_at: int | None = None,
    gap_at: int | None = None,
    loop: tuple[int, int, float] | None = None,
    seed: int = 1,
) -> list[str]:
    """Of keyframes before and after others that saw nothing ahead, and from which on the map is so much off; the k-th
    after them saw walls of its own."""
    rng = np.random.default_rng(seed)
    seen = [(x, walls, 0.0) for x in before_m] + [(x, BARE, 0.0) for x in hidden_m]
    seen += [(x, after(k) if after else walls, off_m) for k, x in enumerate(after_m)]
    poses = np.array([(x + off, 0.0, 0.0) for x, _, off in seen])
    ways_m = np.diff(poses[:, 0], prepend=poses[0, 0])
    keyframes = [
        replace(
            kept(there, SE2(x, 0.0, 0.0), rng), time_s=float(k), session=int(k >= session_from),
            T_before=SE2(ways_m[k], 0.0, 0.0), covariance=1e-4 * np.eye(3), is_break=k == break_at,
            is_after_gap=k == gap_at,
        )
        for k, (x, there, _) in enumerate(seen)
    ]  # fmt: skip
    if not is_kept:
        keyframes[: len(before_m)] = [one.place_alone() for one in keyframes[: len(before_m)]]
    loops = []
    if loop is not None:
        earlier, later, sigma_m = loop
        way = SE2(poses[later, 0] - poses[earlier, 0], 0.0, 0.0)
        loops.append(Loop(earlier, later, way, np.eye(3) / sigma_m**2, 1.0, 0.0))
    steps = [
        FrontEndStep(
            float(k), k, SE2.identity(), one.T_map_base, StepStatus.MATCHED, 1.0, is_keyframe=True,
            is_open=seen[k][0] in hidden_m, session=one.session,
        )
        for k, one in enumerate(keyframes)
    ]  # fmt: skip
    slam_map: Any = SimpleNamespace(keyframes=keyframes, poses=poses, steps=steps, loops=loops)
    return moved_things(slam_map)


@pytest.mark.parametrize("off_m", [0.6, -0.6, 0.2, -1.0])
def test_what_stands_off_after_a_stretch_is_told_with_when_and_how_far(off_m):
    assert said(off_m=off_m) == [
        f"what stood along a bare way until 8.00 s stands {abs(off_m):.2f} m off from 11.00 s on: wheels spun or told"
        " late of the way, or somebody moved it"
    ]


@pytest.mark.parametrize(
    "of",
    [
        {"session_from": 6},
        {"gap_at": 6},
        {"break_at": 7},
        {"break_at": 12},
        {"loop": (2, 14, 0.3)},
        {"loop": (0, 3, 0.01)},
    ],
)
def test_it_is_told_as_well_if(of):
    assert len(said(**of)) == 1


def pillar(x: float) -> np.ndarray:
    return np.concatenate([BARE, box(x, 0.5, x + 0.5, 1.0)])


SMALL = np.concatenate([ONE_PILLAR, box(9.9, -1.0, 10.3, -0.4)])


@pytest.mark.parametrize(
    "of",
    [
        {"off_m": 0.0},
        {"walls": np.concatenate([BARE, box(9.0, 0.6, 9.02, 0.62)])},  # too thin to say so
        {"off_m": 0.1},
        {"session_from": 7},  # too few before it of its session
        {"session_from": 9},  # which begins with it
        {"gap_at": 7},  # too few before it, next to it
        {"gap_at": 12},  # and after it
        {"gap_at": 10},  # past others that were let go, of which nobody knows what they left open
        {"loop": (2, 14, 0.1)},  # that tells where the robot went: somebody moved it
        {"before_m": BEFORE_M[-2:]},
        {"after_m": AFTER_M[:2]},
        {"is_kept": False},
        {"hidden_m": ()},
        {"hidden_m": (6.4, 8.6, 6.4, 6.7)},  # so long that little of what was before it is in view
        {"off_m": 0.0, "after": lambda k: pillar(9.3 + 0.25 * k)},  # who walks
        {"off_m": 0.0, "after": lambda _: BARE},  # who left
        {"after": lambda _: np.concatenate([ONE_PILLAR, box(9.0, -1.0, 9.5, -0.2)])},  # and more
        {"walls": SMALL, "after": lambda _: ONE_PILLAR},  # it fits there, and what else was there is gone
    ],
)  # fmt: skip
def test_else_nothing_is_said(of):
    assert said(**of) == []


@pytest.mark.parametrize("seed", range(6))
def test_of_things_alike_the_one_here_is_believed(seed):
    assert said(PILLARS, 0.0, seed=seed) == []


def test_what_else_fails_a_map_is_looked_at_without_its_wheels():
    (reason,) = said()
    assert is_all_that_is_said([reason])
    assert not is_all_that_is_said([reason, "another"])
    assert not is_all_that_is_said([])

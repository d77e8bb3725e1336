"""Which pieces of a map hold together: by two loops, or by one and the wheels."""

from dataclasses import replace

import numpy as np
import pytest

from slam import SE2
from slam.beams import Beams
from slam.frontend.keyframes import Keyframe
from slam.loop_closing import Loop
from slam.map_checks.pieces import Pieces

STEP, SURE = SE2(1.0, 0.0, 0.0), np.diag([0.3, 0.3, 0.1])


def drive(breaks: tuple[int, ...] = (4,)) -> tuple[list[Keyframe], np.ndarray]:
    """Eight keyframes in a row, and where they lie."""
    empty = Beams(np.empty((0, 2)), np.empty(0), np.empty(0))
    keyframes = [
        Keyframe(float(k), SE2(k, 0.0, 0.0), STEP, SURE, np.empty((0, 2)), empty, k in breaks)
        for k in range(8)
    ]
    return keyframes, np.array([[k, 0.0, 0.0] for k in range(8)], dtype=np.float64)


def loops(*ends: tuple[int, int]) -> list[Loop]:
    return [Loop(*pair, SE2.identity(), np.eye(3), 1.0, 0.0) for pair in ends]


def unsure(keyframes: list[Keyframe], k: int = 4, variance_m2: float = 12.0) -> list[Keyframe]:
    keyframes[k] = replace(keyframes[k], covariance=np.diag([variance_m2, variance_m2, 0.5]))
    return keyframes


@pytest.mark.parametrize(
    ("ends", "is_tied"),
    [
        ((), False),
        (((1, 6),), False),
        (((1, 6), (1, 7)), False),  # one scan looks like two of another place
        (((0, 6), (1, 6)), False),
        (((0, 6), (1, 7)), False),  # wheels that tell of nothing agree with all
        (((0, 7), (1, 6), (2, 5), (3, 4)), True),
        (((7, 0), (6, 1), (5, 2), (4, 3)), True),
        (((1, 2), (5, 7)), False),
    ],
)
def test_four_loops_tie_a_piece_of_which_wheels_tell_nothing(ends, is_tied):
    keyframes, poses = drive()
    pieces = Pieces(unsure(keyframes), loops(*ends), poses)
    assert pieces.breaks == [4]
    assert pieces.joined == [0, 0 if is_tied else 1]


def test_two_loops_tie_where_wheels_do_not_contradict():
    keyframes, poses = drive()
    unsure(keyframes, variance_m2=2.0)
    assert Pieces(keyframes, loops((0, 6)), poses).joined == [0, 1]
    assert Pieces(keyframes, loops((0, 6), (1, 7)), poses).joined == [0, 0]


@pytest.mark.parametrize("count", [2, 3, 4])
def test_few_loops_tie_nothing_where_wheels_say_otherwise(count):
    """As of mit-csail with a third of its records lost: three loops to a place that looks the same."""
    keyframes, poses = drive()
    poses[4:, 0] += 4.0
    ends = [(k, 7 - k) for k in range(count)]
    assert Pieces(keyframes, loops(*ends), poses).joined == [0, 0 if count == 4 else 1]


def test_one_loop_ties_what_lies_where_the_wheels_led():
    keyframes, poses = drive()
    assert Pieces(keyframes, loops((1, 6)), poses).joined == [0, 0]
    poses[4:, 0] += 0.6
    assert Pieces(keyframes, loops((1, 6)), poses).joined == [0, 1]


def test_wheels_tie_nothing_over_a_piece_that_lies_between():
    keyframes, poses = drive((3, 5))
    assert Pieces(keyframes, loops((1, 6)), poses).joined == [0, 1, 2]
    assert Pieces(unsure(keyframes, 3, 2.0), loops((1, 6), (2, 7)), poses).joined == [0, 1, 0]


def test_what_no_loop_ties_lies_between_wheels_to_it_and_on_from_it():
    keyframes, poses = drive((3, 4))
    ends = loops((0, 5), (1, 6))
    assert Pieces(keyframes, ends, poses).joined == [0, 0, 0]
    assert Pieces(keyframes, ends[:1], poses).joined == [0, 1, 2]
    aside = poses.copy()
    aside[3, 1] += 0.6
    assert Pieces(keyframes, ends, aside).joined == [0, 1, 0]
    assert Pieces(unsure(keyframes, variance_m2=2.0), ends, poses).joined == [0, 1, 0]
    long, poses = drive((2, 5))
    assert Pieces(long, ends, poses).joined == [0, 1, 0]


def test_loops_to_pieces_that_hold_together_count_together():
    keyframes, poses = drive((2, 5))
    unsure(unsure(keyframes, 2, 2.0), 5, 2.0)
    ends = ((0, 2), (1, 3), (0, 6), (4, 7))
    assert Pieces(keyframes, loops(*ends), poses).joined == [0, 0, 0]
    assert Pieces(keyframes, loops(*ends[1:]), poses).joined == [0, 1, 2]


def test_a_session_has_rules_of_its_own():
    keyframes, poses = drive()
    later = [replace(one, session=int(k >= 4)) for k, one in enumerate(unsure(keyframes))]
    assert Pieces(later, loops((1, 6)), poses).joined == [0, 0]
    assert Pieces(later, loops((1, 6))).joined == [0, 0]
    # what broke off before and never was tied does not stand between
    torn = [replace(one, is_break=k in (2, 4)) for k, one in enumerate(unsure(later, 2))]
    assert Pieces(torn, loops((1, 6))).joined == [0, 1, 0]
    assert Pieces([], []).joined == [0]

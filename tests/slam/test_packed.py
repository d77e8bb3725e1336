"""Many things of a few numbers each: what is kept of them is what was put in."""

from __future__ import annotations

import sys
from copy import copy
from dataclasses import fields, replace

import numpy as np
import pytest

from slam.frontend.keyframes import FrontEndStep, FrontEndSteps, StepStatus
from slam.frontend.loose_runs import LooseScan, LooseScans
from slam.frontend.told_steps import ToldStep, ToldSteps
from slam.packed import each
from slam.se2 import SE2

RNG = np.random.default_rng(3)


def pose() -> SE2:
    return SE2(*RNG.uniform(-3.0, 3.0, 3))


def step() -> FrontEndStep:
    return FrontEndStep(
        RNG.uniform(1e9, 2e9), int(RNG.integers(-1, 100_000)), pose(), pose(),
        list(StepStatus)[RNG.integers(4)], RNG.uniform(), bool(RNG.integers(2)),
        int(RNG.integers(5)), bool(RNG.integers(2)), RNG.uniform(), bool(RNG.integers(2)),
    )  # fmt: skip


def told() -> ToldStep:
    return ToldStep(pose(), RNG.normal(size=(3, 3)))


def loose() -> LooseScan:
    one, other, third = RNG.normal(size=(3, 3, 3))
    return LooseScan(pose(), one, pose(), other, third, RNG.uniform())


@pytest.mark.parametrize(
    ("kind", "thing"), [(FrontEndSteps, step), (ToldSteps, told), (LooseScans, loose)]
)
@pytest.mark.parametrize("count", [0, 40, 1024, 1100])
def test_each_is_what_it_was_to_the_last_digit(kind, thing, count):
    things = [thing() for _ in range(count)]
    packed = kind(things)
    assert len(packed) == count
    for one, other in zip(packed, things, strict=True):
        for field in fields(other):
            value, right = getattr(one, field.name), getattr(other, field.name)
            assert type(value) is type(right)
            assert np.array_equal(value, right)
    with pytest.raises(IndexError):
        packed[count]


@pytest.mark.parametrize("count", [10, 1030])
def test_what_is_changed_in_a_copy_is_not_in_the_first(count):
    steps = FrontEndSteps(step() for _ in range(count))
    others, was = copy(steps), steps[7].T_map_base
    others[7 - count] = replace(steps[7], T_map_base=SE2.identity())
    assert others[7].T_map_base == SE2.identity()
    assert steps[7].T_map_base == was
    more = [step() for _ in range(1024)]
    for one in more:
        others.append(one)
    assert (len(steps), len(others)) == (count, count + 1024)
    assert [one.time_s for one in others] == [one.time_s for one in (*steps, *more)]
    assert np.array_equal(others.column("time_s"), [one.time_s for one in others])
    assert FrontEndSteps().column("is_open").tolist() == []


def test_some_of_them_are_a_list_of_their_own():
    steps = FrontEndSteps(replace(step(), keyframe=k) for k in range(2500))
    rows = np.flatnonzero(np.arange(2500) % 2)
    found = steps.some(rows)
    assert [one.keyframe for one in found] == rows.tolist()
    for k in range(1500):  # beyond the block that is not full
        found.append(replace(step(), keyframe=-k))
    found[3] = replace(step(), keyframe=7000)
    assert [one.keyframe for one in found[-2:]] == [-1498, -1499]
    assert found[3].keyframe == 7000
    assert [one.keyframe for one in steps[:10]] == list(range(10))
    assert len(steps.some(rows[:0])) == len(FrontEndSteps().some(rows[:0])) == 0


def test_what_is_closed_is_read_only_but_for_copies():
    steps = FrontEndSteps(step() for _ in range(3)).close()
    with pytest.raises(TypeError, match="read only"):
        steps.append(steps[0])
    with pytest.raises(TypeError, match="read only"):
        steps[0] = steps[1]
    others = copy(steps)
    others.append(steps[0])
    assert (len(steps), len(others)) == (3, 4)


def test_some_of_them_and_what_is_made_of_each_are_as_of_a_list():
    things = [told() for _ in range(20)]
    packed = ToldSteps(things)
    longer = each(packed, lambda one: one.longer(2.0))
    for some in (slice(3, None), slice(None, -4), slice(2, 15, 3), slice(25, 30)):
        right = [one.motion for one in things[some]]
        assert [one.motion for one in packed[some]] == right
        assert [one.motion for one in packed[some][1:]] == right[1:]
        assert [one.motion.x for one in longer[some]] == [2.0 * one.x for one in right]
    assert packed[3:][-1].motion == things[-1].motion
    assert [one.motion.x for one in reversed(longer)] == [2.0 * o.motion.x for o in things[::-1]]


@pytest.mark.parametrize(
    ("kind", "thing", "most"), [(FrontEndSteps, step, 105), (ToldSteps, told, 110)]
)
def test_little_is_kept_of_each(kind, thing, most):
    packed = kind(thing() for _ in range(3000))
    assert sum(sys.getsizeof(block) for block in packed._blocks) / len(packed) < most

"""Keyframes that are kept for their place alone: rows of numbers, and the same as ever when they are asked for."""

import tracemalloc
from dataclasses import replace

import numpy as np

from slam.beams import Beams
from slam.frontend.kept_keyframes import Keyframes, has_scan
from slam.frontend.keyframes import Keyframe, as_sure_as_before
from slam.frontend.told_steps import ToldStep
from slam.se2 import SE2


def keyframe(k: int, beam_count: int = 5) -> Keyframe:
    rng = np.random.default_rng(k)
    beams = Beams(np.zeros((beam_count, 2)), np.zeros(beam_count), np.ones(beam_count))
    poses = [SE2.from_array(rng.uniform(-3.0, 3.0, 3)) for _ in range(3)]
    covariance, told = rng.random((2, 3, 3))
    return Keyframe(
        0.1 * k, poses[0], poses[1], covariance, rng.random((beam_count, 2)), beams, k % 3 == 0,
        k % 2, told=ToldStep(poses[2], told),
    )  # fmt: skip


def told(one: Keyframe) -> tuple[object, ...]:
    return (
        one.time_s, one.T_map_base, one.T_before, one.covariance.tolist(), one.is_break, one.session,
        one.told.motion, one.told.covariance.tolist(), len(one.points), len(one.beams),
    )  # fmt: skip


def test_place_of_a_keyframe_is_all_that_is_left_and_is_what_it_was():
    kept = Keyframes(keyframe(k) for k in range(4))
    for k in range(4, 9):
        kept.append(keyframe(k))
    for k in (2, 5, 0):
        kept.keep_place_alone(k)
    assert len(kept) == 9
    for k, one in enumerate(kept):
        is_alone = k in (2, 5, 0)
        assert has_scan(kept, k) is has_scan(list(kept), k) is not is_alone
        assert told(one) == told(keyframe(k).place_alone() if is_alone else keyframe(k))
    assert [one.time_s for one in kept[-4:]] == [one.time_s for one in list(kept)[-4:]]
    assert kept[8] is kept[8]
    # what was taken out cannot be changed by whoever asked for it
    kept[2].covariance[:] = 0.0
    assert told(kept[2]) == told(keyframe(2).place_alone())
    kept[2] = replace(kept[2], session=7)
    assert kept[2].session == 7
    assert not has_scan(kept, 2)


def test_covariance_that_was_changed_is_taken_back_of_a_place_as_well():
    kept = Keyframes(keyframe(k) for k in range(3))
    before = kept[1].covariance
    since = before + 1.0
    kept[1] = replace(kept[1], covariance=since)
    kept.keep_place_alone(1)
    found = as_sure_as_before(kept, {1: (since, before)})
    assert np.array_equal(found[1].covariance, before)
    # something else is known of it by now
    kept[1] = replace(kept[1], covariance=2.0 * since)
    found = as_sure_as_before(kept, {1: (since, before)})
    assert np.array_equal(found[1].covariance, 2.0 * since)


def test_place_takes_a_few_hundred_bytes():
    kept, count = Keyframes(), 4096
    tracemalloc.start()
    for k in range(count):
        kept.append(keyframe(k, 181))
        kept.keep_place_alone(k)
        kept[k] = replace(kept[k], session=1)  # what is known of it since
    held, _ = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert held < 320 * count

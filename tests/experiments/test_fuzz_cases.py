"""Inputs that fuzzing found: each is read, or refused in one line that names the file."""

import sqlite3
import struct
import tracemalloc
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from experiments.fuzzing import room
from experiments.fuzzing.files import check_refusal
from experiments.fuzzing.targets import TARGETS
from slam.mapping import Mapper
from slam.measurements import LaserScan

_MAGIC = b"\x93NUMPY"


def _replaced(old: bytes, new: bytes, count: int = -1) -> Callable[[bytes], bytes]:
    def change(data: bytes) -> bytes:
        assert old in data
        return data.replace(old, new, count)

    return change


def _long_name(whole: bytes) -> bytes:
    """The first name in the directory of a zip file is said to be as long as all that follows."""
    at, end = whole.index(b"PK\x01\x02"), whole.index(b"PK\x05\x06")
    return whole[: at + 28] + struct.pack("<H", end - at - 46) + whole[at + 30 :]


def _odd_topics(bag: bytes) -> bytes:
    """A bag without a scan, whose topics are then listed: a line's end is in one."""
    return bag.replace(b"msg/LaserScan", b"msg/LaserSccn").replace(b"/tf_static", b"/tf\n\n\nstic")


def _long_kind(members: bytes) -> bytes:
    """Another kind of file, told at length."""
    header = b"{'descr': '<U900', 'fortran_order': False, 'shape': (), }"
    length = struct.pack("<H", len(header) + 1)
    array = _MAGIC + b"\1\0" + length + header + b"\n" + "x".encode("utf-32-le") * 900
    return array + _MAGIC + _MAGIC.join(members.split(_MAGIC)[2:])


def _signaling(members: bytes) -> bytes:
    """A range that is a nan of the kind that raises when it is converted."""
    parts = members.split(_MAGIC)
    last = max(number for number, part in enumerate(parts) if b"'<f4'" in part)
    parts[last] = parts[last][:-4] + b"\x01\x00\x80\x7f"
    return _MAGIC.join(parts)


def _topic_of_bytes(bag: bytes) -> bytes:
    """Where a name is looked for, SQLite may have anything."""
    with sqlite3.connect(":memory:") as base:
        base.deserialize(bag)
        base.execute("UPDATE topics SET name = x'00ff' WHERE name = '/odom'")
        base.commit()
        changed = base.serialize()
    base.close()
    return changed


CASES = {
    # squares and products of numbers that are too large
    "tum: quaternion": ("tum", 0, _replaced(b"0 0 0 0 1\n", b"0 0 0 0 1e308\n", 1)),
    "kitti: turn": ("kitti", 0, _replaced(b"1 0 0 0 0", b"1e308 1e308 -1e308 0 0", 1)),
    # a line's end in a name
    "bag: topic": ("bag-sqlite", 0, _odd_topics),
    "bag: bytes": ("bag-sqlite", 0, _topic_of_bytes),
    "baseline: setting": ("baseline", 0, _replaced(b'"place"', b'"pl\\u0085ce"')),
    "baseline: experiment": ("baseline", 0, _replaced(b'"kidnap"', b'"kid\\u2028nap"')),
    # what numpy raises on a header that is no Python
    "map: header": ("slam-map", 0, _replaced(b"'fortran_order': False", b"'fortran_order': (Fals")),
    "map: indent": ("slam-map", 0, _replaced(b"{'descr': ", b"{'d'\n}\n \n", 1)),
    "map: name": ("slam-map", 1, _long_name),
    "map: kind": ("slam-map", 0, _long_kind),
    "map: range": ("slam-map", 0, _signaling),
}


@pytest.mark.parametrize("case", CASES)
def test_input_that_was_found_ends_as_documented(tmp_path, case):
    name, seed, change = CASES[case]
    seeds, read = TARGETS[name].make(tmp_path)
    try:
        read(change(seeds[seed]), tmp_path)
    except ValueError as error:
        check_refusal(error, TARGETS[name].file)


def test_reflections_from_far_away_take_no_memory_of_the_mapper():
    mapper = Mapper(room.T_BASE_LASER)
    measurements = [measurement for _, measurement in room.drive(4, 121)]
    for measurement in measurements[:3]:
        mapper.update(measurement)
    scan = measurements[3].scan
    signaling = np.frombuffer(b"\x01\x00\x00\x00\x00\x00\xf0\x7f", "<f8")
    tracemalloc.start()
    for number in range(3):
        ranges_m = np.random.default_rng(number).uniform(0.1, 9.0, 121)
        ranges_m[40:50] = 2e4  # a table of 0.2 m cells around it has 4e10
        ranges_m[60:61] = signaling
        bad = LaserScan(scan.time_s + 0.1 * number, scan.angles_rad, ranges_m)
        step = mapper.update(replace(measurements[3], time_s=bad.time_s, scan=bad))
        assert np.isfinite(step.T_map_base.as_array()).all()
    assert tracemalloc.get_traced_memory()[1] < 50e6
    tracemalloc.stop()

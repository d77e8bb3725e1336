"""Bags that are cut, damaged, foreign or made to do harm: one line each, and little memory."""

import math
import re
import struct
import sys
import tracemalloc
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import pytest
from rosbags.rosbag2 import CompressionMode

from slam.readers.recognition import read_log
from slam.se2 import SE2
from tests.slam.turtlebot import BEAMS, START_S, Frames, Recording, Sweep, _Messages, write_bag

NO_BAG = "is a folder without metadata.yaml, *.bag, *.mcap or *.db3: give the log"


@dataclass
class _Odd(Recording):
    """A recording with one scan, some of whose fields are other ones."""

    other: dict = field(default_factory=dict)

    def __post_init__(self) -> None:
        self.duration_s = 0.3
        self.sweeps = [Sweep(START_S + 0.1, np.full(BEAMS, 2.0))]


def refused(path) -> str:
    """What is said of a bag, in one line that begins with its path."""
    with pytest.raises(ValueError, match=f"^{re.escape(str(path))}") as caught:
        list(read_log(path).measurements())
    said = str(caught.value)
    assert "\n" not in said
    return said


@pytest.mark.parametrize(
    ("other", "said"),
    [
        ({"angle_increment": math.nan}, "by angle_increment nan; expected angles"),
        ({"angle_increment": math.inf}, "by angle_increment inf; expected angles"),
        ({"angle_increment": 0.0}, "angle_increment is 0"),
        ({"angle_increment": 0.1}, "no more than a turn"),
        ({"angle_min": math.nan}, "from angle_min nan"),
        ({"range_max": 0.0}, "and range_max 0; expected metres"),
        ({"range_max": math.nan}, "and range_max nan; expected metres"),
        ({"ranges": np.zeros(200_000, dtype=np.float32)}, "200000 beams; expected 100000 at most"),
        ({"ranges": np.zeros(0, dtype=np.float32)}, "no scan on /scan has a beam; it has: /odom"),
    ],
)
def test_scan_that_is_none_is_named_by_topic_and_number(tmp_path, monkeypatch, other, said):
    usual = _Messages.scan
    monkeypatch.setattr(_Messages, "scan", lambda self, sweep: usual(self, sweep, **other))
    write_bag(tmp_path / "b", _Odd())
    assert said in refused(tmp_path / "b")


def test_scan_that_announces_a_milliard_of_beams_is_refused_without_the_memory(tmp_path):
    write_bag(tmp_path / "b", _Odd())
    path = tmp_path / "b" / "b.mcap"
    raw = path.read_bytes()
    announced = struct.pack("<I", BEAMS) + np.full(3, 2.0, dtype=np.float32).tobytes()
    assert raw.count(announced) == 1
    path.write_bytes(raw.replace(announced, struct.pack("<I", 10**9) + announced[4:]))
    tracemalloc.start()
    assert "cut or damaged" in refused(path)
    assert tracemalloc.get_traced_memory()[1] < 50e6
    tracemalloc.stop()


def mcap_of_chunk(packed: bytes, size: int, compression: bytes = b"zstd") -> bytes:
    """An MCAP file without index, of one chunk that announces a size."""
    magic = b"\x89MCAP0\r\n"
    chunk = struct.pack("<QQQI", 0, 1, size, 0) + struct.pack("<I", len(compression)) + compression
    chunk += struct.pack("<Q", len(packed)) + packed
    header = struct.pack("<I4sI", 4, b"ros2", 0)
    records = [(1, header), (6, chunk), (2, bytes(20))]
    return magic + b"".join(struct.pack("<BQ", op, len(c)) + c for op, c in records) + magic


@pytest.mark.parametrize("announced", [1000, 1 << 27, 1 << 40])
def test_chunk_that_unpacks_to_gigabytes_is_refused_without_the_memory(tmp_path, announced):
    if sys.version_info >= (3, 14):
        from compression import zstd
    else:
        from backports import zstd
    packer = zstd.ZstdCompressor()
    packed = b"".join(packer.compress(bytes(1 << 24)) for _ in range(16)) + packer.flush()
    assert len(packed) < 100_000
    (tmp_path / "b.mcap").write_bytes(mcap_of_chunk(packed, announced))
    tracemalloc.start()
    assert refused(tmp_path / "b.mcap").startswith(f"{tmp_path}/b.mcap: cut or damaged")
    # at most the 128 MB that a chunk may have, and what the decoder holds
    assert tracemalloc.get_traced_memory()[1] < 300e6
    tracemalloc.stop()


def test_unknown_compression_is_named(tmp_path):
    (tmp_path / "b.mcap").write_bytes(mcap_of_chunk(b"abc", 3, b"brotli"))
    assert "brotli" in refused(tmp_path / "b.mcap")


@pytest.mark.parametrize("suffix", ["bag", "mcap", "db3"])
@pytest.mark.parametrize("content", [b"", b"hello there\n" * 9, bytes(4096)])
def test_junk_called_a_bag_is_refused(tmp_path, suffix, content):
    (tmp_path / f"b.{suffix}").write_bytes(content)
    assert "as neither a ROS 1 bag does nor MCAP" in refused(tmp_path / f"b.{suffix}")


@pytest.fixture(scope="module")
def whole(tmp_path_factory) -> dict[str, bytes]:
    folder, moment = tmp_path_factory.mktemp("whole"), Recording(duration_s=0.4)
    write_bag(folder / "m", moment, compression=CompressionMode.STORAGE)
    write_bag(folder / "s", moment, "sqlite3")
    write_bag(folder / "a.bag", moment, "ros1")
    paths = {
        "mcap": folder / "m" / "m.mcap",
        "db3": folder / "s" / "s.db3",
        "bag": folder / "a.bag",
    }
    return {kind: path.read_bytes() for kind, path in paths.items()}


@pytest.mark.parametrize("kind", ["mcap", "db3", "bag"])
@pytest.mark.parametrize("share", [0.01, 0.5, 0.8])
def test_truncated_bag_is_refused_with_what_mends_it(tmp_path, whole, kind, share):
    path = tmp_path / f"b.{kind}"
    path.write_bytes(whole[kind][: int(share * len(whole[kind]))])
    mends = {"mcap": "`mcap recover`", "db3": "`ros2 bag reindex`", "bag": "`rosbag reindex`"}
    assert f"cut or damaged, try {mends[kind]}" in refused(path)


@pytest.mark.parametrize("kind", ["mcap", "db3", "bag"])
def test_damaged_bag_is_read_or_refused_in_one_line(tmp_path, whole, kind):
    rng = np.random.default_rng(5)
    for _ in range(12):
        raw = np.frombuffer(whole[kind], dtype=np.uint8).copy()
        start = rng.integers(0, len(raw))
        raw[start : start + rng.integers(1, 40)] ^= rng.integers(1, 256, dtype=np.uint8)
        path = tmp_path / f"b.{kind}"
        path.write_bytes(raw.tobytes())
        said = f"{path}: read"
        try:
            list(read_log(path).measurements())
        except ValueError as error:
            said = str(error)
        assert said.startswith(f"{path}: ")
        assert "\n" not in said


def test_folder_without_metadata_names_the_file_that_it_has(tmp_path):
    write_bag(tmp_path / "b", _Odd())
    (tmp_path / "b" / "metadata.yaml").unlink()
    assert refused(tmp_path / "b").endswith(f"give one of its files: {tmp_path}/b/b.mcap")
    (tmp_path / "empty").mkdir()
    said = refused(tmp_path / "empty")
    assert said == f"{tmp_path / 'empty'}: {NO_BAG}"


def test_folder_without_a_bag_is_said_to_be_none_though_no_library_reads_bags(
    tmp_path, monkeypatch
):
    monkeypatch.setitem(sys.modules, "slam.readers.ros_bag", None)
    (tmp_path / "notes.txt").touch()
    monkeypatch.chdir(tmp_path)
    assert refused(Path()) == f".: {NO_BAG}"
    (tmp_path / "metadata.yaml").touch()
    with pytest.raises(
        ImportError, match=r"^\. is a ROS bag, and to read it slam\.readers\.ros_bag"
    ):
        read_log(Path())


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("a: [", "metadata.yaml is not that of a ROS 2 bag"),
        ("hello", "metadata.yaml is not that of a ROS 2 bag"),
        ("rosbag2_bagfile_information: 3", "metadata.yaml is not that of a ROS 2 bag"),
        ("rosbag2_bagfile_information: {}", "names no files"),
        ("rosbag2_bagfile_information: !!python/object/apply:os.system [ls]", "is not that of"),
        (
            "rosbag2_bagfile_information: {relative_file_paths: [a.db3], compression_mode: FILE,"
            " compression_format: zstd}",
            "its files are compressed as a whole (zstd); unpack them first",
        ),
        (
            "rosbag2_bagfile_information: {relative_file_paths: [a.db3],"
            " compression_mode: message, compression_format: snappy}",
            "its messages are compressed as snappy; expected zstd",
        ),
    ],
)
def test_metadata_that_is_none_is_refused(tmp_path, text, said):
    (tmp_path / "b").mkdir()
    (tmp_path / "b" / "metadata.yaml").write_text(text)
    assert said in refused(tmp_path / "b")


def test_file_of_a_bag_is_looked_for_in_its_folder_alone(tmp_path):
    (tmp_path / "b").mkdir()
    (tmp_path / "secret.db3").write_bytes(b"SQLite format 3\0")
    text = "rosbag2_bagfile_information: {relative_file_paths: [../secret.db3]}"
    (tmp_path / "b" / "metadata.yaml").write_text(text)
    with pytest.raises(FileNotFoundError, match=r"b/secret\.db3"):
        read_log(tmp_path / "b")


def test_laser_that_leans_or_moves_on_the_robot_is_refused(tmp_path, monkeypatch):
    usual = _Messages.tf
    leaning = {"base_scan": (0.0, math.sin(0.5), 0.0, math.cos(0.5))}
    monkeypatch.setattr(_Messages, "tf", lambda self, edges, _=None: usual(self, edges, leaning))
    write_bag(tmp_path / "leans", Recording(duration_s=0.3))
    assert "base_scan leans by 57 degrees on base_footprint" in refused(tmp_path / "leans")

    def moving(self, edges, quaternions=None):
        time_s = edges[0][0]
        return usual(self, [*edges, (time_s, "base_link", "base_scan", SE2(0.0, 0.0, time_s % 3))])

    monkeypatch.setattr(_Messages, "tf", moving)
    write_bag(tmp_path / "moves", Recording(duration_s=0.3), frames=Frames(has_static=True))
    assert "base_scan moves in base_link by up to" in refused(tmp_path / "moves")


def test_clocks_that_have_nothing_in_common_are_told(tmp_path, monkeypatch):
    usual = _Messages.scan
    monkeypatch.setattr(
        _Messages, "scan", lambda self, s: usual(self, Sweep(s.start_s - 1e6, s.ranges_m))
    )
    write_bag(tmp_path / "b", Recording(duration_s=0.5))
    assert "these are two clocks; choose another --odom-topic" in refused(tmp_path / "b")


def test_bag_without_a_scan_says_what_it_has(tmp_path, monkeypatch):
    usual = _Messages.all
    monkeypatch.setattr(
        _Messages, "all", lambda self, more: [one for one in usual(self, more) if one[1] != "/scan"]
    )
    write_bag(tmp_path / "b", Recording(duration_s=0.3))
    said = refused(tmp_path / "b")
    assert "no sensor_msgs/msg/LaserScan, so no scan to work with; it has: /odom nav_msgs" in said


def test_hash_with_a_line_in_it_is_told_in_one_line(tmp_path, whole):
    # 94810edda583a504dfda3829e70d7eec is that of tf2_msgs/TFMessage
    path = tmp_path / "b.bag"
    path.write_bytes(whole["bag"].replace(b"94810edda583a504", b"94810ed\na583a504"))
    assert r"with the hash '94810ed\na583a504dfda3829e70d7eec' it is another type" in refused(path)


def test_frame_that_no_screen_shows_or_that_fills_one_is_told_in_a_line(tmp_path):
    frames = Frames(has_static=False, laser="scan\r\n" + 2000 * "r")
    write_bag(tmp_path / "b", Recording(duration_s=0.3), frames=frames)
    said = refused(tmp_path / "b")
    assert r"no transform from base_footprint to scan\r\nrrrr" in said
    assert len(said) < 400

"""ROS bags by the library rosbags: which topics they have, and their messages one after the other.

ROS 1: a .bag. ROS 2: a folder with metadata.yaml, or one file of it, MCAP or SQLite. Messages are
read by ROS's own definitions: what a bag says of its types is compared with these, never compiled.
"""

from __future__ import annotations

import bz2
import struct
import sys
from collections.abc import Callable, Collection, Generator, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cache
from pathlib import Path, PurePath
from typing import Any

import apsw
import yaml
from lz4.frame import LZ4FrameDecompressor
from rosbags import rosbag1, rosbag2
from rosbags.interfaces import Connection
from rosbags.rosbag1 import reader as rosbag1_reader
from rosbags.rosbag2 import storage_mcap
from rosbags.rosbag2.storage_sqlite3 import Sqlite3Reader
from rosbags.serde import SerdeError
from rosbags.typesys import Stores, TypesysError, get_types_from_msg, get_typestore
from rosbags.typesys.store import Typestore

from slam.files.whole_files import opened

if sys.version_info >= (3, 14):
    from compression import zstd
else:
    from backports import zstd

LASER_SCAN = "sensor_msgs/msg/LaserScan"
ODOMETRY = "nav_msgs/msg/Odometry"
POSE = "geometry_msgs/msg/PoseStamped"
POSE_WITH_COVARIANCE = "geometry_msgs/msg/PoseWithCovarianceStamped"
TF = "tf2_msgs/msg/TFMessage"
MOST_NAMED = 12
_OLD_TF = "tf/msg/tfMessage"
_TF_FIELDS = "geometry_msgs/TransformStamped[] transforms"
_LARGEST_PIECE = 1 << 27
"""Bytes of a chunk or message when decompressed; chosen: recorders make chunks of 1 to 4 MB."""
_LARGEST_METADATA = 1 << 24
"""Bytes; chosen: of a bag split into ten thousand files it has one."""
_MAGICS = {b"#ROSBAG V": "bag", b"\x89MCAP": "mcap", b"SQLite format 3\0": "db3"}
_DAMAGE = (
    *(rosbag1.ReaderError, rosbag2.ReaderError, SerdeError, TypesysError, apsw.Error),
    *(zstd.ZstdError, struct.error, yaml.YAMLError, AssertionError, AttributeError, EOFError),
    *(LookupError, MemoryError, OSError, OverflowError, RuntimeError, TypeError, ValueError),
)
"""What rosbags and the decoders below it raise of a bag that is cut or no bag."""

_Reader = rosbag1.Reader | storage_mcap.McapReader | Sqlite3Reader


@dataclass(frozen=True)
class Topic:
    """A topic, the type of its messages as ROS 2 writes it, and how many there are."""

    name: str
    type: str
    count: int


@dataclass(frozen=True)
class BagMessage:
    """A message: topic, its number on it from 1, when it was recorded [s], and its fields."""

    topic: str
    number: int
    logged_s: float
    content: Any


class Bag:
    """The topics of a bag. It is opened anew for each reading, and never read whole.

    Raises ValueError, one line that names the bag, for what is none, is cut or damaged, or of a
    kind that is not known; OSError when it cannot be opened.
    """

    def __init__(self, path: Path) -> None:
        self.path, self.name = path, path.name or str(path)
        self._files, self._is_each_compressed = _files(path)
        counts: dict[tuple[str, str], int] = {}
        for file in self._files:
            with self._opened(file) as reader:
                for topic, one in self._connections(reader):
                    counts[topic] = counts.get(topic, 0) + one.msgcount
        for key in counts:
            # of SQLite, whatever stands there
            if not all(isinstance(one, str) and one.isprintable() for one in key):
                raise ValueError(f"{self.path}: damaged, a topic and its type are {key!r:.160}")
        self.topics = tuple(Topic(*key, count) for key, count in sorted(counts.items()))

    def messages(self, names: Collection[str]) -> Generator[BagMessage]:
        """The messages of some topics in the order of recording."""
        numbers = dict.fromkeys(names, 0)
        for file in self._files:
            with self._opened(file) as reader:
                wanted = [one for (name, _), one in self._connections(reader) if name in numbers]
                if not wanted:
                    continue
                types = _Types(isinstance(reader, rosbag1.Reader), wanted)
                for connection, logged_ns, raw in reader.messages(wanted):
                    numbers[connection.topic] += 1
                    if self._is_each_compressed:
                        raw = _unzstd(raw, _LARGEST_PIECE)
                    yield BagMessage(
                        connection.topic,
                        numbers[connection.topic],
                        logged_ns * 1e-9,
                        types.content(connection, raw),
                    )

    def listed(self) -> str:
        """In words, what topics there are."""
        named = [
            f"{t.name:.60} {t.type.replace('/msg/', '/'):.60} ({t.count})" for t in self.topics
        ]
        more = f" and {len(named) - MOST_NAMED} more" if len(named) > MOST_NAMED else ""
        return f"it has: {', '.join(named[:MOST_NAMED])}{more}" if named else "it has no topics"

    def _connections(self, reader: _Reader) -> list[tuple[tuple[str, str], Connection]]:
        return [((one.topic, _type(one)), one) for one in reader.connections]

    @contextmanager
    def _opened(self, path: Path) -> Iterator[_Reader]:
        """A file of the bag; whatever its reader says of it becomes one line."""
        with opened(path) as file:
            start = file.read(16)
        kind = _kind(start)
        if kind is None:
            raise ValueError(
                f"{path}: begins {start!r}, as neither a ROS 1 bag does nor MCAP or SQLite: is it"
                " compressed, or no bag?"
            )
        reader = _READERS[kind](path)
        try:
            reader.open()
            try:
                yield reader
            finally:
                reader.close()
        except _DAMAGE as error:
            if isinstance(error, OSError) and error.errno is not None:
                raise
            if isinstance(error, _NotOfRosError):
                raise ValueError(f"{path}: {error}") from error
            raise ValueError(f"{path}: cut or damaged{_hint(kind)} ({_said(error)})") from error


class _NotOfRosError(ValueError):
    """A type that is not what ROS means by its name."""


class _Types:
    """The messages of some topics, by ROS's definitions of their types."""

    def __init__(self, is_ros1: bool, connections: list[Connection]) -> None:
        self._is_ros1, self._store = is_ros1, _store(is_ros1)
        for one in connections:
            type_name = _type(one)
            if type_name not in self._store.fielddefs:
                raise _NotOfRosError(f"{one.topic} is {type_name}, which is not read here")
            ours = (
                self._store.generate_msgdef(one.msgtype, ros_version=1)[1]
                if is_ros1
                else self._store.hash_rihs01(type_name)
            )
            if one.digest and one.digest != ours:
                raise _NotOfRosError(
                    f"{one.topic} says to be {type_name}, but with the hash {one.digest!r:.80} it is"
                    f" another type than ROS's, {ours}"
                )

    def content(self, connection: Connection, raw: bytes | memoryview) -> Any:
        """The fields of a message."""
        if self._is_ros1:
            return self._store.deserialize_ros1(raw, connection.msgtype)
        return self._store.deserialize_cdr(raw, connection.msgtype)


@cache
def _store(is_ros1: bool) -> Typestore:
    store = get_typestore(Stores.ROS1_NOETIC if is_ros1 else Stores.ROS2_JAZZY)
    if is_ros1:
        for name in (TF, _OLD_TF):
            store.register(get_types_from_msg(_TF_FIELDS, name))
    return store


def _type(connection: Connection) -> str:
    return TF if connection.msgtype == _OLD_TF else connection.msgtype


def _kind(start: bytes) -> str | None:
    return next((kind for magic, kind in _MAGICS.items() if start.startswith(magic)), None)


_READERS: dict[str, Callable[[Path], _Reader]] = {
    "bag": rosbag1.Reader,
    "mcap": storage_mcap.McapReader,
    "db3": Sqlite3Reader,
}


def _hint(kind: str) -> str:
    """How a bag is mended whose recorder was switched off."""
    mends = {"bag": "`rosbag reindex`", "mcap": "`mcap recover`", "db3": "`ros2 bag reindex`"}
    return f", try {mends[kind]}"


def _said(error: BaseException) -> str:
    said = " ".join(" ".join(map(str, error.args)).split())
    return said[:200] or type(error).__name__


def _files(path: Path) -> tuple[list[Path], bool]:
    """The files of a bag in their order, and whether each message is compressed by itself."""
    if not path.is_dir():
        return [path], False
    metadata = _metadata(path)
    names = metadata.get("relative_file_paths")
    if not isinstance(names, list) or not names or not all(isinstance(n, str) for n in names):
        raise ValueError(f"{path}: metadata.yaml names no files in relative_file_paths")
    mode = str(metadata.get("compression_mode") or "none").lower()
    if mode not in ("none", "message", "file"):
        raise ValueError(f"{path}: metadata.yaml has an unknown compression_mode '{mode}'")
    packing = metadata.get("compression_format")
    if mode == "file":
        raise ValueError(
            f"{path}: its files are compressed as a whole ({packing}); unpack them first, as by"
            f" `ros2 bag convert` or `zstd -d`, and give the .mcap or .db3"
        )
    if mode == "message" and packing != "zstd":
        raise ValueError(f"{path}: its messages are compressed as {packing}; expected zstd")
    # older bags have the folder's name in front; a name never leads out of the folder
    return [path / PurePath(name).name for name in names], mode == "message"


def _metadata(folder: Path) -> dict[str, Any]:
    """What metadata.yaml says of the files beside it."""
    path = folder / "metadata.yaml"
    if not path.exists():
        files = [file for end in (".mcap", ".db3", ".bag") for file in folder.glob(f"*{end}")]
        found = ", ".join(sorted(map(str, files))[:5])
        raise ValueError(
            f"{folder}: a folder without metadata.yaml is no ROS 2 bag; "
            + (f"give one of its files: {found}" if found else "nor does it hold a bag's file")
        )
    with opened(path) as file:
        content = file.read(_LARGEST_METADATA + 1)
    if len(content) > _LARGEST_METADATA:
        raise ValueError(f"{folder}: metadata.yaml is larger than {_LARGEST_METADATA} bytes")
    try:
        loaded = yaml.safe_load(content)
        metadata = loaded["rosbag2_bagfile_information"]
    except (yaml.YAMLError, LookupError, TypeError, RecursionError, ValueError) as error:
        reason = " ".join(str(error).split())[:200]
        raise ValueError(
            f"{folder}: metadata.yaml is not that of a ROS 2 bag ({reason})"
        ) from error
    if not isinstance(metadata, dict):
        raise ValueError(f"{folder}: metadata.yaml is not that of a ROS 2 bag")
    return metadata


def _bounded(decompress: Callable[[bytes, int], bytes], packed: bytes, size: int) -> bytes:
    """What was packed, of at most a size that is announced. Raises ValueError if it is larger."""
    if size > _LARGEST_PIECE:
        raise ValueError(f"a piece of {size} bytes; expected {_LARGEST_PIECE} at most")
    raw = decompress(packed, size + 1)
    if len(raw) > size:
        raise ValueError(f"a piece that unpacks to more than {size} bytes")
    return raw


def _unzstd(packed: bytes | memoryview, size: int) -> bytes:
    return _bounded(
        lambda data, most: zstd.ZstdDecompressor().decompress(data, most), bytes(packed), size
    )


def _unlz4(packed: bytes, size: int) -> bytes:
    return _bounded(
        lambda data, most: bytes(LZ4FrameDecompressor().decompress(data, most)), packed, size
    )


def _unbz2(packed: bytes, size: int) -> bytes:
    return _bounded(lambda data, most: bz2.BZ2Decompressor().decompress(data, most), packed, size)


def _plain(packed: bytes, size: int) -> bytes:
    return _bounded(lambda data, _: data, packed, size)


# rosbags unpacks a chunk to whatever size it has, some thousand times that of the file: its tables of
# decoders get ones that stop
storage_mcap.DECOMPRESSORS.update({"": _plain, "zstd": _unzstd, "lz4": _unlz4})
rosbag1_reader.decompressors.update(
    {
        "bz2": lambda packed: _unbz2(packed, _LARGEST_PIECE),
        "lz4": lambda packed: _unlz4(packed, _LARGEST_PIECE),
    }
)

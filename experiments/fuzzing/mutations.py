"""Changes to a valid input that a reader's authors may not have thought of."""

from __future__ import annotations

import random
import re
import struct

_NUMBER = re.compile(rb"-?\d+(?:\.\d+)?(?:e-?\d+)?")
_ODD_NUMBERS = (
    *(b"0", b"-0", b"-1", b"1", b"nan", b"inf", b"-inf", b"NaN", b"Infinity", b"1e308", b"1e309"),
    *(b"-1e308", b"5e-324", b"1e16", b"9223372036854775807", b"9223372036854775808", b"1_0"),
    *(
        b"99999999999999999999999999",
        b"2147483648",
        b"4294967296",
        b"65536",
        b"1000000000",
        b"0x10",
    ),
    *(b"true", b"null", b"[]", b"{}", b'""', "٣".encode(), "²".encode(), b"1" * 400),
)
_ODD_BYTES = (
    b"\0",
    b"\n",
    b"\r",
    b"\xff",
    b"\xc2\x85",
    b"\x0c",
    b"#",
    b'"',
    b"[",
    b"{",
    b" ",
    b"&a",
)
_ODD_WORDS = (0, 1, 2**7, 2**8 - 1, 2**15, 2**16 - 1, 2**31 - 1, 2**31, 2**32 - 1, 2**63, 2**64 - 1)


def mutated(data: bytes, rng: random.Random, other: bytes = b"") -> bytes:
    """One to four changes; other: another input, of which a part may be taken over."""
    for _ in range(rng.choice((1, 1, 1, 2, 4))):
        data = rng.choice(_CHANGES)(data, rng, other)
    return data


def _number(data: bytes, rng: random.Random, _: bytes) -> bytes:
    """Another number for one written out; of long files, one near a place drawn."""
    start = rng.randrange(len(data) + 1)
    found = _NUMBER.search(data, start) or _NUMBER.search(data)
    if found is None:
        return _flip(data, rng, b"")
    return data[: found.start()] + rng.choice(_ODD_NUMBERS) + data[found.end() :]


def _flip(data: bytes, rng: random.Random, _: bytes) -> bytes:
    if not data:
        return b"0"
    at = rng.randrange(len(data))
    return data[:at] + bytes([data[at] ^ 1 << rng.randrange(8)]) + data[at + 1 :]


def _word(data: bytes, rng: random.Random, _: bytes) -> bytes:
    """Another whole or real number for a binary one."""
    form = rng.choice(("<I", "<Q", "<H", "<d", "<f", ">I"))
    if form in ("<d", "<f"):
        value: float = rng.choice((float("nan"), float("inf"), -1.0, 0.0, 1e300, 1e9, 1e-300))
        word = struct.pack(form, value if form == "<d" or abs(value) < 1e38 else float("inf"))
    else:
        size = struct.calcsize(form)
        word = struct.pack(form, rng.choice(_ODD_WORDS) % (1 << 8 * size))
    at = rng.randrange(max(1, len(data) - len(word) + 1))
    return data[:at] + word + data[at + len(word) :]


def _odd(data: bytes, rng: random.Random, _: bytes) -> bytes:
    at = rng.randrange(len(data) + 1)
    return data[:at] + rng.choice(_ODD_BYTES) + data[at + rng.randrange(2) :]


def _cut(data: bytes, rng: random.Random, _: bytes) -> bytes:
    return data[: rng.randrange(len(data) + 1)]


def _without(data: bytes, rng: random.Random, _: bytes) -> bytes:
    first, last = _span(data, rng)
    return data[:first] + data[last:]


def _repeated(data: bytes, rng: random.Random, _: bytes) -> bytes:
    first, last = _span(data, rng)
    return data[:last] + data[first:last] * rng.choice((1, 1, 2, 30)) + data[last:]


def _spliced(data: bytes, rng: random.Random, other: bytes) -> bytes:
    first, last = _span(data, rng)
    begin, end = _span(other, rng)
    return data[:first] + other[begin:end] + data[last:]


def _line(data: bytes, rng: random.Random, other: bytes) -> bytes:
    """Lines taken out, doubled, swapped, or taken over."""
    lines = data.split(b"\n")
    at = rng.randrange(len(lines))
    how = rng.randrange(4)
    if how == 0:
        del lines[at]
    elif how == 1:
        lines.insert(at, lines[at])
    elif how == 2:
        there = rng.randrange(len(lines))
        lines[at], lines[there] = lines[there], lines[at]
    else:
        lines.insert(at, rng.choice((other or data).split(b"\n")))
    return b"\n".join(lines)


def _span(data: bytes, rng: random.Random) -> tuple[int, int]:
    first = rng.randrange(len(data) + 1)
    length = rng.choice((1, 4, 16, 64, len(data)))
    return first, min(len(data), first + rng.randrange(1, length + 2))


_CHANGES = (
    *(
        _number,
        _number,
        _number,
        _flip,
        _flip,
        _flip,
        _word,
        _word,
        _word,
        _odd,
        _cut,
        _without,
        _repeated,
        _spliced,
    ),
    *(_line, _line),
)

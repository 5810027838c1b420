"""Damage of every kind to the bytes of a file, drawn from a seed."""

import struct
from bisect import bisect
from collections.abc import Callable, Iterator, Sequence
from itertools import accumulate
from random import Random
from typing import Final

from replay.logs.bag.bag_records import parse_header_fields

_LENGTHS: Final = (0, 1, 2**31 - 1, 2**31, 2**32 - 1, 2**40, 2**62, 2**63 - 1, 2**63, 2**64 - 1)
#: What is at the head of a record, a page or a footer.
_HEAD_BYTES: Final = 48
_LONGEST: Final = 2000


class Target:
    """The bytes of a file, and where its records begin: faults there are the most telling."""

    def __init__(self, data: bytes, strange: bytes, covered: Sequence[range] = ()) -> None:
        self.data = data
        self.heads = list(_heads(data))
        #: another file, to splice from
        self.strange = strange
        #: what checksums cover
        self.covered = covered

    def place(self, rng: Random, data: bytearray) -> int:
        """An offset, at every second time in the head of a record."""
        at = rng.randrange(len(data))
        if self.heads and rng.random() < 0.5:
            at = rng.choice(self.heads) + rng.randrange(_HEAD_BYTES)
        return min(at, len(data) - 1)


Damage = Callable[[bytearray, Target, Random], None]


def cut(data: bytearray, target: Target, rng: Random) -> None:
    """What a full disk or a pulled plug leaves."""
    del data[target.place(rng, data) :]


def flip(data: bytearray, target: Target, rng: Random) -> None:
    """Bits anywhere."""
    for _ in range(rng.choice((1, 1, 2, 8))):
        data[target.place(rng, data)] ^= 1 << rng.randrange(8)


def flip_covered(data: bytearray, target: Target, rng: Random) -> None:
    """Bits that a checksum covers, and no others."""
    ends = list(accumulate(map(len, target.covered)))
    for _ in range(rng.choice((1, 1, 2, 8))):
        at = rng.randrange(ends[-1])
        number = bisect(ends, at)
        data[target.covered[number][at - ends[number]]] ^= 1 << rng.randrange(8)


def overwrite(data: bytearray, target: Target, rng: Random) -> None:
    """Other bytes in the place of some."""
    at = target.place(rng, data)
    size = rng.choice((1, 4, 8, 8, 64, 4096))
    content = rng.choice((b"\xff" * size, bytes(size), rng.randbytes(size)))
    data[at : at + size] = content[: len(data) - at]


def lengthen(data: bytearray, target: Target, rng: Random) -> None:
    """A number in a head that is large, negative, or a little beside the truth."""
    at = target.place(rng, data)
    for code in ("<Q", ">I") if rng.random() < 0.5 else ("<I", ">H"):
        size = struct.calcsize(code)
        if at + size <= len(data):
            (true,) = struct.unpack_from(code, data, at)
            value = rng.choice((*_LENGTHS, true + 1, true - 1, 2 * true, len(data)))
            struct.pack_into(code, data, at, value % 2 ** (8 * size))
            return


def delete(data: bytearray, target: Target, rng: Random) -> None:
    """Bytes that are missing."""
    at = target.place(rng, data)
    del data[at : at + rng.randrange(1, rng.choice((2, 50, _LONGEST)))]


def insert(data: bytearray, target: Target, rng: Random) -> None:
    """Bytes that belong to nothing."""
    at = target.place(rng, data)
    size = rng.randrange(1, rng.choice((2, 50, _LONGEST)))
    data[at:at] = rng.choice((bytes(size), rng.randbytes(size)))


def splice(data: bytearray, target: Target, rng: Random) -> None:
    """A stretch of this file, or of another, in a place that is not its own."""
    source = rng.choice((target.data, target.strange))
    begin = rng.choice([*_heads(source), 0]) if rng.random() < 0.5 else rng.randrange(len(source))
    stretch = source[begin : begin + rng.randrange(1, 2 * _LONGEST)]
    at = target.place(rng, data)
    end = at + len(stretch) if rng.random() < 0.5 else at
    data[at:end] = stretch


_SINGLE: Final = (cut, flip, overwrite, lengthen, delete, insert, splice)


def several(data: bytearray, target: Target, rng: Random) -> None:
    """One after the other."""
    for _ in range(rng.randrange(2, 7)):
        rng.choice(_SINGLE)(data, target, rng)
        if not data:
            data[:] = b"\0"


KINDS: Final[tuple[Damage, ...]] = (*_SINGLE, several)


def damaged(target: Target, damage: Damage, rng: Random) -> bytes:
    """The file after some damage."""
    data = bytearray(target.data)
    while data == target.data:
        damage(data, target, rng)
    return bytes(data)


def _heads(data: bytes) -> Iterator[int]:
    if data.startswith(b"\x89MCAP"):
        return _mcap_heads(data)
    if data.startswith(b"#ROSBAG"):
        return _bag_heads(data)
    if data.startswith(b"SQLite"):
        return iter((0, 16, 24, 56, 100, *range(4096, len(data), 4096)))
    return iter((0, max(0, len(data) - _HEAD_BYTES)))


def _mcap_heads(data: bytes) -> Iterator[int]:
    """Every record, also in chunks that are not compressed."""
    at = 8
    while at + 9 <= len(data) - 8:
        yield at
        length, compression = struct.unpack_from("<Q", data, at + 1)[0], data[at + 37 : at + 38]
        at += 9 + (40 if data[at] == 0x06 and compression == b"\0" else length)


def _bag_heads(data: bytes) -> Iterator[int]:
    """Every record and the size of its data, also in chunks that are not compressed."""
    at = 13
    while at + 8 <= len(data):
        yield at
        body = at + 4 + int.from_bytes(data[at : at + 4], "little")
        yield body
        fields = parse_header_fields(data[at + 4 : body]) or {}
        plain = fields.get(b"op") == b"\x05" and fields.get(b"compression") == b"none"
        at = body + 4 + (0 if plain else int.from_bytes(data[body : body + 4], "little"))

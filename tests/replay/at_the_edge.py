"""Damaged bytes at the edge of readable memory, for compiled code: one that reads past it crashes.

Run by `test_edges.py` as a process of its own, with the name of a case.
"""

import resource
import sqlite3
import struct
import sys
import tempfile
from collections.abc import Callable, Iterator
from itertools import chain
from pathlib import Path
from random import Random

import numpy as np
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from numba import njit

from replay.logs.bag import bag_grammar as bag_grammar
from replay.logs.blocks.block_groups import MessageRowIndex, RecordFinders
from replay.logs.decoding.decode_plan import DecodePlan
from replay.logs.decoding.unaligned import load64
from replay.logs.mcap import mcap_grammar as mcap_grammar
from replay.logs.messages.message_fields import resolve_message_field
from replay.logs.messages.message_types import RecordType, Scalar
from replay.logs.messages.raw_batch import RawBatch
from replay.logs.sqlite.database_pages import LEAF, RowFilter, read_page_layout_of_messages_table
from replay.logs.sqlite.leaf_pages import (
    ScannedRows,
    read_child_pages_into,
    scan_requested_rows_of_leaf_pages,
)
from replay.logs.storage.file_bytes import FileBytes
from tests.replay.guarded import Guarded
from tests.replay.logs.decoding.random_types import Sample, Types, types
from tests.replay.logs.decoding.test_equality import fields_of

GUARDED = Guarded(2**18)
#: Lengths that lead astray.
HUGE = [struct.pack("<I", n) for n in (2**32 - 1, 2**31, 2**31 - 1, 2**24, 255, 9)]
HUGE += [struct.pack("<Q", n) for n in (2**64 - 1, 2**63, 2**63 - 1, 2**63 - 30, 2**32)]
HUGE += [each[::-1] for each in HUGE]
EXAMPLES = settings(
    max_examples=8, deadline=None, suppress_health_check=list(HealthCheck), derandomize=True
)


@njit
def _one_byte_too_far(data: np.ndarray) -> int:
    return load64(data, data.size - 7)


def overreach() -> None:
    """What the others must not do."""
    _one_byte_too_far(GUARDED.at_end(bytes(64)))


def _damaged(whole: bytes, rng: Random, head: int = 0) -> Iterator[bytes]:
    """Torn, with lengths that are not, with flipped bits."""
    for _ in range(12):
        yield whole[: rng.randrange(len(whole) + 1)]
        other = bytearray(whole)
        for _ in range(rng.randrange(3)):
            huge = rng.choice(HUGE)
            at = rng.randrange(head, len(other) + 1)
            other[at : at + len(huge)] = huge
        yield bytes(other)
        other = bytearray(whole)
        for _ in range(rng.randrange(1, 4)):
            other[rng.randrange(head, len(other))] ^= 1 << rng.randrange(8)
        yield bytes(other[: rng.randrange(len(other) + 1)])


def _batch(data: np.ndarray, offsets: list[int], lengths: list[int]) -> RawBatch:
    columns = (np.array(each, np.int64) for each in (offsets, lengths, range(len(offsets))))
    return RawBatch(0, data, *columns)


def _decoding(encoding: str) -> Callable[[], None]:
    @EXAMPLES
    @given(drawn=types(), seed=st.integers(0, 2**32))
    def decode(drawn: Types, seed: int) -> None:
        rng = Random(seed)
        sample = Sample(drawn, encoding, seed, count=1)
        (whole,) = sample.stored(encoding)
        plan = DecodePlan(sample.kind.record, ros1=sample.ros1, fields=fields_of(sample))
        head = 0 if encoding == "ros1" else 4
        # elements that a list does not have are looked for at neither edge
        plan.decode(_batch(GUARDED.at_begin(whole), [0], [len(whole)]))
        for damaged in _damaged(whole, rng, head):
            first, size = len(whole), len(damaged)
            # once alone, once behind one that it may repeat, once as the one that is repeated
            plan.decode(_batch(GUARDED.at_begin(damaged), [0], [size]))
            data = GUARDED.at_end(whole + damaged)
            plan.decode(_batch(data, [0, first, 0, first], [first, size, first, size]))
        # every end of a message, each with an encapsulation that is known
        begins = list(range(len(whole)))
        plan.decode(_batch(data := GUARDED.at_end(whole), begins, [data.size - b for b in begins]))
        if head:
            for begin in begins[head::3]:
                part = whole[:4] + whole[begin:]
                plan.decode(_batch(GUARDED.at_end(part), [0], [len(part)]))

    return decode


def text() -> None:
    """Characters of several bytes that the end of their message cuts."""
    record = RecordType("t/msg/Label", (("label", Scalar("string")),))
    plan = DecodePlan(record, ros1=True, fields=[resolve_message_field("label", record)])
    for character in ("é", "€", "🚜"):
        for before in range(9):
            whole = b"x" * before + character.encode()
            for size in range(len(whole) + 1):
                stored = struct.pack("<I", size) + whole[:size]
                plan.decode(_batch(GUARDED.at_end(stored), [0], [len(stored)]))


def _scanning(finders: RecordFinders, records: bytes) -> Callable[[], None]:
    def scan() -> None:
        rng = Random(1)
        whole = [records[at:] for at in range(len(records))]
        for damaged in [*whole, *(d for _ in range(60) for d in _damaged(records, rng))]:
            for data in (GUARDED.at_begin(damaged), GUARDED.at_end(damaged)):
                rows = MessageRowIndex(finders, data, rng.choice([0, 3, 50]))
                for end in (data.size, rng.randrange(data.size + 1)):
                    rows.add_rows_of_span(0, end)
                    finders.find(data, 0, end, data.size + rng.choice([0, 7, 10**6]))
                found = rows.indexed_rows[:, rows.indexed_rows[0] >= 0]
                _batch(data, found[2].tolist(), found[3].tolist())

    return scan


def _mcap_records() -> bytes:
    def record(opcode: int, content: bytes) -> bytes:
        return struct.pack("<BQ", opcode, len(content)) + content

    message = struct.pack("<HIQQ", 1, 0, 5, 5)
    chunk = struct.pack("<QQQII", 0, 9, 64, 0, 4) + b"zstd" + struct.pack("<Q", 40) + bytes(40)
    some = record(3, b"schema") + record(4, b"channel") + record(5, message + b"payload")
    return some + record(5, message) + record(6, chunk) + some + record(5, message)


def _bag_records() -> bytes:
    def record(data: bytes, **fields: bytes) -> bytes:
        named = [name.encode() + b"=" + value for name, value in fields.items()]
        header = b"".join(struct.pack("<I", len(each)) + each for each in named)
        return struct.pack("<I", len(header)) + header + struct.pack("<I", len(data)) + data

    one, time = struct.pack("<I", 1), struct.pack("<II", 7, 8)
    message = record(b"payload", op=b"\2", conn=one, time=time)
    empty = record(b"", time=time, conn=one, op=b"\2")
    return record(b"type", op=b"\7", conn=one, topic=b"/t") + message + 3 * empty + message + empty


def _single_cell(at: int) -> bytes:
    """The beginning of a leaf page."""
    return struct.pack(">BHHHBH", LEAF, 0, 1, 0, 0, at)


def sqlite_pages() -> None:
    """Every page of a database as if it were the last of the memory."""
    rng = Random(1)
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder, "log.db3")
        database = sqlite3.connect(path, isolation_level=None)
        database.execute("PRAGMA page_size = 512")
        database.execute(
            "CREATE TABLE messages(id INTEGER PRIMARY KEY, topic_id INTEGER, timestamp INTEGER,"
            " data BLOB)"
        )
        sizes = rng.choices([0, 9, 99, 2999], k=99)
        many = ((k % 3, 2**k % 2**60, rng.randbytes(size)) for k, size in enumerate(sizes))
        database.executemany("INSERT INTO messages VALUES (NULL, ?, ?, ?)", many)
        file = FileBytes(path)
        layout = read_page_layout_of_messages_table(file, database)
        assert layout is not None
        pages = [file.read_bytes(512 * number, 512) for number in range(1, layout.pages)]
        file.close()
        database.close()
    assert {LEAF, 5} < {page[0] for page in pages}
    wanted = RowFilter(np.empty(0, np.int64), True, -(2**63), 2**63 - 1, True)
    slots = np.zeros(1, np.int64)
    damaged = (each for page in pages for each in _damaged(page, rng) if len(each) == 512)
    # a leaf with a single cell, which begins at any byte
    led_astray = (
        _single_cell(at) + page[10:]
        for page in [*pages[::9], rng.randbytes(512), rng.randbytes(512)]
        for at in range(512)
    )
    # 39 of 1000 bytes are in the leaf, and no room is behind them for the page that goes on
    cell = bytes([0x87, 0x68, 1, 6, 0, 1, 1, 0x8F, 0x4C, 1, 1]) + bytes(31)
    begins = [512 - len(cell) - room for room in range(5)]
    cut_off = ((_single_cell(at).ljust(at) + cell).ljust(512) for at in begins)
    for page in chain(pages, damaged, led_astray, cut_off):
        data = GUARDED.at_end(page)
        found = (np.empty(shape, np.int64) for shape in ((5, 60), (5, 9), (2, 3)))
        scan_requested_rows_of_leaf_pages(
            data, slots, layout, wanted, 512, 2**20, np.zeros(7, np.int64), ScannedRows(*found)
        )
        read_child_pages_into(data, slots, layout.usable_bytes, np.empty(86, np.uint32))


CASES = {
    "overreach": overreach,
    "text": text,
    **{each: _decoding(each) for each in ("cdr_le", "cdr_be", "xcdr2_le", "xcdr2_be", "ros1")},
    "mcap": _scanning(mcap_grammar.RECORD_FINDERS, _mcap_records()),
    "bag": _scanning(bag_grammar.RECORD_FINDERS, _bag_records()),
    "sqlite": sqlite_pages,
}

if __name__ == "__main__":
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    for case in sys.argv[1:]:
        CASES[case]()

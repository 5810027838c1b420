"""Pages of SQLite files give the rows that SQLite gives, and damage costs no more than its page."""

import random
import sqlite3
import struct
from itertools import chain
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from estimators.errors import LogError
from replay.logs.sqlite.database_pages import (
    PageLayout,
    RowFilter,
    read_page_layout_of_messages_table,
)
from replay.logs.sqlite.page_walk import PageWalk
from replay.logs.sqlite.sqlite_file import Db3File
from replay.logs.storage.file_bytes import FileBytes

PAGE_BYTES = [512, 1024, 2048, 4096, 8192, 16384, 32768, 65536]
MESSAGES = (
    "CREATE TABLE messages(id INTEGER PRIMARY KEY, topic_id INTEGER NOT NULL,"
    " timestamp INTEGER NOT NULL, data BLOB NOT NULL)"
)
TOPICS = (
    "CREATE TABLE topics(id INTEGER PRIMARY KEY, name TEXT NOT NULL, type TEXT NOT NULL,"
    " serialization_format TEXT NOT NULL, offered_qos_profiles TEXT NOT NULL)"
)
KEYS = [0, 1, 2, 300, 2**40]
TIMES = [0, 1, 127, 2**15, 2**23, 2**31, 2**47, 2**62, 2**63 - 1]
#: topic, time, bytes
Message = tuple[int, int, bytes]

tmp_path_is_used_again = settings(
    suppress_health_check=[HealthCheck.function_scoped_fixture], deadline=None
)


def create(
    path: Path, page_bytes: int = 4096, *more: str, table: str = MESSAGES
) -> sqlite3.Connection:
    """A new database with the tables of rosbag2."""
    path.unlink(missing_ok=True)
    database = sqlite3.connect(path, isolation_level=None)
    database.execute(f"PRAGMA page_size = {page_bytes}")
    for statement in ("PRAGMA synchronous = OFF", *more, TOPICS, table, "BEGIN"):
        database.execute(statement)
    for key in KEYS:
        database.execute(
            "INSERT INTO topics VALUES (?, ?, 'std_msgs/msg/String', 'cdr', '')", (key, f"/t{key}")
        )
    return database


def insert(database: sqlite3.Connection, messages: list[Message]) -> None:
    columns = "INSERT INTO messages (topic_id, timestamp, data) VALUES (?, ?, ?)"
    database.executemany(columns, messages)


def finish(database: sqlite3.Connection) -> None:
    database.execute("COMMIT")
    database.close()


def by_sqlite(path: Path) -> tuple[list[Message], bool]:
    """What SQLite gives of messages, and whether to the end."""
    database = sqlite3.connect(f"{path.as_uri()}?mode=ro&immutable=1", uri=True)
    rows: list[tuple] = []
    try:
        # what came before a fault stays
        rows.extend(
            database.execute("SELECT topic_id, timestamp, data FROM messages ORDER BY rowid")
        )
    except (sqlite3.Error, UnicodeDecodeError):
        return rows, False
    finally:
        database.close()
    return rows, True


def layout_of(path: Path) -> PageLayout | None:
    file = FileBytes(path)
    database = sqlite3.connect(f"{path.as_uri()}?mode=ro&immutable=1", uri=True)
    layout = read_page_layout_of_messages_table(file, database)
    file.close()
    database.close()
    return layout


def by_pages(path: Path, *, with_data: bool = True) -> tuple[list[Message], list[str], int | None]:
    """What the pages give of all topics, what is said of them, and where they end."""
    file = FileBytes(path)
    database = sqlite3.connect(f"{path.as_uri()}?mode=ro&immutable=1", uri=True)
    notes: list[str] = []
    try:
        layout = read_page_layout_of_messages_table(file, database)
        assert layout is not None
        wanted = RowFilter(np.array([0]), True, -(2**63), 2**63 - 1, with_data)
        walk = PageWalk(file, layout, wanted, notes.append)
        found = [
            (key, time, found.data[offset : offset + size].tobytes() if with_data else b"")
            for found in walk
            for key, time, offset, size, _ in found.rows.T.tolist()
        ]
    finally:
        file.close()
        database.close()
    return found, notes, walk.left_after


def by_container(path: Path) -> tuple[list[Message], list[str]]:
    container = Db3File(path)
    ids = [connection.id for connection in container.connections]
    found: list[Message] = []
    for batch in chain.from_iterable(
        g.batches for g in container.iter_batch_groups(ids, None, None)
    ):
        times = batch.log_times.tolist()
        found += [(batch.connection_id, *m) for m in zip(times, batch.iter_messages(), strict=True)]
    counts = sum(container.log_times(key).size for key in ids)
    whats = [loss.what for loss in container.losses]
    container.close()
    assert whats or counts == len(found)
    return sorted(found), whats


def messages(seed: int, count: int, most_bytes: int) -> list[Message]:
    rng = random.Random(seed)
    return [
        (rng.choice(KEYS), rng.choice(TIMES), rng.randbytes(rng.randint(0, most_bytes)))
        for _ in range(count)
    ]


# each of half a hundred writes a database of hundreds of pages
@pytest.mark.heavy
@settings(tmp_path_is_used_again, max_examples=50)
@given(
    page_bytes=st.sampled_from(PAGE_BYTES),
    most_pages=st.sampled_from([0.02, 0.3, 1.1, 5.0]),
    vacuum=st.sampled_from(["NONE", "FULL", "INCREMENTAL"]),
    journal=st.sampled_from(["DELETE", "MEMORY", "WAL"]),
    is_indexed=st.booleans(),
    first=st.integers(0, 400),
    removed=st.sampled_from([None, "id % 2 = 0", "id % 50 > 9", "id > 20", "1"]),
    then=st.integers(0, 200),
    seed=st.integers(0, 2**32),
)
def test_pages_give_every_row_that_sqlite_gives(
    tmp_path: Path,
    page_bytes: int,
    most_pages: float,
    vacuum: str,
    journal: str,
    is_indexed: bool,
    first: int,
    removed: str | None,
    then: int,
    seed: int,
) -> None:
    path = tmp_path / "shift.db3"
    count = min(first, 4_000_000 // int(most_pages * page_bytes + 1))
    pragmas = f"PRAGMA auto_vacuum = {vacuum}", f"PRAGMA journal_mode = {journal}"
    database = create(path, page_bytes, *pragmas)
    if is_indexed:
        database.execute("CREATE INDEX timestamp_idx ON messages (timestamp ASC)")
    insert(database, messages(seed, count, int(most_pages * page_bytes)))
    if removed:
        # pages that become free are used again, so that leaves are in another order
        database.execute(f"DELETE FROM messages WHERE {removed}")
        database.execute("UPDATE messages SET id = -id WHERE id % 7 = 0")
        insert(database, messages(seed + 1, min(then, count), int(most_pages * page_bytes)))
    finish(database)
    rows, is_whole = by_sqlite(path)
    assert is_whole
    assert by_pages(path) == (rows, [], None)
    times = [(key, time, b"") for key, time, _ in rows]
    assert by_pages(path, with_data=False) == (times, [], None)


def test_bytes_reserved_on_each_page_are_left_out(tmp_path: Path) -> None:
    path = tmp_path / "shift.db3"
    database = sqlite3.connect(path)
    database.execute("VACUUM")
    database.close()
    # SQLite lets extensions reserve bytes, but not Python
    reserved, empty = 40, bytearray(path.read_bytes())
    empty[20] = reserved
    empty[105:107] = struct.pack(">H", len(empty) - reserved)
    path.write_bytes(empty)
    database = sqlite3.connect(path, isolation_level=None)
    for statement in (TOPICS, MESSAGES, "BEGIN"):
        database.execute(statement)
    insert(database, messages(1, 100, 20_000))
    finish(database)
    assert path.read_bytes()[20] == reserved
    assert by_pages(path) == (by_sqlite(path)[0], [], None)


def test_messages_larger_than_what_is_read_at_once_are_whole(tmp_path: Path) -> None:
    path = tmp_path / "shift.db3"
    database = create(path)
    rng = random.Random(1)
    sizes = [9_000_000, 10, 3_000_000, 3_000_000, 0, 9_000_000, 70_000]
    insert(database, [(1, k, rng.randbytes(size)) for k, size in enumerate(sizes)])
    finish(database)
    assert by_pages(path) == (by_sqlite(path)[0], [], None)


def test_only_wanted_topics_and_times_are_given(tmp_path: Path) -> None:
    path = tmp_path / "shift.db3"
    database = create(path)
    recorded = [(KEYS[k % 3], k, bytes([k % 251]) * (k * 100)) for k in range(300)]
    insert(database, recorded)
    finish(database)
    container = Db3File(path)
    found = [
        (batch.connection_id, *message)
        for batch in chain.from_iterable(
            g.batches for g in container.iter_batch_groups([1, 2], 100, 250)
        )
        for message in zip(batch.log_times.tolist(), batch.iter_messages(), strict=True)
    ]
    container.close()
    assert sorted(found) == sorted(m for m in recorded if m[0] in (1, 2) and 100 <= m[1] <= 250)


@pytest.mark.parametrize(
    "table",
    [
        "CREATE TABLE messages(data BLOB, note TEXT, timestamp INT, topic_id INT)",
        "CREATE TABLE messages(topic_id INT, timestamp BIGINT UNIQUE, data)",
    ],
)
def test_columns_may_stand_in_any_order(tmp_path: Path, table: str) -> None:
    path = tmp_path / "shift.db3"
    database = create(path, table=table)
    insert(database, [(1, k, bytes([k]) * 10 * k) for k in range(100)])
    finish(database)
    assert by_pages(path) == (by_sqlite(path)[0], [], None)


#: tables of which pages alone do not tell what SQLite gives
UNUSUAL_TABLES = {
    "time_is_the_key": "(topic_id INTEGER, timestamp INTEGER PRIMARY KEY, data BLOB)",
    "computed": "(topic_id INT, timestamp INT, late INT AS (timestamp + 1) VIRTUAL, data BLOB)",
    "numeric": "(topic_id NUMERIC, timestamp NUMERIC, data BLOB)",
}


@pytest.mark.parametrize("columns", UNUSUAL_TABLES.values(), ids=UNUSUAL_TABLES)
def test_unusual_tables_are_read_by_sqlite(tmp_path: Path, columns: str) -> None:
    path = tmp_path / "shift.db3"
    database = create(path, table=f"CREATE TABLE messages {columns}")
    insert(database, [(1, k, bytes(k)) for k in range(1, 100)])
    finish(database)
    assert layout_of(path) is None
    assert by_container(path) == (sorted(by_sqlite(path)[0]), [])


def test_rows_from_before_a_column_was_added_are_read_by_sqlite(tmp_path: Path) -> None:
    path = tmp_path / "shift.db3"
    database = create(path)
    insert(database, [(1, k, bytes(k)) for k in range(100)])
    database.execute("ALTER TABLE messages ADD COLUMN size INTEGER DEFAULT 7")
    insert(database, [(1, k, bytes(k)) for k in range(100, 200)])
    finish(database)
    assert by_pages(path) == ([], [], -(2**63))
    assert by_container(path) == (sorted(by_sqlite(path)[0]), [])


@pytest.mark.parametrize(
    "order", ["note, topic_id INT, timestamp INT, data", "topic_id INT, timestamp INT, data, note"]
)
def test_a_long_column_before_or_behind_the_message_is_read_by_sqlite(
    tmp_path: Path, order: str
) -> None:
    path = tmp_path / "shift.db3"
    database = create(path, table=f"CREATE TABLE messages ({order})")
    insert(database, [(1, k, bytes(10)) for k in range(50)])
    database.execute(
        "UPDATE messages SET note = zeroblob(9000), data = zeroblob(9000) WHERE rowid = 20"
    )
    finish(database)
    rows, _ = by_sqlite(path)
    assert by_pages(path) == (rows[:19], [], 19)
    assert by_container(path) == (sorted(rows), [])


@pytest.mark.parametrize("beside", ["-wal", "-journal"])
def test_a_database_with_an_open_journal_is_read_by_sqlite(tmp_path: Path, beside: str) -> None:
    path = tmp_path / "shift.db3"
    finish(create(path))
    assert layout_of(path) is not None
    Path(f"{path}{beside}").write_bytes(b"unfinished")
    assert layout_of(path) is None


def test_values_that_are_no_messages_are_left_out_and_counted(tmp_path: Path) -> None:
    path = tmp_path / "shift.db3"
    database = create(path, table=MESSAGES.replace(" NOT NULL", ""))
    insert(database, [(1, k, bytes(k)) for k in range(100)])
    for row, value in ((11, "data = 'text'"), (12, "timestamp = 1.5"), (13, "topic_id = NULL")):
        database.execute(f"UPDATE messages SET {value} WHERE id = {row}")
    finish(database)
    rows, _ = by_sqlite(path)
    assert by_pages(path) == (
        rows[:10] + rows[13:],
        ["3 rows from row 11 on hold no message"],
        None,
    )
    # a message is not looked at where its time is all that is asked for
    times = [(key, time, b"") for key, time, _ in rows[:11] + rows[13:]]
    assert by_pages(path, with_data=False) == (
        times,
        ["2 rows from row 12 on hold no message"],
        None,
    )


def numbered(count: int, size: int) -> list[Message]:
    """Messages that can be found in a file."""
    return [(1, k, b"message %06d" % k * (size // 14)) for k in range(count)]


def page_of(data: bytes, message: Message, page_bytes: int) -> int:
    return data.index(message[2]) // page_bytes


@pytest.mark.parametrize("fill", [b"\0", b"\xff", b"\x0d"])
@pytest.mark.parametrize("page_bytes", [512, 4096, 65536])
def test_a_damaged_leaf_costs_its_rows_and_says_which(
    tmp_path: Path, page_bytes: int, fill: bytes
) -> None:
    path = tmp_path / "shift.db3"
    database = create(path, page_bytes)
    recorded = numbered(200, max(14, page_bytes // 20))
    insert(database, recorded)
    finish(database)
    data = bytearray(path.read_bytes())
    pages = [page_of(data, message, page_bytes) for message in recorded]
    damaged = pages[len(pages) // 3]
    data[damaged * page_bytes : (damaged + 1) * page_bytes] = fill * page_bytes
    path.write_bytes(data)
    first, last = pages.index(damaged) + 1, len(pages) - pages[::-1].index(damaged)
    left = [m for m, page in zip(recorded, pages, strict=True) if page != damaged]
    said = f"the database is damaged: rows from {first} to {last} are lost"
    assert by_container(path) == (left, [said])


@pytest.mark.parametrize("page", [0, 1, 2**31, "itself", "first"])
def test_a_chain_of_pages_that_breaks_or_goes_in_circles_costs_its_message(
    tmp_path: Path, page: int | str
) -> None:
    path = tmp_path / "shift.db3"
    database = create(path)
    recorded = numbered(20, 40_000)
    insert(database, recorded)
    finish(database)
    data = bytearray(path.read_bytes())
    pages = [
        k
        for k in range(len(data) // 4096)
        if b"message %06d" % 7 in data[k * 4096 : k * 4096 + 4096] and data[k * 4096] != 13
    ]
    target = {"itself": pages[4] + 1, "first": pages[0] + 1}.get(page, page)
    data[pages[4] * 4096 : pages[4] * 4096 + 4] = struct.pack(">I", target)
    path.write_bytes(data)
    found, whats = by_container(path)
    assert found == recorded[:7] + recorded[8:]
    assert whats == ["the database is damaged: 1 messages are torn and lost, the first is of row 8"]


def test_a_tree_that_leads_back_to_its_root_ends(tmp_path: Path) -> None:
    path = tmp_path / "shift.db3"
    database = create(path)
    recorded = numbered(2000, 200)
    insert(database, recorded)
    (root,) = database.execute(
        "SELECT rootpage FROM sqlite_master WHERE name = 'messages'"
    ).fetchone()
    finish(database)
    data = bytearray(path.read_bytes())
    begin = (root - 1) * 4096
    (cell,) = struct.unpack_from(">H", data, begin + 12 + 2 * 20)
    data[begin + cell : begin + cell + 4] = struct.pack(">I", root)
    path.write_bytes(data)
    assert by_pages(path) == ([], [], -(2**63))
    found, whats = by_container(path)
    assert found == sorted(set(found))
    assert set(found) < set(recorded)
    assert "damaged" in whats[0]


@pytest.mark.heavy
@tmp_path_is_used_again
@given(
    page_bytes=st.sampled_from([512, 1024, 4096]),
    most_bytes=st.sampled_from([20, 600, 6000]),
    places=st.lists(
        st.tuples(st.integers(0, 2**31), st.integers(0, 15), st.integers(0, 255)),
        min_size=1,
        max_size=8,
    ),
    near_heads=st.booleans(),
    seed=st.integers(0, 9),
)
def test_flipped_bytes_change_nothing_unsaid(
    tmp_path: Path,
    page_bytes: int,
    most_bytes: int,
    places: list[tuple[int, int, int]],
    near_heads: bool,
    seed: int,
) -> None:
    """Whatever differs from what SQLite gives is said; SQLite itself is silent about much."""
    whole, path = tmp_path / f"{page_bytes}-{most_bytes}-{seed}.db3", tmp_path / "damaged.db3"
    if not whole.exists():
        database = create(whole, page_bytes)
        insert(database, messages(seed, 150, most_bytes))
        finish(database)
    data = bytearray(whole.read_bytes())
    for at, head, value in places:
        # most of what can go wrong is at the beginning of pages
        place = at % (len(data) // page_bytes) * page_bytes + head if near_heads else at % len(data)
        data[max(place, len(b"SQLite format 3\0"))] = value
    path.write_bytes(data)
    try:
        found, whats = by_container(path)
    except LogError:
        return
    rows, is_whole = by_sqlite(path)
    usable = [m for m in rows if list(map(type, m)) == [int, int, bytes] and m[1] >= 0]
    if not whats and is_whole:
        assert found == sorted(m for m in usable if m[0] in KEYS)

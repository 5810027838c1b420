"""Recorders of others, which write the messages of a log again while somebody follows.

Each is a generator: it has written a little more whenever it yields.
"""

import sqlite3
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import closing
from pathlib import Path

import yaml
from mcap.reader import make_reader
from mcap.writer import CompressionType
from mcap.writer import Writer as McapWriter
from rosbags.rosbag1 import Reader as BagReader
from rosbags.rosbag1 import Writer as BagWriter

#: Messages between two looks that somebody may take.
A_FEW = 20
CHUNK_BYTES = 30_000


def bag_recorder(source: Path, target: Path, compression: str = "") -> Iterator[None]:
    """rosbags' writer, as `.bag`."""
    writer = BagWriter(target)
    writer.chunk_threshold = CHUNK_BYTES
    if compression:
        writer.set_compression(BagWriter.CompressionFormat[compression.upper()])
    with BagReader(source) as reader, writer:
        connections = {
            each.id: writer.add_connection(
                each.topic, each.msgtype, msgdef=each.msgdef.data, md5sum=each.digest
            )
            for each in reader.connections
        }
        for number, (connection, stamp, data) in enumerate(reader.messages()):
            writer.write(connections[connection.id], stamp, data)
            if number % A_FEW == 0:
                yield
    yield


def mcap_recorder(
    source: Path,
    target: Path,
    compression: CompressionType,
    *,
    chunks: bool = True,
    is_kept: Callable[[str, int], bool] = lambda _topic, _log_time_ns: True,
) -> Iterator[None]:
    """The writer of the mcap library; without chunks, messages stand by themselves."""
    with source.open("rb") as read, target.open("wb") as written:
        writer = McapWriter(
            written, chunk_size=CHUNK_BYTES, compression=compression, use_chunking=chunks
        )
        writer.start("ros2", "test")
        channels: dict[int, int] = {}
        for number, (schema, channel, message) in enumerate(make_reader(read).iter_messages()):
            assert schema is not None
            if not is_kept(channel.topic, message.log_time):
                continue
            if channel.id not in channels:
                known = writer.register_schema(schema.name, schema.encoding, schema.data)
                channels[channel.id] = writer.register_channel(
                    channel.topic, channel.message_encoding, known
                )
            writer.add_message(
                channels[channel.id], message.log_time, message.data, message.publish_time
            )
            if number % A_FEW == 0:
                yield
        writer.finish()
    yield


def rosbag2_recorder(source: Path, target: Path, rows_a_file: int = 10**9) -> Iterator[None]:
    """rosbag2's storage: SQLite in WAL mode, a transaction a few messages, metadata at the end."""
    target.mkdir()
    with closing(sqlite3.connect(f"file:{source}?mode=ro", uri=True)) as known:
        schema = [sql for (sql,) in known.execute("SELECT sql FROM sqlite_master WHERE sql > ''")]
        tables = {name: list(known.execute(f"SELECT * FROM {name}")) for name in _tables(known)}
    messages = tables.pop("messages")
    parts = [messages[k : k + rows_a_file] for k in range(0, len(messages), rows_a_file)]
    names = [f"{target.name}_{number}.db3" for number in range(len(parts))]
    for name, part in zip(names, parts, strict=True):
        database = sqlite3.connect(target / name)
        database.execute("PRAGMA journal_mode = WAL")
        for statement in schema:
            database.execute(statement)
        for table, rows in tables.items():
            _insert(database, table, rows)
        database.commit()
        for begin in range(0, len(part), A_FEW):
            _insert(database, "messages", part[begin : begin + A_FEW])
            database.commit()
            yield
        database.close()
    times = [time for _, _, time, *_ in messages]
    metadata = {
        "version": 5,
        "storage_identifier": "sqlite3",
        "relative_file_paths": names,
        "duration": {"nanoseconds": max(times) - min(times)},
        "starting_time": {"nanoseconds_since_epoch": min(times)},
        "message_count": len(messages),
        "topics_with_message_count": [],
        "compression_format": "",
        "compression_mode": "",
    }
    written = yaml.safe_dump({"rosbag2_bagfile_information": metadata})
    (target / "metadata.yaml").write_text(written)
    yield


def _tables(database: sqlite3.Connection) -> list[str]:
    rows = database.execute(
        "SELECT name FROM sqlite_master WHERE type = 'table' AND name NOT LIKE 'sqlite%'"
    )
    return [name for (name,) in rows]


def _insert(database: sqlite3.Connection, table: str, rows: list[tuple[object, ...]]) -> None:
    if rows:
        places = ", ".join("?" * len(rows[0]))
        database.executemany(f"INSERT INTO {table} VALUES ({places})", rows)


def csv_recorder(source: Path, target: Path) -> Iterator[None]:
    """A logger that appends lines, and flushes in the middle of one."""
    data = source.read_bytes()
    with target.open("wb") as written:
        for begin in range(0, len(data), 1777):
            written.write(data[begin : begin + 1777])
            written.flush()
            yield


class Recording:
    """A recorder in a thread of its own."""

    def __init__(self, recorder: Iterator[None], target: Path, pause_s: float = 0.002) -> None:
        self._recorder, self._target, self._pause_s = recorder, target, pause_s
        self._thread = threading.Thread(target=self._record)

    def __enter__(self) -> "Recording":
        self._thread.start()
        while not self._target.exists():
            time.sleep(0.001)
        return self

    @property
    def is_over(self) -> bool:
        """Whether everything is written."""
        return not self._thread.is_alive()

    def __exit__(self, *_: object) -> None:
        self._thread.join()

    def _record(self) -> None:
        for _ in self._recorder:
            time.sleep(self._pause_s)

"""Write simulated logs as ROS 1 bags (format 2.0, http://wiki.ros.org/Bags/Format/2.0)."""

import struct
from pathlib import Path
from typing import BinaryIO, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from analysis.simulation import SimulatedLog
from estimators.arrays import Ints
from replay.logs.writers.recorded_order import (
    FullChunk,
    iter_records_in_time_order,
    split_into_chunks,
)
from replay.logs.writers.ros_messages import TOPICS, make_recorded_topics
from replay.logs.writers.serialise_messages import Envelope

_MAGIC: Final = b"#ROSBAG V2.0\n"
#: Bytes of a chunk, and of the file's first record (ROS bag format 2.0).
_CHUNK_BYTES: Final = 1 << 20
_HEADER_BYTES: Final = 4096
#: Opcodes of records.
_MESSAGE, _BAG, _INDEX, _CHUNK, _CHUNK_INFO, _CONNECTION = 2, 3, 4, 5, 6, 7
_INDEX_ROW: Final = np.dtype([("sec", "<u4"), ("nsec", "<u4"), ("offset", "<u4")])


class _WrittenChunk(NamedTuple):
    """A chunk in the file: its position, time span, and messages by connection."""

    at: int
    start_ns: int
    end_ns: int
    counts: dict[int, int]


def write_bag(log: SimulatedLog, path: Path) -> None:
    """Write `log` as a ROS 1 bag at `path`, which must not exist."""
    from rosbags.typesys import Stores, get_typestore

    store = get_typestore(Stores.ROS1_NOETIC)
    numbers = {name: number for number, name in enumerate(log.topics)}
    connections: list[bytes] = []
    for name, number in numbers.items():
        definition, digest = store.generate_msgdef(TOPICS[name].msgtype)
        connections.append(_encode_connection_record(number, name, definition, digest))
    topics = make_recorded_topics(log, store, numbers, _make_bag_message_envelope, ros1=True)
    with path.open("xb") as file:
        file.write(_MAGIC + _encode_bag_header(0, 0, 0))
        whole = split_into_chunks(
            iter_records_in_time_order(topics), b"".join(connections), _CHUNK_BYTES
        )
        written = [_write_chunk_record(file, chunk) for chunk in whole]
        index_at = file.tell()
        file.write(b"".join(connections))
        file.write(b"".join(map(_encode_chunk_info, written)))
        file.seek(len(_MAGIC))
        file.write(_encode_bag_header(index_at, len(connections), len(written)))


def _make_bag_message_envelope(connection: int, times: Ints) -> Envelope:
    head = encode_bag_record_header(_MESSAGE, conn=struct.pack("<L", connection), time=bytes(8))[
        :-8
    ]
    sec, nsec = times // 10**9, times % 10**9

    def record_head(size: int) -> list[bytes | tuple[str, Ints]]:
        return [head, ("<u4", sec), ("<u4", nsec), struct.pack("<L", size)]

    return record_head


def encode_bag_record_header(opcode: int | None, **fields: bytes) -> bytes:
    """Encode the header of a record, preceded by its length."""
    kind = {} if opcode is None else {"op": bytes([opcode])}
    parts = [f"{name}=".encode() + value for name, value in {**kind, **fields}.items()]
    data = b"".join(struct.pack("<L", len(part)) + part for part in parts)
    return struct.pack("<L", len(data)) + data


def _prepend_size(data: bytes) -> bytes:
    return struct.pack("<L", len(data)) + data


def _encode_bag_header(index_offset: int, connections: int, written_chunks: int) -> bytes:
    header = encode_bag_record_header(
        _BAG,
        index_pos=struct.pack("<Q", index_offset),
        conn_count=struct.pack("<L", connections),
        chunk_count=struct.pack("<L", written_chunks),
    )
    return header + _prepend_size(b" " * (_HEADER_BYTES - 4 - len(header)))


def _encode_connection_record(connection_id: int, name: str, definition: str, digest: str) -> bytes:
    topic = TOPICS[name]
    package, _, kind = topic.msgtype.partition("/msg/")
    about = encode_bag_record_header(
        None,
        topic=topic.name.encode(),
        type=f"{package}/{kind}".encode(),
        md5sum=digest.encode(),
        message_definition=definition.encode(),
    )
    head = encode_bag_record_header(
        _CONNECTION, conn=struct.pack("<L", connection_id), topic=topic.name.encode()
    )
    return head + about


def _write_chunk_record(file: BinaryIO, chunk: FullChunk) -> _WrittenChunk:
    at = file.tell()
    size = struct.pack("<L", chunk.data.size)
    file.write(encode_bag_record_header(_CHUNK, compression=b"none", size=size) + size)
    file.write(chunk.data.data)
    counts: dict[int, int] = {}
    for number, mine in chunk.split_by_connection().items():
        counts[number] = mine.log_times.size
        head = encode_bag_record_header(
            _INDEX,
            ver=struct.pack("<L", 1),
            conn=struct.pack("<L", number),
            count=struct.pack("<L", counts[number]),
        )
        rows = np.empty(counts[number], _INDEX_ROW)
        rows["sec"], rows["nsec"] = mine.log_times // 10**9, mine.log_times % 10**9
        rows["offset"] = mine.offsets
        file.write(head + _prepend_size(rows.tobytes()))
    return _WrittenChunk(at, int(chunk.log_times.min()), int(chunk.log_times.max()), counts)


def _encode_chunk_info(chunk: _WrittenChunk) -> bytes:
    head = encode_bag_record_header(
        _CHUNK_INFO,
        ver=struct.pack("<L", 1),
        chunk_pos=struct.pack("<Q", chunk.at),
        start_time=_encode_ros_time(chunk.start_ns),
        end_time=_encode_ros_time(chunk.end_ns),
        count=struct.pack("<L", len(chunk.counts)),
    )
    rows: NDArray[np.uint32] = np.array(list(chunk.counts.items()), "<u4")
    return head + _prepend_size(rows.tobytes())


def _encode_ros_time(time_ns: int) -> bytes:
    return struct.pack("<LL", *divmod(time_ns, 10**9))

"""Damage as it happens to files in the field."""

import struct
from pathlib import Path

from mcap.reader import make_reader
from mcap.records import ChunkIndex

from tests.replay.logs.written_logs import Joints

DRIVE = [
    Joints(1000 + k, {"left": float(k), "right": -float(k)}, topic=f"/joints{k % 2}")
    for k in range(200)
]


def without_bag_index(path: Path) -> None:
    """What a recorder leaves that crashed: index_pos is 0, and nothing stands behind the chunks."""
    data = path.read_bytes()
    at = data.index(b"index_pos=") + len(b"index_pos=")
    index = int.from_bytes(data[at : at + 8], "little")
    path.write_bytes(data[:at] + bytes(8) + data[at + 8 : index])


def without_footer(path: Path) -> None:
    """An MCAP file whose recorder crashed after the last chunk: no end of data, no summary."""
    data = path.read_bytes()
    footer = data[-8 - 4 - 8 - 8 :]
    summary = int.from_bytes(footer[:8], "little")
    end_of_data = 1 + 8 + 4
    path.write_bytes(data[: summary - end_of_data])


def chunks(path: Path) -> list[ChunkIndex]:
    """The chunks of an MCAP file in its order."""
    with path.open("rb") as file:
        summary = make_reader(file).get_summary()
    assert summary is not None
    return summary.chunk_indexes


def hide_from_index(path: Path, chunk: ChunkIndex) -> None:
    """Make the index record of a chunk one that no reader knows."""
    begins = (chunk.message_start_time, chunk.message_end_time, chunk.chunk_start_offset)
    place = struct.pack("<QQQ", *begins)
    overwrite(path, path.read_bytes().rindex(place) - 9, b"\x70")


def overwrite(path: Path, at: int, content: bytes) -> None:
    """Put other bytes in their place."""
    data = bytearray(path.read_bytes())
    data[at : at + len(content)] = content
    path.write_bytes(data)

"""The metadata records of an MCAP file: names and texts that its recorder wrote beside the data."""

from collections.abc import Mapping
from io import BytesIO
from pathlib import Path
from typing import Final

from mcap.data_stream import ReadDataStream
from mcap.exceptions import McapError
from mcap.records import Metadata

from replay.logs.mcap.mcap_index import Summary
from replay.logs.mcap.mcap_records import METADATA, RECORD_HEAD
from replay.logs.messages.broken_bytes import BROKEN_BYTES
from replay.logs.storage import FileBytes

#: Bytes of a record that is read; what identifies a machine is short.
_LARGEST_BYTES: Final = 2**20


def metadata_records(path: Path) -> list[tuple[str, Mapping[str, str]]]:
    """Name and texts of each metadata record that the summary points at; none where it is damaged.

    A file that was torn off has no summary: what it may have said is then not looked for.
    """
    file = FileBytes(path)
    try:
        found: list[tuple[str, Mapping[str, str]]] = []
        for index in Summary(file).metadata:
            data = file.read(index.offset, min(index.length, _LARGEST_BYTES))
            if len(data) < RECORD_HEAD.size or data[0] != METADATA:
                continue
            try:
                record = Metadata.read(ReadDataStream(BytesIO(data[RECORD_HEAD.size :])))
            except (McapError, *BROKEN_BYTES):
                continue
            found.append((record.name, record.metadata))
        return found
    finally:
        file.close()

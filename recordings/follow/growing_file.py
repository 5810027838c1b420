"""Rerun recording file that grows by complete messages, and can be continued after a cut.

The file has the header of a recording, then messages: kind and length, 8 bytes each, and content.
Its end (a message of kind 0 and the index of all messages) is omitted, since more may follow:
viewers do not need it, and a file cut after any message is a valid recording.
"""

import struct
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Final, NamedTuple

from recordings.report.atomic_output import AppendOnlyFile

if TYPE_CHECKING:
    from mmap import mmap

#: First bytes of a recording.
_MAGIC: Final = b"RRF2"
#: Bytes of its header: magic, version and options.
HEAD_BYTES: Final = 12
_MESSAGE_HEAD: Final = struct.Struct("<QQ")
#: First bytes of the footer of a complete recording.
_FOOT: Final = b"RRF2FOOT"
#: Kinds of messages: about the store, chunks, and the active layout. The end has kind 0.
_OF_STORE: Final = 1
_KINDS: Final = (_OF_STORE, 2, 3)


class RecordingMessage(NamedTuple):
    """Start and end of a message of a recording, and whether it is about the store."""

    begin: int
    end: int
    is_of_store: bool


def iter_complete_messages(recording_bytes: "bytes | mmap") -> Iterator[RecordingMessage]:
    """Yield the complete messages in the bytes of a recording with its header."""
    at = HEAD_BYTES
    while at + _MESSAGE_HEAD.size <= len(recording_bytes):
        kind, length = _MESSAGE_HEAD.unpack_from(recording_bytes, at)
        end = at + _MESSAGE_HEAD.size + length
        if kind not in _KINDS or end > len(recording_bytes):
            return
        yield RecordingMessage(at, end, kind == _OF_STORE)
        at = end


def append_recording_messages(file: AppendOnlyFile, recording: bytes) -> None:
    """Append the messages of a separate recording.

    Raises:
        OSError: they do not fit on the disk.
    """
    head = b"" if file.size else recording[:HEAD_BYTES]
    messages = (recording[start:end] for start, end, _ in iter_complete_messages(recording))
    file.append_record(b"".join([head, *messages]))


def is_unfinished_recording(path: Path) -> bool:
    """Whether a file is a recording without its footer."""
    with path.open("rb") as file:
        is_recording = file.read(len(_MAGIC)) == _MAGIC
        file.seek(max(0, path.stat().st_size - HEAD_BYTES))
        return is_recording and not file.read().startswith(_FOOT)

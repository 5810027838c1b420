"""Where a recording that grew was cut: what it is of, and how far it came."""

import mmap
import tempfile
import warnings
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

from estimators.errors import RecordingError
from recordings.follow.growing_file import HEAD_BYTES, find_messages
from recordings.follow.growing_recording import PROPERTY, FollowedLog
from recordings.rrd.recording_table import SINCE_START

if TYPE_CHECKING:
    from rerun.chunk import Chunk

#: Messages from the first on among which the description is, and what is said of the stores.
_FIRST: Final = 16
#: Messages of a second at most, from the last back: a chunk a frame and method, twice.
_SECOND: Final = 64
_LAST_OF_PART: Final = "/display/excitation"


@dataclass(frozen=True, slots=True)
class RecordingEnd:
    """The end of a recording that grew.

    Attributes:
        about: what it is of.
        until_ns: `t_ns` of its last row.
        size: bytes up to there.
    """

    about: FollowedLog
    until_ns: int
    size: int


def read_end(path: Path) -> RecordingEnd | None:
    """Read how far a recording came; None where it has not come to its first row.

    Raises:
        RecordingError: it is none that `follow` wrote.
    """
    with path.open("rb") as file, mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ) as data:
        messages = list(find_messages(data))
        if not messages:
            return None
        head = data[: messages[:_FIRST][-1].end]
        found: dict[str, Any] = {}
        for chunk in _chunks(head):
            if chunk.entity_path == f"/__properties/{PROPERTY}":
                batch = chunk.to_record_batch()
                found |= {name: batch.column(name)[0].as_py()[0] for name in batch.schema.names[1:]}
        if not found:
            raise RecordingError(f"{path}: not a recording that `payscope follow` was writing")
        about = FollowedLog(found["identity"], int(found["t0_unix_ns"]), found["recording_id"])
        parts = [data[begin:end] for begin, end, of_store in messages[:_FIRST] if of_store]
        store = b"".join([data[:HEAD_BYTES], *parts])
        for begin, end, _ in reversed(messages[-_SECOND:]):
            for chunk in _chunks(store + data[begin:end]):
                if chunk.entity_path == _LAST_OF_PART:
                    times = chunk.to_record_batch().column(SINCE_START)
                    return RecordingEnd(about, max(t.value for t in times), end)
    return None


def _chunks(data: bytes) -> "Iterator[Chunk]":
    """The chunks of whole messages."""
    import rerun as rr
    from rerun.error_utils import RerunWarning

    with tempfile.NamedTemporaryFile(suffix=".rrd") as part, warnings.catch_warnings():
        warnings.simplefilter("ignore", RerunWarning)  # of the end that is not there
        part.write(data)
        part.flush()
        yield from rr.chunk.RrdReader(part.name).stream()

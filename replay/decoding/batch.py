"""Raw messages of one topic, many at once: the bytes that hold them and where each one lies."""

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

#: A batch holds no more messages than this, and is full at as many bytes, whichever comes first.
BATCH_ROWS: Final = 8192
BATCH_BYTES: Final = 8 << 20


@dataclass(frozen=True, slots=True, eq=False)
class RawBatch:
    """Messages as stored. They may lie anywhere in `data`, also in one another's bytes.

    Raises:
        ValueError: a message reaches out of `data`.
    """

    #: (bytes,) uint8: a decompressed chunk, a mapped file; it must not change while it is decoded
    data: NDArray[np.uint8]
    #: (n,) int64, where each message begins in `data`, and its length in bytes
    offsets: NDArray[np.int64]
    lengths: NDArray[np.int64]
    #: (n,) int64 ns; the sign bit of a 64-bit time beyond 2262 stays, so that it is negative
    log_times: NDArray[np.int64]

    def __post_init__(self) -> None:
        starts, sizes = self.offsets, self.lengths
        inside = (starts >= 0) & (sizes >= 0) & (sizes <= self.data.size - starts)
        if not inside.all() or not starts.size == sizes.size == self.log_times.size:
            raise ValueError("a batch whose messages reach out of its data")
        data = self.data.view()
        # also because numba would compile anew for data that may be written
        data.flags.writeable = False
        object.__setattr__(self, "data", data)

    @property
    def rows(self) -> int:
        """How many messages."""
        return self.offsets.size

    def select(self, chosen: NDArray[np.bool_] | slice) -> "RawBatch":
        """Some of the messages."""
        return RawBatch(
            self.data, self.offsets[chosen], self.lengths[chosen], self.log_times[chosen]
        )

    def parts(self) -> Iterator["RawBatch"]:
        """The same in batches of at most `BATCH_ROWS` messages and, with several, `BATCH_BYTES`."""
        ends = np.cumsum(self.lengths)
        begin = 0
        while begin < self.rows:
            full = ends[begin] - self.lengths[begin] + BATCH_BYTES
            end = int(np.searchsorted(ends, full, side="right"))
            end = min(max(end, begin + 1), begin + BATCH_ROWS)
            yield self.select(slice(begin, end))
            begin = end

    def messages(self) -> Iterator[bytes]:
        """The messages one by one."""
        for start, size in zip(self.offsets.tolist(), self.lengths.tolist(), strict=True):
            yield self.data[start : start + size].tobytes()


class StoredMessage(NamedTuple):
    """A message on its own, where a container has to take them one by one."""

    #: as large as an unsigned 64-bit number
    log_time_ns: int
    data: bytes


def join_messages(messages: Iterable[StoredMessage]) -> Iterator[RawBatch]:
    """Batches of messages that come one by one, in their order."""
    parts: list[bytes] = []
    times: list[int] = []
    size = 0
    for message in messages:
        parts.append(message.data)
        times.append(message.log_time_ns)
        size += len(message.data)
        if len(parts) == BATCH_ROWS or size >= BATCH_BYTES:
            yield _join(parts, times)
            parts, times, size = [], [], 0
    if parts:
        yield _join(parts, times)


def _join(parts: list[bytes], times: list[int]) -> RawBatch:
    lengths = np.fromiter(map(len, parts), np.int64, len(parts))
    stamps = np.fromiter((time & (2**64 - 1) for time in times), np.uint64, len(times))
    data = np.frombuffer(b"".join(parts), np.uint8)
    return RawBatch(data, np.cumsum(lengths) - lengths, lengths, stamps.view(np.int64))

"""Raw messages of one connection: their bytes, and the position of each."""

from collections.abc import Iterator, Sequence
from dataclasses import InitVar, dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

#: Most messages and most bytes of a batch, whichever is reached first.
BATCH_ROWS: Final = 8192
BATCH_BYTES: Final = 8 << 20


@dataclass(frozen=True, slots=True, eq=False)
class RawBatch:
    """Messages of one connection as stored, at any positions in `data`, even overlapping.

    Raises:
        ValueError: a message extends beyond `data`.
    """

    connection_id: int
    #: (bytes,) uint8: decompressed chunks; the memory is reused for the next batch
    data: NDArray[np.uint8]
    #: (n,) int64, offset of each message in `data`, and its length in bytes
    offsets: NDArray[np.int64]
    lengths: NDArray[np.int64]
    #: (n,) int64 ns
    log_times: NDArray[np.int64]
    #: whether it is a part of a checked batch, so that its bounds need no check
    is_part: InitVar[bool] = False

    def __post_init__(self, is_part: bool) -> None:
        if is_part:
            return
        starts, sizes = self.offsets, self.lengths
        if not starts.size == sizes.size == self.log_times.size or (
            starts.size
            and (
                starts.min() < 0
                or sizes.min() < 0
                or starts.max() > self.data.size
                or (self.data.size - starts < sizes).any()
            )
        ):
            raise ValueError("the offset or size of a message lies outside the batch")
        data = self.data.view()
        # also since numba would compile another version for writable data
        data.flags.writeable = False
        object.__setattr__(self, "data", data)

    @property
    def message_count(self) -> int:
        """Number of messages."""
        return self.offsets.size

    def select_messages(
        self, selection: NDArray[np.bool_] | NDArray[np.intp] | slice
    ) -> "RawBatch":
        """Select some of the messages."""
        return RawBatch(
            self.connection_id,
            self.data,
            self.offsets[selection],
            self.lengths[selection],
            self.log_times[selection],
            is_part=True,
        )

    def split_to_bounded_batches(self) -> Iterator["RawBatch"]:
        """Split into batches of at most `BATCH_ROWS` messages and, if several, `BATCH_BYTES`."""
        if 0 < self.message_count <= BATCH_ROWS and self.lengths.sum() <= BATCH_BYTES:
            yield self
            return
        ends = np.cumsum(self.lengths)
        start = 0
        while start < self.message_count:
            full = ends[start] - self.lengths[start] + BATCH_BYTES
            end = int(np.searchsorted(ends, full, side="right"))
            end = min(max(end, start + 1), start + BATCH_ROWS)
            yield self.select_messages(slice(start, end))
            start = end

    def iter_messages(self) -> Iterator[bytes]:
        """Yield the bytes of each message."""
        for start, size in zip(self.offsets.tolist(), self.lengths.tolist(), strict=True):
            yield self.data[start : start + size].tobytes()


def make_batch_of_messages(
    connection_id: int, log_times: Sequence[int], messages: Sequence[bytes]
) -> RawBatch:
    """Make a batch of messages given one by one."""
    lengths = np.fromiter(map(len, messages), np.int64, len(messages))
    return RawBatch(
        connection_id,
        np.frombuffer(b"".join(messages), np.uint8),
        np.cumsum(lengths) - lengths,
        lengths,
        np.array(log_times, np.int64),
    )

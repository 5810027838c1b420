"""Batches on their way through a decoder: small ones are put together, large ones split."""

from typing import Final

import numpy as np
import polars as pl

from replay.decoding.batch import BATCH_BYTES, BATCH_ROWS, RawBatch
from replay.decoding.decoder import Decoder, Tally
from replay.decoding.gather import runs, source_of
from replay.decoding.in_order import joined_frames, sorted_batch

#: With fewer messages, what a batch costs by itself is more than copying them into a larger one.
_FEW_ROWS: Final = 2048


class Stream:
    """The batches of one topic on their way through its decoder, into the order of log times."""

    def __init__(self, decoder: Decoder, schema: pl.Schema) -> None:
        self.tally = Tally()
        self._decoder = decoder
        self._frames = [pl.DataFrame(schema=schema)]
        #: put aside until they are worth the overhead of a batch
        self._few: list[RawBatch] = []
        self._rows = self._bytes = 0

    def take(self, batch: RawBatch) -> None:
        """Take the next messages; their memory may be used again."""
        for part in batch.parts():
            if part.rows < _FEW_ROWS:
                self._few.append(_copied(part))
                self._rows += part.rows
                self._bytes += self._few[-1].data.size
                if self._rows < BATCH_ROWS and self._bytes < BATCH_BYTES:
                    continue
            self._decode_few()
            if part.rows >= _FEW_ROWS:
                self._decode(part)

    def finish(self) -> pl.DataFrame:
        """Everything that was taken."""
        self._decode_few()
        frame = joined_frames(self._frames)
        self._frames.clear()
        return frame

    def _decode_few(self) -> None:
        if self._few:
            self._decode(_joined(self._few))
            self._few, self._rows, self._bytes = [], 0, 0

    def _decode(self, batch: RawBatch) -> None:
        decoded = self._decoder.decode(sorted_batch(batch))
        self.tally.rows += decoded.frame.height
        self.tally.undecodable += decoded.undecodable
        self.tally.first_fault = self.tally.first_fault or decoded.first_fault
        if decoded.frame.height:
            self._frames.append(decoded.frame)


def _copied(batch: RawBatch) -> RawBatch:
    """Its messages alone, since a container may use the memory again."""
    data = runs(source_of(batch.data), batch.offsets, batch.lengths)
    offsets = np.cumsum(batch.lengths) - batch.lengths
    return RawBatch(
        batch.connection_id, data, offsets, batch.lengths.copy(), batch.log_times.copy()
    )


def _joined(batches: list[RawBatch]) -> RawBatch:
    lengths = np.concatenate([batch.lengths for batch in batches])
    return RawBatch(
        batches[0].connection_id,
        np.concatenate([batch.data for batch in batches]),
        np.cumsum(lengths) - lengths,
        lengths,
        np.concatenate([batch.log_times for batch in batches]),
    )

"""Batches on their way through a decoder: small ones are put together, large ones split."""

from collections.abc import Iterable, Iterator
from typing import Final

import numpy as np
import polars as pl

from replay.decoding.batch import BATCH_BYTES, BATCH_ROWS, RawBatch
from replay.decoding.decoder import Decoder, Tally
from replay.decoding.gather import runs

#: With fewer messages, what a batch costs by itself is more than copying them into a larger one.
_FEW_ROWS: Final = 2048


def decode_batches(
    batches: Iterable[RawBatch], decoder: Decoder, tally: Tally
) -> Iterator[pl.DataFrame]:
    """Frames in the order of the messages; `tally` is kept current."""
    for batch in _gathered(_timely(batches, tally)):
        decoded = decoder.decode(batch)
        tally.rows += decoded.frame.height
        _refuse(tally, decoded.undecodable, decoded.first_fault)
        if decoded.frame.height:
            yield decoded.frame


def _refuse(tally: Tally, count: int, fault: str) -> None:
    tally.undecodable += count
    tally.first_fault = tally.first_fault or fault


def _timely(batches: Iterable[RawBatch], tally: Tally) -> Iterator[RawBatch]:
    """Leave out messages whose log time no column can hold."""
    for batch in batches:
        late = batch.log_times < 0
        if late.any():
            first = int(batch.log_times[late][0]) & (2**64 - 1)
            fault = f"its log time, {first} ns, lies beyond the year 2262"
            _refuse(tally, int(late.sum()), fault)
        yield batch.select(~late) if late.any() else batch


def _gathered(batches: Iterable[RawBatch]) -> Iterator[RawBatch]:
    """The same messages in batches of a size that is worth its overhead."""
    few: list[RawBatch] = []
    rows = size = 0
    for batch in batches:
        for part in batch.parts():
            if part.rows < _FEW_ROWS:
                few.append(_copied(part))
                rows += part.rows
                size += few[-1].data.size
                if rows < BATCH_ROWS and size < BATCH_BYTES:
                    continue
            if few:
                yield _joined(few)
                few, rows, size = [], 0, 0
            if part.rows >= _FEW_ROWS:
                yield part
    if few:
        yield _joined(few)


def _copied(batch: RawBatch) -> RawBatch:
    """Its messages alone, since a container may use the memory again."""
    data = runs(batch.data, batch.offsets, batch.lengths)
    offsets = np.cumsum(batch.lengths) - batch.lengths
    return RawBatch(data, offsets, batch.lengths.copy(), batch.log_times.copy())


def _joined(batches: list[RawBatch]) -> RawBatch:
    lengths = np.concatenate([batch.lengths for batch in batches])
    return RawBatch(
        np.concatenate([batch.data for batch in batches]),
        np.cumsum(lengths) - lengths,
        lengths,
        np.concatenate([batch.log_times for batch in batches]),
    )

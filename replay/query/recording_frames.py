"""Open frames of a recording as lazy frames, of which only the needed columns are read."""

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import polars as pl

from analysis.model.schema import FRAMES
from recordings.rrd.reader import open_recording
from recordings.rrd.stored_frames import StoredFrame
from replay.frames.scan import make_lazy_frame_of_batches
from replay.frames.topic_source import SOURCE

#: Column of the seconds since the start of the run, as `view --at` expects them.
AT_S: Final = "at_s"
_RAW: Final = "raw/"


@dataclass(frozen=True, slots=True)
class RecordingFrame:
    """Frame of a recording for queries.

    Attributes:
        recording: path of the recording.
        stored: description of the frame in the recording.
        t0_unix_ns: Unix time of the run's start.
        with_source: whether to add a column with the recording of each row.
    """

    recording: Path
    stored: StoredFrame
    t0_unix_ns: int
    with_source: bool

    @property
    def time_column(self) -> str | None:
        """Column that places the rows in time, if any."""
        if self.stored.name.startswith(_RAW):
            return "log_time_ns"
        declared = FRAMES.get(self.stored.name.partition("/")[0])
        column = declared.time_column if declared else None
        return column if column in {each.name for each in self.stored.columns} else None

    @property
    def schema(self) -> pl.Schema:
        """Data types by column: source, seconds since the run's start, then the frame's columns."""
        own = {each.name: each.polars_dtype for each in self.stored.columns}
        source = {SOURCE: pl.String()} if self.with_source else {}
        second = {AT_S: pl.Float64()} if self.time_column else {}
        return pl.Schema({**source, **second, **own})

    def make_lazy_frame(self) -> pl.LazyFrame:
        """Make a lazy frame, which is read when its rows are collected."""

        def yield_selected_frame(
            columns: list[str] | None, predicate: pl.Expr | None, n_rows: int | None
        ) -> Iterator[pl.DataFrame]:
            wanted = list(self.schema) if columns is None else columns
            needed = [*wanted, *(predicate.meta.root_names() if predicate is not None else ())]
            rows = self._read_needed_columns(dict.fromkeys(needed)).head(n_rows or self.stored.rows)
            yield (rows if predicate is None else rows.filter(predicate)).select(wanted)

        return make_lazy_frame_of_batches(
            yield_selected_frame, self.schema, f"{self.recording} {self.stored.name}"
        )

    def _read_needed_columns(self, needed_columns: dict[str, None]) -> pl.DataFrame:
        own = [each.name for each in self.stored.columns]
        read = [name for name in own if name in needed_columns]
        time = self.time_column
        if AT_S in needed_columns and time is not None and time not in read:
            read.append(time)
        if not read:  # any column serves to count the rows
            read = own[:1]
        with open_recording(self.recording) as held:
            rows = held.read_frame(self.stored.name, read)
        if time is not None and AT_S in needed_columns and AT_S not in own:
            start_ns = self.t0_unix_ns if time == "log_time_ns" else 0
            rows = rows.with_columns(((pl.col(time) - start_ns) / 1e9).alias(AT_S))
        if self.with_source:
            rows = rows.with_columns(pl.lit(str(self.recording)).alias(SOURCE))
        return rows


def open_recording_frames(path: Path, *, has_source_column: bool) -> dict[str, RecordingFrame]:
    """Open the frames of a recording, by name, in the order of the pipeline.

    Raises:
        RecordingError: the file is not a recording with frames.
    """
    with open_recording(path) as held:
        held.refuse_recording_without_frames()
        t0_unix_ns, frames = held.provenance.t0_unix_ns, held.manifest.frames
    return {each.name: RecordingFrame(path, each, t0_unix_ns, has_source_column) for each in frames}

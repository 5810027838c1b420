"""Read tables as logs: text, Parquet, Arrow and spreadsheets, with a time for each row."""

from collections.abc import Mapping, Sequence
from contextlib import ExitStack
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Final

import polars as pl

from analysis.model.loss import Loss
from estimators.errors import LogError, format_count, join_first_names, suggest_choice
from replay.logs.log import TABLE, Log, LogCheck, TimeAxis
from replay.logs.log_limits import LIMITS
from replay.logs.machine_ids import iter_serial_numbers_in_metadata, iter_serial_numbers_in_preamble
from replay.logs.messages.broken_bytes import BrokenBytesError
from replay.logs.storage import LossList
from replay.logs.tables import (
    JSON_LINES,
    NS_PER_UNIT,
    CsvColumns,
    DialectError,
    TableHints,
    TableTimes,
    TimeError,
    describe_contradicting_time_column,
    find_time_columns_and_their_fields,
)

if TYPE_CHECKING:
    from replay.logs.tables.parquet_columns import ParquetColumns

_FORMATS: Final = {
    "parquet": "Parquet table", "xlsx": "Excel table", "csv": "CSV table",
    **dict.fromkeys(JSON_LINES, "table of JSON lines"),
}  # fmt: skip
_STAMPS: Final = ("log_time_ns", "header_stamp_ns")
_TRUTHS: Final = ["true", "false"]
_WHERE: Final = "in the machine file, or by --set log.KEY=VALUE"


class TableLog(Log):
    """A table whose rows are the messages of one topic; columns are read on demand.

    If the columns are pairs of time and value, each time column is a topic: `table`, `table/2` ….
    """

    def __init__(self, path: Path, time_axis: TimeAxis | None) -> None:
        inner = path.with_suffix("") if path.suffix.lower() == ".gz" else path
        self._suffix = inner.suffix.lower().removeprefix(".")
        copies = ExitStack()
        super().__init__(path, _FORMATS.get(self._suffix, "text table"), copies.close)
        self._losses = LossList()
        self._hints = time_axis.table if time_axis else TableHints()
        try:
            self._columns = self._open_columns_of_table(copies)
        except BrokenBytesError as error:
            raise LogError(f"{path}: not a {self._suffix} table: {error}") from error
        except DialectError as error:
            raise LogError(f"{path}: {error} {_WHERE}") from error
        given = (None, None) if time_axis is None else (time_axis.column, time_axis.unit)
        self._is_time_given = given != (None, None)
        found = self._find_time_columns(time_axis)
        names = [TABLE, *(f"{TABLE}/{number}" for number in range(2, len(found) + 1))]
        self._parts = dict(zip(names, found, strict=True))
        self._stamps: dict[str, pl.Series] = {}
        self._expected: list[str] = []
        self._is_checked = False
        self._notes = [*self._columns.notes]

    @property
    def files(self) -> tuple[Path, ...]:
        """File of the table."""
        return (self.path,)

    def notes(self) -> tuple[str, ...]:
        """Notes on the detected dialect and time."""
        for topic in self._parts:
            self._log_times_of_topic(topic)
        return tuple(f"{self.path.name}: {note}" for note in dict.fromkeys(self._notes))

    def machine_ids(self) -> tuple[str, ...]:
        """Serial numbers in the metadata of a Parquet or Arrow file, or above a text table."""
        columns = self._columns
        text = isinstance(columns, CsvColumns)
        found = (
            iter_serial_numbers_in_preamble(columns.preamble_lines)
            if text
            else iter_serial_numbers_in_metadata(columns.metadata)
        )
        return tuple(dict.fromkeys(found))

    def units(self, topic: str) -> dict[str, str]:
        """Units by field, as stated in column names, a row of units or metadata."""
        if topic not in self._parts:
            return {}
        inside = set(self._list_fields_of_topic(topic))
        found = {c.name: c.unit for c in self._columns.columns if c.unit and c.name in inside}
        axis, _ = self._parts[topic]
        # "Time (s) - Speed (m/s)": the last unit is the channel's, not the time's
        return found | ({axis.time: axis.unit} if axis.time and axis.unit else {})

    def _open_columns_of_table(self, copies: ExitStack) -> "CsvColumns | ParquetColumns":
        if self._suffix in ("parquet", "arrow", "feather", *JSON_LINES):
            from replay.logs.tables.parquet_columns import open_typed_columns  # slow to import

            columns = open_typed_columns(self.path, self._suffix)
            for loss in columns.losses:
                self._losses.add_loss(self.path, loss, TABLE)
            return columns
        path = self.path
        if self._suffix == "xlsx":
            from replay.logs.tables.text import write_sheet_as_csv

            path = write_sheet_as_csv(path, self._hints.sheet, copies)
        columns = CsvColumns(path, self._hints)
        copies.callback(columns.close)
        return columns

    def _find_time_columns(self, time_axis: TimeAxis | None) -> list[tuple[TableTimes, list[str]]]:
        columns = self._columns.names
        if time_axis is not None and time_axis.unit not in (None, *NS_PER_UNIT):
            raise LogError(
                f"{self.path}: no unit of time '{time_axis.unit}'; use {', '.join(NS_PER_UNIT)}"
            )
        if (
            time_axis is not None
            and time_axis.column is not None
            and time_axis.column not in columns
        ):
            meant = suggest_choice(time_axis.column, columns)
            raise LogError(
                f"{self.path}: no column '{time_axis.column}' for the time; "
                f"{meant}{'' if meant.endswith('?') else '.'} Set [log] time in the machine file"
            )
        try:
            found = find_time_columns_and_their_fields(
                self._columns.columns, self._columns.read_first_text_cells, time_axis
            )
        except DialectError as error:
            raise LogError(f"{self.path}: {error} {_WHERE}") from error
        if found is None:
            named = join_first_names([*map(repr, columns)], LIMITS.max_columns)
            raise LogError(
                f"{self.path}: no time column among {named}; "
                'name it in the machine file: [log] time = "COLUMN", time_unit = "s", or where '
                "there is none, [log] rate_hz = rows per second"
            )
        return found

    def announce_fields_to_read(self, fields: Mapping[str, Sequence[str]]) -> None:
        """Announce fields that are read together with the times."""
        inside = {name for topic in self._parts for name in self._list_fields_of_topic(topic)}
        asked = dict.fromkeys(name for names in fields.values() for name in names)
        self._expected = [name for name in asked if name in inside]

    def _scan_rows_and_note_losses(self, fields: Sequence[str] = ()) -> None:
        """Scan all rows of a text table once; read its times and some fields, and note losses."""
        if self._is_checked or not isinstance(self._columns, CsvColumns):
            return
        self._is_checked = True
        times = [column for axis, _ in self._parts.values() for column in axis.time_columns]
        once, self._expected = [*self._expected, *fields], []
        try:
            self._columns.scan_all_rows(times, once, partial(self._losses.add_loss, self.path))
        except BrokenBytesError as error:
            raise LogError(f"{self.path}: not a {self._suffix} table: {error}") from error

    def _log_times_of_topic(self, topic: str) -> pl.Series:
        """Log time of each row of a topic, (rows,) in ns; null if the row has none."""
        if topic not in self._stamps:
            self._scan_rows_and_note_losses()
            self._stamps[topic] = self._compute_log_times_of_axis(self._parts[topic][0])
        return self._stamps[topic]

    def _compute_log_times_of_axis(self, axis: TableTimes) -> pl.Series:
        try:
            found = axis.compute_log_times_of_rows(
                self._read_cells(axis.time_columns), self._columns.rows
            )
        except TimeError as error:
            remedy = "" if "[log]" in str(error) else ". Set [log] time and time_unit"
            raise LogError(
                f"{self.path}: column '{axis.time_columns[-1]}' cannot be the time: "
                f"{error}{remedy} {_WHERE}"
            ) from error
        times = found.stamps
        self._refuse_contradicting_time_column(axis, times)
        self._notes += found.notes
        # with several pairs of time and value, one may end before the others
        last = times.is_not_null().arg_true().max() if len(self._parts) > 1 else None
        missing = times.head(int(last) + 1).null_count() if last is not None else times.null_count()  # pyright: ignore[reportArgumentType] an index
        if missing:
            self._losses.add_loss(
                self.path, f"{missing} of {times.len()} rows have no time; they were dropped"
            )
        there = times.drop_nulls()
        steps = there.diff()
        backwards = int((steps < 0).sum())
        self._refuse_repeated_times(axis, there, steps)
        if backwards:
            self._refuse_restarting_time(axis, there, backwards)
            self._losses.add_loss(
                self.path,
                f"the time goes back at {format_count(backwards, 'row')}; all rows were sorted by "
                "time",
                TABLE,
            )
        return times.alias("log_time_ns")

    def _refuse_contradicting_time_column(self, axis: TableTimes, times: pl.Series) -> None:
        """Raise an error if another time column contradicts the detected one."""
        columns = self._columns
        is_unambiguous = self._is_time_given or axis.time is None or len(self._parts) > 1
        if is_unambiguous or not isinstance(columns, CsvColumns):
            return
        first = partial(columns.read_first_text_cells, count=LIMITS.compared_cells)
        said = describe_contradicting_time_column(
            columns.columns, first, axis.time_columns[-1], times.head(columns.head_row_count)
        )
        if said:
            raise LogError(
                f"{self.path}: column '{axis.time_columns[-1]}' cannot be the time: {said} {_WHERE}"
            )

    def _refuse_repeated_times(
        self, axis: TableTimes, known_times: pl.Series, steps: pl.Series
    ) -> None:
        """Raise an error if most rows share their time with the previous one: too coarse."""
        shared = int((steps == 0).sum())
        if (
            known_times.len() <= LIMITS.same_time_rows
            or 2 * (known_times.len() - shared) >= known_times.len()
        ):
            return
        if shared == known_times.len() - 1:
            said = "all rows have the same time; set [log] time to another column"
        else:
            said = (
                f"{shared:,} of {known_times.len():,} rows have the same time as the row before; "
                "set another time column, [log] time, or the column of the fractions of a second, "
                "[log] time_fraction, or set [log] rate_hz = rows per second"
            )
        raise LogError(f"{self.path}: column '{axis.time_columns[-1]}' cannot be the time: {said}")

    def _refuse_restarting_time(
        self, axis: TableTimes, known_times: pl.Series, backwards: int
    ) -> None:
        """Raise an error if time falls back and continues: sorting would interleave two records."""
        wanted = self._hints.sort_times
        if wanted or (wanted is None and self._are_rows_shuffled(known_times, backwards)):
            return
        before = known_times.cum_max()
        row = int((before > known_times).arg_max() or 0)
        fall_s = (before[row] - known_times[row]) / 1e9
        raise LogError(
            f"{self.path}: column '{axis.time_columns[-1]}' cannot be the time: it jumps back by "
            f"{fall_s:.6g} s at row {row + 1:,} below the header and goes on from there: a second "
            "record, a counter that restarts, or a clock that is set back ([log] timezone). Split "
            "the file, set [log] time or rate_hz, or sort_times = true if the rows belong together"
        )

    def _are_rows_shuffled(self, known_times: pl.Series, backwards: int) -> bool:
        """Whether few rows are late, or time falls back so often that the order is arbitrary."""
        late = int((known_times < known_times.cum_max()).sum())
        return (
            late < LIMITS.late_row_fraction * known_times.len()
            or backwards > LIMITS.falling_row_fraction * late
        )

    def _read_cells(self, names: Sequence[str]) -> dict[str, pl.Series]:
        try:
            return self._columns.read_columns(names)
        except BrokenBytesError as error:
            columns = "', '".join(names)
            raise LogError(f"{self.path}: column '{columns}' cannot be read: {error}") from error

    def _list_fields_of_topic(self, topic: str) -> list[str]:
        return [name for name in self._parts[topic][1] if name and name not in _STAMPS]

    def topics(self) -> pl.DataFrame:
        """The single topic, or one per time column; see `Log.topics`."""
        rows = [
            {
                "topic": topic,
                "type": TABLE,
                "encoding": self._suffix,
                **self._make_topic_row_of_log_times(
                    self._log_times_of_topic(topic).drop_nulls().to_numpy()
                ),
                "fields": self._list_fields_of_topic(topic),
                "problem": None,
                "decoder": "columnar",
            }
            for topic in self._parts
        ]
        return pl.DataFrame(rows, schema=self.TOPICS_SCHEMA)

    def _read_frames_by_topic(
        self, fields: Mapping[str, Sequence[str]], start_ns: int | None, end_ns: int | None
    ) -> dict[str, pl.DataFrame]:
        return {
            t: self._read_frame_of_topic(t, names, start_ns, end_ns) for t, names in fields.items()
        }

    def _read_frame_of_topic(
        self, topic: str, fields: Sequence[str], start_ns: int | None, end_ns: int | None
    ) -> pl.DataFrame:
        if topic not in self._parts:
            many = ", ".join(f"'{each}'" for each in self._parts)
            has = f"the one topic '{TABLE}'" if len(self._parts) == 1 else f"the topics {many}"
            raise LogError(f"{self.path}: no topic '{topic}'; a table has {has}")
        choices = self._list_fields_of_topic(topic)
        inside = frozenset(choices)
        for field in fields:
            if field not in inside:
                raise LogError(
                    f"{self.path}: no column '{field}'; {suggest_choice(field, choices)}"
                )
        self._scan_rows_and_note_losses(fields)
        cells = self._read_cells(list(dict.fromkeys(fields)))
        columns = [self._cast_cells_by_dtype(cells.pop(field)) for field in dict.fromkeys(fields)]
        times = self._log_times_of_topic(topic)
        no_stamps = pl.repeat(None, times.len(), dtype=pl.Int64, eager=True)
        frame = pl.DataFrame([times, no_stamps.alias("header_stamp_ns"), *columns])
        if start_ns is None and end_ns is None and times.null_count() == 0 and times.is_sorted():
            return frame
        inside = pl.col("log_time_ns").is_not_null()
        if start_ns is not None:
            inside &= pl.col("log_time_ns") >= start_ns
        if end_ns is not None:
            inside &= pl.col("log_time_ns") <= end_ns
        return frame.filter(inside).sort("log_time_ns", maintain_order=True)

    def _cast_cells_by_dtype(self, cells: pl.Series) -> pl.Series:
        """Cells as numbers, times in ns or text, depending on their type."""
        is_text = isinstance(self._columns, CsvColumns)
        if cells.dtype == pl.String and (is_text or self._suffix in JSON_LINES):
            return self._convert_text_to_likely_type(cells)
        if is_text:
            return cells
        if cells.dtype.is_float() or cells.dtype.is_decimal():
            return cells.cast(pl.Float64)
        if cells.dtype.is_integer() and cells.dtype != pl.UInt64:
            return cells.cast(pl.Int64)
        if cells.dtype == pl.Duration:
            return cells.dt.total_nanoseconds()
        if cells.dtype.is_temporal():
            since_midnight = cells.dtype == pl.Time
            return cells.to_physical() if since_midnight else cells.dt.timestamp("ns")
        is_kept = cells.dtype.is_integer() or cells.dtype == pl.Boolean
        return cells if is_kept else cells.cast(pl.String)

    def _convert_text_to_likely_type(self, text: pl.Series) -> pl.Series:
        """Cast to integers, numbers or booleans: the first type that half of the cells have."""
        text = text.str.strip_chars()
        present = text.filter(text.is_not_null() & (text != ""))
        as_integers = text.cast(pl.Int64, strict=False)
        if as_integers.count() == present.len() > 0:
            return as_integers
        if present.len() and present.str.to_lowercase().is_in(_TRUTHS).all():
            return text.str.to_lowercase() == "true"
        numbers = text.cast(pl.Float64, strict=False)
        if numbers.count() * 2 < present.len():
            return text
        faults = text.filter(numbers.is_null() & text.is_not_null() & (text != ""))
        if faults.len():
            self._losses.add_loss(
                self.path,
                f"{faults.len()} cells of column '{text.name}' are not numbers; the first is "
                f"'{_shorten_text(faults[0])}'",
                TABLE,
            )
        return numbers

    def check(self) -> LogCheck:
        """Read every column; see `Log.check`."""
        self._refuse_closed_log()
        self._scan_rows_and_note_losses()
        fields = {field for topic in self._parts for field in self._list_fields_of_topic(topic)}
        message_bytes = 0
        for name in self._columns.names:
            try:
                column = self._read_cells([name])[name]
                column = self._cast_cells_by_dtype(column) if name in fields else column
            except LogError as error:
                self._losses.add_loss(self.path, str(error).removeprefix(f"{self.path}: "), TABLE)
            else:
                message_bytes += int(column.estimated_size())
        return LogCheck(
            sum(self._log_times_of_topic(t).count() for t in self._parts), message_bytes, crcs=0
        )

    def losses(self) -> tuple[Loss, ...]:
        """Losses so far: data that could not be read."""
        return tuple(self._losses)


def _shorten_text(text: str) -> str:
    return text if len(text) <= LIMITS.quoted_characters else f"{text[: LIMITS.quoted_characters]}…"

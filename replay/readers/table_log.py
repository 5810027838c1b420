"""Tables as logs: `.csv` and `.parquet` with one topic, `table`, and a time column."""

import re
from collections.abc import Mapping, Sequence
from functools import cached_property, partial
from pathlib import Path
from typing import TYPE_CHECKING, Final

import polars as pl

from analysis.run import Loss
from estimators.errors import LogError, nearest
from replay.messages.broken import BrokenBytesError
from replay.readers.csv_table import CsvColumns
from replay.readers.log import TABLE, Checked, Log, TimeAxis
from replay.readers.storage import LossList
from replay.readers.table_time import NS_PER_UNIT, TimeError, guess_axis, nanoseconds

if TYPE_CHECKING:
    from replay.readers.parquet_columns import ParquetColumns

_FORMATS: Final = {"csv": "CSV table", "parquet": "Parquet table"}
#: Columns that an error names.
_NAMED: Final = 20
_STAMPS: Final = ("log_time_ns", "header_stamp_ns")


class TableLog(Log):
    """A table whose rows are the messages of one topic. Columns are read as they are asked for."""

    def __init__(self, path: Path, time: TimeAxis | None) -> None:
        self._suffix = path.suffix.lower().removeprefix(".")
        super().__init__(path, _FORMATS[self._suffix])
        self._losses = LossList()
        try:
            self._columns = self._open()
        except BrokenBytesError as error:
            raise LogError(f"{path}: not a {self._suffix} table: {error}") from error
        self._axis = self._find_axis(time)

    @property
    def files(self) -> tuple[Path, ...]:
        """The table's file."""
        return (self.path,)

    def _open(self) -> "CsvColumns | ParquetColumns":
        if self._suffix == "parquet":
            from replay.readers.parquet_columns import ParquetColumns  # pyarrow is slow to import

            return ParquetColumns(self.path)
        return CsvColumns(self.path, partial(self._losses.note, self.path))

    def _find_axis(self, given: TimeAxis | None) -> TimeAxis:
        columns = self._columns.names
        if given is not None and given.unit not in NS_PER_UNIT:
            raise LogError(
                f"{self.path}: no unit of time '{given.unit}'; use {', '.join(NS_PER_UNIT)}"
            )
        if given is not None and given.column not in columns:
            meant = nearest(given.column, columns)
            raise LogError(
                f"{self.path}: no column '{given.column}' for the time; "
                f"{meant}{'' if meant.endswith('?') else '.'} Set [log] time in the machine file"
            )
        axis = given or guess_axis(columns)
        if axis is None and len(columns) == 1 and re.search(r"[;\t]", columns[0]):
            raise LogError(f"{self.path}: its cells are not separated by commas; convert it first")
        if axis is None:
            more = f" and {len(columns) - _NAMED} more" if len(columns) > _NAMED else ""
            named = ", ".join(map(repr, columns[:_NAMED]))
            raise LogError(
                f"{self.path}: no time column among {named}{more}; "
                'name it in the machine file: [log] time = "COLUMN", time_unit = "s"'
            )
        return axis

    @cached_property
    def _times(self) -> pl.Series:
        """Log time of each row, null where it has none."""
        column = self._column(self._axis.column)
        try:
            times = nanoseconds(column, self._axis.unit)
        except TimeError as error:
            raise LogError(
                f"{self.path}: column '{self._axis.column}' cannot be the time: {error}. "
                "Set [log] time and time_unit in the machine file"
            ) from error
        if times.null_count():
            self._losses.note(
                self.path, f"{times.null_count()} of {times.len()} rows have no time: dropped"
            )
        backwards = int((times.drop_nulls().diff() < 0).sum())
        if backwards:
            self._losses.note(
                self.path, f"the time goes back at {backwards} rows: sorted by time", TABLE
            )
        return times.alias("log_time_ns")

    def _column(self, name: str) -> pl.Series:
        try:
            return self._columns.read(name)
        except BrokenBytesError as error:
            raise LogError(f"{self.path}: column '{name}' cannot be read: {error}") from error

    def _fields(self) -> list[str]:
        return [name for name in self._columns.names if name and name not in _STAMPS]

    def topics(self) -> pl.DataFrame:
        """The one topic; see `Log.topics`."""
        row = {
            "topic": TABLE,
            "type": TABLE,
            "encoding": self._suffix,
            **self._timing(self._times.drop_nulls().to_numpy()),
            "fields": self._fields(),
            "problem": None,
            "decoder": "columnar",
        }
        return pl.DataFrame([row], schema=self.TOPICS_SCHEMA)

    def _read_many(
        self, fields: Mapping[str, Sequence[str]], start_ns: int | None, end_ns: int | None
    ) -> dict[str, pl.DataFrame]:
        return {t: self._read(t, names, start_ns, end_ns) for t, names in fields.items()}

    def _read(
        self, topic: str, fields: Sequence[str], start_ns: int | None, end_ns: int | None
    ) -> pl.DataFrame:
        if topic != TABLE:
            raise LogError(f"{self.path}: no topic '{topic}'; a table has the one topic '{TABLE}'")
        choices = self._fields()
        for field in fields:
            if field not in choices:
                raise LogError(f"{self.path}: no column '{field}'; {nearest(field, choices)}")
        columns = [self._values(field) for field in dict.fromkeys(fields)]
        times = self._times
        frame = pl.DataFrame(
            [times, pl.Series("header_stamp_ns", [None] * times.len(), dtype=pl.Int64), *columns]
        )
        inside = pl.col("log_time_ns").is_not_null()
        if start_ns is not None:
            inside &= pl.col("log_time_ns") >= start_ns
        if end_ns is not None:
            inside &= pl.col("log_time_ns") <= end_ns
        return frame.filter(inside).sort("log_time_ns", maintain_order=True)

    def _values(self, name: str) -> pl.Series:
        values = self._column(name)
        if self._suffix == "csv":
            return self._typed(values)
        if values.dtype.is_float() or values.dtype.is_decimal():
            return values.cast(pl.Float64)
        if values.dtype.is_integer() and values.dtype != pl.UInt64:
            return values.cast(pl.Int64)
        if values.dtype == pl.Duration:
            return values.dt.total_nanoseconds()
        if values.dtype.is_temporal():
            since_midnight = values.dtype == pl.Time
            return values.to_physical() if since_midnight else values.dt.timestamp("ns")
        keeps = values.dtype.is_integer() or values.dtype == pl.Boolean
        return values if keeps else values.cast(pl.String)

    def _typed(self, text: pl.Series) -> pl.Series:
        """Integers, numbers, booleans or text: the first that at least half of the cells are."""
        text = text.str.strip_chars()
        present = text.filter(text.is_not_null() & (text != ""))
        as_integers = text.cast(pl.Int64, strict=False)
        if as_integers.count() == present.len() > 0:
            return as_integers
        if present.len() and present.str.to_lowercase().is_in(["true", "false"]).all():
            return text.str.to_lowercase() == "true"
        numbers = text.cast(pl.Float64, strict=False)
        if numbers.count() * 2 < present.len():
            return text
        faults = text.filter(numbers.is_null() & text.is_not_null() & (text != ""))
        if faults.len():
            self._losses.note(
                self.path,
                f"{faults.len()} cells of column '{text.name}' are no numbers, "
                f"the first is '{faults[0]}'",
                TABLE,
            )
        return numbers

    def check(self) -> Checked:
        """Read every column; see `Log.check`."""
        self._check_open()
        fields = self._fields()
        message_bytes = 0
        for name in self._columns.names:
            try:
                column = self._values(name) if name in fields else self._column(name)
            except LogError as error:
                self._losses.note(self.path, str(error).removeprefix(f"{self.path}: "), TABLE)
            else:
                message_bytes += int(column.estimated_size())
        return Checked(self._times.count(), message_bytes, crcs=0)

    def losses(self) -> tuple[Loss, ...]:
        """What could not be read so far."""
        return tuple(self._losses)

"""The rows of a text table: too long, too short, or torn where its writer stopped in one."""

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Final

import polars as pl
from polars.exceptions import PolarsError

from replay.messages.broken import BrokenBytesError
from replay.readers.tables.dialect import BLANKS, sniff, some_cells
from replay.readers.tables.hints import TableHints
from replay.readers.tables.text import Utf8Text, as_utf8, head_lines, with_tabs

#: Stands in no text: a line is one cell.
_NO_SEPARATOR: Final = "\x1f"
#: A number with a decimal comma; a date with one is none.
_COMMA: Final = r"^(\s*[+-]?\d*),(\d*(?:[eE][+-]?\d+)?\s*)$"


class CsvColumns:
    """The columns of a text table.

    Attributes:
        columns: their names, with units.
        names: their names.
        notes: what was recognised.
    """

    def __init__(self, path: Path, hints: TableHints, note: Callable[[str], None]) -> None:
        """Look at all of it for rows that are too long, too short or torn; see `_checked`.

        Raises:
            BrokenBytesError: it is no table.
            DialectError: how it is written is not known.
        """
        self._text = as_utf8(path, hints.encoding)
        try:
            self._dialect = sniff(head_lines(self._text.path), hints)
            if self._dialect.separator == BLANKS:
                text, self._text = self._text, with_tabs(self._text)
                _remove(text)
            self.columns = self._dialect.columns
            self.names = self._dialect.names
            self.notes = (*self._text.notes, *self._dialect.notes)
            self._rows, self.rows = self._checked(note)
        except BaseException:
            self.close()
            raise

    def close(self) -> None:
        """Remove the copy of the text, if there is one."""
        _remove(self._text)

    @property
    def preamble(self) -> tuple[str, ...]:
        """Some lines above the names."""
        return self._dialect.preamble

    def head(self, place: int) -> list[str]:
        """Some first cells of a column, those that are not empty."""
        return some_cells(self._dialect, place)

    def read(self, names: Sequence[str]) -> dict[str, pl.Series]:
        """Columns as text, (rows,) each, in one pass; a decimal comma is a point.

        Raises:
            BrokenBytesError: one cannot be read.
        """
        wanted = list(dict.fromkeys(names))
        if not wanted:
            return {}
        frame = self._rows.select(wanted)
        if self._dialect.decimal == ",":
            frame = frame.with_columns(pl.all().str.replace(_COMMA, "$1.$2"))
        return {series.name: series for series in _collected(frame).get_columns()}

    @property
    def _tail(self) -> list[str]:
        """The column of nothing behind a separator at the end of each row."""
        return [_NO_SEPARATOR * 2] if self._dialect.has_tail else []

    @property
    def _separator(self) -> str:
        return "\t" if self._dialect.separator == BLANKS else self._dialect.separator

    def _checked(self, note: Callable[[str], None]) -> tuple[pl.LazyFrame, int]:
        """The rows as text, because a fault in a cell should cost that cell; and their number.

        Rows with too few cells end in nulls; the last one, where no line end follows it, is torn
        and left out, since its last cell may be half a number. (A last row that has all its cells
        needs no line end: RFC 4180.)
        """
        frame = self._scan(cut_long_rows=False)
        if self._dialect.is_empty:
            return pl.DataFrame(schema=dict.fromkeys(self.names, pl.String())).lazy(), 0
        # polars notices a row that is too long only when it is to parse every column
        counts = (pl.len().alias(_NO_SEPARATOR), pl.col(self.names).null_count())
        try:
            counted = _collected(frame.select(*counts, pl.col(self._tail).null_count()))
        except BrokenBytesError:
            note("rows with more cells than the header: what is too much is not read")
            frame = self._scan(cut_long_rows=True)
            counted = _collected(frame.select(*counts))
        rows, missing = int(counted.row(0)[0]), counted.row(0)[len(self.names)]
        short = self._short_lines() if missing else []
        if not short:
            return frame, rows
        if short[-1] == rows + self._dialect.data_line and not _ends_in_a_line_end(self._text.path):
            note(f"its last row (line {short.pop()}) is torn and not read")
            rows -= 1
            frame = frame.head(rows)
        if short:
            note(
                f"rows with fewer cells than the header: {len(short):,}, the first in line "
                f"{short[0]}; the cells that they lack are not there"
            )
        return frame, rows

    def _scan(self, *, cut_long_rows: bool) -> pl.LazyFrame:
        return pl.scan_csv(
            self._text.path,
            has_header=False,
            schema=dict.fromkeys([*self.names, *self._tail], pl.String()),
            skip_lines=self._dialect.data_line,
            separator=self._separator,
            quote_char=None if self._dialect.separator == BLANKS else '"',
            glob=False,
            encoding="utf8-lossy",
            truncate_ragged_lines=cut_long_rows,
            # where the first row is too short
            missing_columns="insert",
        )

    def _short_lines(self) -> list[int]:
        """The lines (from 1) with too few separators; none where cells go over lines."""
        line = pl.col("line")
        lines = pl.scan_csv(
            self._text.path,
            has_header=False,
            schema={"line": pl.String},
            skip_lines=self._dialect.data_line,
            separator=_NO_SEPARATOR,
            quote_char=None,
            glob=False,
            encoding="utf8-lossy",
            truncate_ragged_lines=True,
            row_index_name="number",
            row_index_offset=self._dialect.data_line + 1,
        )
        odd_quotes = line.str.count_matches('"', literal=True) % 2 == 1
        if _collected(lines.select(odd_quotes.any())).item():
            return []
        # an empty line is a row without a time, which is counted there
        separators = line.str.count_matches(self._separator, literal=True)
        is_short = separators < len(self.names) - 1
        short = lines.filter(line.is_not_null() & is_short).select("number")
        return _collected(short).to_series().to_list()


def _remove(text: Utf8Text) -> None:
    if text.copy is not None:
        text.copy.cleanup()


def _collected(frame: pl.LazyFrame) -> pl.DataFrame:
    try:
        return frame.collect(engine="streaming")
    except (PolarsError, OSError) as error:
        # polars spreads some messages over several lines
        raise BrokenBytesError(str(error).strip().partition("\n")[0]) from error


def _ends_in_a_line_end(path: Path) -> bool:
    with path.open("rb") as file:
        file.seek(-1, 2)
        return file.read() in (b"\n", b"\r")

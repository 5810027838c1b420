"""Read the columns of a text table, and note rows that are too long, too short or truncated."""

import re
import warnings
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Final

import polars as pl
from polars.exceptions import PanicException, PolarsError

from replay.logs.messages.broken_bytes import BrokenBytesError
from replay.logs.tables.cells import (
    are_most_cells_numeric,
    classify_cell_text,
    convert_numbers_to_python_notation,
)
from replay.logs.tables.dates import is_date_and_time_in_digits
from replay.logs.tables.dialect import BLANKS, read_first_filled_cells, sniff_dialect
from replay.logs.tables.hints import TableHints
from replay.logs.tables.text import (
    Utf8Text,
    convert_file_to_utf8,
    copy_with_ascii_digits,
    copy_with_blanks_as_tabs,
    copy_without_unclosed_quote,
    read_first_lines,
)

#: Separator that no text contains, so that each line is one cell.
_NO_SEPARATOR: Final = "\x1f"
_TAIL: Final = f"{_NO_SEPARATOR}tail"
_BEYOND: Final = f"{_NO_SEPARATOR}beyond"
_SHORT: Final = f"{_NO_SEPARATOR}short"
_LONG: Final = f"{_NO_SEPARATOR}long"
#: Cells that polars reads as the same integer, or float, whether first as text or directly.
_WHOLE: Final = re.compile(r"-?\d{1,18}")
_FLOAT: Final = re.compile(r"-?\d+\.?\d*([eE][+-]?\d+)?")
#: Start of polars' error about an unpaired quote.
_UNPAIRED: Final = "CSV malformed"


class CsvColumns:
    """The columns of a text table.

    Attributes:
        columns: column names, with units.
        names: column names.
        rows: number of rows, known after `scan_all_rows`.
        notes: notes on what was detected.
    """

    def __init__(self, path: Path, hints: TableHints) -> None:
        """Examine the start of the file.

        Raises:
            BrokenBytesError: it is not a table.
            DialectError: its dialect is ambiguous.
        """
        self._text = convert_file_to_utf8(path, hints.encoding)
        try:
            self._replace_text_file(copy_with_ascii_digits(self._text))
            self._dialect = sniff_dialect(read_first_lines(self._text.path), hints)
            if self._dialect.separator == BLANKS:
                self._replace_text_file(copy_with_blanks_as_tabs(self._text))
            whole = copy_without_unclosed_quote(self._text, self._dialect.separator)
            self._is_torn = whole is not None
            self._replace_text_file(whole)
        except BaseException:
            self.close()
            raise
        self.columns = self._dialect.columns
        self.names = self._dialect.column_names
        self.notes = (*self._text.notes, *self._dialect.notes)
        self.rows = 0
        self._height: int | None = None
        self._kept: dict[str, pl.Series] = {}
        self._once: dict[str, pl.Series] = {}
        heads = {
            name: read_first_filled_cells(self._dialect, k) for k, name in enumerate(self.names)
        }
        self._types = {name: guess_polars_type_of_cells(cells) for name, cells in heads.items()}
        decimal, is_grouped = self._dialect.decimal, self._dialect.is_grouped
        #: Columns that contain numbers, or none of whose first rows has a cell.
        self._numeric = {
            name
            for name, cells in heads.items()
            if are_most_cells_numeric(
                [classify_cell_text(cell, decimal, is_grouped=is_grouped) for cell in cells],
                result_if_empty=True,
            )
        }
        self._cell_units = dict(zip(self.names, self._dialect.cell_units, strict=False))
        self._quotes_are_paired = True

    def _replace_text_file(self, new_text: Utf8Text | None) -> None:
        """Read from a copy from now on, and remove the previous copy."""
        if new_text is not None:
            old, self._text = self._text, new_text
            _remove_temporary_copy(old)

    def close(self) -> None:
        """Remove the copy of the text, if any."""
        _remove_temporary_copy(self._text)

    @property
    def preamble_lines(self) -> tuple[str, ...]:
        """First lines above the row of names."""
        return self._dialect.preamble

    @property
    def head_row_count(self) -> int:
        """Number of first rows from which the dialect was detected."""
        return len(self._dialect.rows)

    def read_first_text_cells(self, column_index: int, count: int = 50) -> list[str]:
        """The first `count` non-empty cells of a column, as text, from the start of the file."""
        return read_first_filled_cells(self._dialect, column_index, count)

    def scan_all_rows(
        self,
        kept_columns: Sequence[str],
        single_use_columns: Sequence[str],
        note_fault: Callable[[str], None],
    ) -> None:
        """Read columns, and in the same pass note rows that are too long, too short or truncated.

        Rows with too few cells end in nulls. A last row without a line end is truncated and
        skipped, since its last cell may be half a number, unless it has all its cells (RFC 4180).

        Args:
            kept_columns: columns to read and keep.
            single_use_columns: columns to read and keep until requested.
            note_fault: called with a sentence for each loss.

        Raises:
            BrokenBytesError: the rows cannot be read.
        """
        if self._dialect.is_empty:
            return
        last = self.names[-1]
        looked = self._read_columns_as_numbers_or_text(
            list(dict.fromkeys([*kept_columns, *single_use_columns])),
            pl.col(last).is_null().alias(_SHORT),
            pl.col(_BEYOND).is_not_null().alias(_LONG),
        )
        short, long = looked.pop(_SHORT), looked.pop(_LONG)
        self.rows = short.len()
        if long.any():
            note_fault("rows with more cells than the header: the additional cells are not read")
        if self._is_torn:
            note_fault("its last row is cut off and was not read")
        if not self._quotes_are_paired:
            note_fault("its quotes are not paired: rows between them may be read as one cell")
        lines = self._find_short_lines() if short.any() else []
        end = self.rows + self._dialect.data_line
        if lines and lines[-1] == end and not _does_file_end_with_line_end(self._text.path):
            note_fault(f"its last row (line {lines.pop()}) is cut off and was not read")
            self.rows -= 1
        if lines:
            note_fault(
                f"rows with fewer cells than the header: {len(lines):,}, the first in line "
                f"{lines[0]}; their missing cells are empty"
            )
        self._kept = {name: looked[name].head(self.rows) for name in dict.fromkeys(kept_columns)}
        self._once = {
            name: series.head(self.rows)
            for name, series in looked.items()
            if name not in kept_columns
        }

    def read_columns(self, names: Sequence[str]) -> dict[str, pl.Series]:
        """Read columns, (rows,) each, in one pass: numbers if all cells are numbers, else text.

        Raises:
            BrokenBytesError: a column cannot be read.
        """
        if self._dialect.is_empty:
            return {name: pl.Series(name, [], dtype=pl.String) for name in names}
        there = {n: self._once.pop(n) for n in dict.fromkeys(names) if n in self._once}
        there |= {name: self._kept[name] for name in names if name in self._kept}
        new = [name for name in dict.fromkeys(names) if name not in there]
        read = self._read_columns_as_numbers_or_text(new) if new else {}
        there |= {name: series.head(self.rows) for name, series in read.items()}
        return {name: there[name] for name in dict.fromkeys(names)}

    def _read_columns_as_numbers_or_text(
        self, names: Sequence[str], *flag_expressions: pl.Expr
    ) -> dict[str, pl.Series]:
        """Read columns and flags in one pass; columns with text are read in a second one."""
        frame = self._collect_frame(
            self._scan_lazily_with_types(self._types).select(*names, *flag_expressions)
        )
        self._refuse_wrong_row_count(frame)
        found = {series.name: series for series in frame.get_columns()}
        counts = {n: found[n].count() for n in names if found[n].dtype.is_numeric()}
        text = self._list_columns_with_text({n: c for n, c in counts.items() if c < frame.height})
        if text:
            self._types.update(dict.fromkeys(text, pl.String()))
            again = self._collect_frame(self._scan_lazily_with_types({}).select(text))
            self._refuse_wrong_row_count(again)
            found |= {series.name: series for series in again.get_columns()}
        return {
            name: self._convert_column_to_python_number_notation(column)
            for name, column in found.items()
        }

    def _list_columns_with_text(self, number_count_by_column: Mapping[str, int]) -> list[str]:
        """Columns with more non-empty cells than numbers, which must be read as text."""
        if not number_count_by_column:
            return []
        cells = [(pl.col(name).str.strip_chars() != "").sum() for name in number_count_by_column]
        counted = self._collect_frame(self._scan_lazily_with_types({}).select(cells)).row(0)
        return [
            n
            for (n, c), cells in zip(number_count_by_column.items(), counted, strict=True)
            if cells > c
        ]

    def _convert_column_to_python_number_notation(self, column: pl.Series) -> pl.Series:
        """Rewrite numbers in Python's notation, without units; other columns are unchanged."""
        is_text = column.name not in self._numeric and self._dialect.decimal == "."
        if column.dtype != pl.String or is_text:
            return column
        unit = self._cell_units.get(column.name)
        return convert_numbers_to_python_notation(
            column, self._dialect.decimal, unit, is_grouped=self._dialect.is_grouped
        )

    def _collect_frame(self, frame: pl.LazyFrame) -> pl.DataFrame:
        try:
            with warnings.catch_warnings(record=True) as caught:
                warnings.simplefilter("always")
                found = frame.collect(engine="streaming")
        except (PolarsError, PanicException, OSError) as error:
            # polars spreads some messages over several lines
            raise BrokenBytesError(str(error).strip().partition("\n")[0]) from error
        self._quotes_are_paired &= not any(_UNPAIRED in str(each.message) for each in caught)
        return found

    def _refuse_wrong_row_count(self, frame: pl.DataFrame) -> None:
        """Raise an error for an unclosed quote, after which polars splits rows differently."""
        self._height = frame.height if self._height is None else self._height
        if frame.height != self._height:
            raise BrokenBytesError(
                "a quote is not closed, so its rows cannot be separated; remove it"
            )

    @property
    def _polars_separator(self) -> str:
        return "\t" if self._dialect.separator == BLANKS else self._dialect.separator

    def _scan_lazily_with_types(self, types: Mapping[str, pl.DataType]) -> pl.LazyFrame:
        # as text where a decimal comma or a quoted cell may make polars misread a number
        plain = self._dialect.decimal == "."
        schema = {
            name: types.get(name, pl.String()) if plain else pl.String() for name in self.names
        }
        tail = [_TAIL] if self._dialect.has_tail else []
        return pl.scan_csv(
            self._text.path,
            has_header=False,
            # a column beyond the last one receives the excess cells of a row
            schema=schema | dict.fromkeys([*tail, _BEYOND], pl.String()),
            skip_lines=self._dialect.data_line,
            separator=self._polars_separator,
            quote_char=None if self._dialect.separator == BLANKS else '"',
            glob=False,
            encoding="utf8-lossy",
            ignore_errors=True,
            truncate_ragged_lines=True,
            missing_columns="insert",
        )

    def _find_short_lines(self) -> list[int]:
        """Lines (from 1) with too few separators; empty if cells span lines."""
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
        if self._collect_frame(lines.select(odd_quotes.any())).item():
            return []
        # an empty line is a row without a time, and counted as such elsewhere
        separators = line.str.count_matches(self._polars_separator, literal=True)
        is_short = separators < len(self.names) - 1
        short = lines.filter(line.is_not_null() & is_short).select("number")
        return self._collect_frame(short).to_series().to_list()


def guess_polars_type_of_cells(cells: Sequence[str]) -> pl.DataType:
    """Type of a column, guessed from its first cells."""
    if not cells:
        return pl.String()
    if all(map(is_date_and_time_in_digits, cells)):
        return pl.String()
    if all(map(_WHOLE.fullmatch, cells)):
        return pl.Int64()
    return pl.Float64() if all(map(_FLOAT.fullmatch, cells)) else pl.String()


def _remove_temporary_copy(opened_file: Utf8Text) -> None:
    if opened_file.copy is not None:
        opened_file.copy.cleanup()


def _does_file_end_with_line_end(path: Path) -> bool:
    with path.open("rb") as file:
        file.seek(-1, 2)
        return file.read() in (b"\n", b"\r")

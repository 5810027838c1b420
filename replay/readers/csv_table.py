"""The rows of a CSV: too long, too short, or torn where its writer stopped in the middle of one."""

from collections.abc import Callable
from pathlib import Path
from typing import Final

import polars as pl
from polars.exceptions import PolarsError

from replay.messages.broken import BrokenBytesError

#: Stands in no text: a line is one cell.
_NO_SEPARATOR: Final = "\x1f"


class CsvColumns:
    """The columns of a CSV file."""

    def __init__(self, path: Path, note: Callable[[str], None]) -> None:
        """Look at all of it for rows that are too long, too short or torn; see `_rows`."""
        self._rows = _rows(path, note)
        self.names = _collected(self._rows.head(0)).columns

    def read(self, name: str) -> pl.Series:
        """A column as text, (rows,).

        Raises:
            BrokenBytesError: it cannot be read.
        """
        return _collected(self._rows.select(name)).to_series()


def _collected(frame: pl.LazyFrame) -> pl.DataFrame:
    try:
        return frame.collect(engine="streaming")
    except (PolarsError, OSError) as error:
        # polars spreads some messages over several lines
        raise BrokenBytesError(str(error).strip().partition("\n")[0]) from error


def _rows(path: Path, note: Callable[[str], None]) -> pl.LazyFrame:
    """A CSV as text, because a fault in a cell should cost that cell.

    Rows with too few cells end in nulls; the last one, where no line end follows it, is torn and
    left out, since its last cell may be half a number. (A last row that has all its cells needs no
    line end: RFC 4180.)

    Args:
        path: the file.
        note: told what is lost, in a sentence.

    Raises:
        BrokenBytesError: it is no CSV.
    """
    frame = _scan(path, cut_long_rows=False)
    nulls = pl.all().null_count()
    try:
        # polars notices a row that is too long only when it is to parse every column
        missing = _collected(frame.select(nulls)).row(0)
    except BrokenBytesError:
        note("rows with more cells than the header: what is too much is not read")
        frame = _scan(path, cut_long_rows=True)
        missing = _collected(frame.select(nulls)).row(0)
    short = _short_lines(path, len(missing)) if missing[-1] else []
    if not short:
        return frame
    rows: int = _collected(frame.select(pl.len())).item()
    if short[-1] == rows + 1 and not _ends_in_a_line_end(path):
        note(f"its last row (line {short.pop()}) is torn and not read")
        frame = frame.head(rows - 1)
    if short:
        note(
            f"rows with fewer cells than the header: {len(short):,}, the first in line {short[0]}; "
            "the cells that they lack are not there"
        )
    return frame


def _scan(path: Path, *, cut_long_rows: bool) -> pl.LazyFrame:
    return pl.scan_csv(
        path,
        infer_schema=False,
        glob=False,
        encoding="utf8-lossy",
        truncate_ragged_lines=cut_long_rows,
    )


def _short_lines(path: Path, columns: int) -> list[int]:
    """The lines (the header is 1) with too few separators; none where cells go over lines."""
    line = pl.col("line")
    lines = pl.scan_csv(
        path,
        has_header=False,
        schema={"line": pl.String},
        skip_lines=1,
        separator=_NO_SEPARATOR,
        quote_char=None,
        glob=False,
        encoding="utf8-lossy",
        truncate_ragged_lines=True,
        row_index_name="number",
        row_index_offset=2,
    )
    odd_quotes = line.str.count_matches('"', literal=True) % 2 == 1
    if _collected(lines.select(odd_quotes.any())).item():
        return []
    # an empty line is a row without a time, which is counted there
    is_short = line.str.count_matches(",", literal=True) < columns - 1
    short = lines.filter(line.is_not_null() & is_short).select("number")
    return _collected(short).to_series().to_list()


def _ends_in_a_line_end(path: Path) -> bool:
    with path.open("rb") as file:
        file.seek(-1, 2)
        return file.read() in (b"\n", b"\r")

"""A sheet of an Excel file as a text table of its stored values."""

import csv
import re
import tempfile
from contextlib import ExitStack
from datetime import date, datetime, time, timedelta
from pathlib import Path
from typing import Any, Final
from zipfile import BadZipFile, ZipFile

from replay.logs.messages.broken_bytes import BROKEN_BYTES, BrokenBytesError
from replay.logs.tables.hints import DialectError
from replay.logs.tables.table_limits import LIMITS

_SHEETS: Final = "xl/worksheets/"
#: Where a cell or a row is, in a sheet's XML.
_PLACE: Final = re.compile(rb"\br=[\"']([A-Z]{0,3})(\d{1,7})[\"']")


def write_sheet_as_csv(path: Path, sheet: str | None, copies: ExitStack) -> Path:
    """Write a sheet as a CSV.

    Args:
        path: an `.xlsx` file.
        sheet: name of the sheet, needed if several have data.
        copies: removes the CSV when closed.

    Raises:
        BrokenBytesError: it is not a workbook, or unpacks to more than a gigabyte.
        DialectError: the library is missing, or the sheet must be named.
    """
    try:
        from python_calamine import CalamineError, CalamineWorkbook
    except ImportError:
        raise DialectError(
            "Excel files need another library: pip install 'payscope[excel]', or save the sheet as "
            "CSV; nothing can be set"
        ) from None
    refuse_oversized_workbook(path)
    try:
        with path.open("rb") as file:
            book = CalamineWorkbook.from_object(file)
            chosen = _choose_sheet(book, sheet)
            folder = copies.enter_context(tempfile.TemporaryDirectory(prefix="payscope-table-"))
            place = Path(folder) / f"{path.stem}.csv"
            with place.open("w", encoding="utf-8", newline="") as text:
                writer = csv.writer(text)
                for row in book.get_sheet_by_name(chosen).iter_rows():
                    writer.writerow([_format_cell_as_text(value) for value in row])
    except (CalamineError, *BROKEN_BYTES) as error:
        raise BrokenBytesError(f"it cannot be read: {error}") from error
    return place


def _choose_sheet(workbook: Any, sheet: str | None) -> str:
    names: list[str] = workbook.sheet_names
    if sheet is not None:
        if sheet not in names:
            raise DialectError(f"no sheet '{sheet}'; it has {', '.join(names)}; set [log] sheet")
        return sheet
    full = [
        name for name in names if workbook.get_sheet_by_name(name).height >= LIMITS.sheet_min_rows
    ]
    if len(full) != 1:
        raise DialectError(f"{len(full)} sheets hold rows ({', '.join(names)}); set [log] sheet")
    return full[0]


def _format_cell_as_text(value: Any) -> str:
    """Value as a cell of a text table."""
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, float):
        return repr(int(value)) if value.is_integer() and abs(value) < 2**53 else repr(value)
    if isinstance(value, datetime):
        return value.isoformat(sep=" ")
    if isinstance(value, time | date):
        return value.isoformat()
    if isinstance(value, timedelta):
        return repr(value.total_seconds())
    return str(value)


class _SheetExtent:
    """Last row and column of a sheet, whose cells must all fit into memory."""

    def __init__(self) -> None:
        self._row, self._column = 1, 1

    def update_from_xml_text(self, xml_text: bytes) -> None:
        """Search for cell positions (`r="XFD12"`) and rows (`r="12"`).

        Raises:
            BrokenBytesError: the sheet is too large.
        """
        for column, row in _PLACE.findall(xml_text):
            number = 0
            for letter in column:
                number = number * 26 + letter - ord("A") + 1
            self._row = max(self._row, int(row))
            self._column = max(self._column, number)
        if self._row * self._column > LIMITS.sheet_cells:
            raise BrokenBytesError(
                f"a sheet of {self._row:,} rows and {self._column:,} columns is too large; save it "
                "as CSV"
            )


def refuse_oversized_workbook(path: Path) -> None:
    """Unpack the file once without storing it, since the declared size of a bomb may be false."""
    try:
        with ZipFile(path) as archive:
            left = LIMITS.workbook_bytes
            for member in archive.infolist():
                corner, tail = _SheetExtent(), b""
                with archive.open(member) as file:
                    while piece := file.read(LIMITS.workbook_piece_bytes):
                        left -= len(piece)
                        if member.filename.startswith(_SHEETS):
                            corner.update_from_xml_text(tail + piece)
                            tail = piece[-LIMITS.place_bytes :]
                        if left < 0:
                            raise BrokenBytesError(
                                f"it unpacks to more than {LIMITS.workbook_bytes >> 30} GiB; save "
                                "it as CSV"
                            )
    except (BadZipFile, NotImplementedError, RuntimeError, OSError, *BROKEN_BYTES) as error:
        if isinstance(error, BrokenBytesError):
            raise
        raise BrokenBytesError(f"it is not a workbook: {error}") from error

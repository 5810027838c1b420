"""Provide a table as UTF-8 text: the file itself, or a copy if polars cannot read it directly.

A sheet of an Excel file is copied with its stored values; formulas are not evaluated.
"""

import codecs
import csv
import gzip
import io
import re
import tempfile
import zlib
from collections.abc import Iterator
from contextlib import ExitStack, suppress
from dataclasses import dataclass
from datetime import date, datetime, time, timedelta
from pathlib import Path
from typing import Any, Final
from zipfile import BadZipFile, ZipFile

from replay.logs.messages.broken_bytes import (
    BROKEN_BYTES,
    BrokenBytesError,
    describe_file_of_other_format,
)
from replay.logs.tables.hints import DialectError
from replay.logs.tables.table_limits import LIMITS

_MARKS: Final = (
    (codecs.BOM_UTF8, "utf-8-sig"),
    (codecs.BOM_UTF16_LE, "utf-16"),
    (codecs.BOM_UTF16_BE, "utf-16"),
)
_GZIP: Final = b"\x1f\x8b"
#: Arabic decimal, thousands and percent signs, and full-width point and minus, to ASCII.
_OTHER_SIGNS: Final = {0x066B: ".", 0x066C: "’", 0x066A: "%", 0xFF0E: ".", 0xFF0D: "-"}
_SHEETS: Final = "xl/worksheets/"
#: Reference of a cell or a row in a sheet's XML.
_PLACE: Final = re.compile(rb"\br=[\"']([A-Z]{0,3})(\d{1,7})[\"']")


@dataclass(frozen=True, slots=True)
class Utf8Text:
    """Text file in UTF-8 that polars can read.

    Attributes:
        path: file of the table, or a copy.
        copy: temporary directory of the copy; None without a copy.
        notes: notes on what was detected.
    """

    path: Path
    copy: "tempfile.TemporaryDirectory[str] | None" = None
    notes: tuple[str, ...] = ()


def convert_file_to_utf8(path: Path, encoding: str | None) -> Utf8Text:
    """Return the table in UTF-8: the file, or a copy if it is compressed or encoded otherwise.

    Args:
        path: a text file.
        encoding: its encoding, if given.

    Raises:
        BrokenBytesError: unknown encoding, or the text is not in it.
        DialectError: the encoding must be given.
    """
    with path.open("rb") as file:
        if file.read(2) == _GZIP:
            return _decompress_gzip_to_utf8(path, encoding)
    found = encoding or _detect_text_encoding(path)
    try:
        name = codecs.lookup(found).name
        # some codecs decode to bytes, not text: base64
        io.TextIOWrapper(io.BytesIO(), found)
    except (LookupError, ValueError):
        raise BrokenBytesError(
            f"no encoding '{found}'; set [log] encoding, such as utf-8, utf-16, latin-1, cp1251 or "
            "cp932"
        ) from None
    notes = () if encoding or name.startswith("utf-8") else (f"its text is decoded as {found}",)
    if _does_file_use_cr_line_ends(path):
        notes = (*notes, "its lines end in a carriage return alone")
        return _write_lines_as_utf8_copy(
            path, _iter_decoded_lines(path, found, is_any_line_end_accepted=True), notes
        )
    if name in ("utf-8", "ascii", "utf-8-sig"):
        return Utf8Text(path)
    return _write_lines_as_utf8_copy(path, _iter_decoded_lines(path, found), notes)


def _decompress_gzip_to_utf8(path: Path, encoding: str | None) -> Utf8Text:
    """Decompress a gzip file to a temporary copy in UTF-8."""
    folder = tempfile.TemporaryDirectory(prefix="payscope-table-")
    place = Path(folder.name) / path.name.removesuffix(".gz")
    try:
        with gzip.open(path) as packed, place.open("wb") as file:
            left = LIMITS.unpacked_bytes
            while piece := packed.read(LIMITS.piece_bytes):
                left -= len(piece)
                if left < 0:
                    raise BrokenBytesError(
                        f"it unpacks to more than {LIMITS.unpacked_bytes >> 30} GiB; split it"
                    )
                file.write(piece)
        text = convert_file_to_utf8(place, encoding) if place.stat().st_size else None
    except (OSError, EOFError, zlib.error) as error:
        folder.cleanup()
        raise BrokenBytesError(f"it cannot be unpacked: {error}") from error
    except BaseException:
        folder.cleanup()
        raise
    if text is None:
        folder.cleanup()
        raise BrokenBytesError("it is empty when unpacked")
    if text.copy is None:
        return Utf8Text(place, folder, text.notes)
    folder.cleanup()
    return text


def _does_file_use_cr_line_ends(path: Path) -> bool:
    """Whether lines end in a carriage return alone, as in files from classic Mac OS."""
    with path.open("rb") as file:
        head = file.read(LIMITS.head_bytes)
    return b"\n" not in head and head.count(b"\r") > 1


def copy_with_blanks_as_tabs(text: Utf8Text) -> Utf8Text:
    """Copy a text with each run of blanks replaced by a tab."""
    lines = ("\t".join(line.split()) + "\n" for line in _iter_decoded_lines(text.path, "utf-8-sig"))
    return _write_lines_as_utf8_copy(text.path, lines, text.notes)


def copy_with_ascii_digits(text: Utf8Text) -> Utf8Text | None:
    """Copy a text with digits of other scripts, such as ١٢٫٥ and １２.５, converted to ASCII.

    None if most digits at the start of the text are ASCII: other digits are then in names.
    """
    with text.path.open("rb") as file:
        head = file.read(LIMITS.head_bytes)
    digits = [] if head.isascii() else re.findall(r"\d", head.decode(errors="ignore"))
    if 2 * sum(map(str.isascii, digits)) >= len(digits):
        return None
    beyond = map(chr, range(0x80, 0x10000))
    table = {ord(each): str(int(each)) for each in beyond if each.isdecimal()}
    lines = (
        line.translate(table | _OTHER_SIGNS) for line in _iter_decoded_lines(text.path, "utf-8-sig")
    )
    return _write_lines_as_utf8_copy(
        text.path, lines, (*text.notes, "its digits belong to another script")
    )


def copy_without_unclosed_quote(text: Utf8Text, separator: str) -> Utf8Text | None:
    """Copy a text without a last row that ends after an opening quote, on which polars panics.

    None if there is no such row.
    """
    with text.path.open("rb") as file:
        size = file.seek(0, 2)
        file.seek(max(size - LIMITS.piece_bytes, 0))
        tail = file.read()
    if not tail.endswith((b'\n"', separator.encode() + b'"')):
        return None
    end = size - len(tail) + tail.rfind(b"\n") + 1
    folder = tempfile.TemporaryDirectory(prefix="payscope-table-")
    place = Path(folder.name) / text.path.name
    with text.path.open("rb") as file, place.open("wb") as copy:
        while end > 0 and (piece := file.read(min(LIMITS.piece_bytes, end))):
            copy.write(piece)
            end -= len(piece)
    return Utf8Text(place, folder, text.notes)


def _write_lines_as_utf8_copy(path: Path, lines: Iterator[str], notes: tuple[str, ...]) -> Utf8Text:
    folder = tempfile.TemporaryDirectory(prefix="payscope-table-")
    place = Path(folder.name) / path.name
    try:
        with place.open("w", encoding="utf-8", newline="") as file:
            file.writelines(lines)
    except (OSError, UnicodeError) as error:
        folder.cleanup()
        raise BrokenBytesError(f"its text cannot be read: {error}") from error
    return Utf8Text(place, folder, notes)


def _iter_decoded_lines(
    path: Path, encoding: str, *, is_any_line_end_accepted: bool = False
) -> Iterator[str]:
    with path.open(
        encoding=encoding, errors="replace", newline=None if is_any_line_end_accepted else ""
    ) as file:
        # in pieces: in a damaged file, a single line may be all of it
        while piece := file.readline(LIMITS.piece_bytes):
            yield piece


def _detect_text_encoding(path: Path) -> str:
    with path.open("rb") as file:
        head = file.read(LIMITS.head_bytes)
    if other := describe_file_of_other_format(head, ""):
        raise BrokenBytesError(other)
    for mark, name in _MARKS:
        if head.startswith(mark):
            return name
    for places, name in ((head[1::2], "utf-16-le"), (head[::2], "utf-16-be")):
        if places and places.count(0) > LIMITS.utf16_nul_fraction * len(places):
            return name
    with suppress(UnicodeDecodeError):
        codecs.getincrementaldecoder("utf-8")().decode(head)
        return "utf-8"
    if _OTHER_LETTERS.search(
        b"\n".join(head.split(b"\n", LIMITS.names_lines)[: LIMITS.names_lines])
    ):
        raise DialectError(
            "its column names are neither UTF-8 nor Western; set [log] encoding, such as cp1251 or "
            "cp932,"
        )
    # bytes that no text has are faults of single cells, which polars reads as they are
    readable = re.sub(rb"[^\x20-\x7e\t\r\n]", b"", head)
    return "cp1252" if len(readable) > LIMITS.ascii_min_fraction * len(head) else "utf-8"


#: Three non-ASCII letters in a row, which no Western language has. Only the lines of names are
#: searched for them, since damaged cells have them too.
_OTHER_LETTERS: Final = re.compile(rb"[\x80-\xff]{3}")


def read_first_lines(path: Path) -> list[str]:
    """Read the first complete lines of a UTF-8 text, from which its dialect is detected."""
    with path.open("rb") as file:
        head = file.read(LIMITS.head_bytes)
        while head.count(b"\n") < LIMITS.head_min_lines and len(head) < LIMITS.head_max_bytes:
            more = file.read(LIMITS.head_bytes)
            if not more:
                break
            head += more
        is_all = not file.read(1)
    text = head.decode("utf-8-sig", errors="replace")
    # polars does not end a line at a lone carriage return
    lines = text.split("\n")
    if not is_all and len(lines) > 1:
        lines.pop()
    if lines and not lines[-1]:
        lines.pop()
    return [line.removesuffix("\r") for line in lines[: LIMITS.head_lines]]


def write_sheet_as_csv(path: Path, sheet: str | None, copies: ExitStack) -> Path:
    """Write a sheet of a workbook to a temporary CSV file, and return its path.

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
            "CSV; its format can then be set"
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
        raise DialectError(
            f"{len(full)} of its sheets have rows ({', '.join(names)}); set [log] sheet"
        )
    return full[0]


def _format_cell_as_text(value: Any) -> str:
    """Format the value of a cell for a text table."""
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
        """Extend the sheet to the cells (`r="XFD12"`) and rows (`r="12"`) in a piece of XML.

        Raises:
            BrokenBytesError: the sheet has more than `LIMITS.sheet_cells` cells.
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
    """Raise an error for a workbook that unpacks to more than `LIMITS.workbook_bytes`.

    It is unpacked once without being stored, since the size that it declares may be false.
    """
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

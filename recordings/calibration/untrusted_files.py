"""Read untrusted tables, recordings and PDFs of a bundle in separate processes, which may crash.

A few bytes of Parquet can unpack to gigabytes, and some damaged files crash Arrow's reader. So
tables of bundles are neither compressed nor encoded, and a separate process with limits reads them.
The words of a bundle's PDF are compared with its page.
"""

import hashlib
import io
import json
import math
import re
import subprocess
import sys
import tempfile
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from html.parser import HTMLParser
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final, NamedTuple

import polars as pl

from recordings.calibration.bundle_folder import PDF, copy_bundle_file_and_return_sha256
from recordings.calibration.bundle_limits import LIMITS
from recordings.calibration.calibration_report import write_report_pdf

if TYPE_CHECKING:
    import pyarrow as pa


_TABLE_READER: Final = Path(__file__).with_name("parquet_process.py")
#: Arrow's name of the type that `encode_uncompressed_parquet_table` gives a column, as text, since
#: only the reader's process imports Arrow.
_ARROW: Final[Mapping[type[pl.DataType], str]] = {
    pl.String: "string",
    pl.Float64: "double",
    pl.Int64: "int64",
    pl.Boolean: "bool",
}

Schema = Mapping[str, type[pl.DataType]]
#: Module that the process for recordings and PDFs runs.
_FILE_READER: Final = "recordings.calibration.digest_process"
_DAMAGED: Final = "is so damaged that it crashes the reader"
#: Bullet of a list, which in a PDF comes at the end of the page.
_BULLET: Final = "•"
_NUMBER: Final = re.compile(r"[-+−±]?\d[\d,.]*")


def encode_uncompressed_parquet_table(frame: pl.DataFrame) -> bytes:
    """Encode a frame as Parquet, without compression and dictionaries."""
    import pyarrow.parquet as pq

    buffer = io.BytesIO()
    pq.write_table(
        _convert_to_plain_arrow(frame),
        buffer,
        compression="none",
        use_dictionary=False,
        write_statistics=False,
        store_schema=False,
    )
    return buffer.getvalue()


@dataclass(frozen=True, slots=True)
class UntrustedTable:
    """A table from an untrusted source.

    Attributes:
        data: content.
        schema: required columns in order.
    """

    data: bytes
    schema: Schema


def read_untrusted_tables(tables: Sequence[UntrustedTable]) -> list[pl.DataFrame | str]:
    """Read untrusted tables in the format of `encode_uncompressed_parquet_table`.

    Returns:
        The frame of each table, or its fault: it has other columns, is compressed or encoded, has
        too many rows or a number that is not finite, or is damaged.
    """
    said = run_table_reader_on_untrusted_tables(tables)
    if said is None and len(tables) > 1:  # a table crashed the reader: read each by itself
        return [each for table in tables for each in read_untrusted_tables([table])]
    if said is None:
        return ["is so damaged that it crashes the reader"]
    return [
        _make_frame_or_describe_fault(each, table.schema)
        for each, table in zip(said, tables, strict=True)
    ]


def run_table_reader_on_untrusted_tables(
    tables: Sequence[UntrustedTable],
) -> list[dict[str, Any]] | None:
    """Run the reader's process on tables; its result for each, or None if it crashed."""
    asked = json.dumps(
        [
            {
                "bytes": len(table.data),
                "columns": [[name, _ARROW[dtype]] for name, dtype in table.schema.items()],
            }
            for table in tables
        ]
    )
    data = b"".join(table.data for table in tables)
    ask = _ask_once if len(data) <= LIMITS.kept_tables_bytes else run_table_reader_process
    out = ask(asked, data)
    return None if out is None else json.loads(out)


def run_table_reader_process(request_json: str, tables_bytes: bytes) -> bytes | None:
    """Run the reader's process, and return its JSON output, or None if it crashed."""
    # the process gets only the expected columns and the bytes, and writes JSON
    child = subprocess.Popen(
        [sys.executable, "-I", str(_TABLE_READER), request_json],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        stderr=subprocess.DEVNULL,
    )
    try:
        out, _ = child.communicate(tables_bytes, timeout=LIMITS.tables_max_s)
    except subprocess.TimeoutExpired:
        child.kill()
        child.communicate()
        return None
    return None if child.returncode or len(out) > LIMITS.tables_output_bytes else out


#: Cached, since the reader takes a quarter of a second to start, and equal bytes give equal output.
_ask_once: Final = lru_cache(maxsize=16)(run_table_reader_process)


def _make_frame_or_describe_fault(
    reader_output: dict[str, Any], schema: Schema
) -> pl.DataFrame | str:
    """Make the frame of an untrusted table, or state the fault that makes it unusable."""
    if "fault" in reader_output:
        return str(reader_output["fault"])
    columns: dict[str, list[Any]] = reader_output["columns"]
    for values in columns.values():
        if any(isinstance(v, float) and not math.isfinite(v) for v in values):
            return "holds a number that is not finite"
    return pl.DataFrame(columns, schema=dict(schema))


def _convert_to_plain_arrow(frame: pl.DataFrame) -> "pa.Table":
    """Convert a frame to Arrow with plain types, without large strings and string views."""
    import pyarrow as pa

    table = frame.to_arrow()
    texts = (pa.types.is_large_string, pa.types.is_string_view)
    fields = [
        pa.field(f.name, pa.string() if any(is_text(f.type) for is_text in texts) else f.type)
        for f in table.schema
    ]
    return table.cast(pa.schema(fields))


@dataclass(frozen=True, slots=True)
class RecordingDigests:
    """Digests of a recording's content.

    Attributes:
        inputs: SHA-256 of each input file.
        settings: digest of machine and settings.
        results: digest of all frames.
        frames: digest of each frame, by name.
        notes: notes of the recording.
    """

    inputs: tuple[str, ...]
    settings: str
    results: str
    frames: Mapping[str, str]
    notes: tuple[str, ...]


def digest_bundle_recordings(
    folder: Path, expected_digests: Mapping[str, str]
) -> dict[str, RecordingDigests | str]:
    """Compute the digests of a bundle's recordings.

    Args:
        folder: the bundle.
        expected_digests: required SHA-256 of each file, by name.

    Returns:
        Digests of each recording, or why there are none, by name.
    """
    said = read_untrusted_files_in_child_process("recording", folder, expected_digests)
    return {
        name: each
        if isinstance(each, str)
        else RecordingDigests(
            tuple(each["inputs"]),
            each["settings"],
            each["results"],
            each["frames"],
            tuple(each["notes"]),
        )
        for name, each in said.items()
    }


def read_pdf_words_or_describe_fault(folder: Path, name: str, sha256: str) -> list[str] | str:
    """Read the words of a PDF in the order of its pages, or say why it cannot be read."""
    said = read_untrusted_files_in_child_process("pdf", folder, {name: sha256})[name]
    return said if isinstance(said, str) else [str(word) for word in said["words"]]


def read_untrusted_files_in_child_process(
    file_type: str, folder: Path, expected_digests: Mapping[str, str]
) -> dict[str, dict[str, Any] | str]:
    """Read files in a separate process, from copies that no other process can change."""
    found: dict[str, dict[str, Any] | str] = {}
    with tempfile.TemporaryDirectory(prefix="payscope-") as place:
        copies: dict[str, Path] = {}
        for number, (name, sha256) in enumerate(expected_digests.items()):
            copy = Path(place) / f"{number}{Path(name).suffix}"
            if copy_bundle_file_and_return_sha256(folder, name, copy) != sha256:
                found[name] = "is not the file whose digest the bundle has"
            else:
                copies[name] = copy
        said = run_reader_process(file_type, list(copies.values()))
        for number, (name, copy) in enumerate(copies.items()):
            # a file crashed the process: read each by itself
            each = (
                said[number]
                if said is not None
                else (run_reader_process(file_type, [copy]) or [None])[0]
            )
            found[name] = _DAMAGED if each is None else each.get("fault", each)
    return found


def run_reader_process(file_type: str, copied_files: Sequence[Path]) -> list[dict[str, Any]] | None:
    """Run the reader's process on copied files; its result for each, or None if it crashed."""
    if not copied_files:
        return []
    child = subprocess.Popen(
        [sys.executable, "-P", "-m", _FILE_READER, file_type, *map(str, copied_files)],
        stdin=subprocess.DEVNULL,
        stdout=subprocess.PIPE,
        stderr=subprocess.DEVNULL,
        cwd=copied_files[0].parent,
    )
    try:
        out, _ = child.communicate(timeout=LIMITS.recordings_max_s)
    except subprocess.TimeoutExpired:
        child.kill()
        child.communicate()
        return None
    return None if child.returncode or len(out) > LIMITS.answer_bytes else json.loads(out)


class PdfComparison(NamedTuple):
    """Fault of a PDF, and why it was not compared; "" for none."""

    fault: str
    reason_not_compared: str


def compare_words_of_pdf_with_html(folder: Path, pdf_sha256: str, page_html: str) -> PdfComparison:
    """Compare the PDF of a bundle with one made from its page.

    With other fonts or another version of WeasyPrint, pages break elsewhere and parts may be in
    another order. So repeated table heads, bullets and page numbers are ignored, and if the order
    differs, only the numbers are compared.

    Args:
        folder: the bundle.
        pdf_sha256: SHA-256 of the PDF in the evidence.
        page_html: the report as HTML.

    Returns:
        The fault, "" if there is none; and why the PDF could not be compared, "" if it was.
    """
    if find_spec("pypdf") is None:
        return PdfComparison("", "pypdf is not installed (pip install 'payscope[pdf]')")
    with tempfile.TemporaryDirectory(prefix="payscope-") as place:
        own = Path(place) / PDF
        missing = write_report_pdf(page_html, own)
        if missing:
            return PdfComparison("", missing.removeprefix("no PDF: "))
        wanted = read_pdf_words_or_describe_fault(
            own.parent, PDF, hashlib.sha256(own.read_bytes()).hexdigest()
        )
    found = read_pdf_words_or_describe_fault(folder, PDF, pdf_sha256)
    if isinstance(found, str):
        return PdfComparison(found, "")
    if isinstance(wanted, str):
        return PdfComparison("", f"the PDF that this payscope makes {wanted}")
    heads = collect_table_heads(page_html)
    fault = describe_first_difference(
        join_words_without_page_heads(wanted, heads), join_words_without_page_heads(found, heads)
    )
    if fault and count_numbers_outside_table_heads(
        wanted, heads
    ) == count_numbers_outside_table_heads(found, heads):
        return PdfComparison(
            "",
            "it is laid out with other fonts or another version of WeasyPrint; its numbers are the "
            "same",
        )
    return PdfComparison(fault, "")


def join_words_without_page_heads(words: Iterable[str], table_heads: Iterable[str]) -> str:
    """Join words without spaces, and remove table heads, which are repeated at page breaks.

    Args:
        words: words of all pages.
        table_heads: table heads, without spaces.
    """
    text = "".join(word for word in words if word != _BULLET)
    for head in sorted(table_heads, key=len, reverse=True):
        text = text.replace(head, "")
    return text


def count_numbers_outside_table_heads(
    words: Iterable[str], table_heads: Iterable[str]
) -> Counter[str]:
    """Count the occurrences of each number outside table heads, in any order."""
    in_heads = {number for head in table_heads for number in _NUMBER.findall(head)}
    plain = (word.strip("()[]:;,.%") for word in words)
    return Counter(word for word in plain if _NUMBER.fullmatch(word) and word not in in_heads)


def describe_first_difference(expected_text: str, found_text: str) -> str:
    """Describe the first difference of two texts; "" if they are equal."""
    if expected_text == found_text:
        return ""
    pairs = enumerate(zip(expected_text, found_text, strict=False))
    at = next((k for k, (a, b) in pairs if a != b), min(len(expected_text), len(found_text)))
    start = max(0, at - LIMITS.context_characters)
    there, here = (
        text[start : at + LIMITS.difference_characters] or "nothing"
        for text in (found_text, expected_text)
    )
    return f"reads '{there}' where report.html has '{here}'"


class _TableHeadParser(HTMLParser):
    """HTML parser that collects the text of each `thead`."""

    def __init__(self) -> None:
        super().__init__()
        self.found: list[str] = []
        self._inside = False

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:  # noqa: ARG002
        if tag == "thead":
            self._inside = True
            self.found.append("")

    def handle_endtag(self, tag: str) -> None:
        if tag == "thead":
            self._inside = False

    def handle_data(self, data: str) -> None:
        if self._inside:
            self.found[-1] += "".join(data.split())


def collect_table_heads(page_html: str) -> set[str]:
    """Collect the table heads of a page, without spaces."""
    parser = _TableHeadParser()
    parser.feed(page_html)
    return {head for head in parser.found if head}

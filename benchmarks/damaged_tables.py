"""Damaged and hostile tables: one line, or losses that are declared; never a crash.

    python -P benchmarks/damaged_tables.py [SEEDS]

Files of the table of dialects with their rows cut, mixed, doubled or overwritten, and hostile ones
that are written for it, go through what `info` and `init` do. Prints what became of them, the
slowest, and by how much the process grew; a traceback ends it.
"""

import gzip
import io
import random
import resource
import sys
import tempfile
import time
import zipfile
from collections import Counter
from functools import cache
from pathlib import Path
from typing import Final

import xlsxwriter

from benchmarks.dialects.dialect_file import DialectFile
from benchmarks.dialects.every_file import every_file
from estimators.errors import LogError
from replay.init.describe_log import describe_log_by_index
from replay.init.guess_machine import draft_machine_file
from replay.logs import open_log

#: Bytes of a file that is damaged.
_HEAD: Final = 40_000
_TEXT: Final = (".csv", ".txt", ".tsv", ".dat", ".asc", ".prn", ".pos")


@cache
def _bases() -> list[DialectFile]:
    return [f for f in every_file() if f.suffix in _TEXT and f.name != "a thousand columns"]


def damaged(seed: int) -> tuple[str, bytes]:
    """A file of the table of dialects with its rows cut, mixed, doubled or overwritten."""
    rng = random.Random(seed)  # noqa: S311 a test
    file = _bases()[seed % len(_bases())]
    data = bytearray(file.data[:_HEAD])
    for _ in range(rng.randint(1, 4)):
        at = rng.randrange(len(data))
        kind = rng.randrange(9)
        if kind == 0:
            del data[at:]
        elif kind == 1:
            data[at:at] = b'"'
        elif kind == 2:
            data[at : at + 30] = rng.randbytes(30)
        elif kind == 3:
            data[at:at] = b"9" * 5000
        elif kind == 4:
            data[at:at] = "größe;äöü\n".encode("latin-1")
        elif kind == 5:
            data[at:at] = data[: rng.randrange(1, 2000)]
        elif kind == 6:
            data[at:at] = b"\0" * rng.randrange(1, 500)
        elif kind == 7:
            data[at:at] = b"," * rng.randrange(1, 3000)
        else:
            del data[at : at + rng.randrange(1, 5000)]
        data = data or bytearray(b"\n")
    return file.suffix, bytes(data)


_ROWS: Final = b"".join(b"%d.%02d,%d\n" % (k // 50, k % 50 * 2, k) for k in range(300))


def hostile() -> dict[str, bytes]:
    """Hostile texts."""
    return {
    "nothing but quotes": b'"' * 10_000,
    "an open quote": b'time_s,a\n0,"1\n' + _ROWS,
    "one long line": b"1" * 3_000_000,
    "a number of 5,000 digits": b"time_s,a\n0.0," + b"7" * 5000 + b"\n" + _ROWS,
    "a time of 5,000 digits": b"time_s,a\n" + b"7" * 5000 + b",1\n" + _ROWS,
    "a hundred thousand columns": b"time_s," + b",".join(b"c%d" % k for k in range(100_000))
    + b"\n" + b"\n".join(b"%d" % k + b",1" * 100_000 for k in range(3)),
    "formulas": b"time_s,a\n" + b"".join(b"%d.5,=1+1\n" % k for k in range(50)),
    "commands": b"time_s,=cmd|' /C calc'!A0\n" + _ROWS,
    "names of brackets": b"time_s,[bold]a[/bold]\n" + _ROWS,
    "names of escapes": b"time_s,\x1b[31ma\n" + _ROWS,
    "names of our own": b"time_s,log_time_ns,header_stamp_ns,log_time_ns\n"
    + b"".join(b"%d.5,1,2,3\n" % k for k in range(50)),
    "the separator of lines in a name": b"time_s,\x1fbeyond,\x1f\n"
    + b"".join(b"%d.5,1,2\n" % k for k in range(50)),
    "ten thousand equal names": b"time_s" + b",a" * 10_000 + b"\n"
    + b"".join(b"%d.5" % k + b",1" * 10_000 + b"\n" for k in range(5)),
    "NULs": b"\0" * 100_000,
    "a mark alone": b"\xff\xfe",
    "half a mark": b"\xef\xbb",
    "UTF-16 cut in a letter": "time_s,a\n0,1\n".encode("utf-16")[:-1],
    "line ends alone": b"\r\n" * 1000,
    "carriage returns": b"time_s,a\r0.5,1\r1.0,2\r",
    "separators alone": b";;;;;\n" * 1000,
    "inf and nan": b"time_s,a\n" + b"inf,nan\nnan,inf\n-inf,1\n" * 50,
    "times beyond 64 bits": b"time_s,a\n" + b"1e300,1\n-1e300,2\n" * 50,
    "all at once": b"time_s,a\n" + b"1.5,1\n" * 100,
    "dates that are none": b"Date,a\n" + b"31/02/2026 25:61:61,1\n99/99/9999 10:00:00,2\n" * 50,
    "months of no month": b"time,a\n" + b"2026-13-45T00:00:00Z,1\n" * 50,
    "binary": bytes(range(256)) * 400,
    "JSON": b'[{"time": 0, "a": 1},\n{"time": 1, "a": 2}]\n' * 40,
    "XML": b"<log><row t='0' a='1'/>\n<row t='1' a='2'/></log>\n" * 40,
    "a page": b"<html>\n<body>404, not found</body>\n</html>\n",
    "one cell": b"1",
    "one column": b"force_N\n1\n2\n3\n",
    "headers again and again": (b"time_s,a\n" + _ROWS) * 5,
    "two tables": b"time_s,a\n" + _ROWS + b"\nname;value;unit\nx;1;m\n" * 30,
    "every row longer": b"time_s,a\n" + b"".join(b"%d" % k + b",1" * k + b"\n" for k in range(200)),
    "decimals in both": b"t;a\n" + b"0,5;1.5\n1.5;2,5\n" * 50,
    "thousands": b"time_s;a\n" + b"1.234;2.345\n2.345;3.456\n" * 50,
    "a zip": b"PK\3\4" + bytes(5000),
    "a bare quote in each row": b'time_s,a\n' + b'0.5,5"\n1.0,6"\n' * 50,
    "tabs and commas": b"time_s\ta,b\n" + b"0.5\t1,2\n1.0\t2,3\n" * 50,
    "UTF-32": "time_s,a\n0,1\n1,2\n".encode("utf-32"),
}  # fmt: skip


def _workbook(names: int = 1) -> bytes:
    file = io.BytesIO()
    with xlsxwriter.Workbook(file, {"in_memory": True}) as book:
        for number in range(names):
            sheet = book.add_worksheet(f"s{number}")
            sheet.write_row(0, 0, ["time_s", "a"])
            for k in range(50):
                sheet.write_number(k + 1, 0, k / 10)
                sheet.write_formula(k + 1, 1, '=WEBSERVICE("http://127.0.0.1:9")', None, k)
    return file.getvalue()


def _with_member(name: str, data: bytes) -> bytes:
    """A workbook with one of its members replaced, or one more."""
    old, new = zipfile.ZipFile(io.BytesIO(_workbook())), io.BytesIO()
    with zipfile.ZipFile(new, "w", zipfile.ZIP_DEFLATED) as archive:
        for member in old.namelist():
            if member != name:
                archive.writestr(member, old.read(member))
        archive.writestr(name, data)
    return new.getvalue()


_SHEET: Final = "xl/worksheets/sheet1.xml"
_ENTITIES: Final = (
    b'<?xml version="1.0"?><!DOCTYPE x [<!ENTITY a SYSTEM "file:///etc/passwd">'
    b'<!ENTITY b "&a;&a;&a;&a;&a;&a;&a;&a;">]><worksheet><sheetData><row r="1"><c r="A1" t="str">'
    b"<v>&b;</v></c></row></sheetData></worksheet>"
)
_LAUGHS: Final = (
    b'<?xml version="1.0"?><!DOCTYPE x [<!ENTITY a0 "ha">'
    + b"".join(b'<!ENTITY a%d "%s">' % (k, b"&a%d;" % (k - 1) * 10) for k in range(1, 12))
    + b']><worksheet><sheetData><row r="1"><c r="A1" t="str"><v>&a11;</v></c></row>'
    b"</sheetData></worksheet>"
)
_FAR_CELL: Final = (
    b'<?xml version="1.0"?><worksheet><sheetData><row r="1"><c r="A1"><v>1</v></c></row>'
    b'<row r="1048576"><c r="XFD1048576"><v>1</v></c></row></sheetData></worksheet>'
)


def packed() -> dict[str, tuple[str, bytes]]:
    """Hostile files that are packed: workbooks and gzip."""
    book = _workbook()
    zeros = gzip.compress(b"time_s,a\n" + b"0" * (1 << 24))
    return {
        "a workbook with formulas that call out": (".xlsx", book),
        "a workbook cut": (".xlsx", book[: len(book) // 2]),
        "a workbook without its end": (".xlsx", book[:-30]),
        "a workbook overwritten": (".xlsx", book[:900] + bytes(200) + book[1100:]),
        "a workbook of a hundred sheets": (".xlsx", _workbook(100)),
        "a workbook with outer entities": (".xlsx", _with_member(_SHEET, _ENTITIES)),
        "a workbook of a billion laughs": (".xlsx", _with_member(_SHEET, _LAUGHS)),
        "a workbook with a cell at its far corner": (".xlsx", _with_member(_SHEET, _FAR_CELL)),
        "a workbook with a sheet that is no XML": (".xlsx", _with_member(_SHEET, b"\0" * 5000)),
        "a zip of zeros": (".xlsx", _with_member("xl/media/z.bin", bytes(1 << 25))),
        "a gzip of one long line": (".csv.gz", zeros),
        "a gzip cut": (".csv.gz", zeros[: len(zeros) // 2]),
        "a gzip of a gzip": (".csv.gz", gzip.compress(zeros)),
        "a gzip that is none": (".csv.gz", b"time_s,a\n0,1\n1,2\n"),
        "a gzip of nothing": (".csv.gz", gzip.compress(b"")),
        "a gzip with rubbish behind": (".csv.gz", gzip.compress(b"time_s,a\n0,1\n1,2\n") + b"xyz"),
    }


def outcome(path: Path) -> str:
    """What `info` and `init` make of a file: refused in a line, with losses declared, or whole.

    Raises:
        AssertionError: a message of several lines.
    """
    try:
        with open_log(path) as log:
            described = describe_log_by_index(log)
            text, lacking = draft_machine_file(log, None)
            said = [*(loss.what for loss in log.losses()), *lacking, *described.notes]
            found = "losses declared" if log.losses() else "whole"
    except LogError as error:
        text, said, found = "refused", [str(error)], "refused"
    if not text or any("\n" in each for each in said):
        raise AssertionError(f"{path}: a message of several lines, or no draft")
    return found


def main(seeds: int) -> None:
    """Print the counts."""
    cases = {f"damaged {seed}": damaged(seed) for seed in range(seeds)}
    cases |= {name: (".csv", data) for name, data in hostile().items()} | packed()
    begun = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    counts: Counter[str] = Counter()
    times: list[tuple[float, str]] = []
    grown: list[tuple[float, str]] = []
    with tempfile.TemporaryDirectory() as folder:
        for name, (suffix, data) in cases.items():
            path = Path(folder) / f"log{suffix}"
            path.write_bytes(data or b"\n")
            before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
            start = time.perf_counter()
            counts[outcome(path)] += 1
            times.append((time.perf_counter() - start, name))
            after = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
            grown.append(((after - before) / 1e3, name))
    print(f"{len(cases)} tables: {dict(counts)}")
    print("slowest:", *(f"{s:.1f} s {name};" for s, name in sorted(times)[-5:]))
    print("grew most:", *(f"{mb:.0f} MB {name};" for mb, name in sorted(grown)[-5:]))
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    print(f"the process: {begun / 1e3:.0f} MB at first, {peak / 1e3:.0f} MB at most")


if __name__ == "__main__":
    main(int(sys.argv[1]) if len(sys.argv) > 1 else 200)

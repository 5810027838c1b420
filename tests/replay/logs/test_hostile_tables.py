"""Two hundred damaged and hostile tables: one line, or what was lost is declared; nothing else."""

import random
import resource
from pathlib import Path

import pytest

from benchmarks.dialects.every_file import SETS
from estimators.errors import LogError
from replay.logs import open_log
from tests.one_line import assert_one_line

#: The process may grow by so much over all of them, in MB.
MOST_MB = 1500
SEEDS = range(160)
BASES = [f for f in SETS["written with the reader"] if f.name != "a thousand columns"]


def damaged(seed: int) -> tuple[str, bytes]:
    """A file of the table of dialects with its rows cut, mixed, doubled or overwritten."""
    rng = random.Random(seed)
    file = BASES[seed % len(BASES)]
    data = bytearray(file.data[:40_000])
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


ROWS = b"".join(b"%d.%02d,%d\n" % (k // 50, k % 50 * 2, k) for k in range(300))
HOSTILE = {
    "nothing but quotes": b'"' * 10_000,
    "an open quote": b'time_s,a\n0,"1\n' + ROWS,
    "one long line": b"1" * 3_000_000,
    "a number of 5,000 digits": b"time_s,a\n0.0," + b"7" * 5000 + b"\n" + ROWS,
    "a time of 5,000 digits": b"time_s,a\n" + b"7" * 5000 + b",1\n" + ROWS,
    "a hundred thousand columns": b"time_s," + b",".join(b"c%d" % k for k in range(100_000))
    + b"\n" + b"\n".join(b"%d" % k + b",1" * 100_000 for k in range(3)),
    "formulas": b"time_s,a\n" + b"".join(b"%d.5,=1+1\n" % k for k in range(50)),
    "commands": b"time_s,=cmd|' /C calc'!A0\n" + ROWS,
    "names of brackets": b"time_s,[bold]a[/bold]\n" + ROWS,
    "names of escapes": b"time_s,\x1b[31ma\n" + ROWS,
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
    "headers again and again": (b"time_s,a\n" + ROWS) * 5,
    "two tables": b"time_s,a\n" + ROWS + b"\nname;value;unit\nx;1;m\n" * 30,
    "every row longer": b"time_s,a\n" + b"".join(b"%d" % k + b",1" * k + b"\n" for k in range(200)),
    "decimals in both": b"t;a\n" + b"0,5;1.5\n1.5;2,5\n" * 50,
    "thousands": b"time_s;a\n" + b"1.234;2.345\n2.345;3.456\n" * 50,
    "a zip": b"PK\3\4" + bytes(5000),
    "a bare quote in each row": b'time_s,a\n' + b'0.5,5"\n1.0,6"\n' * 50,
    "tabs and commas": b"time_s\ta,b\n" + b"0.5\t1,2\n1.0\t2,3\n" * 50,
    "UTF-32": "time_s,a\n0,1\n1,2\n".encode("utf-32"),
}  # fmt: skip


def read_all(path: Path) -> None:
    """Everything that `info` asks of a log."""
    try:
        with open_log(path) as log:
            for row in log.topics().iter_rows(named=True):
                log.read(row["topic"], row["fields"][:40])
            log.notes()
            losses = log.losses()
    except LogError as error:
        assert_one_line(error)
    else:
        assert all("\n" not in loss.what for loss in losses)


@pytest.mark.parametrize("seed", SEEDS)
def test_a_damaged_table_is_one_line_or_declared_losses(tmp_path: Path, seed: int) -> None:
    suffix, data = damaged(seed)
    path = tmp_path / f"log{suffix}"
    path.write_bytes(data or b"\n")
    read_all(path)


@pytest.mark.parametrize("name", HOSTILE)
def test_a_hostile_table_is_one_line_or_declared_losses(tmp_path: Path, name: str) -> None:
    path = tmp_path / "log.csv"
    path.write_bytes(HOSTILE[name])
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    read_all(path)
    assert (resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before) / 1e3 < MOST_MB

"""Errors for damaged data, the content of a log that violates its format.

Only calls of a library are guarded with `BROKEN_BYTES`, and the returned values are checked; both
raise `BrokenBytesError`, the only error that callers catch and report as damage. All errors of our
own code are passed on unchanged.
"""

import struct
from typing import Final

from estimators.errors import join_to_one_line

#: Errors that the format libraries raise for invalid bytes, besides errors of their own (lz4 raises
#: RuntimeError, bz2 OSError and EOFError, rosbags asserts).
BROKEN_BYTES: Final = (
    ArithmeticError,
    AssertionError,
    EOFError,
    LookupError,
    MemoryError,
    OSError,
    RuntimeError,
    TypeError,
    ValueError,
    struct.error,
)


#: First bytes of files whose suffix may be wrong, in full for formats with several versions.
_KINDS: Final = (
    (b"%PDF-", "a PDF document"),
    (b"\x89PNG", "a picture (PNG)"),
    (b"\xff\xd8\xff", "a picture (JPEG)"),
    (b"PK\x03\x04", "an Excel workbook or a ZIP archive; a workbook's name ends in .xlsx"),
    (b"\x1f\x8b", "packed by gzip; its name ends in .gz"),
    (b"PAR1", "a Parquet table; its name ends in .parquet"),
    (b"#ROSBAG V2.0\n", "a ROS 1 bag; its name ends in .bag"),
    (b"\x89MCAP0\r\n", "an MCAP file; its name ends in .mcap"),
    (b"SQLite format 3\0", "an SQLite database; that of rosbag2 ends in .db3"),
    (b"RRF2", "a recording; its name ends in .rrd"),
)
#: Number of first bytes that identify each of these formats.
KIND_BYTES: Final = 16


def describe_file_of_other_format(first_bytes: bytes, default_text: str) -> str:
    """Say what a file is by its first bytes, and which name it should have.

    Args:
        first_bytes: its first `KIND_BYTES`.
        default_text: text to return for a file of no known kind.
    """
    found = (f"it is {kind}" for mark, kind in _KINDS if first_bytes.startswith(mark))
    return next(found, default_text)


class BrokenBytesError(Exception):
    """Raised if data cannot be used; one line with the reason."""

    def __init__(self, why: object) -> None:
        super().__init__(join_to_one_line(" ".join(str(why).split())))

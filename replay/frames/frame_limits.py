"""Limits of reading logs as frames."""

from dataclasses import dataclass
from typing import Final


@dataclass(frozen=True)
class FrameLimits:
    """Limits of reading logs as frames.

    One section per file; a comment says what a value limits, in which unit, and how it was chosen.
    """

    # scan
    #: Time in s that the interpreter waits at its end for a chunk that is being read.
    scan_read_s: float = 30.0
    #: Time in s that it then waits for polars to close the scan.
    scan_close_s: float = 0.5

    # select_statement
    #: Most names that an error lists.
    max_names: int = 40

    # topic_source
    #: Most logs that are kept open: each has an open file, and log times of messages in memory.
    max_open_logs: int = 8


#: The values in use.
LIMITS: Final = FrameLimits()

"""Limits of logs as frames."""

from dataclasses import dataclass
from typing import Final


@dataclass(frozen=True)
class FrameLimits:
    """Limits of logs as frames.

    One section per file; a comment says what a value limits, in which unit, and how it was chosen.
    """

    # scan
    #: Time in s that the end of a scan waits for a chunk that is being read,
    scan_read_s: float = 30.0
    #: and for what polars does with it.
    scan_close_s: float = 0.5

    # select_statement
    #: Names that an error lists.
    max_names: int = 40

    # topic_source
    #: Logs that are kept open: each holds a file open and the log times of its messages.
    max_open_logs: int = 8


#: The values in use.
LIMITS: Final = FrameLimits()

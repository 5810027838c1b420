"""Sizes of the parts of a converted log."""

from dataclasses import dataclass
from typing import Final


@dataclass(frozen=True)
class ConvertLimits:
    """Sizes of the parts of a converted log.

    One section per file; a comment says what a value limits, in which unit, and how it was chosen.
    """

    # convert_log
    #: Most messages of a part, which are converted again after an interruption.
    span_messages: int = 2_000_000
    #: Most bytes of the log's files in a part.
    span_bytes: int = 512 << 20

    # unfinished_folder
    #: Rows of a row group: reading a few rows decompresses whole groups, but smaller groups take
    #: more space.
    group_rows: int = 1 << 17
    #: Bytes at which a row group ends, for large rows such as images.
    group_bytes: int = 32 << 20


#: The values in use.
LIMITS: Final = ConvertLimits()

"""Bounds of a notary's list, and of what is said of it."""

from dataclasses import dataclass
from typing import Final


@dataclass(frozen=True)
class NotaryLimits:
    """Bounds of a notary's list, and of what is said of it.

    One section per file; a comment says what a value limits, in which unit, and how it was chosen.
    """

    # notary_check
    #: Time in s by which the clocks of a recorder and of its notary may differ.
    clock_difference_s: int = 300
    #: Faults that are listed,
    max_faults: int = 20
    #: and entries that a fault names.
    max_entries: int = 8

    # notary_list
    #: Bytes of a line that are read,
    line_bytes: int = 1 << 20
    #: and of a list; a rosbag2 directory may have many files.
    list_bytes: int = 256 << 20


#: The values in use.
LIMITS: Final = NotaryLimits()

"""Bounds of a notary's list, and of what is reported about it."""

from dataclasses import dataclass
from typing import Final


@dataclass(frozen=True)
class NotaryLimits:
    """Bounds of a notary's list, and of what is reported about it.

    One section per file; a comment says what a value limits, in which unit, and how it was chosen.
    """

    # notary_check
    #: Time in s by which the clocks of a recorder and of its notary may differ.
    clock_difference_s: int = 300
    #: Most faults that are listed.
    max_faults: int = 20
    #: Most entries that a fault names.
    max_entries: int = 8

    # notary_list
    #: Most bytes of a line; a rosbag2 directory may have many files.
    line_bytes: int = 1 << 20
    #: Most bytes of a list.
    list_bytes: int = 256 << 20


#: The values in use.
LIMITS: Final = NotaryLimits()

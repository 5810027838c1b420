"""Built-in limits of reading the channels of logs, which no machine file can set."""

from dataclasses import dataclass
from typing import Final


@dataclass(frozen=True)
class InputLimits:
    """Built-in limits of reading the channels of logs, which no machine file can set.

    One section per file; a comment says what a value limits, in which unit, and how it was chosen.
    """

    # channel_inputs
    #: Time in ns by which parts of one recording reach into each other at most; what they reach
    #: further in is there twice, or of another recording.
    overlap_ns: int = 1_000_000_000
    #: Fraction of the messages in such a stretch that are in both at least.
    repeated_min_fraction: float = 0.5
    #: Names of a message's list that are read to find an element.
    max_names: int = 32

    # time_line
    #: Begin of a time, in ns, up to which it is counted from the file's own begin.
    from_zero_ns: int = 1_000_000_000
    #: Time between two logs that follow one another, which nobody knows, in s,
    between_logs_s: float = 10.0
    #: and in periods of the slowest topic: longer than a gap.
    between_logs_periods: float = 10.0
    #: Distance of two stamps of one phase, in periods.
    same_phase_periods: float = 1e-6


#: The values in use.
LIMITS: Final = InputLimits()

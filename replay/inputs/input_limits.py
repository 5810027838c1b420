"""Built-in limits of reading the channels of logs, which no machine file can set."""

from dataclasses import dataclass
from typing import Final


@dataclass(frozen=True)
class InputLimits:
    """Built-in limits of reading the channels of logs, which no machine file can set.

    One section per file; a comment says what a value limits, in which unit, and how it was chosen.
    """

    # channel_inputs
    #: Time in ns by which parts of one recording may overlap; with a longer overlap, it is recorded
    #: twice, or there are two recordings.
    overlap_ns: int = 1_000_000_000
    #: Smallest fraction of the messages in such an overlap that are in both logs.
    repeated_min_fraction: float = 0.5
    #: Most names that are read of a message's list `name` to find an element.
    max_names: int = 32

    # time_line
    #: First time of a log, in ns, up to which its times count from its own start.
    from_zero_ns: int = 1_000_000_000
    #: First time of a log, in ns, from which it is a date: the largest counter of milliseconds in
    #: 32 bits is 50 days.
    undated_ns: int = 60 * 86_400 * 1_000_000_000
    #: Time in ns from the end of a log to the start of the next one, a day later, up to which the
    #: clock has passed midnight between them.
    around_midnight_ns: int = 3_600 * 1_000_000_000
    #: Assumed time in s between consecutive logs, which is unknown.
    between_logs_s: float = 10.0
    #: Assumed time between consecutive logs in periods of the slowest topic: longer than a gap.
    between_logs_periods: float = 10.0
    #: Difference of two stamps, in periods, within which they have the same phase.
    same_phase_periods: float = 1e-6


#: The values in use.
LIMITS: Final = InputLimits()

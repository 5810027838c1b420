"""Built-in limits of following a log, which no file can set."""

from dataclasses import dataclass
from typing import Final


@dataclass(frozen=True)
class FollowLimits:
    """Built-in limits of following a log, which no file can set.

    One section per file; a comment says what a value limits, in which unit, and how it was chosen.
    """

    # agreement
    #: Relative difference of sums that is rounding: nine digits.
    same_sum_1: float = 1e-9

    # background_replay
    #: Share of one core that replays may take unless the caller says otherwise.
    replay_share_1: float = 0.1
    #: Lowest priority: whatever else the machine computes goes first.
    replay_niceness: int = 19
    #: Processes that may end without a result before no more are started while the log grows.
    max_ended_processes: int = 3
    #: Replays of the whole log that are begun: the process of one may end without a result.
    max_last_replays: int = 2
    #: Bytes of a result that are read at once.
    read_bytes: int = 1 << 20
    #: Bytes of a log that are more than its first seconds.
    worth_replaying_bytes: int = 1 << 20

    # follow_logs
    #: Time in s between two looks at the log: a row is at most as late as this and a look take, 50
    #: ms in all, and each look at something new costs some milliseconds of the processor.
    look_s: float = 0.04
    #: Time in s without growth after which a log counts as ended, unless the caller says otherwise.
    idle_s: float = 10.0

    # interrupts
    #: The interrupt that is raised after all, for a process that hangs where nobody looks.
    raised_interrupt: int = 4


#: The values in use.
LIMITS: Final = FollowLimits()

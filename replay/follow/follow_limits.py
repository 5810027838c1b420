"""Built-in limits of following a log, which no file can set."""

from dataclasses import dataclass
from typing import Final


@dataclass(frozen=True)
class FollowLimits:
    """Built-in limits of following a log, which no file can set.

    One section per file; a comment says what a value limits, in which unit, and how it was chosen.
    """

    # agreement
    #: Largest relative difference of sums that counts as rounding: nine digits agree.
    same_sum_1: float = 1e-9

    # background_replay
    #: Share of one core that replays may take unless the caller says otherwise.
    replay_share_1: float = 0.1
    #: Niceness of the process: lowest priority, so that everything else goes first.
    replay_niceness: int = 19
    #: Processes that may end without a result; after that, none is started while the log grows.
    max_ended_processes: int = 3
    #: Attempts at the last replay, of the whole log, since its process may end without a result.
    max_last_replays: int = 2
    #: Bytes of a result that are read at once.
    read_bytes: int = 1 << 20
    #: Bytes of a log from which a first replay is faster than following it.
    worth_replaying_bytes: int = 1 << 20

    # follow_logs
    #: Time in s between polls of the log: a row is late by at most this and the duration of a poll,
    #: 50 ms in all, and each poll with new data takes some milliseconds of processor time.
    look_s: float = 0.044
    #: Time in s without growth after which a log counts as ended, unless the caller says otherwise.
    idle_s: float = 10.0

    # interrupts
    #: Number of the interrupt that is raised after all, in case the process hangs.
    raised_interrupt: int = 4


#: The values in use.
LIMITS: Final = FollowLimits()

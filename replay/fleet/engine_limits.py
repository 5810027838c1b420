"""Limits of the replays of a fleet and of its storage that no fleet file sets."""

from dataclasses import dataclass
from typing import Final


@dataclass(frozen=True)
class EngineLimits:
    """Limits of the replays of a fleet and of its storage that no fleet file sets.

    One section per file; a comment says what a value limits, in which unit, and how it was chosen.
    """

    # object_store
    #: Objects that are fetched at once,
    objects_at_once: int = 16
    #: and the bytes of a part of one.
    chunk_bytes: int = 8 * 2**20

    # ray_engine
    #: Times that Ray starts a task of a lost worker or node again.
    max_retries: int = 3
    #: Tasks of a worker before another takes its place: Rerun keeps two threads and some 130 MB of
    #: address space of each recording that a process has written (rerun-io/rerun#2116).
    tasks_per_worker: int = 200
    #: Tasks that are handed to Ray for each slot beyond those that run: enough that no slot waits.
    tasks_ahead: int = 2
    #: Bytes of Ray's own storage: results go through the fleet's.
    ray_storage_bytes: int = 100 * 2**20
    #: Longest wait for a result, in s, before the next look,
    wait_s: float = 1.0
    #: and for the answer of a cluster.
    answer_s: float = 10.0

    # recording_task
    #: Time in s between two looks at the memory and the clock.
    look_s: float = 0.05
    #: Time in s to come back from a library before the process is ended.
    grace_s: float = 20.0

    # write_fleet_page
    #: Hexadecimal digits of a key that the page shows, enough to name a recording.
    shown_key_digits: int = 12


#: The values in use.
LIMITS: Final = EngineLimits()

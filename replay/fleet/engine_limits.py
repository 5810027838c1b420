"""Limits of the replays of a fleet and of its storage that no fleet file sets."""

from dataclasses import dataclass
from typing import Final


@dataclass(frozen=True)
class EngineLimits:
    """Limits of the replays of a fleet and of its storage that no fleet file sets.

    One section per file; a comment says what a value limits, in which unit, and how it was chosen.
    """

    # object_store
    #: Objects that are fetched in parallel.
    objects_at_once: int = 16
    #: Bytes of a chunk of an object that is downloaded.
    chunk_bytes: int = 8 * 2**20

    # ray_engine
    #: Number of times that Ray restarts a task of a lost worker or node.
    max_retries: int = 3
    #: Tasks after which a worker is replaced: Rerun keeps two threads and some 130 MB of address
    #: space for each recording that a process has written (rerun-io/rerun#2116).
    tasks_per_worker: int = 200
    #: Tasks per slot that are submitted to Ray in addition to the running ones, so that no slot
    #: waits.
    tasks_ahead: int = 2
    #: Bytes of Ray's object store, small since results are written to the fleet's storage.
    ray_storage_bytes: int = 100 * 2**20
    #: Longest wait for a result, in s, between checks.
    wait_s: float = 1.0
    #: Longest wait, in s, for a cluster to answer.
    answer_s: float = 10.0

    # recording_task
    #: Time in s between checks of memory and time.
    look_s: float = 0.05
    #: Time in s for a library to return before the process is ended.
    grace_s: float = 20.0

    # write_fleet_page
    #: Hexadecimal digits of a key on the page, enough to identify a recording.
    shown_key_digits: int = 12


#: The values in use.
LIMITS: Final = EngineLimits()

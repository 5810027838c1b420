"""The limits of one task: seconds and memory, held by the task itself.

A task that is over one is interrupted with the reason. One that cannot be interrupted, since it
hangs in a library, ends its process; the engine counts that and gives it up.
"""

import faulthandler
import os
import signal
import sys
import threading
import time
from collections.abc import Generator
from contextlib import contextmanager
from pathlib import Path
from types import FrameType
from typing import Final

#: Seconds between two looks at the memory and the clock.
_LOOK_S: Final = 0.05
#: Time to come back from a library before the process is ended.
_GRACE_S: Final = 20.0
_STATM: Final = Path("/proc/self/statm")
#: Bytes of a GiB.
_GIB: Final = 2**30


class LimitError(Exception):
    """A task is over one of its limits; its text says which."""


@contextmanager
def limited(seconds: float, memory_bytes: int) -> Generator[None]:
    """Interrupt what is inside when it is over a limit; of the main thread alone.

    Args:
        seconds: of wall-clock time.
        memory_bytes: that the process may grow by; what it held before is not of this task.

    Raises:
        LimitError: over a limit.
    """
    watch = _Watch(seconds, memory_bytes)
    before = signal.signal(signal.SIGALRM, watch.interrupt)
    if sys.stderr is not None and _has_file(sys.stderr):
        # also where the interpreter's lock is held for ever
        faulthandler.dump_traceback_later(seconds + 2 * _GRACE_S, exit=True)
    watch.start()
    try:
        yield
    finally:
        watch.done.set()
        watch.join()
        faulthandler.cancel_dump_traceback_later()
        signal.signal(signal.SIGALRM, before)


class _Watch(threading.Thread):
    """Looks at time and memory from beside."""

    def __init__(self, seconds: float, memory_bytes: int) -> None:
        super().__init__(name="limits", daemon=True)
        self.done = threading.Event()
        self._watched = threading.get_ident()
        self._end = time.monotonic() + seconds
        self._seconds, self._memory_bytes = seconds, memory_bytes
        self._held = resident_bytes()
        self._reason = ""

    def run(self) -> None:
        while not self.done.wait(_LOOK_S):
            self._reason = self._over()
            if self._reason:
                break
        if not self._reason or self.done.is_set():
            return
        signal.pthread_kill(self._watched, signal.SIGALRM)
        if not self.done.wait(_GRACE_S):
            os._exit(1)

    def interrupt(self, _number: int, _frame: FrameType | None) -> None:
        """Raise in the watched thread."""
        if self._reason and not self.done.is_set():
            raise LimitError(self._reason)

    def _over(self) -> str:
        if time.monotonic() > self._end:
            return f"took longer than {self._seconds:g} s, its limit"
        used = resident_bytes() - self._held
        if used > self._memory_bytes:
            return (
                f"needed more than {self._memory_bytes / _GIB:.2f} GiB of memory, twice what it "
                "declares; [limits] of the fleet file says how much that is"
            )
        return ""


def resident_bytes() -> int:
    """Resident memory of this process; 0 where the system does not say."""
    try:
        pages = int(_STATM.read_text(encoding="ascii").split()[1])
    except OSError:
        return 0
    return pages * os.sysconf("SC_PAGE_SIZE")


def _has_file(stream: object) -> bool:
    try:
        return stream.fileno() >= 0  # pyright: ignore[reportAttributeAccessIssue] asked for right here
    except (AttributeError, OSError, ValueError):
        return False

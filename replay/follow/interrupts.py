"""Count ctrl-C instead of raising it, so that no row is lost between its processing and output."""

import signal
import threading
from types import FrameType, TracebackType
from typing import Self

from replay.follow.follow_limits import LIMITS


class InterruptCounter:
    """Counter of ctrl-C within a `with` statement of the main thread; other threads count none.

    Attributes:
        count: number of interrupts so far.
        is_raised: whether ctrl-C raises `KeyboardInterrupt`, as until there is a row to lose.
    """

    def __init__(self) -> None:
        self.count = 0
        self.is_raised = True
        self._before: object = None

    def __enter__(self) -> Self:
        if threading.current_thread() is threading.main_thread():
            self._before = signal.signal(signal.SIGINT, self._count_interrupt)
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        if callable(self._before) or isinstance(self._before, signal.Handlers):
            signal.signal(signal.SIGINT, self._before)

    def _count_interrupt(self, _number: int, _frame: FrameType | None) -> None:
        self.count += 1
        if self.is_raised or self.count >= LIMITS.raised_interrupt:
            raise KeyboardInterrupt

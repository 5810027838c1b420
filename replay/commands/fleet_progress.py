"""Progress of a fleet's run on stderr: recordings done, and an honest estimate of the time left."""

import sys
from collections.abc import Sequence
from types import TracebackType
from typing import TYPE_CHECKING, Self

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn

if TYPE_CHECKING:
    from replay.fleet.log_sources import FleetLog
    from replay.fleet.recording_task import TaskOutcome
    from replay.fleet.task_engine import Engine


class FleetProgress:
    """A bar where a person watches."""

    def __init__(self) -> None:
        self._bar = Progress(
            TextColumn("recordings"),
            BarColumn(),
            MofNCompleteColumn(),
            TimeElapsedColumn(),
            TextColumn("{task.fields[left]}"),
            console=Console(stderr=True),
            transient=True,
            disable=not sys.stderr.isatty(),
        )
        self._task = self._bar.add_task("recordings", total=None, left="")
        self._slots = 1

    def begin(self, logs: "Sequence[FleetLog]") -> None:
        """The logs are known."""
        from replay.fleet.time_left import TimeLeft

        self._left = TimeLeft([log.size_bytes for log in logs])
        self._bar.update(self._task, total=len(logs))

    def on_engine(self, engine: "Engine") -> None:
        """The engine is open."""
        self._slots = engine.slots()

    def done(self, log: "FleetLog", outcome: "TaskOutcome") -> None:
        """A log is done."""
        from replay.fleet.time_left import spoken

        took = outcome.seconds + outcome.overhead_s
        self._left.done(log.size_bytes, took if outcome.status == "made" else None)
        left = spoken(self._left.interval_s(self._slots))
        self._bar.update(self._task, advance=1, left=left)

    def __enter__(self) -> Self:
        self._bar.start()
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self._bar.stop()

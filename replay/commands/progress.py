"""Progress on stderr: a bar where a person watches, seconds a stage where they were asked for."""

import sys
import time
from types import TracebackType
from typing import Self

from rich.console import Console
from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn


class Stages:
    """Told when each stage begins; shows where the work is, and keeps the seconds."""

    def __init__(self, total: int, *, timing: bool = False) -> None:
        self._timing = timing
        self._began: list[tuple[str, float]] = []
        self._bar = Progress(
            TextColumn("{task.description:<9}"),
            BarColumn(),
            TimeElapsedColumn(),
            console=Console(stderr=True),
            transient=True,
            disable=not sys.stderr.isatty(),
        )
        self._task = self._bar.add_task("open", total=total)

    def begin(self, stage: str) -> None:
        """A stage begins; the one before it has ended."""
        self._began.append((stage, time.perf_counter()))
        self._bar.update(self._task, description=stage, completed=len(self._began) - 1)

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
        if self._timing and kind is None:
            ends = [*(begun for _, begun in self._began[1:]), time.perf_counter()]
            took = [
                (stage, end - begun) for (stage, begun), end in zip(self._began, ends, strict=True)
            ]
            console = Console(stderr=True, highlight=False)
            for stage, seconds in took:
                console.print(f"{stage:<9} {seconds:8.3f} s")
            total = sum(seconds for _, seconds in took)
            reading = sum(seconds for stage, seconds in took if stage == "read")
            # which waits for libraries, too
            opening = sum(seconds for stage, seconds in took if stage == "open")
            console.print(
                f"{'total':<9} {total:8.3f} s, "
                f"but for opening {(total - opening) / reading:.1f} times the reading"
            )

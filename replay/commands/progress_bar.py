"""Progress on stderr: a bar on a terminal, and seconds per stage on request."""

import sys
import time
from collections.abc import Callable, Generator
from contextlib import ExitStack, contextmanager
from types import TracebackType
from typing import Any, Final, Self

from rich.console import Console
from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn

#: Compiling is worth a line when it has taken this long.
LONG_S: Final = 2.0
COMPILING: Final = (
    "payscope: compiling numerical code for this version, once; up to a minute "
    "(payscope warm-up does it ahead)"
)


class StageProgress:
    """Shows the current stage and measures the seconds of each."""

    def __init__(self, total: int, *, timing: bool = False, warns: bool = True) -> None:
        self._timing, self._warns = timing, warns
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
        self._until_exit = ExitStack()

    def begin_stage(self, stage: str) -> None:
        """Begin a stage, which ends the previous one.

        Args:
            stage: short name and position: "decode 3 of 8".
        """
        name = stage.partition(" ")[0]
        if not self._began or self._began[-1][0] != name:
            self._began.append((name, time.perf_counter()))
        self._bar.update(self._task, description=stage, completed=len(self._began) - 1)

    def __enter__(self) -> Self:
        self._bar.start()
        tell = self._bar.console.print
        if self._warns:
            self._until_exit.enter_context(
                warn_of_slow_compilation(lambda: tell(COMPILING, highlight=False, soft_wrap=True))
            )
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self._until_exit.close()
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
            reading = sum(seconds for stage, seconds in took if stage in ("decode", "read"))
            # which waits for libraries, too
            opening = sum(seconds for stage, seconds in took if stage == "open")
            console.print(
                f"{'total':<9} {total:8.3f} s, "
                f"without opening {(total - opening) / reading:.1f} times the reading time"
            )


@contextmanager
def warn_of_slow_compilation(print_warning: Callable[[], None]) -> Generator[None]:
    """Print a warning once after numba has compiled for `LONG_S`; cached code does not count."""
    # numba is slow to import: whoever shows stages has loaded it already
    from numba.core import event

    class Compiling(event.Listener):
        """Adds up the seconds of compilation; nested compilations count once."""

        def __init__(self) -> None:
            self._nested = 0
            self._began = self._took = 0.0
            self._has_warned = False

        def on_start(self, event: Any) -> None:
            del event
            if self._nested == 0:
                self._began = time.perf_counter()
            self._nested += 1
            self._check()

        def on_end(self, event: Any) -> None:
            del event
            self._check()
            self._nested -= 1
            if self._nested == 0:
                self._took += time.perf_counter() - self._began

        def _check(self) -> None:
            if not self._has_warned and self._took + time.perf_counter() - self._began > LONG_S:
                self._has_warned = True
                print_warning()

    listener = Compiling()
    event.register("numba:compile", listener)
    try:
        yield
    finally:
        event.unregister("numba:compile", listener)

"""Show progress on stderr: bars on a terminal, and seconds per stage on request.

The bar of one run shows its stages; that of a fleet counts recordings, and estimates the time left.
"""

import math
import sys
import time
from collections.abc import Callable, Generator, Sequence
from contextlib import ExitStack, contextmanager
from types import TracebackType
from typing import TYPE_CHECKING, Any, Final, Self

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn

from replay.commands.screen_limits import LIMITS

if TYPE_CHECKING:
    from replay.fleet.log_sources import FleetLog
    from replay.fleet.ray_engine import TaskEngine
    from replay.fleet.recording_task import TaskOutcome


#: Seconds of compilation after which a line reports it.
LONG_S: Final = 2.0
COMPILING: Final = (
    "payscope: compiling numerical code for this version, once; up to a minute "
    "(payscope warm-up does it ahead)"
)
#: Coverage factor of an interval of 95 %.
_K: Final = 2.0


class StageProgress:
    """Bar that shows the current stage, and measures the seconds of each."""

    def __init__(
        self,
        total: int,
        *,
        prints_stage_times: bool = False,
        warns_of_slow_compilation: bool = True,
    ) -> None:
        self._timing, self._warns = prints_stage_times, warns_of_slow_compilation
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
            # opening includes importing libraries
            opening = sum(seconds for stage, seconds in took if stage == "open")
            console.print(
                f"{'total':<9} {total:8.3f} s; "
                f"without open, {(total - opening) / reading:.1f} times as long as decode and read"
            )


@contextmanager
def warn_of_slow_compilation(print_warning: Callable[[], None]) -> Generator[None]:
    """Context that warns once if numba compiles for more than `LONG_S`, without cached code."""
    # numba is slow to import, but commands with stages need it anyway
    from numba.core import event

    class CompilationTimer(event.Listener):
        """Listener that sums the seconds of compilation; nested compilations count once."""

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

    listener = CompilationTimer()
    event.register("numba:compile", listener)
    try:
        yield
    finally:
        event.unregister("numba:compile", listener)


class FleetProgress:
    """Progress bar of a fleet, shown only on a terminal."""

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

    def begin_progress_bar(self, fleet_logs: "Sequence[FleetLog]") -> None:
        """Start the bar with the logs to replay."""
        self._left = RemainingTimeEstimator([log.size_bytes for log in fleet_logs])
        self._bar.update(self._task, total=len(fleet_logs))

    def note_engine_slots(self, engine: "TaskEngine") -> None:
        """Read the number of parallel slots from the opened engine."""
        self._slots = engine.count_parallel_slots()

    def count_finished_log(self, log: "FleetLog", outcome: "TaskOutcome") -> None:
        """Count a finished log."""
        took = outcome.seconds + outcome.overhead_s
        self._left.add_finished_recording(
            log.size_bytes, took if outcome.status == "made" else None
        )
        left = format_time_left(self._left.estimate_time_left_interval_s(self._slots))
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


class RemainingTimeEstimator:
    """Estimator of the time left, by the seconds per size of finished recordings."""

    def __init__(self, sizes_bytes: list[int]) -> None:
        self._left = sum(map(_count_progress_units, sizes_bytes))
        self._squares = sum(_count_progress_units(size) ** 2 for size in sizes_bytes)
        self._done: list[tuple[float, float]] = []

    def add_finished_recording(self, size_bytes: int, replay_s: float | None) -> None:
        """Add a finished recording with its seconds on the node, None if its result existed."""
        weight = _count_progress_units(size_bytes)
        self._left -= weight
        self._squares -= weight**2
        if replay_s is not None:
            self._done.append((weight, replay_s))

    def estimate_time_left_interval_s(self, parallel_slots: int) -> tuple[float, float] | None:
        """Estimate the time left as an interval in s; None with too few finished recordings.

        The duration of a recording is a rate times its weight, with a scatter proportional to it.
        """
        if len(self._done) < LIMITS.forecast_min_recordings:
            return None
        weight = sum(w for w, _ in self._done)
        rate = sum(s for _, s in self._done) / weight
        apart = sum((s / w - rate) ** 2 for w, s in self._done) / (len(self._done) - 1)
        expected = rate * self._left
        # uncertainty of the rate, and scatter of each recording left
        u = math.sqrt(apart * (self._left**2 / len(self._done) + max(self._squares, 0.0)))
        low, high = max(expected - _K * u, 0.0), expected + _K * u
        return low / parallel_slots, high / parallel_slots


def _count_progress_units(size_bytes: int) -> float:
    """Weight of a recording in the progress: its size in bytes plus a constant."""
    return float(size_bytes + LIMITS.base_bytes)


def format_time_left(interval_s: tuple[float, float] | None) -> str:
    """Format an interval of the time left in a suitable unit; empty for None."""
    if interval_s is None:
        return ""
    low, high = interval_s
    for unit, seconds in (("h", 3600.0), ("min", 60.0)):
        if high >= 2 * seconds:
            return f"{low / seconds:.1f} to {high / seconds:.1f} {unit} left"
    return f"{low:.0f} to {high:.0f} s left"

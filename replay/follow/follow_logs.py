"""The command `follow`: read a growing log, and emit rows and reports as they appear."""

import gc
import time
from collections.abc import Callable, Mapping, Sequence
from contextlib import ExitStack, closing, suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Final

import polars as pl

from analysis.model.loss import Loss
from analysis.model.machine import Machine
from analysis.online.follower import FollowedRow, Follower
from analysis.online.growing_log import copy_machine_with_causal_filters
from analysis.online.online_limits import LIMITS as ONLINE_LIMITS
from analysis.online.rehearsal import compile_loops_by_synthetic_start
from estimators.errors import DataError, LogError
from estimators.interpreted import compile_even_short_loops
from estimators.threads import limit_blas_to_one_thread
from replay.follow.background_replay import find_path_after_closing, is_text_table
from replay.follow.follow_limits import LIMITS
from replay.follow.interrupts import InterruptCounter
from replay.inputs.channel_inputs import list_channel_fields
from replay.logs import GrowingLogFile, open_growing_log
from replay.machines.machine_file import (
    find_machine_file_or_shipped_one,
    find_time_axis_of_machine,
    read_file_state,
)

_INTERRUPTED: Final = "interrupted"


@dataclass(slots=True)
class FollowedLogState:
    """State of a followed log.

    Attributes:
        paths: paths of the log.
        follower: gate and estimators.
        topics: topics found so far.
        losses: data that could not be read.
        last_poll_s: duration of the last poll that found data.
        end_reason: reason for the end; empty while following.
        is_interrupted: whether ctrl-C was the reason, so that the log may still grow.
        sizes: size of each file in bytes when it last grew.
        loss_reason: says that a file of the log is gone or has shrunk; else empty.
    """

    paths: Sequence[Path]
    follower: Follower
    topics: list[str] = field(default_factory=list)
    losses: list[Loss] = field(default_factory=list)
    last_poll_s: float = 0.0
    end_reason: str = ""
    is_interrupted: bool = False
    sizes: Mapping[Path, int] = field(default_factory=dict)
    loss_reason: str = ""

    @property
    def topics_without_messages(self) -> list[str]:
        """Topics of the machine file without any message so far."""
        return [topic for topic in self.follower.topics if topic not in self.topics]

    @property
    def missing_topics_remedy(self) -> str:
        """Remedy for missing topics; empty if none is missing."""
        if not self.topics_without_messages:
            return ""
        has = f"it has {', '.join(self.topics)}" if self.topics else "it has no topic yet"
        return f"; {has}. Set the topic of the channel in the machine file"


@limit_blas_to_one_thread()  # else the last bits depend on the number of cores
def follow_logs(
    paths: Sequence[Path],
    machine: Machine,
    on_rows: Callable[[FollowedLogState, list[FollowedRow]], None],
    *,
    noise: pl.DataFrame | None = None,
    idle_s: float = LIMITS.idle_s,
    valid_s: float = ONLINE_LIMITS.valid_s,
    until_u_kg: float | None = None,
    interrupts: InterruptCounter | None = None,
) -> FollowedLogState:
    """Follow a log until its recorder closes it, it stops growing for `idle_s`, or ctrl-C.

    Ctrl-C ends it between two polls, and a second one within a poll. In both cases, `on_rows` gets
    every row that was processed.

    Args:
        paths: as in `open_growing_log`.
        machine: channels and settings.
        on_rows: called with the rows of each poll, empty if there is nothing new.
        noise: as in `Follower`.
        idle_s: seconds without growth before it ends.
        valid_s: as in `Follower`.
        until_u_kg: as in `Follower`.
        interrupts: the caller's counter, which continues to count; None for a new one.

    Raises:
        LogError: the log cannot be followed, or a topic cannot be decoded.
        DataError: the log ended before there was enough data.
    """
    fields = list_channel_fields(copy_machine_with_causal_filters(machine))
    follower = Follower(machine, noise, valid_s=valid_s, until_u_kg=until_u_kg)
    following = FollowedLogState(paths, follower)
    with ExitStack() as opened:
        noted = interrupts or opened.enter_context(InterruptCounter())
        log = opened.enter_context(
            closing(open_growing_log(paths, fields, find_time_axis_of_machine(machine)))
        )
        opened.enter_context(compile_even_short_loops())
        compile_loops_by_synthetic_start(follower.log.machine.settings, noise)
        # objects of libraries live forever: collecting among them takes 0.1 s, and rows would wait;
        # if the caller has frozen them, they stay frozen
        if not gc.get_freeze_count():
            gc.collect()
            gc.freeze()
            opened.callback(gc.unfreeze)
        noted.is_raised = False
        try:
            following.end_reason = poll_log_until_end(log, following, on_rows, idle_s, noted)
        except KeyboardInterrupt:  # raised by `on_rows`
            following.end_reason = _INTERRUPTED
        following.is_interrupted = following.end_reason == _INTERRUPTED
        following.loss_reason = describe_lost_log_file(paths, following.sizes)
        if following.loss_reason and not following.is_interrupted:
            following.end_reason = following.loss_reason
        try:
            if not (following.is_interrupted and should_skip_remaining_work(following, noted)):
                process_new_log_data(log, following, on_rows, noted, is_last=True)
        except DataError as error:
            raise LogError(
                f"{paths[0]}: {following.end_reason}: {error}{following.missing_topics_remedy}"
            ) from error
    return following


def should_skip_remaining_work(following: FollowedLogState, interrupts: InterruptCounter) -> bool:
    """Whether a ctrl-C beyond the one that ends following asks to skip the remaining work."""
    return interrupts.count > (following.is_interrupted or not following.end_reason)


def poll_log_until_end(
    growing_log: GrowingLogFile,
    following: FollowedLogState,
    on_rows: Callable[[FollowedLogState, list[FollowedRow]], None],
    idle_s: float,
    interrupts: InterruptCounter,
) -> str:
    """Poll the log until it ends, and return the reason."""
    grew = time.monotonic()
    while True:
        began = time.monotonic()
        if interrupts.count:
            return _INTERRUPTED
        sizes = read_file_sizes(following.paths)
        if process_new_log_data(growing_log, following, on_rows, interrupts):
            grew = time.monotonic()
            following.sizes = sizes
        elif growing_log.is_finished:
            return "the recorder has closed the log"
        elif began - grew > idle_s:
            return f"the log has not grown for {idle_s:g} s"
        time.sleep(max(0.0, began + LIMITS.look_s - time.monotonic()))


def read_file_sizes(paths: Sequence[Path]) -> dict[Path, int]:
    """Read the size of each file in bytes; 0 if it is not a regular file, absent if missing."""
    sizes: dict[Path, int] = {}
    for path in paths:
        with suppress(OSError):
            sizes[path] = path.stat().st_size if path.is_file() else 0
    return sizes


def describe_lost_log_file(paths: Sequence[Path], sizes_before: Mapping[Path, int]) -> str:
    """Say which file of the log is gone, or which table has shrunk; empty if none.

    Args:
        paths: paths of the log.
        sizes_before: size of each file in bytes when it last grew.
    """
    sizes = read_file_sizes(paths)
    for path in paths:
        if not find_path_after_closing(path).exists():
            return f"{path} is no longer there"
        if is_text_table(path) and sizes.get(path, 0) < sizes_before.get(path, 0):
            return f"{path} has shrunk from {sizes_before[path]:,} to {sizes.get(path, 0):,} bytes"
    return ""


def process_new_log_data(
    growing_log: GrowingLogFile,
    following: FollowedLogState,
    on_rows: Callable[[FollowedLogState, list[FollowedRow]], None],
    interrupts: InterruptCounter,
    *,
    is_last: bool = False,
) -> bool:
    """Process new data of the log, and return whether there were any.

    Args:
        growing_log: the log.
        following: state of the followed log.
        on_rows: called with all rows that were processed.
        interrupts: counter of ctrl-C; a further one skips the rows not processed yet.
        is_last: whether no poll follows.
    """
    began = time.monotonic()
    # a table that is still recorded may end within a line, which would be half a row
    frames = growing_log.poll(is_log_complete=is_last and not following.is_interrupted)
    following.topics, following.losses = growing_log.topics, [*growing_log.losses]
    for topic, frame in frames.items():
        following.follower.append_samples(topic, frame)
    rows: list[FollowedRow] = []
    if frames or is_last:
        for row in following.follower.iter_complete_rows(is_log_complete=is_last):
            rows.append(row)
            if should_skip_remaining_work(following, interrupts):
                break
        following.last_poll_s = time.monotonic() - began
    on_rows(following, rows)
    return bool(frames)


class MachineFileChange:
    """Text of a machine file, to notice when the file changes."""

    def __init__(self, path: Path) -> None:
        """Read the file; if it is missing or not a file, whoever loads it raises the error."""
        self._path = find_machine_file_or_shipped_one(path)
        self._file_state = read_file_state(self._path)
        self._text = self._read_file_or_empty()

    def has_file_changed(self) -> bool:
        """Whether the text has changed since the last call; a missing file has not changed."""
        file_state = read_file_state(self._path)
        if file_state in (None, self._file_state):
            return False
        self._file_state, before = file_state, self._text
        self._text = self._read_file_or_empty()
        return self._text != before

    def _read_file_or_empty(self) -> bytes:
        try:
            return self._path.read_bytes()
        except OSError:
            return b""

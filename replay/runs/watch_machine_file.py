"""The command `run --watch`: replay the logs whenever the machine file changes."""

import time
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Final

from analysis.compare.run_comparison import ValueChange, changed_settings
from analysis.model.answer import Answer
from analysis.model.machine import Machine
from estimators.errors import PayscopeError
from recordings.rrd.viewer import list_shown_recordings, replace_recording
from replay.machines.machine_file import load_machine, machine_file_or_shipped
from replay.runs.run_logs import RecordTo, open_live_view

#: A look at one file costs nothing; an editor writes within one such step.
_LOOK_S: Final = 0.2

#: An editor puts a file in place within so many looks; one that is missing longer is gone.
_GONE_LOOKS: Final = 10

#: What tells one state of a file from another: also that it was put in the place of another.
_Signature = tuple[int, int, int] | None


def watch_machine_file(
    machine_file: Path,
    output: RecordTo,
    overrides: list[str],
    replay: Callable[[RecordTo], Answer],
    on_answer: Callable[[Answer, list[ValueChange]], None],
    on_error: Callable[[PayscopeError], None],
) -> None:
    """Replay now and after each change of the machine file, until interrupted.

    A viewer stays open in between: it keeps its tabs and the place of its time cursor, and holds
    the replay before the last one as well.

    Args:
        machine_file: file to watch.
        output: recording, replaced by each replay.
        overrides: `key=value`, with precedence over the file.
        replay: function that replays once and records as requested.
        on_answer: called with each answer and the keys changed since the previous replay.
        on_error: called with the error in a changed file; watching continues.

    Raises:
        PayscopeError: the first replay failed.
    """
    # a file that is gone is not the shipped one of its name
    path = machine_file_or_shipped(machine_file).absolute()
    view = open_live_view(output)
    last: Machine | None = None
    failed = False
    for _ in machine_file_changes(path):
        try:
            machine = load_machine(path, overrides)
            changed = [] if last is None else changed_settings(last, machine)
            if last is not None and not changed and not failed:
                continue  # a comment, or the file was touched
            before = list_shown_recordings(view.address) if view else ()
            answer = replay(replace(output, viewer=view))
            if view:
                replace_recording(view.address, before)
        except PayscopeError as error:
            if last is None:
                raise
            failed = True
            on_error(error)
            continue
        last, failed = machine, False
        # what we have written ourselves may be replaced, and the viewer knows the layout
        output = replace(output, force=True)
        view = view and replace(view, laid_out=True)
        on_answer(answer, changed)


def machine_file_changes(path: Path) -> Iterator[None]:
    """Yield once at the start, after each change that has settled, and when the file vanishes."""
    seen, missed = _file_signature(path), 0
    yield
    while True:
        time.sleep(_LOOK_S)
        now = _file_signature(path)
        missed = missed + 1 if now is None else 0
        if missed == _GONE_LOOKS:
            seen = None  # the same file again is a change
            yield
        if now in (None, seen):
            continue
        while True:
            time.sleep(_LOOK_S)
            settled = _file_signature(path)
            if settled == now:
                break
            now = settled
        if now is not None:
            seen = now
            yield


def _file_signature(path: Path) -> _Signature:
    """Time, size and inode by which a change shows; None if absent."""
    try:
        about = path.stat()
    except OSError:
        return None
    return about.st_mtime_ns, about.st_size, about.st_ino

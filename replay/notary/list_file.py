"""File of a notary's list, which only one process appends to, in whole lines.

A line is written with its newline and flushed to the disc before the next. A killed process leaves
at most a line without a newline, which the next process cuts off. The end of the list is kept a
second time in the user's state folder; a list that ends earlier has been truncated.
"""

import hashlib
import json
import os
from collections.abc import Generator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from estimators.errors import EvidenceError, OutputError
from recordings.notary.notary_list import (
    MOST_LIST_BYTES,
    NotaryEntry,
    NotaryHead,
    NotaryLine,
    parse_line,
    split_whole_lines,
)
from recordings.signatures.canonical_json import canonical_json_bytes

#: The environment variable that names the folder of the second copy.
STATE_VARIABLE: Final = "PAYSCOPE_NOTARY_STATE"
#: No link is followed, where the system can refuse one.
_FLAGS: Final = os.O_RDWR | os.O_CREAT | os.O_APPEND | getattr(os, "O_NOFOLLOW", 0)


@dataclass(frozen=True, slots=True)
class ListEnd:
    """End of a list, as kept in the second place."""

    head: str
    counter: int
    digest: str


@dataclass(slots=True)
class OpenList:
    """List that only this process may write.

    Attributes:
        path: path of the list.
        lines: lines of the list; empty if it is new.
        cut_bytes: size of the torn tail that was cut off.
        second: second place of the list's end; None if it cannot be written.
    """

    path: Path
    lines: list[NotaryLine]
    cut_bytes: int
    second: Path | None
    _file: int
    _size: int

    def append(self, line: NotaryLine) -> None:
        """Append a line and flush it to the disc, whole or not at all.

        Raises:
            OutputError: the disc is full, or the list cannot be written; it is as it was before.
        """
        data = line.data + b"\n"
        try:
            written = 0
            while written < len(data):
                written += os.write(self._file, data[written:])
            os.fsync(self._file)
        except OSError as error:
            os.ftruncate(self._file, self._size)
            raise OutputError(
                f"{self.path}: cannot be written ({error.strerror}); it ends as before, with "
                f"number {len(self.lines) - 1}; free some space and run this again"
            ) from None
        self._size += len(data)
        self.lines.append(line)
        self._write_second_copy_of_end()

    def _write_second_copy_of_end(self) -> None:
        """Write the end of the list to the second place."""
        if self.second is None:
            return
        last = self.lines[-1]
        end = {
            "head": self.lines[0].digest,
            "counter": last.content.counter,
            "digest": last.digest,
            "list": str(self.path),
        }
        partial = self.second.with_suffix(f".{os.getpid()}")
        try:
            with partial.open("wb") as file:
                file.write(canonical_json_bytes(end))
                file.flush()
                os.fsync(file.fileno())
            partial.replace(self.second)
        except OSError:
            # the list itself is written: the second place is behind, and that is known from it
            partial.unlink(missing_ok=True)


@contextmanager
def open_list(path: Path) -> Generator[OpenList]:
    """Open a list for this process alone, and compare it with its end at the last time.

    The system releases the lock when the process ends, however it ends.

    Raises:
        EvidenceError: it is not a list, was truncated or rewritten, or another process writes it.
        OutputError: it cannot be written.
    """
    import fcntl

    try:
        number = os.open(path, _FLAGS, 0o644)
    except OSError as error:
        raise OutputError(f"{path}: cannot be written ({error.strerror})") from None
    try:
        try:
            fcntl.flock(number, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError:
            raise EvidenceError(
                f"{path}: another process is writing this list; only one notary may write it"
            ) from None
        size = os.fstat(number).st_size
        if size > MOST_LIST_BYTES:
            raise EvidenceError(f"{path}: is larger than the {MOST_LIST_BYTES} bytes of a list")
        whole, tail = split_whole_lines(_read_descriptor(number, size))
        lines = [parse_line(line, f"{path}: line {k}") for k, line in enumerate(whole, start=1)]
        second = second_copy_path(path)
        refuse_altered_list(path, lines, read_kept_end(second))
        if tail:
            os.ftruncate(number, size - len(tail))
            os.fsync(number)
        yield OpenList(path, lines, len(tail), second, number, size - len(tail))
    finally:
        os.close(number)


def _read_descriptor(descriptor: int, size: int) -> bytes:
    parts: list[bytes] = []
    while size > 0 and (part := os.read(descriptor, size)):
        parts.append(part)
        size -= len(part)
    return b"".join(parts)


def refuse_altered_list(path: Path, lines: list[NotaryLine], end: ListEnd | None) -> None:
    """Check that a list contains its former lines and that its chain is intact.

    Raises:
        EvidenceError: it does not.
    """
    for before, line in zip([None, *lines], lines, strict=False):
        entry, fault = line.content, ""
        if before is None:
            fault = "" if isinstance(entry, NotaryHead) else "does not begin with its head"
        elif not isinstance(entry, NotaryEntry) or entry.previous != before.digest:
            fault = f"number {entry.counter} does not follow the line before"
        elif entry.counter != before.content.counter + 1:
            fault = f"number {entry.counter} follows number {before.content.counter}"
        if fault:
            raise EvidenceError(
                f"{path}: {fault}; the list was changed; `payscope verify {path}` lists all "
                "faults, and a changed list cannot be continued"
            )
    if end is None:
        return
    if not lines:
        raise EvidenceError(
            f"{path}: is empty, but number {end.counter} was written before, so the list was "
            "removed; restore it, or start another one elsewhere with --list"
        )
    known = len(lines) > end.counter and lines[end.counter].digest == end.digest
    if lines[0].digest != end.head or not known:
        raise EvidenceError(
            f"{path}: ends with number {len(lines) - 1}, but was written up to number "
            f"{end.counter}, so it was truncated or replaced; restore it, or start another one "
            "elsewhere with --list"
        )


def second_copy_path(path: Path) -> Path | None:
    """Path of the second copy of a list's end; None if it cannot be written."""
    named = os.environ.get(STATE_VARIABLE)
    base = os.environ.get("XDG_STATE_HOME")
    try:
        home = Path(base) if base else Path.home() / ".local" / "state"
        folder = Path(named) if named else home / "payscope" / "notary"
        folder.mkdir(parents=True, exist_ok=True)
    except (OSError, RuntimeError):
        return None
    name = hashlib.sha256(str(path.resolve()).encode()).hexdigest()[:32]
    return folder / f"{name}.json" if os.access(folder, os.W_OK) else None


def read_kept_end(second: Path | None) -> ListEnd | None:
    """Read the kept end of a list; None if there is none.

    Raises:
        EvidenceError: it is damaged.
    """
    if second is None or not second.exists():
        return None
    try:
        held = json.loads(second.read_bytes())
        return ListEnd(str(held["head"]), int(held["counter"]), str(held["digest"]))
    except (OSError, ValueError, KeyError, TypeError) as error:
        raise EvidenceError(
            f"{second}: does not contain the end of the list ({type(error).__name__}); remove this "
            "file if you know that the list is complete"
        ) from None

"""The command `notarise`: list, sign and chain the finished logs of a folder."""

import datetime as dt
import os
import secrets
import stat
import time
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final, NamedTuple

from analysis.stages.signals.timestamps import FIRST_DATE_NS
from estimators.errors import EvidenceError, PayscopeError
from estimators.file_digest import file_sha256
from recordings.notary.notary_limits import LIMITS as NOTARY_LIMITS
from recordings.notary.notary_list import (
    FORMAT,
    NotaryEntry,
    NotaryFile,
    NotaryHead,
    make_signed_line,
)
from recordings.signatures.signing import KEY_VARIABLE, SigningKey, read_signing_key_or_none
from replay.logs import open_log
from replay.notary.list_file import OpenNotaryList, open_list_exclusively

#: Name of the list in the folder, unless another path is given.
LIST_NAME: Final = "notary.jsonl"
#: Seconds without a change after which a log is finished: recorders write at least once a minute.
QUIET_S: Final = 60.0
#: Suffixes of logs; a recording is derived from one and not listed.
_SUFFIXES: Final = (".bag", ".mcap", ".db3", ".csv", ".parquet")
_METADATA: Final = "metadata.yaml"
#: Most folders that are searched for logs.
_MOST_ENTRIES: Final = 1_000_000
#: Characters kept of a machine's serial number.
_LONGEST_ID: Final = 64
#: Nanoseconds of a microsecond, the common resolution of times of files.
_US: Final = 1000


@dataclass(frozen=True, slots=True)
class NotarisedFolder:
    """Result of a pass over a folder.

    Attributes:
        path: path of the list.
        added: lines added.
        waiting: logs that are still being written.
        last: counter of the list's last line.
        notes: notes for the keeper of the list.
    """

    path: Path
    added: tuple[NotaryEntry, ...]
    waiting: tuple[str, ...]
    last: int
    notes: tuple[str, ...]

    def to_dict(self) -> dict[str, Any]:
        """The fields as JSON-compatible values."""
        return {
            "list": str(self.path),
            "added": [each.model_dump(mode="json") for each in self.added],
            "waiting": list(self.waiting),
            "last": self.last,
            "notes": list(self.notes),
        }


@dataclass(frozen=True, slots=True)
class CandidateLog:
    """A log in the folder.

    Attributes:
        name: path relative to the folder.
        path: the file, or the rosbag2 directory.
        files: files of the log with their sizes and modification times.
    """

    name: str
    path: Path
    files: Mapping[str, tuple[int, int]]

    @property
    def modified_unix_s(self) -> float:
        """Unix time of the last modification of its files, in s."""
        return max(us for _, us in self.files.values()) / 1e6


def notarise_folder(
    folder: Path,
    *,
    key_file: Path | None = None,
    list_path: Path | None = None,
    machine_id: str = "",
    quiet_s: float = QUIET_S,
) -> NotarisedFolder:
    """Add the finished logs of a folder to its list.

    Args:
        folder: recorder's folder; subfolders are searched, links are not followed.
        key_file: private key of the recorder; by default from the environment.
        list_path: the list; `notary.jsonl` in the folder by default.
        machine_id: serial number of the machine, for a new list or to compare with the list's.
        quiet_s: seconds without changes after which a log is finished.

    Raises:
        EvidenceError: there is no key, it is not the list's, or the list was altered.
        OutputError: the list cannot be written; entries added before that are kept.
    """
    if not folder.is_dir():
        raise EvidenceError(
            f"{folder}: no such folder; give the folder that the recorder writes to"
        )
    key = read_signing_key_or_none(key_file)
    if key is None:
        raise EvidenceError(f"a notary needs a signing key; give --key KEY.pem, or {KEY_VARIABLE}")
    path = list_path or folder / LIST_NAME
    with open_list_exclusively(path) as held:
        head = begin_list_or_refuse_other_signer(held, key, machine_id)
        notes = [f"a torn tail of {held.cut_bytes} bytes was cut off"] if held.cut_bytes else []
        if held.second is None:
            notes.append(
                "the end of the list is kept nowhere else: a truncated list is not detected"
            )
        known = {e.log: e for line in held.lines if isinstance(e := line.content, NotaryEntry)}
        added: list[NotaryEntry] = []
        waiting: list[str] = []
        for log in sorted(
            iter_logs_below_folder(folder, path), key=lambda log: (log.modified_unix_s, log.name)
        ):
            before = known.get(log.name)
            if before is not None and _is_log_unchanged_since_entry(before, log):
                continue
            age_s = time.time() - log.modified_unix_s  # negative if a clock is wrong
            is_quiet = age_s >= quiet_s or age_s < -NOTARY_LIMITS.clock_difference_s
            entry = make_list_entry_of_log(held, log, before) if is_quiet else None
            if entry is None:
                waiting.append(log.name)
                continue
            notes += _iter_notes_on_wrong_clock(held, entry)
            held.append_line_durably(make_signed_line(entry, key))
            added.append(entry)
        return NotarisedFolder(
            path, tuple(added), tuple(waiting), len(held.lines) - 1, (*notes, *head)
        )


def begin_list_or_refuse_other_signer(
    open_list: OpenNotaryList, signing_key: SigningKey, machine_id: str
) -> list[str]:
    """Begin a new list, or check that an existing one has this key and machine.

    Returns:
        Notes for the user on a new list.

    Raises:
        EvidenceError: the list is signed with another key, or is of another machine.
    """
    if not open_list.lines:
        head = NotaryHead(
            format=FORMAT,
            counter=0,
            machine_id=machine_id,
            public_key=signing_key.public_key.base64_text,
            nonce=secrets.token_hex(32),
            begun=_format_current_utc_second(),
        )
        open_list.append_line_durably(make_signed_line(head, signing_key))
        return [] if machine_id else ["the list names no machine; name it with --machine-id"]
    head = open_list.lines[0].content
    assert isinstance(head, NotaryHead)
    key, last = signing_key.public_key, open_list.lines[-1]
    if head.public_key != key.base64_text or not last.is_signed_by(key):
        raise EvidenceError(
            f"{open_list.path}: is signed with another key than {key.key_id[:12]}…; "
            "a list has one key: start another list with --list"
        )
    if machine_id and head.machine_id != machine_id:
        raise EvidenceError(
            f"{open_list.path}: is of machine '{head.machine_id}', not of '{machine_id}'; give the "
            "list of that machine with --list"
        )
    return []


def iter_logs_below_folder(folder: Path, list_path: Path) -> Iterator[CandidateLog]:
    """Yield the logs of a folder and its subfolders; links are not followed.

    Args:
        folder: folder of the recorder.
        list_path: path of the list, which is not a log.
    """
    own = list_path.resolve()
    for number, (place, folders, names) in enumerate(os.walk(folder, followlinks=False)):
        if number >= _MOST_ENTRIES:
            raise EvidenceError(f"{folder}: more than {_MOST_ENTRIES} folders; give a smaller one")
        folders[:] = sorted(each for each in folders if not each.startswith("."))
        inside = Path(place)
        files = {
            name: about
            for name in sorted(names)
            if not name.startswith(".")
            and (about := read_size_and_modification_time(inside / name)) is not None
        }
        if _METADATA in files and inside != folder:
            folders.clear()
            yield CandidateLog(inside.relative_to(folder).as_posix(), inside, files)
            continue
        for name, about in files.items():
            log = inside / name
            if log.suffix.lower() in _SUFFIXES and log.resolve() != own:
                yield CandidateLog(log.relative_to(folder).as_posix(), log, {name: about})


class SizeAndTime(NamedTuple):
    """Size of a file in bytes, and its modification time in µs."""

    size_bytes: int
    modified_us: int


def read_size_and_modification_time(path: Path) -> SizeAndTime | None:
    """Read size and modification time of a regular file; None for anything else."""
    try:
        held = path.lstat()
    except OSError:
        return None
    return (
        SizeAndTime(held.st_size, held.st_mtime_ns // _US) if stat.S_ISREG(held.st_mode) else None
    )


def _is_log_unchanged_since_entry(entry: NotaryEntry, log: CandidateLog) -> bool:
    return {f.name: (f.size_bytes, f.modified_us) for f in entry.files} == dict(log.files)


def make_list_entry_of_log(
    open_list: OpenNotaryList, log: CandidateLog, previous_entry: NotaryEntry | None
) -> NotaryEntry | None:
    """Make the entry of a log in the list; None if the log changes in the meantime."""
    inside = log.path if log.path.is_dir() else log.path.parent
    try:
        digests = {name: file_sha256(inside / name) for name in log.files}
    except OSError:
        return None
    starts, ends, machine = read_time_span_and_machine_of_log(log.path)
    if any(
        read_size_and_modification_time(inside / name) != about for name, about in log.files.items()
    ):
        return None
    last = open_list.lines[-1]
    return NotaryEntry(
        counter=last.content.counter + 1,
        head=open_list.lines[0].line_sha256,
        previous=last.line_sha256,
        log=log.name,
        files=tuple(
            NotaryFile(name=name, sha256=digests[name], size_bytes=size, modified_us=us)
            for name, (size, us) in log.files.items()
        ),
        begins=starts,
        ends=ends,
        listed=_format_current_utc_second(),
        machine_id=machine,
        replaces=None if previous_entry is None else previous_entry.counter,
    )


class _LogSpanAndMachine(NamedTuple):
    """Start, end and machine of a log as texts; "" for each that is unknown."""

    begin: str
    end: str
    machine_id: str


def read_time_span_and_machine_of_log(log_path: Path) -> _LogSpanAndMachine:
    """Read start, end and machine of a log; "" for each that is unknown.

    A damaged log is no error, since it is listed as well.
    """
    try:
        with open_log(log_path) as log:
            topics = log.topics()
            machine = next(iter(log.machine_ids()), "")
    except PayscopeError:
        return _LogSpanAndMachine("", "", "")
    first, last = topics["start_ns"].min(), topics["end_ns"].max()
    if not isinstance(first, int) or not isinstance(last, int) or first < FIRST_DATE_NS:
        return _LogSpanAndMachine("", "", machine[:_LONGEST_ID])
    return _LogSpanAndMachine(
        _format_unix_ns_as_utc_second(first),
        _format_unix_ns_as_utc_second(last),
        machine[:_LONGEST_ID],
    )


def _format_unix_ns_as_utc_second(unix_ns: int) -> str:
    return f"{dt.datetime.fromtimestamp(unix_ns // 10**9, dt.UTC):%Y-%m-%dT%H:%M:%SZ}"


def _format_current_utc_second() -> str:
    return _format_unix_ns_as_utc_second(time.time_ns())


def _iter_notes_on_wrong_clock(open_list: OpenNotaryList, entry: NotaryEntry) -> Iterator[str]:
    """Yield notes on a wrong clock; the log is listed nevertheless, and `verify` reports it."""
    last = open_list.lines[-1].content
    if isinstance(last, NotaryEntry) and entry.listed < last.listed:
        yield (
            f"number {entry.counter}: the clock was set back: number {last.counter} was listed "
            f"{last.listed}, and now it is {entry.listed}"
        )
    late = dt.datetime.fromisoformat(entry.listed) + dt.timedelta(
        seconds=NOTARY_LIMITS.clock_difference_s
    )
    if entry.ends and dt.datetime.fromisoformat(entry.ends) > late:
        yield f"number {entry.counter}: '{entry.log}' ends {entry.ends}, after it is listed"

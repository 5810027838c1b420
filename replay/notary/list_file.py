"""Append to a notary's list, by one process at a time and in whole lines, and verify lists.

A line is written with its newline and flushed to disk before the next. A killed process leaves at
most a line without a newline, which the next process cuts off. A second copy of the list's end is
in the user's state folder; a list that ends earlier has been truncated.
"""

import datetime as dt
import hashlib
import json
import os
from collections.abc import Generator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

from estimators.errors import EvidenceError, OutputError, format_count
from recordings.calibration.check_outcomes import (
    BundleFinding,
    BundleOutcome,
    find_most_severe_outcome,
    format_bundle_verdict,
)
from recordings.notary.notary_check import check_untrusted_notary_list
from recordings.notary.notary_limits import LIMITS as NOTARY_LIMITS
from recordings.notary.notary_list import (
    NotaryEntry,
    NotaryHead,
    NotaryLine,
    parse_untrusted_line,
    split_list_into_complete_lines_and_tail,
)
from recordings.signatures.canonical_json import encode_canonical_json
from recordings.signatures.keyring import load_keyring
from recordings.signatures.signed_by import SignedBy
from recordings.signatures.signing import read_public_key_file

#: Environment variable that names the folder of the second copy.
STATE_VARIABLE: Final = "PAYSCOPE_NOTARY_STATE"
#: Flags to open a list; links are not followed if the system supports this.
_FLAGS: Final = os.O_RDWR | os.O_CREAT | os.O_APPEND | getattr(os, "O_NOFOLLOW", 0)
#: Statements of what no check of a list can find.
UNSEEN = (
    "A log of a second recorder, or of another folder.",
    "A log that was deleted before it ended, or before the notary looked.",
    "A list that was truncated or rewritten by whoever has a copy of its key, before evidence "
    "named its later numbers. The notary detects a truncated list by its second copy of the end.",
    "Whether the clocks of recorder and notary were right: only a time stamp of evidence proves a "
    "time from outside.",
)


@dataclass(frozen=True, slots=True)
class NotaryListEnd:
    """End of a list, as kept in the second copy."""

    head: str
    counter: int
    digest: str


@dataclass(slots=True)
class OpenNotaryList:
    """List that is locked for writing by this process.

    Attributes:
        path: path of the list.
        lines: lines of the list; empty if it is new.
        cut_bytes: bytes of an incomplete last line that were cut off.
        second: path of the second copy of the list's end; None if it cannot be written.
    """

    path: Path
    lines: list[NotaryLine]
    cut_bytes: int
    second: Path | None
    _file: int
    _size: int

    def append_line_durably(self, notary_line: NotaryLine) -> None:
        """Append a line and flush it to disk, whole or not at all.

        Raises:
            OutputError: the disk is full, or the list cannot be written; it is unchanged.
        """
        data = notary_line.data + b"\n"
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
        self.lines.append(notary_line)
        self._write_second_copy_of_list_end()

    def _write_second_copy_of_list_end(self) -> None:
        """Write the end of the list to its second copy."""
        if self.second is None:
            return
        last = self.lines[-1]
        end = {
            "head": self.lines[0].line_sha256,
            "counter": last.content.counter,
            "digest": last.line_sha256,
            "list": str(self.path),
        }
        partial = self.second.with_suffix(f".{os.getpid()}")
        try:
            with partial.open("wb") as file:
                file.write(encode_canonical_json(end))
                file.flush()
                os.fsync(file.fileno())
            partial.replace(self.second)
        except OSError:
            # the list itself is written, from which one can see that the second copy is outdated
            partial.unlink(missing_ok=True)


@contextmanager
def open_list_exclusively(path: Path) -> Generator[OpenNotaryList]:
    """Context with a list locked for this process, and checked against the second copy of its end.

    The system releases the lock when the process ends, however it ends.

    Raises:
        EvidenceError: it is not a list, was truncated or rewritten, or another process has it open.
        OutputError: the list cannot be written.
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
        if size > NOTARY_LIMITS.list_bytes:
            raise EvidenceError(
                f"{path}: has more than {NOTARY_LIMITS.list_bytes >> 20} MiB, the most that a list "
                "may have; begin a list in another file"
            )
        whole, tail = split_list_into_complete_lines_and_tail(
            _read_bytes_from_descriptor(number, size)
        )
        lines = [
            parse_untrusted_line(line, f"{path}: line {k}") for k, line in enumerate(whole, start=1)
        ]
        second = find_path_of_second_copy(path)
        refuse_altered_list(path, lines, read_kept_list_end(second))
        if tail:
            os.ftruncate(number, size - len(tail))
            os.fsync(number)
        yield OpenNotaryList(path, lines, len(tail), second, number, size - len(tail))
    finally:
        os.close(number)


def _read_bytes_from_descriptor(descriptor: int, byte_count: int) -> bytes:
    parts: list[bytes] = []
    while byte_count > 0 and (part := os.read(descriptor, byte_count)):
        parts.append(part)
        byte_count -= len(part)
    return b"".join(parts)


def refuse_altered_list(
    path: Path, lines: list[NotaryLine], kept_end: NotaryListEnd | None
) -> None:
    """Raise an error unless the chain of a list is intact and includes its kept end.

    Raises:
        EvidenceError: the list was altered or truncated.
    """
    for before, line in zip([None, *lines], lines, strict=False):
        entry, fault = line.content, ""
        if before is None:
            fault = "" if isinstance(entry, NotaryHead) else "does not begin with its head"
        elif not isinstance(entry, NotaryEntry) or entry.previous != before.line_sha256:
            fault = f"number {entry.counter} does not hold the digest of the line before"
        elif entry.counter != before.content.counter + 1:
            fault = f"number {entry.counter} follows number {before.content.counter}"
        if fault:
            raise EvidenceError(
                f"{path}: {fault}; the list was changed; `payscope verify {path}` lists all "
                "faults; restore the list, or start another one elsewhere with --list"
            )
    if kept_end is None:
        return
    if not lines:
        raise EvidenceError(
            f"{path}: is empty, but number {kept_end.counter} was written before, so the list was "
            "removed; restore it, or start another one elsewhere with --list"
        )
    known = len(lines) > kept_end.counter and lines[kept_end.counter].line_sha256 == kept_end.digest
    if lines[0].line_sha256 != kept_end.head or not known:
        raise EvidenceError(
            f"{path}: ends with number {len(lines) - 1}, but was written up to number "
            f"{kept_end.counter}, so it was truncated or replaced; restore it, or start another "
            "one "
            "elsewhere with --list"
        )


def find_path_of_second_copy(path: Path) -> Path | None:
    """Find the path of the second copy of a list's end; None if it cannot be written."""
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


def read_kept_list_end(second_copy: Path | None) -> NotaryListEnd | None:
    """Read the kept end of a list; None if there is none.

    Raises:
        EvidenceError: the copy is damaged.
    """
    if second_copy is None or not second_copy.exists():
        return None
    try:
        held = json.loads(second_copy.read_bytes())
        return NotaryListEnd(str(held["head"]), int(held["counter"]), str(held["digest"]))
    except (OSError, ValueError, KeyError, TypeError) as error:
        raise EvidenceError(
            f"{second_copy}: does not contain the end of the list ({type(error).__name__}); remove "
            "this file if you know that the list is complete"
        ) from None


@dataclass(frozen=True, slots=True)
class VerifiedNotaryList:
    """Result of verifying a list.

    Attributes:
        path: path of the list.
        findings: faults of the list.
        notes: further notes for the reader.
        logs: number of logs.
        kept_by: signer of the list.
    """

    path: Path
    findings: tuple[BundleFinding, ...]
    notes: tuple[str, ...]
    logs: int
    kept_by: SignedBy

    @property
    def outcome(self) -> BundleOutcome | None:
        """Outcome that is the exit status; None if nothing is wrong."""
        return find_most_severe_outcome(self.findings)

    @property
    def verdict(self) -> str:
        """The outcome as a sentence."""
        holds = f"{format_count(self.logs, 'log')} verified; {self.kept_by}"
        return format_bundle_verdict(self.path, self.findings, holds)

    def to_dict(self) -> dict[str, Any]:
        """The fields as JSON-compatible values."""
        return {
            "list": str(self.path),
            "outcome": 0 if self.outcome is None else int(self.outcome),
            "findings": [
                {"kind": each.kind, "item": each.item, "what": each.what} for each in self.findings
            ],
            "notes": list(self.notes),
            "logs": self.logs,
            "no_check_can_find": list(UNSEEN),
        }


def verify_notary_list(
    path: Path, *, key_file: Path | None = None, is_signature_required: bool = False
) -> VerifiedNotaryList:
    """Check a list on its own, without the logs.

    Args:
        path: path of the list.
        key_file: public key of the recorder.
        is_signature_required: whether the list must be signed with that key, or one in the user's
            keyring.

    Raises:
        EvidenceError: the list or the key cannot be read.
    """
    key = None if key_file is None else read_public_key_file(key_file)
    try:
        with path.open("rb") as file:
            data = file.read(NOTARY_LIMITS.list_bytes + 1)
    except OSError as error:
        raise EvidenceError(f"{path}: cannot be read ({error.strerror})") from None
    kept = check_untrusted_notary_list(data, dt.datetime.now(dt.UTC))
    findings = [
        BundleFinding(
            BundleOutcome.TAMPERED if fault.forged else BundleOutcome.INCOMPLETE,
            path.name,
            fault.what,
        )
        for fault in kept.faults
    ]
    own = kept.notary_public_key
    by = SignedBy("broken")
    if own is not None and not any(fault.forged for fault in kept.faults):
        known = load_keyring().find_key_by_id_or_prefix(own.key_id)
        how = "known" if known is not None else "unknown"
        by = SignedBy(how, "", "" if known is None else known.owner, own.key_id, own.base64_text)
        if key is not None and key.key_id == own.key_id:
            by = SignedBy("given", "", by.owner, own.key_id, own.base64_text)
        elif known is not None:
            last = (
                kept.log_entries[-1].listed
                if kept.log_entries
                else kept.head.begun
                if kept.head
                else ""
            )
            fault = known.explain_distrust(dt.datetime.fromisoformat(last).date(), None)
            if fault:
                what = f"the key of {known.owner}, {own.key_id[:12]}…, {fault}"
                outcome = BundleOutcome.TAMPERED if known.revoked else BundleOutcome.INCOMPLETE
                findings.append(BundleFinding(outcome, path.name, what))
    if key is not None and own is not None and key.key_id != own.key_id:
        what = f"is not kept with the key {key.key_id[:12]}… given"
        findings.append(BundleFinding(BundleOutcome.TAMPERED, path.name, what))
    elif is_signature_required and not by.is_trusted and not findings:
        what = f"is {by}, but a signature by a known key is required"
        findings.append(BundleFinding(BundleOutcome.INCOMPLETE, path.name, what))
    return VerifiedNotaryList(path, tuple(findings), tuple(kept.notes), len(kept.lines), by)

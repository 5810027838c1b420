"""Check a notary's list, or a part of it: signatures, chain and order of times."""

import datetime as dt
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from itertools import pairwise
from typing import Final

from estimators.errors import EvidenceError, join_first_names
from recordings.notary.notary_limits import LIMITS
from recordings.notary.notary_list import (
    NotaryEntry,
    NotaryHead,
    NotaryLine,
    parse_untrusted_line,
    split_list_into_complete_lines_and_tail,
)
from recordings.signatures.signing import PublicKey

#: Time from a log's end to its listing after which it is noted that it may have been changed.
LATE: Final = dt.timedelta(days=1)


@dataclass(frozen=True, slots=True)
class NotaryListFault:
    """Fault in a list.

    Attributes:
        forged: whether no honest notary writes such a list; otherwise a clock or a log is at fault.
        counter: counter of the faulty line; 0 if the fault concerns the list as a whole.
        what: description of the fault.
    """

    forged: bool
    counter: int
    what: str


@dataclass(slots=True)
class CheckedNotaryList:
    """Result of checking a list.

    Attributes:
        head: first line; None if it cannot be read.
        lines: readable lines after the head.
        faults: faults of the list.
        notes: further notes for the reader.
    """

    head: NotaryHead | None = None
    lines: list[NotaryLine] = field(default_factory=list)
    faults: list[NotaryListFault] = field(default_factory=list)
    notes: list[str] = field(default_factory=list)

    @property
    def log_entries(self) -> list[NotaryEntry]:
        """Entries of the logs."""
        return [line.content for line in self.lines if isinstance(line.content, NotaryEntry)]

    @property
    def notary_public_key(self) -> PublicKey | None:
        """Public key named in the head; None without a head."""
        return None if self.head is None else PublicKey.from_base64_text(self.head.public_key)

    def add_forgery_fault(self, text: str, counter: int = 0) -> None:
        """Add a fault that an honest notary cannot cause."""
        self.faults.append(NotaryListFault(True, counter, text))


def check_untrusted_notary_list(
    list_bytes: bytes, current_time: dt.datetime, first_counter: int = 1
) -> CheckedNotaryList:
    """Check an untrusted list, or the head and a part of one.

    Args:
        list_bytes: bytes of the list.
        current_time: present time, which no time of the list may exceed.
        first_counter: counter of the first line after the head.
    """
    checked = CheckedNotaryList()
    if len(list_bytes) > LIMITS.list_bytes:
        checked.add_forgery_fault(
            f"has more than {LIMITS.list_bytes >> 20} MiB, the most that is read"
        )
        return checked
    whole, tail = split_list_into_complete_lines_and_tail(list_bytes)
    if tail:
        checked.faults.append(
            NotaryListFault(
                False, 0, f"is truncated: {len(tail)} bytes follow its last complete line"
            )
        )
    lines: list[NotaryLine] = []
    for number, line in enumerate(whole, start=1):
        try:
            lines.append(parse_untrusted_line(line, f"line {number}"))
        except EvidenceError as fault:
            checked.add_forgery_fault(str(fault))
            if len(checked.faults) >= LIMITS.max_faults:
                return checked
    _check_head_signature(checked, lines)
    if checked.head is None:
        return checked
    checked.lines = lines[1:]
    _check_chain_of_lines(checked, lines, first_counter)
    checked.faults += _iter_contradictory_times(checked.log_entries, current_time)
    checked.notes += iter_remarks_on_notary_list(checked.log_entries)
    return checked


def _check_head_signature(
    checked_list: CheckedNotaryList, notary_lines: Sequence[NotaryLine]
) -> None:
    """Check the signature of the first line with the key that the line names."""
    if not notary_lines or not isinstance(notary_lines[0].content, NotaryHead):
        checked_list.add_forgery_fault("its first line is not the head of a notary list")
        return
    try:
        key = PublicKey.from_base64_text(notary_lines[0].content.public_key)
    except EvidenceError as fault:
        checked_list.add_forgery_fault(f"its head names no valid key: {fault}")
        return
    checked_list.head = notary_lines[0].content
    for line in notary_lines[1:]:
        if isinstance(line.content, NotaryHead):
            checked_list.add_forgery_fault("has a second head: two lists were put together")
            return
    for line in notary_lines:
        if not line.is_signed_by(key):
            counter = line.content.counter
            checked_list.add_forgery_fault(
                f"number {counter} is not signed by the key that the list's head names", counter
            )


def _check_chain_of_lines(
    checked_list: CheckedNotaryList, notary_lines: Sequence[NotaryLine], first_counter: int
) -> None:
    """Check that each line refers to the line before it."""
    head = notary_lines[0].line_sha256
    for line in checked_list.lines:
        entry = line.content
        if isinstance(entry, NotaryEntry) and entry.head != head:
            checked_list.add_forgery_fault(
                f"number {entry.counter} belongs to another list", entry.counter
            )
    for before, line in pairwise(notary_lines):
        entry, last = line.content, before.content
        if not isinstance(entry, NotaryEntry):
            continue
        before_it = first_counter - 1 if isinstance(last, NotaryHead) else last.counter
        if before_it and isinstance(last, NotaryHead) and entry.counter == first_counter:
            continue  # first line of a part of a list, whose previous line is absent
        if entry.counter <= before_it:
            checked_list.add_forgery_fault(
                f"number {entry.counter} comes after number {before_it}: out of order, or twice",
                entry.counter,
            )
        elif entry.counter > before_it + 1:
            start, end = before_it + 1, entry.counter - 1
            span = f"number {start} is" if start == end else f"numbers {start} to {end} are"
            checked_list.add_forgery_fault(f"{span} missing", end)
        elif entry.previous != before.line_sha256:
            checked_list.add_forgery_fault(
                f"number {entry.counter} was not written after number {last.counter} of this list",
                entry.counter,
            )


def _iter_contradictory_times(
    entries: Sequence[NotaryEntry], current_time: dt.datetime
) -> Iterator[NotaryListFault]:
    """Yield faults on contradictory times: of entries, of logs, or later than the present."""
    clock = dt.timedelta(seconds=LIMITS.clock_difference_s)
    latest: NotaryEntry | None = None
    ended: NotaryEntry | None = None
    for entry in entries:
        starts, ends, listed = map(parse_list_time, (entry.begins, entry.ends, entry.listed))
        assert listed is not None
        number = entry.counter
        if starts is not None and ends is not None and ends < starts:
            yield NotaryListFault(True, number, f"number {number} ends before it begins")
        if listed > current_time + clock:
            yield NotaryListFault(
                False,
                number,
                f"number {number} was listed in the future, {entry.listed}: the recorder's clock "
                "is ahead of this computer's",
            )
        if ends is not None and ends > listed + clock:
            yield NotaryListFault(
                False,
                number,
                f"number {number} ends {entry.ends}, after it was listed, {entry.listed}: one of "
                "the two clocks is wrong or was set back",
            )
        if latest is not None and entry.listed < latest.listed:
            yield NotaryListFault(
                False,
                number,
                f"number {number} was listed {entry.listed}, before number {latest.counter}, "
                f"{latest.listed}: the clock was set back",
            )
        elif latest is None or entry.listed > latest.listed:
            latest = entry
        if ended is not None and entry.ends and entry.ends < ended.ends:
            yield NotaryListFault(
                False,
                number,
                f"number {number} ends {entry.ends}, before number {ended.counter}, {ended.ends}: "
                "it reached the folder late, or the recorder's clock was set back",
            )
        elif entry.ends:
            ended = entry
        if entry.replaces is not None:
            yield NotaryListFault(
                False,
                number,
                f"number {number}: '{entry.log}' was changed after it had been listed as number "
                f"{entry.replaces}",
            )


def iter_remarks_on_notary_list(log_entries: Sequence[NotaryEntry]) -> Iterator[str]:
    """Yield remarks on a list that are not faults."""
    seen: dict[tuple[str, ...], NotaryEntry] = {}
    late: dict[int, float] = {}
    undated: list[int] = []
    for entry in log_entries:
        ends, listed = parse_list_time(entry.ends), parse_list_time(entry.listed)
        if ends is None:
            undated.append(entry.counter)
        elif listed is not None and listed - ends > LATE:
            late[entry.counter] = (listed - ends).total_seconds() / 86400.0
        digests = tuple(sorted(file.sha256 for file in entry.files))
        first = seen.setdefault(digests, entry)
        if first is not entry:
            yield f"number {entry.counter}: '{entry.log}' is the same log as number {first.counter}"
    if undated:
        yield f"{_format_line_numbers(undated)}: the log has no absolute time, or cannot be read"
    if late:
        named, days = _format_line_numbers(list(late)), max(late.values())
        yield (
            f"{named}: listed up to {days:.0f} days after the log ended; the list does not show "
            "whether it was changed in between"
        )


def _format_line_numbers(counters: Sequence[int]) -> str:
    """Format the counters of affected lines; only the first ones are listed."""
    return f"number {join_first_names(counters, LIMITS.max_entries)}"


def parse_list_time(time_text: str) -> dt.datetime | None:
    """Parse a time of a list; None if it is empty."""
    return dt.datetime.fromisoformat(time_text) if time_text else None

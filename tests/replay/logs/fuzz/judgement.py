"""What a reader may do with a damaged log: read less, and say so. Nothing else."""

import json
import re
import struct
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, Final

import polars as pl

from estimators.errors import LogError
from replay import open_log
from replay.logs import Log
from tests.replay.logs.fuzz.campaign import Case
from tests.replay.logs.fuzz.damage import cut, delete, flip, flip_covered, lengthen, overwrite
from tests.replay.logs.fuzz.sources import Guard
from tests.replay.sledge import Payscope

_ADDING_NOTHING: Final = (cut, flip, flip_covered, overwrite, lengthen, delete)
Row = tuple[Any, ...]
#: "lost from log time 12 ns, 0.150 s: 4 of /state, 5 of /wheels"
_HELD: Final = re.compile(r"(?:: |, )([\d,]+) of (/\w+)")


@dataclass(frozen=True)
class Reading:
    """Everything that a log gave."""

    #: by topic, in the order read, numbers by their bits
    rows: dict[str, list[Row]] = field(default_factory=dict)
    #: messages by topic, as the table of topics says
    announced: dict[str, int] = field(default_factory=dict)
    losses: tuple[str, ...] = ()
    #: why the log, or a topic of it, was not read
    refused: tuple[str, ...] = ()
    #: what does not hold of this log by itself
    faults: tuple[str, ...] = ()

    @property
    def count(self) -> int:
        """All rows."""
        return sum(map(len, self.rows.values()))

    @property
    def outcome(self) -> str:
        """For the table of the campaign."""
        if self.refused and not self.rows:
            return "refused"
        return "losses" if self.losses or self.refused else "whole"


def read_all(path: Path, start_ns: int, end_ns: int) -> Reading:
    """Read every field of every topic: one by one, at once, and between two times."""
    try:
        with open_log(path) as log:
            return _read_all(log, start_ns, end_ns)
    except LogError as error:
        return Reading(refused=(str(error),))


def _read_all(log: Log, start_ns: int, end_ns: int) -> Reading:
    topics = log.topics()
    readable = topics.filter(pl.col("problem").is_null())
    frames: dict[str, pl.DataFrame] = {}
    refused: list[str] = []
    fields = {row["topic"]: _every_field(row["fields"]) for row in readable.iter_rows(named=True)}
    for topic, names in fields.items():
        try:
            frames[topic] = log.read(topic, names)
        except LogError as error:
            refused.append(str(error))
    faults: list[str] = []
    asked = {topic: fields[topic] for topic in frames}
    at_once = log.read_many(asked)
    losses = log.losses()
    for topic, frame in frames.items():
        if not frame["log_time_ns"].is_sorted():
            faults.append(f"{topic}: rows are not in the order of log time")
        if _rows(at_once[topic]) != _rows(frame):
            faults.append(f"{topic}: read_many gives other rows than read")
    inside = pl.col("log_time_ns").is_between(start_ns, end_ns)
    try:
        between = log.read_many(asked, start_ns, end_ns)
    except LogError as error:  # all messages between the two may be undecodable
        refused.append(str(error))
    else:
        for topic, frame in frames.items():
            if not losses and _rows(between[topic]) != _rows(frame.filter(inside)):
                faults.append(f"{topic}: other rows between two times, and no loss says so")
    return Reading(
        {topic: _rows(frame) for topic, frame in frames.items()},
        dict(topics.select("topic", "messages").rows()),
        tuple(str(loss) for loss in log.losses()),
        tuple(refused),
        tuple(faults),
    )


def _every_field(leaves: list[str]) -> list[str]:
    """Leaves, and of each list an element by number and, where there are names, by name."""
    picks = ["[1]", *(["[left]"] if "name[]" in leaves else [])]
    lists = [leaf.removesuffix("[]") for leaf in leaves if leaf.endswith("[]")]
    return [*leaves, *(f"{name}{pick}" for name in lists if "[" not in name for pick in picks)]


def _rows(frame: pl.DataFrame) -> list[Row]:
    return [_bits(row) for row in frame.rows()]


def _bits(value: Any) -> Any:
    if isinstance(value, tuple | list):
        return tuple(_bits(one) for one in value)
    return struct.pack("<d", value) if isinstance(value, float) else value


def faults_of(found: Reading, whole: Reading, case: Case) -> Iterator[str]:
    """What does not hold of a damaged log, in sentences."""
    yield from found.faults
    for text in (*found.losses, *found.refused):
        if len(text.splitlines()) != 1:
            yield f"more than a line: {text!r}"
    said = bool({*found.losses, *found.refused} - {*whole.losses})
    for topic, rows in found.rows.items():
        if len(rows) != found.announced[topic] and not said:
            yield f"{topic}: {found.announced[topic]} announced, {len(rows)} read, nothing said"
    if whole.count > found.count and not said and _is_counted(case):
        yield f"{whole.count - found.count} rows are lost without a word"
    if found.count > whole.count and case.damage in _ADDING_NOTHING:
        yield f"{found.count - whole.count} rows more than there were"
    if case.damage is cut:
        yield from _faults_of_cut(found, whole, case)
    if case.guard is not None:
        yield from _faults_of_guarded(found, whole, case.guard, said=said)


def _is_counted(case: Case) -> bool:
    """Nothing counts the lines of a text, nor the rows of a database unless its end is missing."""
    suffix = case.source.path.suffix
    return suffix not in (".csv", ".jsonl") and (suffix != ".db3" or case.damage is cut)


def _faults_of_cut(found: Reading, whole: Reading, case: Case) -> Iterator[str]:
    """Nothing was altered, but for a row that is cut in two where nothing tells its length."""
    if case.source.path.suffix == ".csv":
        # of what kind a column is depends on every cell: only the times of rows can be compared
        found, whole = (
            replace(each, rows={t: [row[:1] for row in rows] for t, rows in each.rows.items()})
            for each in (found, whole)
        )
        yield from _new_rows(found, whole, 1)
    else:
        torn = any("its last page is incomplete" in loss for loss in found.losses)
        yield from _new_rows(found, whole, 1 if torn else 0)


def _faults_of_guarded(
    found: Reading, whole: Reading, guard: Guard, *, said: bool
) -> Iterator[str]:
    if found.rows != whole.rows and not said:
        yield "other rows than those that a checksum covers, nothing said"
    if guard.keeps_rows:
        yield from _new_rows(found, whole, 0)
    if guard.is_counted:
        rows = whole.rows.items()
        lost = Counter({t: len(was) - len(found.rows.get(t, ())) for t, was in rows})
        named = _named(found)
        if named != +lost:
            yield f"lost are {dict(+lost)}, the losses name {dict(named)}"


def _new_rows(found: Reading, whole: Reading, tolerated: int) -> Iterator[str]:
    for topic, rows in found.rows.items():
        new = Counter(rows) - Counter(whole.rows.get(topic, ()))
        if new.total() > tolerated:
            yield f"{topic}: {new.total()} rows that the undamaged log does not have"


def _named(found: Reading) -> Counter[str]:
    """Messages that losses name, by topic."""
    named: Counter[str] = Counter()
    for loss in found.losses:
        for count, topic in _HELD.findall(loss):
            named[topic] += int(count.replace(",", ""))
    return named


def faults_of_command(payscope: Payscope, words: tuple[object, ...]) -> Iterator[str]:
    """What does not hold of a command on a damaged log."""
    said = payscope(*words)
    told = f"{words[0]} left with {said.status}: {said.err!r}"
    if said.status not in (0, 1, 2) or "Traceback" in said.out + said.err:
        yield told
    if said.status == 2 and (said.out or len(said.err.splitlines()) != 1):
        yield told
    if said.status == 0 and "--json" in words:
        json.loads(said.out)

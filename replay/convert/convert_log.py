"""The command `convert`: write a log as Parquet by topic, which payscope reads as a log again."""

import json
import re
import shutil
from collections.abc import Callable, Mapping, Sequence
from contextlib import ExitStack
from dataclasses import asdict, dataclass
from importlib.metadata import version
from math import ceil
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final, NamedTuple

import polars as pl

from analysis.model.loss import Loss
from estimators.errors import LogError, OutputError, suggest_choice
from recordings.report.atomic_output import refuse_input_as_output, require_writable_folder
from replay.convert.convert_limits import LIMITS
from replay.convert.unfinished_folder import (
    ConversionPlan,
    PartWriter,
    UnfinishedFolder,
    make_arrow_schema_with_units,
    open_unfinished_folder,
    write_file_atomically,
)
from replay.logs import Log
from replay.logs.converted import DESCRIPTION
from replay.logs.converted.description import (
    LOG_TIME,
    ConvertedDescription,
    ConvertedField,
    ConvertedPart,
    ConvertedTopic,
    SourceFile,
)

if TYPE_CHECKING:
    import pyarrow as pa

_STAMP: Final = "header_stamp_ns"


@dataclass(frozen=True, slots=True)
class Conversion:
    """Result of a conversion.

    Attributes:
        folder: output folder.
        topics: converted topics with their parts.
        losses: data that could not be read.
        spans: number of time spans that the log was divided into.
        resumed_spans: number of spans from an earlier, interrupted conversion.
    """

    folder: Path
    topics: tuple[ConvertedTopic, ...]
    losses: tuple[Loss, ...]
    spans: int
    resumed_spans: int

    @property
    def row_count(self) -> int:
        """Number of rows written over all topics."""
        return sum(part.rows for topic in self.topics for part in topic.parts)

    @property
    def size_bytes(self) -> int:
        """Size of all parts in bytes."""
        return sum(part.size_bytes for topic in self.topics for part in topic.parts)

    def to_dict(self) -> dict[str, Any]:
        """The fields as JSON-compatible values."""
        return {
            "folder": str(self.folder),
            "rows": self.row_count,
            "size_bytes": self.size_bytes,
            "spans": self.spans,
            "taken_up": self.resumed_spans,
            "topics": [
                {
                    "topic": topic.summary["topic"],
                    "folder": topic.folder,
                    "rows": sum(part.rows for part in topic.parts),
                    "size_bytes": sum(part.size_bytes for part in topic.parts),
                    "fault": topic.fault or topic.summary["problem"],
                }
                for topic in self.topics
            ],
            "losses": [asdict(loss) for loss in self.losses],
        }


def convert_log(
    log: Log,
    target: Path,
    topics: Sequence[str] | None = None,
    *,
    overwrites: bool = False,
    on_span: Callable[[str], None] = lambda _: None,
    span_messages: int = LIMITS.span_messages,
) -> Conversion:
    """Write every topic of a log as Parquet, in bounded memory.

    An interrupted conversion of the same log is resumed. If data is lost, or an index disagrees
    with the messages, the log is converted in one pass without its time index, so that the rows
    equal those of reading it.

    Args:
        log: opened log.
        target: output folder; it appears when complete.
        topics: topics to convert; None converts all decodable ones.
        overwrites: whether to replace an existing converted log.
        on_span: called when a span begins: "convert 2 of 7".
        span_messages: most messages per span.

    Raises:
        LogError: a topic does not exist.
        OutputError: the folder cannot be written, or exists already.
    """
    refuse_input_as_output(target, [log.path])
    require_writable_folder(target, overwrites=overwrites, marker=DESCRIPTION)
    making = RunningConversion(log, topics)
    try:
        with open_unfinished_folder(target) as folder:
            done, resumed_spans = making.convert_by_time_spans(folder, span_messages, on_span)
            described = making.describe_converted_log(folder, done)
            kept = {part.file for topic in described.topics for part in topic.parts}
            folder.remove_all_except(kept)
            write_file_atomically(folder.path / DESCRIPTION, described.model_dump_json(indent=1))
            _move_finished_folder_into_place(folder.path, target)
    except OSError as error:
        raise OutputError(f"{target}: cannot be written ({error.strerror or error})") from None
    return Conversion(target, described.topics, described.losses, len(done), resumed_spans)


def _move_finished_folder_into_place(finished: Path, target: Path) -> None:
    """Move the finished folder to its name; the old one is deleted afterwards."""
    before = finished / ".replaced"
    if target.exists():
        target.replace(before)
    finished.replace(target)
    shutil.rmtree(target / before.name, ignore_errors=True)


_Parts = Mapping[str, ConvertedPart]


class ConvertedSpans(NamedTuple):
    """Parts of each span, and number of spans from an earlier conversion."""

    parts_by_span: list[_Parts]
    resumed_span_count: int


class RunningConversion:
    """A conversion in progress."""

    def __init__(self, log: Log, topics: Sequence[str] | None) -> None:
        self._log = log
        self._summaries = {row["topic"]: row for row in log.topics().iter_rows(named=True)}
        for topic in topics or ():
            if topic not in self._summaries:
                raise LogError(
                    f"{log.path}: no topic '{topic}'; {suggest_choice(topic, self._summaries)}"
                )
        chosen = dict.fromkeys(topics or self._summaries)
        self._summaries = {t: row for t, row in self._summaries.items() if t in chosen}
        decoded = [t for t, row in self._summaries.items() if row["problem"] is None]
        self._fields = {t: _list_fields_to_convert(log, t) for t in decoded}
        self._folders = make_unique_folder_names(decoded)
        self._faults: dict[str, str] = {}
        self._files = tuple(
            SourceFile(name=path.name, size_bytes=path.stat().st_size, sha256=digest)
            for path, digest in zip(log.files, log.digests, strict=True)
        )
        self._schemas = {t: self._make_topic_schema(t) for t in decoded}

    def convert_by_time_spans(
        self, working_folder: UnfinishedFolder, span_messages: int, on_span: Callable[[str], None]
    ) -> ConvertedSpans:
        """Convert span by span; in one pass if that would differ, or if the log has faults.

        Returns:
            The converted parts of each span, and how many spans an earlier, interrupted conversion
            had finished.
        """
        borders = self._choose_span_boundaries_ns(span_messages)
        plan = ConversionPlan(
            payscope=version("payscope"),
            files=self._files,
            topics=tuple(self._summaries),
            borders_ns=borders,
        )
        before = set(self._log.losses())
        done: list[_Parts] = [
            span.parts for span in working_folder.resume_or_restart_conversion(plan)
        ]
        resumed_spans = len(done)
        if borders and not before:
            for number in range(len(done), len(borders) + 1):
                on_span(f"convert {number + 1} of {len(borders) + 1}")
                first = borders[number - 1] if number else None
                last = borders[number] - 1 if number < len(borders) else None
                parts = self._convert_time_span(working_folder.path, number, first, last)
                if self._faults or self._log.losses():
                    break
                done.append(working_folder.record_finished_span(number, parts).parts)
            else:
                if self._do_rows_match_index(done):
                    return ConvertedSpans(done, resumed_spans)
        working_folder.remove_content_except_lock()
        self._faults.clear()
        on_span("convert 1 of 1")
        return ConvertedSpans([self._convert_time_span(working_folder.path, 0, None, None)], 0)

    def _choose_span_boundaries_ns(self, span_messages: int) -> tuple[int, ...]:
        """Choose the log times in ns that divide the log into spans of equal duration."""
        rows = self._summaries.values()
        starts = [row["start_ns"] for row in rows if row["start_ns"] is not None]
        if not starts:
            return ()
        start, end = min(starts), max(row["end_ns"] for row in rows if row["end_ns"] is not None)
        size = sum(file.size_bytes for file in self._files)
        messages = sum(row["messages"] for row in rows)
        spans = max(ceil(messages / span_messages), ceil(size / LIMITS.span_bytes))
        found = {start + (end - start) * k // spans for k in range(1, spans)}
        return tuple(sorted(found - {start}))

    def _convert_time_span(
        self, working_folder: Path, span_number: int, first_ns: int | None, last_ns: int | None
    ) -> dict[str, ConvertedPart]:
        """Write the rows of a span, as a part for each topic with rows."""
        with ExitStack() as open_files:
            writers: dict[str, PartWriter] = {}
            names = {topic: [f.name for f in fields] for topic, fields in self._fields.items()}
            scanned = self._log.scan_many(names, self._faults, first_ns, last_ns)
            for topic, rows in scanned:
                if topic not in writers:
                    file = self._make_part_path(topic, span_number)
                    writer = PartWriter(working_folder, file, self._schemas[topic])
                    writers[topic] = open_files.enter_context(writer)
                writers[topic].append_rows(rows)
            return {
                topic: writer.close_and_describe_part() for topic, writer in sorted(writers.items())
            }

    def _make_part_path(self, topic: str, span_number: int) -> str:
        return f"{self._folders[topic]}/part-{span_number:05}.parquet"

    def _do_rows_match_index(self, finished_spans: Sequence[_Parts]) -> bool:
        """Whether each topic has as many written rows as messages in the index."""
        rows = dict.fromkeys(self._fields, 0)
        for parts in finished_spans:
            for topic, part in parts.items():
                rows[topic] += part.rows
        return all(self._summaries[topic]["messages"] == count for topic, count in rows.items())

    def describe_converted_log(
        self, working_folder: UnfinishedFolder, finished_spans: Sequence[_Parts]
    ) -> ConvertedDescription:
        """Describe the converted log; a topic without rows gets an empty part with its columns."""
        topics: list[ConvertedTopic] = []
        for topic, summary in self._summaries.items():
            if topic not in self._fields:
                topics.append(ConvertedTopic(summary=summary))
                continue
            parts = [each[topic] for each in finished_spans if topic in each]
            if not parts:
                writer = PartWriter(
                    working_folder.path, self._make_part_path(topic, 0), self._schemas[topic]
                )
                parts = [writer.close_and_describe_part()]
            topics.append(
                ConvertedTopic(
                    summary=summary,
                    fault=self._faults.get(topic, ""),
                    folder=self._folders[topic],
                    fields=self._fields[topic],
                    parts=tuple(parts),
                )
            )
        return ConvertedDescription(
            payscope=version("payscope"),
            log=self._log.path.name,
            log_format=self._log.format,
            files=self._files,
            topics=tuple(topics),
            losses=self._log.losses(),
            notes=self._log.notes(),
        )

    def _make_topic_schema(self, topic: str) -> "pa.Schema":
        """Make the schema of a topic, with metadata for readers of a single file."""
        log, summary = self._log, self._summaries[topic]
        leaves = log.leaf_fields(topic, [field.name for field in self._fields[topic]])
        schema = pl.Schema(
            {LOG_TIME: pl.Int64(), _STAMP: pl.Int64(), **{leaf.name: leaf.dtype for leaf in leaves}}
        )
        units = {field.name: field.unit for field in self._fields[topic]}
        about = {
            "log": log.path.name,
            "log_format": log.format,
            "log_files": json.dumps([file.model_dump() for file in self._files]),
            "topic": topic,
            "type": summary["type"],
            "encoding": summary["encoding"],
            "definition": log.definition(topic),
            "version": version("payscope"),
        }
        named = {f"payscope.{key}": str(value) for key, value in about.items()}
        return make_arrow_schema_with_units(schema, {LOG_TIME: "ns", _STAMP: "ns", **units}, named)


def _list_fields_to_convert(log: Log, topic: str) -> tuple[ConvertedField, ...]:
    units = log.units(topic)
    return tuple(
        ConvertedField(
            name=leaf.name,
            lengths=leaf.lengths,
            value_names=leaf.value_names,
            is_stamp=leaf.is_stamp,
            unit=units.get(leaf.name, "ns" if leaf.is_stamp else ""),
        )
        for leaf in log.leaf_fields(topic)
    )


def make_unique_folder_names(topics: Sequence[str]) -> dict[str, str]:
    """Make a unique folder name for each topic, of letters, digits and underscores."""
    found: dict[str, str] = {}
    taken: set[str] = set()
    for topic in topics:
        word = re.sub(r"\W+", "_", topic, flags=re.ASCII).strip("_") or "topic"
        name, number = word, 1
        # a file system may not distinguish upper and lower case
        while name.lower() in taken:
            number += 1
            name = f"{word}_{number}"
        taken.add(name.lower())
        found[topic] = name
    return found

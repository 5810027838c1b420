"""Importer of the Rerun viewer, which replays a log with a machine file, and shows others raw."""

from collections.abc import Iterator
from pathlib import Path
from typing import Final

import polars as pl

from analysis.stages.signals.timestamps import assign_timestamps
from estimators.errors import LogError, PayscopeError, format_count, join_to_one_line
from recordings.rrd.viewer_stream import (
    ViewerRequest,
    stream_run_to_stdout,
    stream_topics_to_stdout,
)
from replay.logs import Log, open_log
from replay.machines.machine_file import (
    find_machine_file_or_shipped_one,
    find_time_axis_of_machine,
    load_machine,
)
from replay.pipeline import run
from replay.recording.importer_files import VARIABLE, find_machine_file_of_log

#: Most elements of a list without names that are drawn.
_ELEMENTS: Final = 12
#: Fields with numbers that are not worth plotting over time.
_LEFT_OUT: Final = ("header.", "covariance")


def stream_log_to_viewer(log: Path, request: ViewerRequest) -> str | None:
    """Write a log to standard output in the viewer's format.

    Args:
        log: path accepted by `should_import_file`.
        request: request of the viewer.

    Returns:
        Why the log is shown without a replay if its machine file does not fit, otherwise None.

    Raises:
        PayscopeError: the log cannot be read.
    """
    machine_file = find_machine_file_of_log(log)
    fault: str | None = None
    if machine_file is not None:
        try:
            machine = load_machine(find_machine_file_or_shipped_one(machine_file))
            with open_log(log, time=find_time_axis_of_machine(machine)) as opened:
                replayed = run(opened, machine)
        except PayscopeError as error:
            fault = join_to_one_line(str(error))
        else:
            stream_run_to_stdout(replayed, request)
            return None
    with open_log(log) as opened:
        topics = dict(iter_readable_topic_frames(opened))
        stream_topics_to_stdout(
            topics, _describe_log_markdown(opened, machine_file, fault), log.name, request
        )
    return fault


def iter_readable_topic_frames(log: Log) -> Iterator[tuple[str, pl.DataFrame]]:
    """Yield each readable topic with its rows in order of time: `unix_ns`, and fields to plot."""
    for row in log.topics().sort("messages", descending=True).to_dicts():
        if row["problem"] or not row["messages"]:
            continue
        fields = list(iter_imported_field_paths(log, row))
        if not fields:
            continue
        try:
            frame = log.read(row["topic"], fields)
        except LogError:
            continue  # if a topic cannot be decoded, only that topic is missing
        placed, _, _ = assign_timestamps({row["topic"]: frame})
        yield row["topic"], placed[row["topic"]]


def iter_imported_field_paths(log: Log, topic_row: dict[str, object]) -> Iterator[str]:
    """Yield the paths of the fields that are imported; list elements by name, if they have one."""
    fields, topic = topic_row["fields"], str(topic_row["topic"])
    assert isinstance(fields, list)
    for field in map(str, fields):
        if any(part in field for part in _LEFT_OUT):
            continue
        if "[]" not in field:
            yield field
        elif field.endswith("[]") and field.count("[]") == 1 and not field.endswith("name[]"):
            yield from _iter_paths_of_list_elements(
                log, topic, field.removesuffix("[]"), fields, topic_row["start_ns"]
            )


def _iter_paths_of_list_elements(
    log: Log, topic: str, field: str, fields: list[object], start_ns: object
) -> Iterator[str]:
    assert isinstance(start_ns, int)
    names = f"{field.rpartition('.')[0]}.name[]".lstrip(".")
    asked = [f"{field}[]", *([names] if names in fields else [])]
    first = log.read(topic, asked, end_ns=start_ns).head(1)
    if not first.height:
        return
    values = first[f"{field}[]"].to_list()[0] or []
    if names in fields:
        listed = first[names].to_list()[0] or []
        yield from (f"{field}[{name}]" for name in listed[: len(values)] if name)
    elif len(values) <= _ELEMENTS:
        yield from (f"{field}[{number}]" for number in range(len(values)))


def _describe_log_markdown(log: Log, machine_file: Path | None, weighing_fault: str | None) -> str:
    """Describe the log, and how to weigh it, in Markdown."""
    parts = [f"# {join_to_one_line(log.path.name)}", f"{log.format}, read by payscope."]
    if weighing_fault is not None:
        parts.append(
            f"**{machine_file} does not fit the log, so nothing was replayed:** {weighing_fault}"
        )
    else:
        parts.append(
            "Columns as recorded. To see masses, put a machine file next to the log under the "
            f"same name (`payscope init {log.path.name} -o {log.path.stem}.toml` drafts one), or "
            f"give one in `{VARIABLE}`."
        )
    rows = ["| topic | type | messages |", "|---|---|---|"]
    for row in log.topics().to_dicts():
        problem = f": {row['problem']}" if row["problem"] else ""
        rows.append(
            join_to_one_line(f"| {row['topic']} | {row['type']}{problem} | {row['messages']} |")
        )
    parts.append("\n".join(rows))
    lost = log.losses()
    if lost:
        parts.append(f"## {format_count(len(lost), 'loss')}")
        parts.append("\n".join(f"- {join_to_one_line(str(loss))}" for loss in lost))
    return "\n\n".join(parts)

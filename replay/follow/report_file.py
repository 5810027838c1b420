"""Write reports to a growing topic of an MCAP file, and format them as text."""

import json
import struct
from collections.abc import Iterable, Iterator, Sequence
from datetime import UTC, datetime
from io import BytesIO
from pathlib import Path
from typing import Any, Final, NamedTuple

from mcap.exceptions import McapError
from mcap.records import Channel, Message, Metadata
from mcap.stream_reader import StreamReader
from mcap.writer import CompressionType, Writer

from analysis.online.answer_progress import describe_missing_manoeuvres
from analysis.online.online_report import OnlineReport, make_report_schema
from analysis.online.replay_report import LoadReport, ReplayReport, make_replay_report_schema
from estimators.errors import format_count
from recordings.report.atomic_output import (
    AppendOnlyFile,
    refuse_input_as_output,
    require_writable_output,
)
from recordings.report.number_text import format_plus_minus

TOPIC: Final = "/payscope/mass"
#: Topic of the reports of background replays.
REPLAY_TOPIC: Final = "/payscope/replay"
#: Name of the metadata record that identifies the followed log.
_FOLLOWED: Final = "payscope.followed"
#: Bytes of the magic of an MCAP file, and what precedes each record: kind and length.
_MAGIC_BYTES: Final = 8
_RECORD_HEAD: Final = struct.Struct("<BQ")
#: Kinds of records: a message, and the metadata record that identifies the followed log.
_REPORTED: Final = (0x05, 0x0C)


class ReportFile:
    """MCAP file of JSON messages with their schema, each flushed to disk immediately.

    Unlike other outputs it has its final name from the first report on, so that the machine's
    controller can follow it; a killed process leaves complete reports without an index. A file that
    reports the same log is continued.

    Attributes:
        path: path of the file.
        until_unix_ns: time of the last existing report; 0 without one.
        replayed: end of the last existing replay (Unix time in ns), and whether it was of the whole
            log.
    """

    def __init__(
        self, path: Path, logs: Sequence[Path], identity: str, *, overwrites: bool
    ) -> None:
        """Create a file, or continue one of the same log.

        Raises:
            OutputError: the file is one of the logs, reports another log, or cannot be written.
        """
        refuse_input_as_output(path, (log for log in logs if log.exists()))
        reported: list[tuple[str, Message]] = []
        size = 0
        is_empty = path.is_file() and path.stat().st_size == 0
        if path.is_file() and not overwrites:
            reported, size = read_complete_reports(path, identity)
        require_writable_output(path, overwrites=overwrites or is_empty or size > 0)
        self.path = path
        self.until_unix_ns, self.replayed = 0, (0, False)
        self._stream = _ResumedStream(AppendOnlyFile(path, size))
        # in a chunk, messages would be late by the duration of the chunk
        self._writer = Writer(self._stream, compression=CompressionType.NONE, use_chunking=False)
        self._writer.start("", "payscope")
        #: channel ids by topic; replays have one from their first report on
        self._channels: dict[str, int] = {}
        self._append_channel_with_schema(TOPIC, make_report_schema())
        self._writer.add_metadata(_FOLLOWED, {"identity": identity})
        for topic, each in reported:
            self._append_json_message(topic, each.log_time, each.publish_time, each.data)
            if topic == TOPIC:
                self.until_unix_ns = max(self.until_unix_ns, each.log_time)
            else:
                found = json.loads(each.data)
                self.replayed = max(self.replayed, (found["unix_ns"], found["is_whole"]))
        self._stream.flush()

    def append_new_reports(self, reports: Iterable[OnlineReport]) -> None:
        """Append the reports that are later than the last one in the file.

        Raises:
            OSError: they do not fit on the disk.
        """
        for report in reports:
            if report.unix_ns > self.until_unix_ns:
                self._append_report_message(TOPIC, report.unix_ns, report)
        self._stream.flush()

    def append_replay_report_if_new(self, replay_report: ReplayReport, unix_ns: int) -> None:
        """Append the report of a replay, made at `unix_ns` of the log, unless it is there.

        Raises:
            OSError: it does not fit on the disk.
        """
        if (replay_report.unix_ns, replay_report.is_whole) > self.replayed:
            self._append_report_message(REPLAY_TOPIC, unix_ns, replay_report)
            self._stream.flush()

    def close_with_index(self) -> None:
        """Write the index, and close the file.

        Raises:
            OSError: it does not fit on the disk.
        """
        try:
            self._writer.finish()
            self._stream.flush()
        finally:
            self._stream.close()

    def close_without_index(self) -> None:
        """Close the file without an index."""
        self._stream.close()

    def _append_report_message(
        self, topic: str, log_time_ns: int, report: OnlineReport | ReplayReport
    ) -> None:
        data = json.dumps(report.to_dict(), allow_nan=False).encode()
        self._append_json_message(topic, log_time_ns, report.unix_ns, data)

    def _append_json_message(
        self, topic: str, log_time_ns: int, time_ns: int, json_bytes: bytes
    ) -> None:
        # registered at its first message, so that a continued file has the same bytes
        if topic not in self._channels:
            self._append_channel_with_schema(topic, make_replay_report_schema())
        self._writer.add_message(self._channels[topic], log_time_ns, json_bytes, time_ns)

    def _append_channel_with_schema(self, topic: str, json_schema: dict[str, Any]) -> None:
        number = self._writer.register_schema(
            str(json_schema["title"]), "jsonschema", json.dumps(json_schema).encode()
        )
        self._channels[topic] = self._writer.register_channel(topic, "json", number)


class _ResumedStream(BytesIO):
    """File object for the MCAP writer that skips existing bytes."""

    def __init__(self, file: AppendOnlyFile) -> None:
        super().__init__()
        self._file, self._at = file, 0
        self._new = bytearray()

    def write(self, data: "bytes | bytearray | memoryview", /) -> int:  # pyright: ignore[reportIncompatibleMethodOverride]
        there = max(0, self._file.size - self._at)
        self._new += data[there:]
        self._at += len(data)
        return len(data)

    def tell(self) -> int:
        return self._at

    def flush(self) -> None:
        new, self._new = bytes(self._new), bytearray()
        self._file.append_record(new)

    def close(self) -> None:
        self._file.close()
        super().close()


class _StoredReports(NamedTuple):
    """Complete reports with their topics, and the number of bytes up to their end."""

    messages: list[tuple[str, Message]]
    complete_bytes: int


def read_complete_reports(path: Path, input_identity: str) -> _StoredReports:
    """Read the complete reports of a file, if it is of the same log; else none and 0 bytes."""
    data = path.read_bytes()
    size = _count_complete_bytes(data)
    found: list[tuple[str, Message]] = []
    topics: dict[int, str] = {}
    is_of_same = False
    try:
        for record in StreamReader(BytesIO(data[:size])).records:
            if isinstance(record, Metadata) and record.name == _FOLLOWED:
                is_of_same = record.metadata.get("identity") == input_identity
            elif isinstance(record, Channel):
                topics[record.id] = record.topic
            elif isinstance(record, Message):
                found.append((topics[record.channel_id], record))
    except (McapError, struct.error):
        pass  # the file is incomplete, or not an MCAP file
    return _StoredReports(found, size) if is_of_same else _StoredReports([], 0)


def _count_complete_bytes(data: bytes) -> int:
    """Count the bytes up to the end of the last complete report."""
    at, whole = _MAGIC_BYTES, 0
    while at + _RECORD_HEAD.size <= len(data):
        kind, length = _RECORD_HEAD.unpack_from(data, at)
        at += _RECORD_HEAD.size + length
        if kind in _REPORTED and at <= len(data):
            whole = at
    return whole


def format_utc_time_of_day(unix_ns: int) -> str:
    """Format the time of day in UTC, to a tenth of a second."""
    at = datetime.fromtimestamp(unix_ns // 10**9, UTC)
    return f"{at:%H:%M:%S}.{unix_ns % 10**9 // 10**8}"


def describe_mass_and_friction(report: OnlineReport) -> str:
    """Format mass and friction with their uncertainties, or say why there is no mass."""
    if report.mass_kg is None:
        return report.validity.replace("_", " ")
    return (
        f"{report.mass_kg:,.1f} ± {report.mass_u_kg:,.1f} kg, friction "
        f"{report.friction_x_N_s_m:,.0f} ± {report.friction_u_N_s_m:,.0f} N·s/m, {report.validity}"
    )


def describe_inertia_and_yaw_friction(report: OnlineReport) -> str:
    """Format yaw inertia and friction with their uncertainties; empty before the first spin."""
    if not report.spins:
        return ""
    if report.inertia_z_kg_m2 is None:
        return f"inertia {report.spin_validity}"
    return (
        f"inertia {report.inertia_z_kg_m2:,.0f} ± {report.inertia_u_kg_m2:,.0f} kg·m², friction "
        f"{report.friction_z_N_m_s:,.0f} ± {report.friction_z_u_N_m_s:,.0f} N·m·s, "
        f"{report.spin_validity}"
    )


def describe_finished_manoeuvre(report: OnlineReport) -> str:
    """Describe the result of a manoeuvre or spin; empty for other events."""
    match report.event:
        case "manoeuvre":
            return describe_mass_and_friction(report)
        case "spin":
            return describe_inertia_and_yaw_friction(report)
        case _:
            return ""


def describe_progress_to_target_uncertainty(report: OnlineReport) -> str:
    """Describe the progress to the target uncertainty, and the starts needed; "" without target."""
    if report.until_u_kg is None or report.percent is None:
        return ""
    missing = describe_missing_manoeuvres(report.starts_missing, report.reverse_missing)
    rest = f"; needs {missing}" if missing else ""
    if report.load_mass_kg is None or report.load_u_kg is None:
        return f"0 % of the information for ± {report.until_u_kg:,.3g} kg{rest}"
    return (
        f"{report.percent:.0f} % of the information for ± {report.until_u_kg:,.3g} kg: "
        f"present load {report.load_mass_kg:,.1f} ± {report.load_u_kg:,.1f} kg from "
        f"{format_count(report.load_manoeuvres, 'manoeuvre')}{rest}"
    )


def describe_load_state(load: LoadReport) -> str:
    """Describe a load state in a line: span, mass and payload with uncertainties, or why none."""
    start, end = map(format_utc_time_of_day, (load.start_unix_ns, load.end_unix_ns))
    head = f"load {load.load_id}, {start} to {end}, {format_count(load.manoeuvres, 'manoeuvre')}: "
    if load.mass_kg is None:
        return f"{head}no mass, withheld by {load.withheld_by}"
    mass = f"{format_plus_minus(load.mass_kg, load.mass_u_kg)} kg"
    if load.empty:
        return f"{head}{mass}, empty"
    if load.payload_kg is None:
        return f"{head}{mass}"
    return f"{head}{mass}, payload {format_plus_minus(load.payload_kg, load.payload_u_kg)} kg"


def describe_replay_result(replay_report: ReplayReport) -> str:
    """Describe the result of a replay in a line: its end and loads, or why there is none."""
    if replay_report.fault:
        return f"not replayed: {replay_report.fault}"
    until = f"replayed up to {format_utc_time_of_day(replay_report.unix_ns)}"
    when = (
        "the whole log replayed"
        if replay_report.is_whole
        else f"{until}, {replay_report.age_s:,.0f} s ago"
    )
    loads = format_count(len(replay_report.loads), "load")
    if replay_report.inertia_z_kg_m2 is not None:
        turning = format_plus_minus(replay_report.inertia_z_kg_m2, replay_report.inertia_u_kg_m2)
        loads += f", yaw inertia {turning} kg·m²"
    if replay_report.withheld_by:
        return f"{when}: no mass, withheld by {', '.join(replay_report.withheld_by)}"
    return f"{when}: {loads}"


def iter_closed_load_lines(
    replay_report: ReplayReport, earlier_report: ReplayReport | None
) -> Iterator[str]:
    """Yield a line per load that closed since an earlier replay; all loads for the whole log."""
    if replay_report.is_whole:
        yield describe_replay_result(replay_report)
    known = [] if replay_report.is_whole or earlier_report is None else earlier_report.closed_loads
    spans = {(load.start_unix_ns, load.end_unix_ns) for load in known}
    for load in replay_report.closed_loads:
        if (load.start_unix_ns, load.end_unix_ns) not in spans:
            yield describe_load_state(load)


def format_replay_markdown(replay_report: ReplayReport) -> str:
    """Format the newest replay in Markdown, for the panel beside the plots."""
    return "\n".join(
        [
            f"## {describe_replay_result(replay_report)}\n",
            *(f"- {describe_load_state(e)}" for e in replay_report.loads),
        ]
    )


def format_reports_markdown(report: OnlineReport) -> str:
    """Format the newest report in Markdown, for the panel beside the plots."""
    age = "" if report.age_s is None else f", {report.age_s:,.0f} s old"
    return (
        f"# {describe_mass_and_friction(report)}\n\nLast manoeuvre{age}; {report.manoeuvres:,} "
        "gave a mass "
        f"so far.\n\n{describe_progress_to_target_uncertainty(report)}\n\n"
        f"{describe_inertia_and_yaw_friction(report)}\n\n"
        f"{format_utc_time_of_day(report.unix_ns)} UTC: {report.phase or 'unknown'}, "
        f"gate {report.gate.replace('_', ' ')}.\n\nRecorded while following: random "
        "uncertainties, but for load states. When the log ends, its causal replay replaces this "
        "recording.\n"
    )

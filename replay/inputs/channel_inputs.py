"""Read the fields of the channels from logs, and record the provenance."""

import platform
import re
from collections.abc import Iterable, Mapping, Sequence
from functools import cache
from importlib.metadata import version
from typing import Any, Final, NamedTuple

import polars as pl

from analysis.model.loss import Loss
from analysis.model.machine import Machine
from analysis.model.physical_units import find_gain_and_offset_to_si
from analysis.model.run_record import InputFile, Provenance
from analysis.model.schema import HINTS
from analysis.stages.signals.derive import find_unit_in_name
from estimators.errors import LogError, MachineError, suggest_choice
from replay.inputs.input_limits import LIMITS
from replay.inputs.time_line import compute_log_offsets_ns, shift_message_times
from replay.logs import TABLE, Log

_STAMP: Final = "same_ns"
#: A list element selected by name, `effort[left]`, and the path of its message.
_BY_NAME = re.compile(r"(?P<parent>(?:.*\.)?)[^.\[\]]+\[(?P<name>[^\[\]]*[^\[\]\d][^\[\]]*)\]")
#: Packages whose versions may change a number or a recording.
_VERSIONS = ("payscope", "numpy", "scipy", "numba", "polars", "rosbags", "mcap", "rerun-sdk")


class ChannelInputs(NamedTuple):
    """Frames of the channels' fields by topic, and losses of the logs."""

    frame_by_topic: dict[str, pl.DataFrame]
    losses: list[Loss]


def read_channel_fields_and_losses(logs: Sequence[Log], machine: Machine) -> ChannelInputs:
    """Read the fields that the channels name.

    Args:
        logs: logs of one time line, or each counting from 0 (`time_line`); each topic must be in at
            least one of them.
        machine: machine with its channels.

    Returns:
        Frames by topic with `log_time_ns`, `header_stamp_ns` and the fields, in log-time order,
        without optional topics that are in no log; and the losses of the logs.

    Raises:
        LogError: a topic is in no log, has no message, or differs between two logs at the same
            time.
    """
    wanted = list_channel_fields(machine)
    losses: list[Loss] = []
    has = {log: set(log.topic_names()) for log in logs}
    # a channel that no estimate needs must not prevent a replay
    hints = {
        topic for topic in wanted if HINTS.issuperset(list_channels_reading_topic(topic, machine))
    }
    for topic in list(wanted):
        if not any(topic in topics for topics in has.values()):
            fault = _format_unknown_topic_message(topic, has, machine)
            if topic not in hints:
                damage = [f" It is damaged: {loss}" for log in logs for loss in log.losses()]
                names = ", ".join(str(log.path) for log in logs)
                raise LogError(f"{names}: {fault}{''.join(damage[:1])}")
            losses += [Loss(source=log.path.name, what=fault) for log in logs]
            del wanted[topic]
            continue
        losses += [
            Loss(source=log.path.name, topic=topic, what="this log does not have the topic")
            for log in logs
            if topic not in has[log] and _has_log_companion_of_topic(log, topic, has, wanted)
        ]
    losses += [
        Loss(source=log.path.name, what="has no topic of the machine file: nothing is read from it")
        for log in logs
        if not has[log] & wanted.keys()
    ]
    for log in logs:
        _refuse_contradicting_units(log, machine)
    later = compute_log_offsets_ns(logs, wanted)
    read = {
        log: log.read_many({topic: names for topic, names in wanted.items() if topic in has[log]})
        for log in logs
    }
    raw: dict[str, pl.DataFrame] = {}
    for topic in wanted:
        parts = {
            log: shift_message_times(frames.pop(topic), later[log])
            for log, frames in read.items()
            if topic in frames
        }
        frame = merge_messages_of_logs(topic, parts)
        holders = list(parts)
        if frame.is_empty() and topic in hints:
            losses.append(
                Loss(source=holders[0].path.name, topic=topic, what="the topic has no messages")
            )
            continue
        if frame.is_empty():
            why = [f": {loss.what}" for log in holders for loss in log.losses()]
            raise LogError(f"{holders[0].path}: topic '{topic}' has no messages{''.join(why[:1])}")
        _refuse_unknown_element_names(holders[0], topic, frame)
        raw[topic] = frame
    for log in logs:
        losses += log.losses()
    return ChannelInputs(raw, losses)


def _has_log_companion_of_topic(
    log: Log,
    topic: str,
    topics_of_logs: Mapping[Log, set[str]],
    wanted_topics: Mapping[str, Sequence[str]],
) -> bool:
    """Whether a log has a wanted topic that occurs together with this one in some log."""
    return any(
        topics_of_logs[log] & topics & wanted_topics.keys()
        for topics in topics_of_logs.values()
        if topic in topics
    )


def _refuse_contradicting_units(log: Log, machine: Machine) -> None:
    """Raise an error if a field states another unit than its channel's."""
    for name, channel in machine.channels.items():
        topic = channel.topic or TABLE
        stated = log.units(topic).get(channel.field or "")
        if stated is None or channel.unit is not None or channel.scale != 1.0 or channel.offset:
            continue
        try:
            gain, offset = find_gain_and_offset_to_si(stated, find_unit_in_name(name))
        except MachineError:  # of another dimension: the name is not that of a unit
            continue
        if gain != 1.0 or offset:
            raise LogError(
                f"{log.path}: '{channel.field}' is in {stated}, not in the unit of its channel; "
                f'set channels.{name}.unit = "{stated}" (or its scale)'
            )


def list_channel_fields(machine: Machine) -> dict[str, list[str]]:
    """List the fields that the channels name, by topic."""
    wanted: dict[str, list[str]] = {}
    for channel in machine.channels.values():
        for field in channel.fields:
            fields = wanted.setdefault(channel.topic or "table", [])
            if field not in fields:
                fields.append(field)
    return wanted


def list_channels_reading_topic(topic: str, machine: Machine) -> list[str]:
    """List the channels that read from a topic."""
    return [
        name
        for name, channel in machine.channels.items()
        if channel.fields and (channel.topic or "table") == topic
    ]


def _format_unknown_topic_message(
    topic: str, topics_of_logs: Mapping[Log, set[str]], machine: Machine
) -> str:
    """Format the error on an unknown topic, with the choices and the remedy."""
    meant = suggest_choice(topic, set().union(*topics_of_logs.values()))
    return (
        f"no topic '{topic}'; {meant}{'' if meant.endswith('?') else '.'} "
        f"Set channels.{list_channels_reading_topic(topic, machine)[0]}.topic in the machine file."
    )


def _refuse_unknown_element_names(log: Log, topic: str, frame: pl.DataFrame) -> None:
    """Raise an error for an element name that no message has, with the existing names."""
    for field in frame.columns:
        named = _BY_NAME.fullmatch(field)
        if named is None or frame[field].null_count() < frame.height:
            continue
        listed = [f"{named['parent']}name[{i}]" for i in range(LIMITS.max_names)]
        starts = int(frame["log_time_ns"].to_numpy().min())
        first = log.read(topic, listed, end_ns=starts).select(listed)
        known = [name for name in first.row(0) if name] if first.height else []
        if named["name"] not in known:
            raise LogError(
                f"{log.path}: topic '{topic}' has no '{named['name']}' for the field '{field}'; "
                f"{suggest_choice(named['name'], known)}"
            )


def name_raw_frames_by_topic(raw_frames: Mapping[str, pl.DataFrame]) -> dict[str, pl.DataFrame]:
    """Rename frames as a run names them: `raw/imu/data` for topic `/imu/data`.

    If there is a topic `imu/data` as well, it gets that name, and `/imu/data` keeps its slash:
    `raw//imu/data`.
    """
    return {
        f"raw/{topic if topic[1:] in raw_frames else topic.removeprefix('/')}": frame
        for topic, frame in raw_frames.items()
    }


def make_provenance_of_inputs(
    logs: Iterable[Log],
    machine: Machine,
    t0_unix_ns: int,
    stamps: dict[str, str],
    losses: Sequence[Loss],
    notes: Sequence[str],
    logged_machine_id: str = "",
) -> Provenance:
    """Hash the inputs and record everything that the result depends on."""
    return Provenance(
        inputs=tuple(file for log in logs for file in list_input_files(log)),
        machine=convert_machine_without_settings_to_dict(machine),
        settings=machine.settings,
        versions=collect_versions_of_packages(),
        t0_unix_ns=t0_unix_ns,
        stamps=stamps,
        losses=tuple(losses),
        notes=tuple(notes),
        logged_machine_id=logged_machine_id,
    )


def list_input_files(log: Log) -> list[InputFile]:
    """List the files of a log with their digests."""
    return [
        InputFile(name=path.name, sha256=digest, size_bytes=path.stat().st_size)
        for path, digest in zip(log.files, log.digests, strict=True)
    ]


def convert_machine_without_settings_to_dict(machine: Machine) -> dict[str, Any]:
    """Convert a machine without its settings to JSON-compatible values."""
    plain = machine.model_dump(mode="json")
    del plain["settings"]
    return plain


def collect_versions_of_packages() -> dict[str, str]:
    """Collect the versions of all packages that may change a number or a recording."""
    return {"python": platform.python_version(), **{n: _find_version(n) for n in _VERSIONS}}


@cache  # each query reads and parses a file
def _find_version(package: str) -> str:
    return version(package)


def merge_messages_of_logs(topic: str, frames_of_logs: Mapping[Log, pl.DataFrame]) -> pl.DataFrame:
    """Merge messages of several logs in log-time order; messages in two logs count once.

    Messages are equal if their header stamps (log times without one) and fields are: two recorders
    of one topic stamp its arrival differently.

    Args:
        topic: name of the topic.
        frames_of_logs: frames by log, with `log_time_ns`, `header_stamp_ns` and fields, in log-time
            order.

    Raises:
        LogError: two logs have different messages of the topic at the same time.
    """
    # a column of integers in one table may have fractions in the next
    schema = pl.concat(
        [frame.clear() for frame in frames_of_logs.values()], how="vertical_relaxed"
    ).schema
    known = [(frame.cast(schema), log) for log, frame in frames_of_logs.items() if frame.height]
    if not known:
        return pl.DataFrame(schema=schema)
    known.sort(key=lambda part: (part[0]["log_time_ns"][0], str(part[1].path)))
    whole: list[pl.DataFrame] = []
    for frame, log in known:
        for before, earlier in known[: len(whole)]:
            frame = drop_messages_of_earlier_log(
                before, frame, topic, str(earlier.path), str(log.path)
            )
        whole.append(frame)
    # in one piece: the batches of a log hold half as much again, and each use would join them
    joint = pl.concat(whole, rechunk=True)
    if joint["log_time_ns"].is_sorted():
        return joint
    return joint.sort("log_time_ns", maintain_order=True)


def drop_messages_of_earlier_log(
    earlier_frame: pl.DataFrame, frame: pl.DataFrame, topic: str, earlier_log: str, later_log: str
) -> pl.DataFrame:
    """Drop the messages of a frame that an earlier log contains as well."""
    if not frame.height:
        return frame
    start, end = frame["log_time_ns"][0], earlier_frame["log_time_ns"][-1]
    if start > end:
        return frame
    time = pl.col("log_time_ns")
    # recorders may be late by different times
    shared = frame.filter(time <= end + LIMITS.overlap_ns)
    theirs = earlier_frame.filter(time >= start - LIMITS.overlap_ns)
    keys = [name for name in frame.columns if name not in ("log_time_ns", "header_stamp_ns")]
    new = _add_stamp_column(shared).join(
        _add_stamp_column(theirs),
        on=[*keys, _STAMP],
        how="anti",
        nulls_equal=True,
        maintain_order="left",
    )
    overlap_ns = min(end, frame["log_time_ns"][-1]) - start
    inside = shared.filter(time <= end).height
    if (
        overlap_ns > LIMITS.overlap_ns
        and shared.height - new.height < LIMITS.repeated_min_fraction * inside
    ):
        raise LogError(
            f"{later_log}: topic '{topic}' begins {(end - start) / 1e9:.3f} s before its end in "
            f"{earlier_log}, with different messages; logs replayed together must not overlap, so "
            "replay these separately"
        )
    return pl.concat([new.drop(_STAMP), frame.filter(time > end + LIMITS.overlap_ns)])


def _add_stamp_column(frame: pl.DataFrame) -> pl.DataFrame:
    """Add the stamp of each message: header stamp, else log time."""
    header = pl.col("header_stamp_ns")
    own = pl.when(header.is_not_null() & (header != 0)).then(header)
    return frame.with_columns(own.otherwise(pl.col("log_time_ns")).alias(_STAMP))

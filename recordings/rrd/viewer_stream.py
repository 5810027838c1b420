"""Stream a log's drawn columns to standard output, for the importer of the Rerun viewer.

The viewer starts an importer for a file that is opened in it, and reads a recording from its
standard output. Frames are only drawn and not stored.
"""

import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from enum import StrEnum
from typing import TYPE_CHECKING, Final

import polars as pl

from analysis.model.run_record import Run
from recordings.report import colours
from recordings.rrd.blueprint import Page, Panel, lay_out_pages_as_tabs
from recordings.rrd.display_frames import DisplayColumn, bin_frame_rows, should_draw_as_points
from recordings.rrd.drawn_rows import iter_record_batches_to_draw
from recordings.rrd.recording_limits import LIMITS
from recordings.rrd.recording_views import ViewKind
from recordings.rrd.stored_names import SINCE_START, TIME
from recordings.rrd.writer import (
    Scene,
    make_scene_of_run,
    send_events_of_scene,
    send_texts_and_pictures,
)

if TYPE_CHECKING:
    import pyarrow as pa

_TEXT: Final = "log"
#: Timelines that Rerun fills itself.
_OF_RERUN: Final = ("log_time", "log_tick")


class TimelineKind(StrEnum):
    """Kind of a timeline."""

    SEQUENCE = "sequence"
    DURATION = "duration"
    TIMESTAMP = "timestamp"


@dataclass(frozen=True, slots=True)
class ViewerRequest:
    """Request of a viewer for the recording of a log.

    Attributes:
        application: id of the application.
        recording: id of the recording.
        under: parent entity in Rerun's spelling; empty for none.
        at: additional timelines: name, kind, and number or ns.
    """

    application: str
    recording: str | None = None
    under: str = ""
    at: tuple[tuple[str, TimelineKind, int], ...] = ()


def stream_run_to_stdout(run: Run, request: ViewerRequest) -> None:
    """Write the drawn data of a run to standard output, for the viewer."""
    _send_scene_to_stdout(make_scene_of_run(run, request.under), request, run.provenance.t0_unix_ns)


def stream_topics_to_stdout(
    frame_by_topic: Mapping[str, pl.DataFrame],
    description: str,
    recording_name: str,
    request: ViewerRequest,
) -> None:
    """Write the numeric columns of a log to standard output, with a tab per topic.

    Args:
        frame_by_topic: frames by topic, with `unix_ns` and fields; fields without numbers are
            omitted.
        description: description of the log, in Markdown.
        recording_name: name of the log.
        request: request of the viewer.
    """
    stamps = [frame["unix_ns"] for frame in frame_by_topic.values() if frame.height]
    t0_ns = min((int(each[0]) for each in stamps), default=0)
    end_ns = max((int(each[-1]) for each in stamps), default=0)
    shown: dict[str, pl.DataFrame] = {}
    pages = [Page("Log", texts=(_TEXT,))]
    for topic, frame in frame_by_topic.items():
        columns = [c for c, kind in frame.schema.items() if kind.is_numeric() or kind == pl.Boolean]
        fields = [column for column in columns if column != "unix_ns"]
        if not (fields and frame.height):
            continue
        entity = topic.strip("/") or "log"
        shown[entity] = _decimate_fields_of_topic(frame, fields, t0_ns)
        if len(pages) <= LIMITS.max_tabs:
            pages.append(
                Page(topic, tuple(make_panels_of_message_parts(entity, fields, shown[entity])))
            )
    span = (t0_ns, end_ns) if stamps else None
    _send_scene_to_stdout(
        Scene(
            recording_name,
            shown,
            lay_out_pages_as_tabs(pages, span, request.under),
            {_TEXT: description},
        ),
        request,
        t0_ns,
    )


def _decimate_fields_of_topic(
    frame: pl.DataFrame, fields: Sequence[str], t0_ns: int
) -> pl.DataFrame:
    numbers = [pl.col(field).cast(pl.Float64) for field in fields]
    placed = frame.select((pl.col("unix_ns") - t0_ns).alias("t_ns"), *numbers)
    if placed.height <= LIMITS.stream_max_rows:
        return placed
    ends = (int(placed["t_ns"][0]), int(placed["t_ns"][-1]))
    wanted = [
        each
        for field in fields
        for each in (
            pl.col(field).mean(),
            pl.col(field).min().alias(f"{field} min"),
            pl.col(field).max().alias(f"{field} max"),
        )
    ]
    return bin_frame_rows(placed, wanted, ends, max((ends[1] - ends[0]) // LIMITS.stream_bins, 1))


def make_panels_of_message_parts(
    entity_path: str, fields: Sequence[str], displayed_fields: pl.DataFrame
) -> list[Panel]:
    """Make a panel for the fields of each message part, such as `linear_acceleration.x` to `.z`."""
    parts: dict[str, list[str]] = {}
    for field in fields:
        cut = max(field.rfind("."), field.rfind("["))
        parts.setdefault(field[:cut] if cut > 0 else field, []).append(field)
    panels: list[Panel] = []
    for name, members in list(parts.items())[: LIMITS.max_panels]:
        drawn: list[DisplayColumn] = []
        for number, field in enumerate(members):
            colour = colours.choose_line_colour(number)
            label = field.removeprefix(name).strip(".[]") or field
            drawn += [
                DisplayColumn(entity_path, f"{field} {end}", f"{label}, {end}", colour, faint=True)
                for end in ("min", "max")
                if f"{field} {end}" in displayed_fields.columns
            ]
            alone = should_draw_as_points(displayed_fields[field])
            drawn.append(DisplayColumn(entity_path, field, label, colour, dotted=alone))
        panels.append(Panel(name, ViewKind.LINES, tuple(drawn)))
    return panels


def _send_scene_to_stdout(scene: Scene, request: ViewerRequest, t0_unix_ns: int) -> None:
    # keeps Rerun's log messages out of the viewer's log
    os.environ.setdefault("RUST_LOG", "off")
    import rerun as rr

    recording = rr.RecordingStream(request.application, recording_id=request.recording)
    recording.stdout()
    # data under a parent entity belong to another scene, whose layout is kept
    recording.send_blueprint(scene.layout, make_active=not request.under, make_default=True)
    if not request.under:
        recording.send_recording_name(scene.name)
        recording.send_recording_start_time_nanos(t0_unix_ns)
    send_texts_and_pictures(recording, scene, request.under)
    at = make_requested_timelines(request)
    send_events_of_scene(recording, scene, t0_unix_ns, request.under, at)
    for name, frame in scene.frames.items():
        for batch in iter_record_batches_to_draw(name, frame, t0_unix_ns, request.under, at):
            recording.send_record_batch(batch, index=[TIME, SINCE_START, *at])
    recording.flush()
    recording.disconnect()


def make_requested_timelines(request: ViewerRequest) -> "dict[str, pa.Scalar]":
    """Make the additional timelines of every row, except those that rows have anyway."""
    import pyarrow as pa

    types = {
        TimelineKind.SEQUENCE: pa.int64(),
        TimelineKind.DURATION: pa.duration("ns"),
        TimelineKind.TIMESTAMP: pa.timestamp("ns"),
    }
    return {
        name: pa.scalar(number, types[kind])
        for name, kind, number in request.at
        if name not in (TIME, SINCE_START, *_OF_RERUN)
    }

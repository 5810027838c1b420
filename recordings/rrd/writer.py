"""Write a run as a Rerun recording, verified by reading it back."""

import json
import os
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final
from uuid import uuid4

import polars as pl

from analysis.model.run_record import Run
from analysis.model.schema import FRAMES
from estimators.errors import OutputError, RecordingError
from estimators.threads import return_freed_memory_to_os
from recordings.report.atomic_output import require_writable_output, stage_output_file
from recordings.report.finding_text import format_finding, read_findings_of_run
from recordings.rrd.blueprint import (
    lay_out_run_in_tabs,
    make_events_entity_path,
    make_picture_entity_path,
    make_text_entity_path,
)
from recordings.rrd.display_frames import find_time_span_of_grid_ns, make_display_frames
from recordings.rrd.drawn_rows import iter_record_batches_to_draw
from recordings.rrd.piped_file import PipedFile, open_piped_file
from recordings.rrd.plane_pictures import PlanePicture, make_plane_pictures, send_plane_picture
from recordings.rrd.reader import FORMAT, PROPERTY, open_recording
from recordings.rrd.recording_limits import LIMITS
from recordings.rrd.recording_properties import ANSWER, make_recording_properties
from recordings.rrd.recording_texts import make_recording_name, make_texts_of_run
from recordings.rrd.stored_frames import Manifest, StoredFrame, make_entity_path
from recordings.rrd.stored_names import ROW, SINCE_START, TIME, make_component_name

if TYPE_CHECKING:
    from collections.abc import Iterator

    import pyarrow as pa
    from rerun import RecordingStream, TimeColumn
    from rerun.blueprint import Blueprint

#: Entity below which these frames are.
ROWS: Final = "rows"
#: Frames with a row per load, manoeuvre, cycle or finding.
TIMED: Final = ("loads", "segments", "cycles", "findings")
APPLICATION: Final = "payscope"
SUFFIX: Final = ".rrd"


@dataclass(frozen=True, slots=True)
class LiveView:
    """A viewer that shows a recording while it is written.

    Attributes:
        address: address of the viewer (`start_waiting_viewer`).
        laid_out: whether it keeps the layout of an earlier recording, with the user's changes.
    """

    address: str
    laid_out: bool = False


def write_recording(
    run: Run, path: str | Path, *, overwrites: bool = False, viewer: str | LiveView | None = None
) -> Path:
    """Write every frame of `run`, its provenance, and a blueprint of its layout.

    The file gets its final name only after everything in it was read back and found equal.

    Args:
        run: run to write. Floats outside `raw` must not be NaN (missing is null).
        path: the `.rrd` file to write; its folder must exist.
        overwrites: whether to replace an existing file.
        viewer: viewer that shows the recording while it is written, or its address
            (`start_waiting_viewer`).

    Returns:
        The path of the recording.

    Raises:
        OutputError: the name does not end in .rrd, the file exists, its folder is missing or not
            writable, the disk is full, a column cannot be stored, or what was read back differs.
    """
    return write_recording_with_scene(
        run, make_scene_of_run, path, overwrites=overwrites, live_viewer=viewer
    )


@dataclass(frozen=True)
class Scene:
    """Drawn content of a recording, as a viewer shows it.

    Attributes:
        name: name in the viewer's list.
        frames: drawn frames, with `t_ns`.
        layout: blueprint.
        texts: Markdown texts by name.
    """

    name: str
    frames: Mapping[str, pl.DataFrame]
    layout: "Blueprint"
    texts: Mapping[str, str]
    events: tuple[tuple[int, str, bool], ...] = ()
    """`t_ns`, a line, and whether it is a warning."""
    pictures: Mapping[str, PlanePicture] = field(default_factory=dict)


def make_scene_of_run(run: Run, parent_entity: str = "") -> Scene:
    """Make the scene of a run by the table of views, below a parent entity if given."""
    shown = make_display_frames(run)
    name = make_recording_name(run.provenance)
    start = (find_time_span_of_grid_ns(run) or (0, 0))[0]
    events = sorted(
        (
            start if each.start_s is None else round(each.start_s * 1e9),
            format_finding(each),
            each.severity != "tell",
        )
        for each in read_findings_of_run(run)
    )
    written, pictures = make_texts_of_run(run), make_plane_pictures(run)
    layout = lay_out_run_in_tabs(run, shown, written, pictures, parent_entity)
    return Scene(name, shown, layout, written, tuple(events), pictures)


def write_recording_with_scene(
    run: Run,
    make_scene: Callable[[Run], Scene],
    path: str | Path,
    *,
    overwrites: bool = False,
    live_viewer: str | LiveView | None = None,
) -> Path:
    """Write the recording of a run as `write_recording` does, but with a given scene.

    Args:
        run: run to store.
        make_scene: function that makes the scene, called once the output is known to be writable.
        path: the `.rrd` file to write.
        overwrites: whether to replace an existing file.
        live_viewer: viewer that shows the recording while it is written, or its address.

    Raises:
        OutputError: as `write_recording`.
    """
    path = Path(path)
    live_viewer = LiveView(live_viewer) if isinstance(live_viewer, str) else live_viewer
    require_writable_recording(path, overwrites=overwrites)
    return_freed_memory_to_os()  # of a shift's replay a gigabyte
    with stage_output_file(path, overwrites=overwrites) as partial:
        with open_piped_file(partial) as piped:
            _send_run_through_pipe(run, make_scene, piped, path, live_viewer)
        refuse_recording_unlike_run(run, partial, path)
    return path


def require_writable_recording(path: Path, *, overwrites: bool) -> None:
    """Raise an error, before any work, if a recording cannot be written.

    Raises:
        OutputError: as `write_recording`.
    """
    if path.suffix != SUFFIX:
        raise OutputError(
            f"{path}: the name of a recording must end in {SUFFIX}; rename the output"
        )
    require_writable_output(path, overwrites=overwrites)


def _send_run_through_pipe(
    run: Run,
    make_scene: Callable[[Run], Scene],
    piped_file: PipedFile,
    path: Path,
    live_viewer: LiveView | None,
) -> None:
    # a closed viewer is reported by our own line instead of Rerun's log
    os.environ.setdefault("RUST_LOG", "off")
    import rerun as rr

    stored = tuple(StoredFrame.from_frame(name, frame) for name, frame in run.frames.items())
    scene = make_scene(run)
    description = rr.AnyValues(
        format=FORMAT,
        manifest=Manifest(frames=stored).model_dump_json(),
        provenance=json.dumps(run.provenance.model_dump(mode="json")),
    )
    recording = rr.RecordingStream(APPLICATION, recording_id=uuid4())
    watching = [rr.GrpcSink(live_viewer.address)] if live_viewer else []
    recording.set_sinks(rr.FileSink(piped_file.name), *watching)
    piped_file.close_writing_end()
    first = live_viewer is None or not live_viewer.laid_out
    recording.send_blueprint(scene.layout, make_active=first, make_default=True)
    recording.send_property(PROPERTY, description)
    said: dict[str, Any] = {**make_recording_properties(run)}
    recording.send_property(ANSWER, rr.AnyValues(**said))
    recording.send_recording_name(scene.name)
    recording.send_recording_start_time_nanos(run.provenance.t0_unix_ns)
    send_texts_and_pictures(recording, scene)
    send_events_of_scene(recording, scene, run.provenance.t0_unix_ns)
    wait_until_recording_is_written(
        recording, piped_file, path
    )  # the description comes first, else a truncated file could not be recovered
    waiting = 0
    for index, batch in iter_batches_of_run_with_index(run, scene.frames):
        recording.send_record_batch(batch, index=index)
        waiting += batch.nbytes
        if waiting > LIMITS.waiting_bytes:  # else the queue of chunks grows to the whole run
            wait_until_recording_is_written(recording, piped_file, path)
            waiting = 0
    wait_until_recording_is_written(recording, piped_file, path)
    recording.disconnect()


def send_texts_and_pictures(
    recording: "RecordingStream", scene: Scene, parent_entity: str = ""
) -> None:
    """Send the texts and pictures of a scene, which are independent of time."""
    import rerun as rr

    for name, text in scene.texts.items():
        document = rr.TextDocument(text, media_type=rr.MediaType.MARKDOWN)
        recording.log(make_text_entity_path(name, parent_entity), document, static=True)
    for name, picture in scene.pictures.items():
        send_plane_picture(recording, make_picture_entity_path(name, parent_entity), picture)


def send_events_of_scene(
    recording: "RecordingStream",
    scene: Scene,
    t0_unix_ns: int,
    parent_entity: str = "",
    extra_times: "Mapping[str, pa.Scalar] | None" = None,
) -> None:
    """Send the events of a scene, on both timelines and on additional ones."""
    import numpy as np
    import rerun as rr

    if not scene.events:
        return
    t_ns, lines, warn = zip(*scene.events, strict=True)
    since_start = np.array(t_ns, np.int64)
    levels = [rr.TextLogLevel.WARN if each else rr.TextLogLevel.INFO for each in warn]
    recording.send_columns(
        make_events_entity_path(parent_entity),
        indexes=[
            rr.TimeColumn(TIME, timestamp=(since_start + t0_unix_ns).view("datetime64[ns]")),
            rr.TimeColumn(SINCE_START, duration=since_start.view("timedelta64[ns]")),
            *(
                make_constant_timeline(name, time, len(t_ns))
                for name, time in (extra_times or {}).items()
            ),
        ],
        columns=rr.TextLog.columns(text=list(lines), level=levels),
    )


def make_constant_timeline(
    timeline_name: str, constant_time: "pa.Scalar", row_count: int
) -> "TimeColumn":
    """Make a timeline with the same time for all rows."""
    import numpy as np
    import pyarrow as pa
    import rerun as rr

    values = np.full(row_count, constant_time.cast(pa.int64()).as_py(), np.int64)
    if pa.types.is_duration(constant_time.type):
        return rr.TimeColumn(timeline_name, duration=values.view("timedelta64[ns]"))
    if pa.types.is_timestamp(constant_time.type):
        return rr.TimeColumn(timeline_name, timestamp=values.view("datetime64[ns]"))
    return rr.TimeColumn(timeline_name, sequence=values)


def wait_until_recording_is_written(
    recording: "RecordingStream", piped_file: PipedFile, path: Path
) -> None:
    """Wait until everything sent is in the file; raise an error if the file stops growing."""
    size = -1
    while True:
        piped_file.raise_write_error()
        try:
            recording.flush(timeout_sec=LIMITS.stuck_s)
        except RuntimeError as error:
            if piped_file.written_bytes == size:
                raise OutputError(
                    f"{path}: the file stopped growing at {size} bytes; check for a full disk or a "
                    "stuck viewer"
                ) from error
            size = piped_file.written_bytes
        else:
            return


def iter_batches_of_run_with_index(
    run: Run, display_frames: Mapping[str, pl.DataFrame]
) -> "Iterator[tuple[list[str], pa.RecordBatch]]":
    """Yield record batches with their index: first drawn frames, then all stored frames."""
    for name, frame in display_frames.items():
        for batch in iter_record_batches_to_draw(name, frame, run.provenance.t0_unix_ns):
            yield [TIME, SINCE_START], batch
    for batch in iter_batches_of_frames(run.frames, run.provenance.t0_unix_ns):
        yield [TIME, SINCE_START], batch
    for name, frame in run.frames.items():
        for batch in StoredFrame.from_frame(name, frame).iter_blocks_of_frame(frame):
            yield [ROW], batch


def refuse_recording_unlike_run(run: Run, partial_path: Path, path: Path) -> None:
    """Read every frame back, and raise an error if it differs from the run."""
    try:
        with open_recording(partial_path, stored_names=True) as held:
            if held.provenance != run.provenance:
                raise OutputError(
                    f"{path}: the provenance read back differs from the one written; it may hold "
                    "plain JSON values only"
                )
            for name, frame in run.frames.items():
                back = held.read_frame(name)
                if back.schema != frame.schema or not back.equals(frame):
                    raise OutputError(
                        f"{path}: '{name}' read back differs, so the file was removed; try again"
                    )
    except RecordingError as error:
        raise OutputError(
            f"{path}: cannot be read back after writing; check for a full disk"
        ) from error


def iter_batches_of_frames(
    frames: Mapping[str, pl.DataFrame], t0_unix_ns: int
) -> "Iterator[pa.RecordBatch]":
    """Yield a record batch of each frame in `TIMED`; rows about the whole run are at its start.

    Args:
        frames: frames of a run.
        t0_unix_ns: Unix time of `t_ns` 0.
    """
    import pyarrow as pa

    for name in TIMED:
        frame, time = frames.get(name, pl.DataFrame()), FRAMES[name].time_column
        if frame.is_empty() or time is None:
            continue
        since_start = frame[time].fill_null(0)
        arrays: dict[str, pa.Array] = {
            TIME: (since_start + t0_unix_ns).to_arrow().cast(pa.timestamp("ns")),
            SINCE_START: since_start.to_arrow().cast(pa.duration("ns")),
        }
        fields = [pa.field(each, array.type) for each, array in arrays.items()]
        for column in frame.get_columns():
            plain = column.cast(pl.String) if isinstance(column.dtype, pl.Enum) else column
            values = plain.to_arrow()
            if not pa.types.is_primitive(values.type):
                values = values.cast(pa.string())
            stored = make_component_name(column.name)
            # one value per row, and none if it is missing
            cells = [[] if value is None else [value] for value in values.to_pylist()]
            arrays[stored] = pa.array(cells, pa.list_(values.type))
            metadata = {
                "rerun:entity_path": make_entity_path(name, ROWS),
                "rerun:component": stored,
            }
            fields.append(pa.field(stored, arrays[stored].type, metadata=metadata))
        yield pa.record_batch(list(arrays.values()), schema=pa.schema(fields))

"""Write a run as a Rerun recording: whole, verified, or not at all."""

import json
from pathlib import Path
from typing import TYPE_CHECKING, Final
from uuid import uuid4

import polars as pl

from analysis.run import Run
from estimators.errors import OutputError, RecordingError
from recordings.blueprint import blueprint, text_entity
from recordings.display import display_frames
from recordings.output import check_output, whole_file
from recordings.reader import FORMAT, PROPERTY, read_frame, read_provenance
from recordings.stored import Manifest, StoredFrame
from recordings.table import ROW, SINCE_START, TIME
from recordings.texts import recording_name, texts

if TYPE_CHECKING:
    from rerun import RecordingStream

_ROWS_A_CHUNK: Final = 16_384
_CHUNKS_A_FLUSH: Final = 10
APPLICATION: Final = "payscope"
SUFFIX: Final = ".rrd"


def write_recording(
    run: Run, path: str | Path, *, force: bool = False, viewer: str | None = None
) -> Path:
    """Write every frame of `run` and its provenance, with a blueprint that lays it out.

    The file gets its name only after everything in it was read back and found equal.

    Args:
        run: what to write. Floats outside `raw` hold no NaN (missing is null).
        path: the `.rrd` file to write; its folder must exist.
        force: whether to replace a file that is there already.
        viewer: the address of a viewer (`start_viewer`) that shows it while it is written.

    Returns:
        The path of the recording.

    Raises:
        OutputError: it does not end in .rrd, the file exists, its folder is missing or refuses the
            file, a column cannot be stored, or what was read back differs.
    """
    path = Path(path)
    check_recording(path, force=force)
    with whole_file(path, force=force) as partial:
        _write(run, partial, viewer)
        _verify(run, partial, path)
    return path


def check_recording(path: Path, *, force: bool) -> None:
    """Refuse the name of a recording before the work that it is for.

    Raises:
        OutputError: as `write_recording`.
    """
    if path.suffix != SUFFIX:
        raise OutputError(f"{path}: a recording ends in {SUFFIX}, or no viewer opens it")
    check_output(path, force=force)


def _write(run: Run, partial: Path, viewer: str | None) -> None:
    import rerun as rr

    stored = [(StoredFrame.of(name, frame), frame) for name, frame in run.frames.items()]
    shown = display_frames(run)
    description = rr.AnyValues(
        format=FORMAT,
        manifest=Manifest(frames=tuple(each for each, _ in stored)).model_dump_json(),
        provenance=json.dumps(run.provenance.model_dump(mode="json")),
    )
    with rr.RecordingStream(APPLICATION, recording_id=uuid4()) as recording:
        watching = [rr.GrpcSink(viewer)] if viewer else []
        recording.set_sinks(rr.FileSink(partial), *watching)
        recording.send_blueprint(blueprint(run, shown), make_active=True, make_default=True)
        recording.send_property(PROPERTY, description)
        recording.send_recording_name(recording_name(run.provenance))
        recording.send_recording_start_time_nanos(run.provenance.t0_unix_ns)
        for name, text in texts(run).items():
            document = rr.TextDocument(text, media_type=rr.MediaType.MARKDOWN)
            recording.log(text_entity(name), document, static=True)
        recording.flush()  # what describes the frames comes first, or a cut file is past help
        drawn = [(StoredFrame.of(name, frame), frame) for name, frame in shown.items()]
        for each, frame in (*drawn, *stored):
            _send(recording, each, frame, run.provenance.t0_unix_ns)
        recording.flush()
        recording.disconnect()


def _send(
    recording: "RecordingStream", stored: StoredFrame, frame: pl.DataFrame, t0_ns: int
) -> None:
    index = [ROW] if stored.rows_by == ROW else [TIME, SINCE_START]
    for number, part in enumerate(frame.iter_slices(_ROWS_A_CHUNK), start=1):
        batch = stored.to_batch(part, (number - 1) * _ROWS_A_CHUNK, t0_ns)
        recording.send_record_batch(batch, index=index)
        if number % _CHUNKS_A_FLUSH == 0:  # or the queue of chunks grows to the whole frame
            recording.flush()


def _verify(run: Run, partial: Path, path: Path) -> None:
    """Read everything back, a frame at a time, and compare."""
    try:
        if read_provenance(partial) != run.provenance:
            raise OutputError(f"{path}: the provenance read back differs; it takes plain JSON only")
        for name, frame in run.frames.items():
            back = read_frame(partial, name)
            if back.schema != frame.schema or not back.equals(frame):
                raise OutputError(f"{path}: '{name}' read back differs, so nothing was kept")
    except RecordingError as error:
        raise OutputError(f"{path}: cannot be read back; is the disk full?") from error

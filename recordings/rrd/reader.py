"""Read a recording back as exactly the run that was written."""

import json
import warnings
from collections.abc import Generator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import polars as pl
from pydantic import ValidationError

from analysis.model.check_names import rename_stored_checks
from analysis.model.loss import Loss
from analysis.model.run_record import Provenance, Run
from estimators.errors import RecordingError, suggest_choice
from recordings.rrd.stored_frames import Manifest, StoredColumn, StoredFrame
from recordings.rrd.stored_names import make_component_name

if TYPE_CHECKING:
    from rerun.chunk import LazyStore

#: Property of a recording with payscope's description of it.
PROPERTY = "payscope"
#: Version of recordings, raised whenever the meaning of their content changes: 2 has settings by
#: stage, 3 frames in blocks.
FORMAT = 3
#: What is wrong with a file, by words of Rerun's message.
_FAULTS: Final = {
    "without footer": "its end is missing, or something was appended",
    "exceeds file size": "its end is missing",
    "too small": "its end is missing",
    "CRC": "a checksum does not match",
}


def read_recording(path: str | Path, *, stored_names: bool = False) -> Run:
    """Read a whole recording.

    Args:
        path: the recording.
        stored_names: whether checks keep the names that they were stored with, for the digests
            of the frames; otherwise former names become the present ones.

    Returns:
        A run equal to the one written, except for former names of checks. For a recovered
        recording, its remaining rows, with a loss in the provenance for each frame that lacks rows.

    Raises:
        RecordingError: the file does not exist, is not a recording of payscope, or is damaged.
    """
    with open_recording(path, stored_names=stored_names) as held:
        manifest, provenance = held.manifest, held.provenance
        frames = {frame.name: held.read_frame(frame.name) for frame in manifest.frames}
    heights = {name: frame.height for name, frame in frames.items()}
    return Run(frames, add_losses_of_missing_frame_rows(path, manifest, provenance, heights))


def add_losses_of_missing_frame_rows(
    path: str | Path, manifest: Manifest, provenance: Provenance, row_counts: Mapping[str, int]
) -> Provenance:
    """Add a loss for each incomplete frame to the provenance.

    Args:
        path: the recording.
        manifest: manifest of the recording.
        provenance: provenance of the recording.
        row_counts: rows found, by frame.
    """
    lost = tuple(
        Loss(
            source=Path(path).name,
            topic=stored.name,
            what=f"the recording has {row_counts[stored.name]} of {stored.rows} rows",
        )
        for stored in manifest.frames
        if row_counts[stored.name] != stored.rows
    )
    return provenance.model_copy(update={"losses": (*provenance.losses, *lost)})


def read_frame(
    path: str | Path, frame_name: str, columns: Sequence[str] | None = None
) -> pl.DataFrame:
    """Read one frame, or some of its columns, without reading the others.

    Raises:
        RecordingError: as `read_recording`, or if the frame or column does not exist.
    """
    with open_recording(path) as held:
        return held.read_frame(frame_name, columns)


def read_provenance(path: str | Path) -> Provenance:
    """Read the provenance of a recording, without its frames.

    Raises:
        RecordingError: as `read_recording`.
    """
    with open_recording(path) as held:
        return held.provenance


def list_columns_by_frame(path: str | Path) -> dict[str, tuple[str, ...]]:
    """List a recording's frames in the order of the pipeline, with their columns.

    Raises:
        RecordingError: as `read_recording`.
    """
    with open_recording(path) as held:
        return held.columns_by_frame


@dataclass(frozen=True)
class OpenRecording:
    """An open recording, whose frames are read on demand.

    Attributes:
        path: path of the recording.
        manifest: names and columns of its frames.
        provenance: provenance of the run.
        store: Rerun's view of the file.
        stored_names: whether checks keep the names that they were stored with.
    """

    path: Path
    manifest: Manifest
    provenance: Provenance
    store: "LazyStore"
    stored_names: bool = False

    @property
    def columns_by_frame(self) -> dict[str, tuple[str, ...]]:
        """Columns of each frame, by name, in pipeline order."""
        return {each.name: tuple(c.name for c in each.columns) for each in self.manifest.frames}

    def refuse_recording_without_frames(self) -> None:
        """Raise an error for a recording without frames, such as an overlay of two others.

        Raises:
            RecordingError: the recording contains no frames.
        """
        if not self.manifest.frames:
            notes = "; ".join(self.provenance.notes) or "it was written for viewing only"
            raise RecordingError(
                f"{self.path}: contains no frames of data ({notes}); "
                "give a recording of `payscope run`"
            )

    def read_frame(self, frame_name: str, columns: Sequence[str] | None = None) -> pl.DataFrame:
        """Read a frame, or some of its columns.

        Raises:
            RecordingError: the frame or column does not exist, or the file is damaged.
        """
        stored = self.manifest.find_frame_by_name(frame_name)
        if stored is None:
            raise RecordingError(
                f"{self.path}: no frame '{frame_name}'; "
                f"{suggest_choice(frame_name, self.columns_by_frame)}"
            )
        known = self.columns_by_frame[frame_name]
        for column in columns or ():
            if column not in known:
                raise RecordingError(
                    f"{self.path}: '{frame_name}' has no '{column}'; "
                    f"{suggest_choice(column, known)}"
                )
        wanted = stored.columns if columns is None else stored.select_columns(columns)
        with _convert_errors_to_one_line(self.path):
            frame = _read_stored_frame(self.store, stored, wanted)
        return frame if self.stored_names else rename_stored_checks(frame_name, frame)


@contextmanager
def open_recording(path: str | Path, *, stored_names: bool = False) -> "Generator[OpenRecording]":
    """Context with an open recording, in which errors of Rerun are raised as one line.

    Args:
        path: the recording.
        stored_names: as in `read_recording`.

    Raises:
        RecordingError: as `read_recording`.
    """
    path = Path(path)
    if not path.exists():
        raise RecordingError(f"{path}: no such recording; `payscope run` writes one")
    if not path.is_file():
        raise RecordingError(f"{path}: is a folder or device, not a recording; give the .rrd file")
    with path.open("rb") as file:
        if file.read(3) != b"RRF":
            raise RecordingError(f"{path}: is not a Rerun recording; give an .rrd file")
    import rerun as rr
    from rerun.error_utils import RerunWarning

    with _convert_errors_to_one_line(path):
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", RerunWarning)  # raised as an error as well
            store = rr.chunk.RrdReader(path).store()
        held = OpenRecording(path, *_read_manifest_and_provenance(path, store), store, stored_names)
    yield held  # outside the `with`: errors of the caller are not those of the recording


@contextmanager
def _convert_errors_to_one_line(path: Path) -> Generator[None]:
    try:
        yield
    except (RuntimeError, ValueError) as error:
        raise RecordingError(
            f"{path}: damaged or not finished ({describe_rerun_fault(str(error))}); recover its "
            f"complete rows with `rerun rrd optimize {path} -o recovered.rrd`"
        ) from error


def describe_rerun_fault(said_by_rerun: str) -> str:
    """Describe what is wrong with a file that Rerun cannot read, without its advice on its API."""
    return next(
        (fault for words, fault in _FAULTS.items() if words in said_by_rerun),
        "a part of it cannot be decoded",
    )


def _read_manifest_and_provenance(
    path: Path, chunk_store: "LazyStore"
) -> tuple[Manifest, Provenance]:
    """Read manifest and provenance; raise an error if payscope did not write the recording."""
    found: dict[str, Any] = {}
    for chunk in chunk_store.stream().filter(content=f"/__properties/{PROPERTY}"):
        batch = chunk.to_record_batch()
        found |= {name: batch.column(name)[0].as_py()[0] for name in batch.schema.names[1:]}
    if "manifest" not in found or "provenance" not in found:
        raise RecordingError(
            f"{path}: is a Rerun recording, but not one that payscope wrote; replay the log with "
            "payscope run"
        )
    if found.get("format") != FORMAT:
        raise RecordingError(
            f"{path}: has format {found.get('format')}, this payscope reads {FORMAT}; "
            "use the payscope that wrote it, or replay the log"
        )
    try:
        return (
            Manifest.model_validate_json(found["manifest"]),
            Provenance.model_validate(json.loads(found["provenance"])),
        )
    except ValidationError as error:
        first = error.errors(include_url=False)[0]
        where = ".".join(map(str, first["loc"]))
        raise RecordingError(
            f"{path}: this payscope cannot read its description ({where}: {first['msg']}); "
            "use the payscope that wrote it, or replay the log"
        ) from error
    except json.JSONDecodeError as error:
        raise RecordingError(
            f"{path}: the recording's metadata is damaged; run the log again to make a new "
            "recording"
        ) from error


def _read_stored_frame(
    store: "LazyStore", stored_frame: StoredFrame, columns: Sequence[StoredColumn]
) -> pl.DataFrame:
    """Read columns of a frame, with rows in the order in which they were written."""
    wanted = [make_component_name(column.name) for column in columns]
    # Rerun trims expressions, but an entity may end in a space: filter by everything below it
    below = store.stream().filter(content=f"{stored_frame.entity_path_text}/**", components=wanted)
    chunks = (chunk for chunk in below if chunk.entity_path == stored_frame.entity_path_text)
    return stored_frame.rebuild_frame_from_blocks(
        [chunk.to_record_batch() for chunk in chunks], columns
    )

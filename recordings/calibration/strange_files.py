"""A stranger's recordings and PDF, read by processes of their own, which damage may end."""

import json
import subprocess
import sys
import tempfile
from collections.abc import Generator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

from recordings.calibration.bundle_folder import copy_file

#: Seconds that a recording of a long log may take.
_PATIENCE_S: Final = 900.0
_MOST_OUTPUT: Final = 64 << 20


@dataclass(frozen=True, slots=True)
class RecordingDigests:
    """What a recording holds, by digests.

    Attributes:
        inputs: SHA-256 of each file that was replayed.
        settings: digest of machine and settings.
        results: digest of all frames.
        frames: of each frame, by name.
        notes: its notes.
    """

    inputs: tuple[str, ...]
    settings: str
    results: str
    frames: Mapping[str, str]
    notes: tuple[str, ...]


def recording_digests(folder: Path, name: str, sha256: str) -> RecordingDigests | str:
    """Digest the frames of a recording of a bundle.

    Args:
        folder: the bundle.
        name: of the recording.
        sha256: that the file has to have.

    Returns:
        Its digests; or why there are none.
    """
    said = _asked_of("recording_process", folder, name, sha256)
    if isinstance(said, str):
        return said
    return RecordingDigests(
        tuple(said["inputs"]),
        said["settings"],
        said["results"],
        said["frames"],
        tuple(said["notes"]),
    )


def pdf_words(folder: Path, name: str, sha256: str) -> list[str] | str:
    """The words of a PDF in the order of its pages; or why there are none."""
    said = _asked_of("pdf_process", folder, name, sha256)
    return said if isinstance(said, str) else [str(word) for word in said["words"]]


def _asked_of(process: str, folder: Path, name: str, sha256: str) -> dict[str, Any] | str:
    """What a process says of a copy of a file, which nobody else can change meanwhile."""
    with _copy(folder, name) as (copied, digest):
        if digest != sha256:
            return "is not the file whose digest the bundle has"
        child = subprocess.Popen(
            [sys.executable, "-P", "-m", f"recordings.calibration.{process}", str(copied)],
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
            cwd=copied.parent,
        )
        try:
            out, _ = child.communicate(timeout=_PATIENCE_S)
        except subprocess.TimeoutExpired:
            child.kill()
            child.communicate()
            return f"is not read within {_PATIENCE_S:.0f} s"
    if child.returncode or len(out) > _MOST_OUTPUT:
        return "is damaged so that no reader survives it"
    said = json.loads(out)
    return str(said["fault"]) if "fault" in said else said


@contextmanager
def _copy(folder: Path, name: str) -> Generator[tuple[Path, str]]:
    """A copy with its digest."""
    with tempfile.TemporaryDirectory(prefix="payscope-") as place:
        to = Path(place) / Path(name).name
        yield to, copy_file(folder, name, to)

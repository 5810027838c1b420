"""Read untrusted recordings and PDFs in separate processes, which may crash."""

import json
import subprocess
import sys
import tempfile
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

from recordings.calibration.bundle_folder import copy_bundle_file_and_digest

#: Seconds that recordings of long logs may take.
_PATIENCE_S: Final = 900.0
#: What is started for them.
_READER: Final = "recordings.calibration.digest_process"
#: Bytes of JSON that a process may answer with.
_MOST_OUTPUT: Final = 64 << 20
_DAMAGED: Final = "is so damaged that it crashes the reader"


@dataclass(frozen=True, slots=True)
class RecordingDigests:
    """Digests of a recording's content.

    Attributes:
        inputs: SHA-256 of each input file.
        settings: digest of machine and settings.
        results: digest of all frames.
        frames: digest of each frame, by name.
        notes: notes of the recording.
    """

    inputs: tuple[str, ...]
    settings: str
    results: str
    frames: Mapping[str, str]
    notes: tuple[str, ...]


def digest_bundle_recordings(
    folder: Path, sums: Mapping[str, str]
) -> dict[str, RecordingDigests | str]:
    """Digests of the recordings of a bundle.

    Args:
        folder: the bundle.
        sums: required SHA-256 of each file, by name.

    Returns:
        Digests of each, or why there are none, by name.
    """
    said = read_untrusted_files_in_process("recording", folder, sums)
    return {
        name: each
        if isinstance(each, str)
        else RecordingDigests(
            tuple(each["inputs"]),
            each["settings"],
            each["results"],
            each["frames"],
            tuple(each["notes"]),
        )
        for name, each in said.items()
    }


def read_pdf_words(folder: Path, name: str, sha256: str) -> list[str] | str:
    """Words of a PDF in the order of its pages, or why there are none."""
    said = read_untrusted_files_in_process("pdf", folder, {name: sha256})[name]
    return said if isinstance(said, str) else [str(word) for word in said["words"]]


def read_untrusted_files_in_process(
    kind: str, folder: Path, sums: Mapping[str, str]
) -> dict[str, dict[str, Any] | str]:
    """Read the files in a process of its own, from copies that no other process can change."""
    found: dict[str, dict[str, Any] | str] = {}
    with tempfile.TemporaryDirectory(prefix="payscope-") as place:
        copies: dict[str, Path] = {}
        for number, (name, sha256) in enumerate(sums.items()):
            copy = Path(place) / f"{number}{Path(name).suffix}"
            if copy_bundle_file_and_digest(folder, name, copy) != sha256:
                found[name] = "is not the file whose digest the bundle has"
            else:
                copies[name] = copy
        said = _run_reader_process(kind, list(copies.values()))
        for number, (name, copy) in enumerate(copies.items()):
            # one of them ended the process: which?
            each = (
                said[number]
                if said is not None
                else (_run_reader_process(kind, [copy]) or [None])[0]
            )
            found[name] = _DAMAGED if each is None else each.get("fault", each)
    return found


def _run_reader_process(kind: str, copies: Sequence[Path]) -> list[dict[str, Any]] | None:
    """Results of the process for each copy; None if it crashed."""
    if not copies:
        return []
    child = subprocess.Popen(
        [sys.executable, "-P", "-m", _READER, kind, *map(str, copies)],
        stdin=subprocess.DEVNULL,
        stdout=subprocess.PIPE,
        stderr=subprocess.DEVNULL,
        cwd=copies[0].parent,
    )
    try:
        out, _ = child.communicate(timeout=_PATIENCE_S)
    except subprocess.TimeoutExpired:
        child.kill()
        child.communicate()
        return None
    return None if child.returncode or len(out) > _MOST_OUTPUT else json.loads(out)

"""Read a bundle's folder safely: names, sizes and digests.

No link is followed, no name leads outside, and every file is opened once.
"""

import hashlib
import os
import re
import stat
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from estimators.errors import EvidenceError
from recordings.calibration.bundle_limits import LIMITS

EVIDENCE: Final = "evidence.json"
READINGS: Final = "readings.parquet"
POINTS: Final = "points.parquet"
RECORDING: Final = "calibration.rrd"
REPORT: Final = "report.html"
PDF: Final = "report.pdf"
SUMS: Final = "SHA256SUMS"
STATEMENT: Final = "statement.dsse.json"
#: Time stamp of the signature, added after the bundle is signed.
TIMESTAMP: Final = "timestamp.tsr"
#: Part of a recorder's notary list that the campaign names.
NOTARY: Final = "notary.jsonl"
RUNS: Final = "runs"
#: Files of every bundle.
REQUIRED: Final = (EVIDENCE, READINGS, POINTS, RECORDING, REPORT)
#: Files not in SHA256SUMS: itself, the statement, which has its digest, and the time stamp.
UNLISTED: Final = (SUMS, STATEMENT, TIMESTAMP)

_RUN: Final = re.compile(rf"{RUNS}/[A-Za-z0-9][A-Za-z0-9._-]{{0,80}}\.rrd")
_SUM: Final = re.compile(r"([0-9a-f]{64})  (\S+)")


@dataclass(frozen=True, slots=True)
class BundleFile:
    """A file of a bundle.

    Attributes:
        sha256: SHA-256 in hexadecimal.
        data: content; None for a recording or a PDF, which are only hashed.
    """

    sha256: str
    data: bytes | None


def is_bundle_file_name(name: str) -> bool:
    """Whether a file name may occur in a bundle."""
    return name in (*REQUIRED, PDF, NOTARY, *UNLISTED) or _RUN.fullmatch(name) is not None


def list_bundle_files_and_faults(folder: Path) -> tuple[list[str], list[tuple[str, str]]]:
    """List the folder of a bundle.

    Returns:
        Sorted names of regular files that a bundle may contain; and (name, fault) of all others.

    Raises:
        EvidenceError: it is not a folder, has no file of a bundle, or has too many entries.
    """
    if not folder.is_dir():
        fault = (
            "is not a folder; give the folder of the bundle"
            if folder.exists()
            else "no such folder"
        )
        raise EvidenceError(f"{folder}: {fault}; `payscope calibrate` writes one")
    good: list[str] = []
    bad: list[tuple[str, str]] = []
    is_runs_empty = False
    for number, (name, mode) in enumerate(iter_bundle_entry_names_and_modes(folder)):
        if number >= LIMITS.bundle_max_files:
            raise EvidenceError(
                f"{folder}: more than {LIMITS.bundle_max_files} entries, so it is not a bundle; "
                "give the folder of one bundle"
            )
        is_runs_empty &= not name.startswith(f"{RUNS}/")
        if stat.S_ISLNK(mode):
            bad.append((name, "is a link, which a bundle cannot contain; it was not followed"))
        elif stat.S_ISDIR(mode):
            if name == RUNS:  # comes before what it contains
                is_runs_empty = True
            else:
                bad.append(
                    (f"{name}/", "is a folder, which a bundle cannot contain; it was not opened")
                )
        elif not stat.S_ISREG(mode):
            bad.append((name, "is not a regular file; it was not opened"))
        elif not is_bundle_file_name(name):
            bad.append((name, "does not belong to a bundle"))
        else:
            good.append(name)
    if is_runs_empty:
        bad.append((f"{RUNS}/", "is an empty folder, which a bundle cannot contain"))
    if not good and not any(name in (*REQUIRED, *UNLISTED) for name, _ in bad):
        raise EvidenceError(f"{folder}: no evidence in this folder; `payscope calibrate` writes it")
    return sorted(good), sorted(bad)


def iter_bundle_entry_names_and_modes(folder: Path) -> Iterator[tuple[str, int]]:
    """Yield names and modes of the entries in the folder and its runs/; links are not followed."""
    try:
        for place, prefix in ((folder, ""), (folder / RUNS, f"{RUNS}/")):
            if prefix and (place.is_symlink() or not place.is_dir()):
                continue
            with os.scandir(place) as entries:
                for entry in entries:
                    mode = entry.stat(follow_symlinks=False).st_mode
                    yield f"{prefix}{entry.name}", mode
    except OSError as error:
        raise EvidenceError(f"{folder}: cannot be read ({error.strerror})") from None


def read_bundle_file(folder: Path, name: str) -> BundleFile:
    """Read a file from `list_bundle_files_and_faults` once, without following a link.

    Raises:
        EvidenceError: the file cannot be read, or is too large.
    """
    keep = name not in (RECORDING, PDF) and not name.startswith(f"{RUNS}/")
    digest, size = hashlib.sha256(), 0
    parts: list[bytes] = []
    for part in iter_bundle_file_chunks(folder, name):
        size += len(part)
        digest.update(part)
        if keep and size > LIMITS.held_file_bytes:
            raise EvidenceError(
                f"{name}: has more than {LIMITS.held_file_bytes >> 20} MiB, the most that this "
                "file of a bundle may have; ask for the bundle as it was written"
            )
        if keep:
            parts.append(part)
    return BundleFile(digest.hexdigest(), b"".join(parts) if keep else None)


def copy_bundle_file_and_return_sha256(folder: Path, name: str, target_path: Path) -> str:
    """Copy a file from `list_bundle_files_and_faults`, and return the SHA-256 of the copy.

    Raises:
        EvidenceError: the file cannot be read.
    """
    digest = hashlib.sha256()
    with target_path.open("xb") as copy:
        for part in iter_bundle_file_chunks(folder, name):
            digest.update(part)
            copy.write(part)
    return digest.hexdigest()


def iter_bundle_file_chunks(folder: Path, name: str) -> Iterator[bytes]:
    """Yield the content of a file in chunks, without following a link."""
    try:
        number = os.open(folder / name, os.O_RDONLY | getattr(os, "O_NOFOLLOW", 0))
        with os.fdopen(number, "rb") as file:
            while part := file.read(LIMITS.chunk_bytes):
                yield part
    except OSError as error:
        raise EvidenceError(f"{name}: cannot be read ({error.strerror})") from None


def format_sha256sums(digests: dict[str, str]) -> str:
    """Format `SHA256SUMS`, as `sha256sum -c` reads it."""
    return "".join(f"{digests[name]}  {name}\n" for name in sorted(digests))


def parse_sha256sums(sums_bytes: bytes) -> dict[str, str]:
    """Parse `SHA256SUMS` to digests by file name.

    Raises:
        EvidenceError: the content is not in the format of `format_sha256sums`.
    """
    try:
        lines = sums_bytes.decode("ascii").splitlines()
    except UnicodeDecodeError:
        raise EvidenceError(f"{SUMS}: is not plain text; copy the bundle again") from None
    found: dict[str, str] = {}
    for number, line in enumerate(lines[: LIMITS.bundle_max_files], start=1):
        match = _SUM.fullmatch(line)
        if match is None or not is_bundle_file_name(match[2]) or match[2] in UNLISTED:
            raise EvidenceError(
                f"{SUMS}: line {number} is not the digest of a file of this bundle; copy the "
                "bundle again"
            )
        found[match[2]] = match[1]
    if format_sha256sums(found).encode() != sums_bytes:
        raise EvidenceError(
            f"{SUMS}: was changed: its lines are not sorted, or a file appears twice; copy the "
            "bundle again"
        )
    return found

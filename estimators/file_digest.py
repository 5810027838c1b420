"""The SHA-256 of a file, by which inputs, recordings and evidence are told from each other."""

import hashlib
from pathlib import Path


def file_sha256(path: Path) -> str:
    """The digest of what a file holds, in hexadecimal.

    Raises:
        OSError: it cannot be read.
    """
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()

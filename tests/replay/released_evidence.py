"""Evidence as released versions made it: unpacked from where the repository keeps it."""

import tarfile
from pathlib import Path

from tests.conftest import REPO

KEPT = REPO / "tests" / "golden" / "evidence"
#: Two bundles of one machine, `second` chained to `first`, and the signer's public key.
FORMAT_2 = KEPT / "0.1.0-format-2.tar.xz"


def unpacked(archive: Path, folder: Path) -> Path:
    """The folder with what the archive holds."""
    with tarfile.open(archive) as packed:
        packed.extractall(folder, filter="data")
    return folder

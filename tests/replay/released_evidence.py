"""Evidence as released versions made it: unpacked from where the repository keeps it."""

import tarfile
from pathlib import Path

from tests.conftest import REPO

KEPT = REPO / "tests" / "golden" / "evidence"
#: Two bundles of one machine, `second` chained to `first`, and the signer's public key.
FORMAT_2 = KEPT / "0.1.0-format-2.tar.xz"
#: Likewise, of logs with dates: `campaign_folder(…, extra=LIMITS, loads=FORMAT_3_LOADS,
#: begin_unix_s=FORMAT_3_BEGIN_S)` writes them again.
FORMAT_3 = KEPT / "0.1.0-format-3.tar.xz"
FORMAT_3_LOADS = (0, 2, 3)
FORMAT_3_BEGIN_S = 1777622400.0


def unpacked(archive: Path, folder: Path) -> Path:
    """The folder with what the archive holds."""
    with tarfile.open(archive) as packed:
        if hasattr(tarfile, "data_filter"):  # from Python 3.11.4 on
            packed.extraction_filter = tarfile.data_filter
        packed.extractall(folder)
    return folder

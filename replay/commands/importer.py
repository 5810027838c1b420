"""The executable `rerun-importer-payscope`, which the Rerun viewer starts for a file it opens.

The viewer starts every executable on the path of this prefix with the file and its own ids, reads a
recording from standard output, and takes the exit status 66 for "not mine".
"""

import argparse
import sys
from pathlib import Path
from typing import Final

#: The viewer's own number.
NOT_MINE: Final = 66


def main() -> None:
    """Import one file, and leave with the status that the viewer understands."""
    asked, _ = _parser().parse_known_args()  # newer viewers may ask for more
    # the viewer starts every importer for every file: nothing heavy before the answer "not mine"
    from replay.importer_files import is_ours

    if not is_ours(asked.path):
        sys.exit(NOT_MINE)
    from estimators.errors import PayscopeError, one_line
    from recordings.imported import ViewerIds
    from replay.importer import import_log

    ids = ViewerIds(asked.application_id or asked.path.stem or "payscope", asked.recording_id)
    try:
        fault = import_log(asked.path, ids)
    except PayscopeError as error:
        sys.stderr.write(f"payscope: {one_line(str(error))}\n")
        sys.exit(2)
    if fault is not None:
        sys.stderr.write(f"payscope: shown without a replay: {fault}\n")


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog="rerun-importer-payscope",
        description="Importer of the Rerun viewer for robots' logs (.bag, .db3, .csv; .mcap and "
        ".parquet with a machine file beside them).",
    )
    parser.add_argument("path", type=Path, help="the file or folder that the viewer opens")
    parser.add_argument("--application-id", help="of the recording that the viewer waits for")
    parser.add_argument("--recording-id", help="likewise")
    return parser

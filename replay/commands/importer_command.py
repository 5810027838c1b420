"""The executable `rerun-importer-payscope`, which the Rerun viewer starts for a file it opens.

The viewer starts every executable on the path with this prefix, with the file and its own ids; it
reads a recording from standard output, and interprets the exit status 66 as "not mine".
"""

import argparse
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Final

if TYPE_CHECKING:
    from recordings.rrd.viewer_stream import ViewerRequest

#: Exit status for a file that this importer does not import, as the viewer defines it.
NOT_MINE: Final = 66
#: Bound of times, which have 64 bits with a sign.
_LARGEST: Final = 1 << 63


def main() -> None:
    """Import one file, and exit with a status that the viewer understands."""
    asked, _ = _make_viewer_argument_parser().parse_known_args()  # newer viewers may give more
    # the viewer starts every importer for every file: nothing slow before the answer "not mine"
    from replay.recording.importer_files import should_import_file

    if not should_import_file(asked.path):
        sys.exit(NOT_MINE)
    from estimators.errors import PayscopeError, join_to_one_line
    from replay.recording.import_log import stream_log_to_viewer

    try:
        fault = stream_log_to_viewer(asked.path, parse_viewer_request(asked))
    except PayscopeError as error:
        sys.stderr.write(f"payscope: {join_to_one_line(str(error))}\n")
        sys.exit(2)
    if fault is not None:
        sys.stderr.write(f"payscope: shown without a replay: {fault}\n")


def parse_viewer_request(arguments: argparse.Namespace) -> "ViewerRequest":
    """Parse the viewer's request; an invalid time is ignored, as in Rerun's own importers."""
    from recordings.rrd.viewer_stream import TimelineKind, ViewerRequest

    times: list[tuple[str, TimelineKind, int]] = []
    for kind, option in (
        (TimelineKind.SEQUENCE, arguments.time_sequence),
        (TimelineKind.DURATION, arguments.time_duration_nanos),
        (TimelineKind.TIMESTAMP, arguments.time_timestamp_nanos),
    ):
        for text in option:
            name, _, number = text.rpartition("=")
            try:
                time = int(number)
            except ValueError:
                continue
            if name and -_LARGEST <= time < _LARGEST:
                times.append((name, kind, time))
    application = arguments.application_id or arguments.path.stem or "payscope"
    return ViewerRequest(
        application, arguments.recording_id, arguments.entity_path_prefix, tuple(times)
    )


def _make_viewer_argument_parser() -> argparse.ArgumentParser:
    # with abbreviations, an option of an older viewer (--time) would be ambiguous
    parser = argparse.ArgumentParser(
        allow_abbrev=False,
        prog="rerun-importer-payscope",
        description="Importer of the Rerun viewer for robots' logs (.bag, .db3, .csv; .mcap and "
        ".parquet with a machine file next to them).",
    )
    parser.add_argument("path", type=Path, help="the file or folder that the viewer opens")
    parser.add_argument(
        "--application-id", help="application id of the recording that the viewer waits for"
    )
    parser.add_argument("--recording-id", help="id of the recording that the viewer waits for")
    parser.add_argument(
        "--entity-path-prefix", default="", help="entity path under which everything is shown"
    )
    for kind in ("sequence", "duration_nanos", "timestamp_nanos"):
        parser.add_argument(
            f"--time_{kind}",
            action="append",
            default=[],
            metavar="TIMELINE=TIME",
            help="additional timeline, and the time of all data on it; repeatable",
        )
    return parser

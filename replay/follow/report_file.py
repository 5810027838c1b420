"""Reports as a topic of an MCAP file, which grows as they come."""

import json
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Final

from mcap.writer import CompressionType, Writer

from analysis.online.online_report import OnlineReport, report_schema
from recordings.report.atomic_output import check_output, refuse_input_as_output

TOPIC: Final = "/payscope/mass"


class ReportFile:
    """An MCAP file of JSON messages with their schema, each on disk when it is made.

    Unlike other outputs it is there from the first report on, under its own name, so that whoever
    controls the machine can follow it: what is killed leaves whole reports and no index.
    """

    def __init__(self, path: Path, logs: Sequence[Path], *, force: bool) -> None:
        """Begin a file, which is none of the logs that are followed.

        Raises:
            OutputError: it is there already, or cannot be written to.
        """
        check_output(path, force=force)
        refuse_input_as_output(path, (log for log in logs if log.exists()))
        self._file = path.open("wb")
        # a message by itself: a chunk would be as late as it is long
        self._writer = Writer(self._file, compression=CompressionType.NONE, use_chunking=False)
        self._writer.start("", "payscope")
        schema = report_schema()
        known = self._writer.register_schema(
            str(schema["title"]), "jsonschema", json.dumps(schema).encode()
        )
        self._channel = self._writer.register_channel(TOPIC, "json", known)
        self._file.flush()

    def write(self, reports: Iterable[OnlineReport]) -> None:
        """Add reports."""
        for number, report in enumerate(reports):
            data = json.dumps(report.to_dict(), allow_nan=False).encode()
            self._writer.add_message(
                self._channel, report.unix_ns, data, report.unix_ns, sequence=number
            )
        self._file.flush()

    def close(self) -> None:
        """Write the index."""
        self._writer.finish()
        self._file.close()

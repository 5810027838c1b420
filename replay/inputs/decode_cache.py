"""Cache of decoded logs: each log is decoded in its own process, and kept until it changes.

The cache keeps the fields of a log that the machine file names, as they were read. A decoding
process ends with its log, so that memory depends on the logs in progress and not on all logs.
"""

import hashlib
import json
import os
import shutil
import subprocess
import sys
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import asdict
from pathlib import Path
from typing import Any, Final

import polars as pl
from pydantic import BaseModel, ConfigDict

from analysis.model.loss import Loss
from analysis.model.machine import Machine
from estimators.errors import LogError, OutputError, PayscopeError
from replay.inputs.channel_inputs import (
    collect_versions_of_packages,
    list_channel_fields,
    list_input_files,
)
from replay.logs import TABLE, Log, LogCheck, TableHints, TimeAxis, open_log
from replay.machines.machine_file import find_time_axis_of_machine

#: Hidden folder beside the outputs.
FOLDER: Final = ".decoded"
_ABOUT: Final = "about.json"
_TOPICS: Final = "topics.arrow"
_BEGUN: Final = ".begun-"
#: Bytes of a log below which decoding it is faster than starting a process.
_WORTH_A_PROCESS: Final = 64 * 2**20
#: Exit status of a process that failed with an error of one line.
_SAID: Final = 2


class _CachedDescription(BaseModel):
    """Description of a cached log."""

    model_config = ConfigDict(frozen=True)

    format: str
    stages: dict[str, str]
    fields: dict[str, tuple[str, ...]]
    losses: tuple[Loss, ...]
    notes: tuple[str, ...] = ()


class DecodedLog(Log):
    """A log whose needed fields are read from the cache."""

    def __init__(self, log: Log, kept: Path, time_axis: TimeAxis | None) -> None:
        """Read the description of the cached log.

        Args:
            log: the log itself, whose digests equal those of the cache entry.
            kept: folder of the cache entry.
            time_axis: time column and format of a table.
        """
        super().__init__(log.path, log.format)
        self._files, self._digests, self._time = log.files, log.digests, time_axis
        self._kept = kept
        self._machine_ids = log.machine_ids()
        self._about = _CachedDescription.model_validate_json((kept / _ABOUT).read_bytes())

    @property
    def files(self) -> tuple[Path, ...]:
        """Files of the log."""
        return self._files

    @property
    def digests(self) -> tuple[str, ...]:  # pyright: ignore[reportIncompatibleVariableOverride] known already
        """SHA-256 of every file, in hexadecimal."""
        return self._digests

    def topics(self) -> pl.DataFrame:
        """Topics of the log; see `Log.topics`."""
        return pl.read_ipc(self._kept / _TOPICS)

    def _read_frames_by_topic(
        self, fields: Mapping[str, Sequence[str]], start_ns: int | None, end_ns: int | None
    ) -> dict[str, pl.DataFrame]:
        known = self._about.fields
        if any(set(names) - set(known.get(topic, ())) for topic, names in fields.items()):
            with open_log(self.path, time=self._time) as log:
                return log.read_many(fields, start_ns, end_ns)
        time = pl.col("log_time_ns")
        begun = pl.lit(value=True) if start_ns is None else time >= start_ns
        over = pl.lit(value=True) if end_ns is None else time <= end_ns
        found: dict[str, pl.DataFrame] = {}
        for topic, names in fields.items():
            frame = pl.read_ipc(self._kept / self._about.stages[topic])
            frame = frame.select("log_time_ns", "header_stamp_ns", *dict.fromkeys(names))
            whole = start_ns is None and end_ns is None
            found[topic] = frame if whole else frame.filter(begun & over)
        return found

    def losses(self) -> tuple[Loss, ...]:
        """Losses when the log was decoded: data that could not be read."""
        return self._about.losses

    def notes(self) -> tuple[str, ...]:
        """Notes on the log's format when it was decoded."""
        return self._about.notes

    def machine_ids(self) -> tuple[str, ...]:
        """Serial numbers of machines in the log."""
        return self._machine_ids

    def check(self) -> LogCheck:
        """Check the log itself, not its cached fields."""
        with open_log(self.path, time=self._time) as log:
            return log.check()


def decode_logs_in_parallel(
    logs: Sequence[Log],
    machine: Machine,
    cache_folder: Path,
    on_log: Callable[[int], None] = lambda _: None,
) -> list[Log]:
    """Decode logs in parallel, using existing entries of the cache folder.

    Args:
        logs: opened logs.
        machine: machine with its channels.
        cache_folder: folder of the cache; entries of other logs are removed.
        on_log: called with the number of logs decoded so far.

    Raises:
        LogError: a topic or field cannot be read.
        OutputError: the folder cannot be written.
    """
    time = find_time_axis_of_machine(machine)
    wanted = {log: _select_fields_of_log(log, list_channel_fields(machine)) for log in logs}
    places = {log: cache_folder / _digest_cache_key(log, wanted[log], time) for log in logs}
    remove_unused_cache_entries(cache_folder, {place.name for place in places.values()})
    missing = [log for log in logs if not places[log].is_dir()]
    on_log(len(logs) - len(missing))
    large = len(missing) > 1 and sum(map(_count_bytes_of_log_files, missing)) > _WORTH_A_PROCESS

    def decode_missing(log: Log) -> None:
        if large:
            _decode_log_in_own_process(log, wanted[log], places[log], time)
        else:
            decode_log_into_cache(log, wanted[log], places[log])

    with ThreadPoolExecutor(min(os.cpu_count() or 1, len(missing)) if large else 1) as pool:
        for done, _ in enumerate(
            pool.map(decode_missing, missing), start=len(logs) - len(missing) + 1
        ):
            on_log(done)
    return [DecodedLog(log, places[log], time) for log in logs]


def decode_log_into_cache(
    log: Log, fields: Mapping[str, Sequence[str]], cache_folder: Path
) -> None:
    """Decode fields of a log into a folder of the cache, atomically.

    Args:
        log: the opened log.
        fields: names of the fields to decode, by topic.
        cache_folder: folder to create.

    Raises:
        LogError: as from `Log.read_many`.
        OutputError: the folder cannot be written.
    """
    frames = log.read_many(fields)
    begun = cache_folder.with_name(f"{_BEGUN}{cache_folder.name}-{os.getpid()}")
    try:
        begun.mkdir(parents=True)
        stages = {topic: f"{number}.arrow" for number, topic in enumerate(frames)}
        for topic, frame in frames.items():
            frame.write_ipc(begun / stages[topic], compression="uncompressed")
        log.topics().write_ipc(begun / _TOPICS)
        about = _CachedDescription(
            format=log.format,
            stages=stages,
            fields={topic: tuple(names) for topic, names in fields.items()},
            losses=log.losses(),
            notes=log.notes(),
        )
        (begun / _ABOUT).write_text(about.model_dump_json(), encoding="utf-8")
        if not cache_folder.is_dir():  # else another process has made the same entry
            begun.rename(cache_folder)
    except OSError as error:
        reason = error.strerror or error  # polars has the reason only in the text
        raise OutputError(f"{cache_folder.parent}: cannot be written ({reason})") from None
    finally:
        shutil.rmtree(begun, ignore_errors=True)


def _decode_log_in_own_process(
    log: Log, fields: Mapping[str, Sequence[str]], cache_entry: Path, time_axis: TimeAxis | None
) -> None:
    """Decode a log in a process of its own, which limits the memory in use."""
    asked = {
        "path": str(log.path),
        "time": _convert_time_axis_to_json(time_axis),
        "fields": fields,
        "place": str(cache_entry),
    }
    done = subprocess.run(
        [sys.executable, "-P", "-m", "replay.inputs.decode_cache"],
        input=json.dumps(asked),
        capture_output=True,
        text=True,
        check=False,
    )
    if done.returncode == _SAID:
        raise LogError(done.stderr.strip())
    if done.returncode:
        why = done.stderr.strip().splitlines()[-1:] or [f"ended with {done.returncode}"]
        raise LogError(f"{log.path}: cannot be decoded: {why[0]}")


def _select_fields_of_log(
    log: Log, fields: Mapping[str, Sequence[str]]
) -> dict[str, Sequence[str]]:
    """Select the requested fields that a log has, by topic; another table may have the others."""
    found: dict[str, Sequence[str]] = {}
    for topic, has in log.topics().select("topic", "fields").iter_rows():
        if topic in fields:
            names = fields[topic]
            found[topic] = [each for each in names if each in has] if topic == TABLE else names
    return found


def _digest_cache_key(
    log: Log, fields: Mapping[str, Sequence[str]], time_axis: TimeAxis | None
) -> str:
    """Compute the digest of everything that the decoded log depends on."""
    whole: dict[str, Any] = {
        "files": [(each.name, each.sha256) for each in list_input_files(log)],
        "fields": fields,
        "time": _convert_time_axis_to_json(time_axis),
        "versions": collect_versions_of_packages(),
    }
    return hashlib.sha256(json.dumps(whole, sort_keys=True).encode()).hexdigest()[:32]


def _convert_time_axis_to_json(time_axis: TimeAxis | None) -> list[Any] | None:
    """Convert time column and format of a table to JSON-compatible values."""
    return (
        None if time_axis is None else [time_axis.column, time_axis.unit, asdict(time_axis.table)]
    )


def _count_bytes_of_log_files(log: Log) -> int:
    return sum(path.stat().st_size for path in log.files)


def remove_unused_cache_entries(cache_folder: Path, used_entries: set[str]) -> None:
    """Remove entries of other logs, and unfinished entries of killed processes."""
    for each in cache_folder.iterdir() if cache_folder.is_dir() else ():
        if each.name not in used_entries:
            shutil.rmtree(each, ignore_errors=True)


def main() -> int:
    """Decode the log requested on standard input, and return the exit status."""
    asked = json.load(sys.stdin)
    time: TimeAxis | None = None
    if asked["time"] is not None:
        column, unit, table = asked["time"]
        time = TimeAxis(column, unit, TableHints(**table))
    try:
        with open_log(asked["path"], time=time) as log:
            decode_log_into_cache(log, asked["fields"], Path(asked["place"]))
    except PayscopeError as error:
        sys.stderr.write(f"{error}\n")
        return _SAID
    return 0


if __name__ == "__main__":
    sys.exit(main())

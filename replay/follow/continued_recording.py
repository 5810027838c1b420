"""Where the recording of a log that is followed again goes on."""

import hashlib
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import polars as pl

from analysis.model.machine import Machine
from analysis.online.growing_log import causal_machine
from estimators.errors import OutputError
from recordings import check_recording, read_frame, read_provenance
from recordings.follow.growing_file import is_unfinished
from recordings.follow.growing_recording import RecordingEnd, read_end
from recordings.report.atomic_output import refuse_input_as_output
from replay.inputs.channel_inputs import resolve_machine
from replay.logs import ACTIVE


@dataclass(frozen=True, slots=True)
class Continuation:
    """How far a recording came.

    Attributes:
        until_unix_ns: of its last row.
        end: of one that was cut, which is appended to; None of one whose log had not ended, which
            is replaced when the log was followed as far again.
    """

    until_unix_ns: int
    end: RecordingEnd | None


def identify(paths: Sequence[Path], machine: Machine, noise: pl.DataFrame | None) -> str:
    """Tell what is followed: names of logs, and a digest of the machine file and the noise."""
    digest = hashlib.sha256(causal_machine(machine).model_dump_json().encode())
    digest.update(b"" if noise is None else noise.write_json().encode())
    return f"{', '.join(map(_log_name, paths))}; {digest.hexdigest()}"


def find_continuation(
    output: Path, paths: Sequence[Path], identity: str, machine: Machine, *, force: bool
) -> Continuation | None:
    """Find where a recording goes on; None where it begins.

    Raises:
        OutputError: there is a recording of another log or machine file, or a whole one of a log
            that has not grown, and no `force`.
    """
    refuse_input_as_output(output, (path for path in paths if path.exists()))
    if force or not output.is_file() or output.stat().st_size == 0:
        check_recording(output, force=force or output.is_file())
        return None
    if is_unfinished(output):
        end = read_end(output)
        if end is None:
            return None
        if end.about.identity != identity:
            raise OutputError(
                f"{output}: follows {end.about.identity.partition(';')[0]} with the machine file, "
                "settings and noise of then; name another output, or give --force"
            )
        return Continuation(end.about.t0_unix_ns + end.until_ns, end)
    if not _has_grown(output, paths, machine):
        check_recording(output, force=False)
    last_ns = read_frame(output, "excitation", ["t_ns"])["t_ns"].max()
    assert isinstance(last_ns, int)
    return Continuation(read_provenance(output).t0_unix_ns + last_ns, None)


def _has_grown(output: Path, paths: Sequence[Path], machine: Machine) -> bool:
    """Whether a recording is the causal replay of these logs when they were smaller."""
    about = read_provenance(output)
    inner = [
        each for path in paths for each in (sorted(path.iterdir()) if path.is_dir() else [path])
    ]
    sizes = {_log_name(path): path.stat().st_size for path in inner if path.exists()}
    then = {each.name.removesuffix(ACTIVE): each.size_bytes for each in about.inputs}
    return (
        about.settings.filter.causal
        and about.machine == resolve_machine(machine)
        and all(size <= sizes.get(name, 0) for name, size in then.items())
        and sum(sizes.values()) > sum(then.values())
    )


def _log_name(path: Path) -> str:
    return path.name.removesuffix(ACTIVE)

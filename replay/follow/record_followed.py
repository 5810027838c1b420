"""The recording of a log that was followed: that of its causal replay, and how far both agree."""

from collections.abc import Sequence
from pathlib import Path
from typing import Final

from analysis.model.answer import Answer
from recordings import read_recording
from replay.follow.agreement import Agreement, FollowedDigests
from replay.logs import ACTIVE
from replay.runs.run_logs import RecordTo, replay_logs

CAUSAL: Final = "settings.filter.causal=true"


def record_followed(
    paths: Sequence[Path],
    machine_file: Path,
    output: RecordTo,
    overrides: Sequence[str],
    followed: FollowedDigests,
) -> tuple[Answer, list[Agreement]]:
    """Replay what was followed and record it.

    Args:
        paths: of the log; a `.bag.active` that its recorder has renamed since is found.
        machine_file: as `replay_logs` takes it.
        output: the recording.
        overrides: of the machine file.
        followed: the decisions and estimates so far.

    Raises:
        PayscopeError: as `replay_logs`.
    """
    assert output.path is not None
    closed = [_closed_name(path) for path in paths]
    found = replay_logs(closed, machine_file, output, [*overrides, CAUSAL])
    return found, followed.compare(read_recording(output.path).frames)


def _closed_name(path: Path) -> Path:
    """The name that a recorder gives a bag when it closes it."""
    inner = path.with_suffix("")
    return inner if path.suffix == ACTIVE and not path.exists() and inner.exists() else path

"""A log is replayed once by a worker, for all evidence and reviews that are made of it.

Evidence is made and verified in a dozen files, of the same four logs with the same machine, and one
shift is reviewed in five; a replay takes longer than what is tested. The same bytes give the same
frames (`tests/golden/test_golden.py`, `tests/replay/test_fingerprint.py`), so that a log that was
tampered with, or a machine of other settings, is replayed as ever.
"""

from collections.abc import Callable, Generator, Sequence
from contextlib import contextmanager

import pytest

from analysis.model.machine import Machine
from analysis.model.run_record import Run
from replay import pipeline
from replay.inputs.channel_inputs import list_input_files
from replay.logs import Log

#: By the names and digests of a log's files, and the machine.
_KEPT: dict[str, Run] = {}


@contextmanager
def kept_replays() -> Generator[None]:
    """Context in which campaigns and reviews take the replay that is kept of a log."""
    with pytest.MonkeyPatch.context() as patched:
        patched.setattr("replay.calibration.campaign_runs.run", _replay_once)
        patched.setattr("replay.review.review_shift.run", _replay_once)
        yield


def forget_replays() -> None:
    """Replay anew whatever comes, where that replays agree is the statement."""
    _KEPT.clear()


def _replay_once(
    logs: Log | Sequence[Log], machine: Machine, on_stage: Callable[[str], None] = lambda _: None
) -> Run:
    every = logs if isinstance(logs, Sequence) else [logs]
    key = f"{[list_input_files(log) for log in every]} {machine.model_dump_json()}"
    if key not in _KEPT:
        _KEPT[key] = pipeline.run(logs, machine, on_stage)
    return _KEPT[key]

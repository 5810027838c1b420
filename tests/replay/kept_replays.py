"""A log is replayed once a session, for all that is made of it.

Evidence is made and verified in a dozen files, of the same four logs with the same machine, one
shift is reviewed in five, and one sledge is recorded to be looked at; a replay takes longer than
what is tested. The same bytes give the same
frames (`tests/golden/test_golden.py`, `tests/replay/test_fingerprint.py`), so that a log that was
tampered with, or a machine of other settings, is replayed as ever. Likewise evidence is recomputed
once by a worker: each attack on it brings the evidence before, which nobody touched.
"""

import pickle
from collections.abc import Callable, Generator, Sequence
from contextlib import contextmanager
from hashlib import sha256

import polars as pl
import pytest

from analysis.model.machine import Machine
from analysis.model.run_record import Run
from recordings.calibration.check_outcomes import BundleFinding
from recordings.calibration.evidence_document import EvidenceDocument
from recordings.calibration.recomputation import compare_bundle_with_recomputed
from replay.inputs.channel_inputs import list_input_files
from replay.logs import Log
from replay.pipeline import run as replay
from tests.made_once import make_value_once

#: Where campaigns, reviews, fleets, `run` and `explain` find what replays a log.
_PLACES = (
    "replay.calibration.campaign_runs.run",
    "replay.review.review_shift.run",
    "replay.runs.run_logs.run",
    "replay.fleet.recording_task.run",
    "replay.pipeline.run",
)
#: Where a check of evidence finds what recomputes it.
_RECOMPUTES = "recordings.calibration.bundle_checks.compare_bundle_with_recomputed"
#: By all that it is recomputed from: what was found, and notes.
_RECOMPUTED: dict[str, tuple[list[BundleFinding], list[str]]] = {}


@contextmanager
def kept_replays() -> Generator[None]:
    """Context in which they take the replay that is kept of a log."""
    with pytest.MonkeyPatch.context() as patched:
        for place in _PLACES:
            patched.setattr(place, _replay_once)
        patched.setattr(_RECOMPUTES, _recompute_once)
        yield


@contextmanager
def replays_anew() -> Generator[None]:
    """Context of a replay for each, where that replays agree is the statement."""
    with pytest.MonkeyPatch.context() as patched:
        for place in _PLACES:
            patched.setattr(place, replay)
        patched.setattr(_RECOMPUTES, compare_bundle_with_recomputed)
        yield


def _replay_once(
    logs: Log | Sequence[Log], machine: Machine, on_stage: Callable[[str], None] = lambda _: None
) -> Run:
    every = logs if isinstance(logs, Sequence) else [logs]
    made_of = f"replay {[list_input_files(log) for log in every]} {machine.model_dump_json()}"
    return make_value_once(made_of, lambda: replay(logs, machine, on_stage))


def _recompute_once(
    document: EvidenceDocument,
    readings: pl.DataFrame,
    points: pl.DataFrame | None,
    report: bytes | None,
) -> tuple[list[BundleFinding], list[str]]:
    key = sha256(pickle.dumps((document, readings, points, report))).hexdigest()
    if key not in _RECOMPUTED:
        _RECOMPUTED[key] = compare_bundle_with_recomputed(document, readings, points, report)
    found, notes = _RECOMPUTED[key]
    return [*found], [*notes]

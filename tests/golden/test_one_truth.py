"""Whether there is a mass is one truth: text, JSON, exit status and recording say the same."""

from pathlib import Path

import pytest

from benchmarks.degenerate_tables import Driven, disagreements
from replay.commands import progress_bar
from tests.golden.golden import FOLDER, LOGS
from tests.replay.kept_replays import kept_replays
from tests.twins import mark_slow_after

#: What is set beside a golden log, which may leave it without a mass.
TOLD = {
    "as it is": (),
    "with a window that no manoeuvre fills": ("settings.gate.window_samples=100000",),
    "with no mass known well enough": ("settings.verdict.relative_std_max=1e-9",),
    "where no stretch is asked for": (
        "settings.gate.window_samples=100000",
        "settings.verdict.accepted_stretches_min=0",
    ),
}


#: Every log as it is, and one in every way.
FAST = [(log, case) for log in LOGS for case in TOLD if case == "as it is" or log == "table.csv"]
MORE = [(log, case) for log in LOGS for case in TOLD if (log, case) not in FAST]


@pytest.mark.parametrize(("log", "case"), mark_slow_after(len(FAST), FAST + MORE))
def test_a_golden_log_is_weighed_or_not_by_text_json_exit_status_and_recording_alike(
    log: str, case: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(progress_bar, "LONG_S", float("inf"))
    payscope, recording = Driven(tmp_path), tmp_path / "golden.rrd"
    machine, overrides = LOGS[log]
    words = ["run", FOLDER / log, "-m", machine]
    for each in (*overrides, *TOLD[case]):
        words += ["--set", each]
    with kept_replays():  # `test_golden.py` says that two are the same
        status, said = payscope.json(*words, "-o", recording)
        _, text = payscope(*words)
    assert not payscope.faults, "\n".join(payscope.faults)
    assert list(disagreements(status, said, recording, text)) == []
    if case != "as it is":
        return
    assert status == (0 if said["loads"][0]["mass_kg"] is not None else 1)

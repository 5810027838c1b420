"""After a rehearsal no row waits: every loop that a drive needs is compiled and loaded."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

from analysis.model.methods import METHODS

REPO = Path(__file__).resolve().parents[3]

#: In a process of its own: in this one other tests have loaded the loops. Prints the loops that
#: were loaded for the first time by a drive.
_DRIVE = """
import gc
from analysis.online import on_board
from analysis.online.rehearsal import compile_loops_by_synthetic_start
from estimators.interpreted import CompiledLoop, compile_even_short_loops
from tests.analysis import plane_drives as plane
from tests.analysis.settings_by_name import settings_of

settings = settings_of(methods={methods})
rows = list(plane.excitation(plane.sensors(plane.braked(plane.start()))).iter_rows(named=True))
if {rehearsed}:
    compile_loops_by_synthetic_start(settings)

def loaded():
    loops = (each for each in gc.get_objects() if isinstance(each, CompiledLoop))
    return {{
        (each.__name__, len(getattr(each.compiled, "signatures", ())))
        for each in loops
        if "compiled" in each.__dict__
    }}

before = loaded()
with compile_even_short_loops():
    state = on_board.start(settings)
    for row in rows:
        step = on_board.step(state, row)
        state = step.state
    late = list(on_board.finish(state))
assert any(found for _, found in late) or step.gate
print(sorted(loaded() - before))
"""


def first_loaded_by_a_drive(methods, *, rehearsed):
    return subprocess.run(
        [sys.executable, "-c", _DRIVE.format(methods=methods, rehearsed=rehearsed)],
        cwd=REPO,
        env={**os.environ, "PYTHONPATH": str(REPO)},
        capture_output=True,
        text=True,
        check=True,
    ).stdout.strip()


@pytest.mark.heavy
def test_a_drive_loads_nothing_that_was_not_rehearsed():
    assert first_loaded_by_a_drive(tuple(METHODS), rehearsed=True) == "[]"
    assert "advance_window" in first_loaded_by_a_drive(("ls",), rehearsed=False)

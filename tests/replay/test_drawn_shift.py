"""One of the shifts of `make shifts`, a short one: cycles and tonnes beside the truth."""

from pathlib import Path

import numpy as np
import pytest

from benchmarks.shift_logs import matched, reviewed_shift
from benchmarks.shifts import table, totals


@pytest.mark.heavy
def test_a_drawn_shift_is_reviewed_with_its_tonnes_in_their_interval(tmp_path: Path) -> None:
    found = reviewed_shift(102, tmp_path, hours=0.12, break_s=120.0)
    assert found.right >= found.true - 1
    assert found.found <= found.true
    assert abs(found.error) < 3.0
    assert found.idle_s > 100.0
    assert not found.invented
    assert table([found]).count("\n") == 2
    assert "F1" in totals([found])


def test_a_dump_is_matched_once_with_the_nearest() -> None:
    true = np.array([100.0, 104.0, 300.0])
    assert matched(np.array([101.0, 103.5, 200.0, 304.9]), true) == {0: 0, 1: 1, 3: 2}

"""A few shifts of `make shift-coverage`: intervals hold, as wide as with the true boundaries."""

import numpy as np
import pytest

from benchmarks.shift_coverage import covered, tables


@pytest.mark.heavy
def test_intervals_of_payloads_hold_and_are_about_as_wide_as_with_the_true_boundaries() -> None:
    out = covered(8, seed=41)
    for name in ("whole", "random", "common"):
        off = np.concatenate([getattr(each, name) for each in out.found])
        assert np.mean(np.abs(off) <= 2.0) > 0.88, name
    assert np.mean([abs(each.total[0]) <= 2.0 for each in out.found]) > 0.7
    pairs = zip(out.found, out.oracle, strict=True)
    assert np.median([found.u_kg / oracle.u_kg for found, oracle in pairs]) < 1.2
    true, found, right = np.array([each.cycles for each in out.found]).sum(axis=0)
    assert 2.0 * right / (true + found) > 0.95
    assert "F1" in tables(out)

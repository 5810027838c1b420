"""95 % intervals: Student's over trials, bootstrap of a root mean square."""

import numpy as np
import polars as pl
import pytest

from analysis.paper.confidence_intervals import bootstrap_rms_and_interval, compute_mean_intervals


def test_students_interval_of_a_hand_checked_mean() -> None:
    trials = pl.DataFrame({"method": ["ls"] * 4, "error_kg": [1.0, 2.0, 3.0, 4.0]})
    row = compute_mean_intervals(trials, ["method"], ["error_kg"]).row(0, named=True)
    half = 3.182446 * np.sqrt(5 / 3) / 2  # t(0.975, 3) s / √n
    assert row["trials"] == 4
    assert row["error_kg"] == 2.5
    assert (row["error_kg_low"], row["error_kg_high"]) == pytest.approx((2.5 - half, 2.5 + half))


def test_one_trial_has_no_interval_and_missing_values_do_not_count() -> None:
    trials = pl.DataFrame({"method": ["ls", "ls", "rls"], "error_kg": [1.0, None, None]})
    ls, rls = compute_mean_intervals(trials, ["method"], ["error_kg"]).iter_rows(named=True)
    assert (ls["trials"], ls["error_kg"], ls["error_kg_low"]) == (2, 1.0, None)
    assert (rls["error_kg"], rls["error_kg_high"]) == (None, None)


@pytest.mark.heavy
def test_the_bootstrap_interval_holds_the_true_root_mean_square_nearly_always() -> None:
    rng = np.random.default_rng(11)
    # errors of two sizes, as windows of different phases have
    scale = np.where(np.arange(300) % 2, 1.0, 3.0)
    held = 0
    for _ in range(60):
        _, low, high = bootstrap_rms_and_interval(scale * rng.standard_normal(300), rng)
        held += low <= np.sqrt(5.0) <= high
    assert held >= 50


def test_no_error_at_all_has_no_root_mean_square() -> None:
    assert np.isnan(bootstrap_rms_and_interval(np.array([np.nan]), np.random.default_rng(0))).all()

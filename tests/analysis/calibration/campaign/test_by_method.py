"""Calibrations of the methods, and what their masses err by."""

import numpy as np
import polars as pl
import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from analysis.calibration.campaign.by_method import fit_calibration_line_by_method
from analysis.calibration.campaign.method_errors import (
    add_calibrated_mass_error_columns,
    compute_rms_mass_errors_by_method,
)


def runs(method, masses_by_load, empty_kg=3614.0):
    """A row a run: `masses_by_load` gives each load's estimates."""
    return pl.DataFrame(
        [
            {
                "method": method,
                "load_kg": float(load),
                "reference_kg": empty_kg + load,
                "mass_kg": mass,
            }
            for load, masses in masses_by_load.items()
            for mass in masses
        ],
        schema={
            "method": pl.String,
            "load_kg": pl.Float64,
            "reference_kg": pl.Float64,
            "mass_kg": pl.Float64,
        },
    )


def test_a_hand_checked_example():
    # means 10, 20, 40 for references 1, 2, 3: c1 = 15, c0 = 70 / 3 - 30
    fit = fit_calibration_line_by_method(
        runs("ls", {1: [9.0, 11.0], 2: [19.0, 21.0], 3: [38.0, 42.0]}, empty_kg=0.0)
    )
    assert fit["runs"].to_list() == [2, 2, 2]
    assert fit["estimate_kg"].to_list() == [10.0, 20.0, 40.0]
    spread = [pytest.approx(value**0.5) for value in (2, 2, 8)]
    assert fit["estimate_std_kg"].to_list() == spread
    assert fit["alpha_1"].to_list() == pytest.approx([1 / 15] * 3)
    assert fit["beta_kg"].to_list() == pytest.approx([4 / 9] * 3)
    assert fit["calibrated_kg"].to_list() == pytest.approx([10 / 9, 16 / 9, 28 / 9])
    assert fit["error_kg"].to_list() == pytest.approx([1 / 9, -2 / 9, 1 / 9])
    # without 1: m = y/20 + 1; without 2: m = y/15 + 1/3; without 3: m = y/10
    assert fit["error_left_out_kg"].to_list() == pytest.approx([0.5, -1 / 3, 1.0])
    errors = compute_rms_mass_errors_by_method(fit).row(0, named=True)
    assert errors["loads"] == 3
    assert errors["rmse_kg"] == pytest.approx(np.sqrt(6 / 81 / 3))
    assert errors["rmse_left_out_kg"] == pytest.approx(np.sqrt((1 / 4 + 1 / 9 + 1) / 3))
    assert errors["rmse_constant_kg"] == pytest.approx(np.sqrt(2 / 3))
    assert errors["load_range_kg"] == 2.0


def test_a_constant_scores_85_kg_on_the_papers_loads():
    loads = (0, 50, 100, 150, 200, 250)
    fit = fit_calibration_line_by_method(runs("ls", {load: [3000.0 + 2 * load] for load in loads}))
    errors = compute_rms_mass_errors_by_method(fit).row(0, named=True)
    assert errors["rmse_constant_kg"] == pytest.approx(85.39, abs=0.01)
    assert errors["rmse_kg"] == pytest.approx(0.0, abs=1e-9)
    assert errors["rmse_left_out_kg"] == pytest.approx(0.0, abs=1e-9)


estimates = st.lists(st.lists(st.floats(-50, 50), min_size=3, max_size=3), min_size=4, max_size=8)


@pytest.mark.heavy
@given(estimates)
@example([[0.0] * 3, [0.0] * 3, [0.0] * 3, [0.0, 0.0, 1e-8]])  # they scatter by rounding alone
def test_with_as_many_starts_each_load_counts_alike(noise):
    table = runs("rls", {50 * i: [3000 + 60 * i + n for n in of] for i, of in enumerate(noise)})
    fit = fit_calibration_line_by_method(table)
    x, y = fit["reference_kg"].to_numpy(), fit["estimate_kg"].to_numpy()
    c1, c0 = np.polyfit(x, y, 1)
    np.testing.assert_allclose(fit["calibrated_kg"], (y - c0) / c1, rtol=1e-6)
    for k in range(x.size):
        others = np.arange(x.size) != k
        slope, level = np.polyfit(x[others], y[others], 1)
        expected = (y[k] - level) / slope - x[k]
        assert fit["error_left_out_kg"][k] == pytest.approx(expected, rel=1e-5, abs=1e-4)


def test_each_method_has_its_own_fit_and_methods_keep_their_order():
    ls = runs("tls", {0: [1.0], 1: [2.0], 2: [3.0]})
    other = runs("fgls", {0: [2.0], 1: [4.0], 2: [6.0]})
    fit = fit_calibration_line_by_method(pl.concat([ls, other]))
    assert fit["method"].to_list() == ["tls"] * 3 + ["fgls"] * 3
    assert fit["alpha_1"].to_list() == pytest.approx([1.0] * 3 + [0.5] * 3)


def test_runs_without_an_estimate_do_not_count_and_a_load_without_any_has_no_error():
    table = runs("ls", {0: [1.0, None], 1: [2.0], 2: [None, float("nan")], 3: [4.0]})
    fit = fit_calibration_line_by_method(table)
    assert fit["runs"].to_list() == [1, 1, 0, 1]
    assert fit["estimate_kg"].to_list() == [1.0, 2.0, None, 4.0]
    assert fit["error_kg"].null_count() == fit["error_left_out_kg"].null_count() == 1
    assert compute_rms_mass_errors_by_method(fit)["loads"].to_list() == [3]


@pytest.mark.parametrize(
    "masses",
    [
        {0: [1.0], 1: [2.0]},
        {0: [1.0], 1: [2.0], 2: [None]},
        {0: [5.0], 1: [5.0], 2: [5.0]},
        {0: [None], 1: [None], 2: [None]},
        {0: [float("inf")], 1: [1.0], 2: [2.0]},
    ],
    ids=["two loads", "two with estimates", "no spread", "no estimate", "not finite"],
)
def test_too_little_to_fit_gives_nulls_and_no_warning(masses):
    fit = fit_calibration_line_by_method(runs("ls", masses))
    fitted = ("alpha_1", "beta_kg", "calibrated_kg", "error_kg", "error_left_out_kg")
    assert all(fit[name].null_count() == fit.height for name in fitted)
    errors = compute_rms_mass_errors_by_method(fit).row(0, named=True)
    assert errors["rmse_kg"] is None
    assert errors["rmse_left_out_kg"] is None


def test_a_load_without_which_the_others_do_not_spread_has_no_left_out_error():
    fit = fit_calibration_line_by_method(runs("ls", {0: [5.0], 1: [5.0], 2: [8.0]}))
    assert fit["error_kg"].null_count() == 0
    assert [e is None for e in fit["error_left_out_kg"]] == [False, False, True]


def test_no_estimates_at_all_give_an_empty_frame_with_all_columns():
    fit = fit_calibration_line_by_method(runs("ls", {}))
    assert fit.height == 0
    assert "error_left_out_kg" in fit.columns
    assert compute_rms_mass_errors_by_method(fit).height == 0


def test_errors_of_single_runs_are_those_of_the_lines_with_and_without_their_load():
    # the lines of the hand-checked example
    errors = add_calibrated_mass_error_columns(
        runs("ls", {1: [9.0, 11.0], 2: [20.0], 3: [38.0, None]}, empty_kg=0.0)
    )
    fit = fit_calibration_line_by_method(
        runs("ls", {1: [9.0, 11.0], 2: [20.0], 3: [38.0]}, empty_kg=0.0)
    )
    alpha, beta = fit["alpha_1"][0], fit["beta_kg"][0]
    within = [alpha * m + beta - r for m, r in ((9, 1), (11, 1), (20, 2), (38, 3))]
    assert errors["error_kg"].to_list() == [*(pytest.approx(e) for e in within), None]
    # without 1 the line goes through (20, 2) and (38, 3)
    without = [(m - 20) / 18 + 2 - 1 for m in (9, 11)]
    assert errors["error_left_out_kg"][:2].to_list() == pytest.approx(without)
    means = errors.group_by("load_kg", maintain_order=True).agg(pl.col("error_left_out_kg").mean())
    assert means["error_left_out_kg"].to_list() == pytest.approx(fit["error_left_out_kg"].to_list())


def test_runs_of_too_few_loads_have_no_error():
    errors = add_calibrated_mass_error_columns(runs("ls", {0: [9.0, 11.0], 50: [20.0]}))
    assert errors["error_kg"].null_count() == errors["error_left_out_kg"].null_count() == 3

"""The mass over the whole log by each method, and what of it is withheld."""

import numpy as np
import polars as pl
import pytest

from analysis.model.axes import make_straight_regressor_and_force
from analysis.stages.estimation.method_estimates import (
    summarise_masses,
    trace_estimates,
    withhold_masses,
)
from analysis.stages.gating.gate import gate_windows, mark_samples_for_pooling
from estimators.methods import pooled
from tests.analysis.opinions import CANNOT_WEIGH, WEIGHS

TRIP = ("standstill", "start", "brake", "standstill")


@pytest.fixture(scope="module")
def log(drive, excitation_of, machine):
    made = machine()
    excitation = excitation_of(drive(TRIP * 3, (1.5, 5.0, 2.0, 1.5) * 3), made)
    gated = gate_windows(excitation, made.settings)
    return excitation, gated, trace_estimates(excitation, gated, made.settings)


NUMBERS = ("mass_kg", "mass_std_kg", "friction_x_N_s_m", "friction_x_std_N_s_m", "payload_kg")


def test_a_row_a_method_with_a_believable_mass(log, machine):
    table = summarise_masses(*log, machine())
    assert table["method"].to_list() == ["ls", "rls", "fgls", "tls", "pooled"]
    assert not table["withheld"].any()
    for row in table.iter_rows(named=True):
        assert row["rows"] == log[2][row["method"]].height
        assert abs(row["mass_kg"] - 3614.0) < 4 * row["mass_std_kg"] + 20.0
        assert row["payload_kg"] == pytest.approx(row["mass_kg"] - 3614.0)


def test_a_verdict_that_forbids_the_mass_takes_out_every_number(log, machine):
    table = withhold_masses(summarise_masses(*log, machine()), CANNOT_WEIGH, ())
    assert table["withheld"].all()
    for name in NUMBERS:
        assert table[name].null_count() == 5, name
    assert (table["rows"] > 0).all()


def test_a_method_that_the_log_contradicts_is_taken_out_alone(log, machine):
    table = summarise_masses(*log, machine())
    kept = withhold_masses(table, WEIGHS, ("ls", "rls"))
    assert kept["withheld"].to_list() == [True, True, False, False, False]
    for name in NUMBERS:
        assert kept[name][:2].null_count() == 2, name
        assert kept[name][2:].equals(table[name][2:]), name


def test_nothing_is_withheld_where_nothing_speaks_against_it(log, machine):
    table = summarise_masses(*log, machine())
    assert withhold_masses(table, WEIGHS, ()).equals(table)


def test_pooled_is_one_fit_over_every_accepted_sample_of_the_whole_log(log, machine):
    excitation, gated, estimates = log
    settings = machine().settings
    A, f = make_straight_regressor_and_force(excitation, settings)
    used = mark_samples_for_pooling(excitation, gated, settings)
    whole = pooled.estimate_along_log(A, f, np.where(used, 0, -1))
    row = summarise_masses(*log, machine()).row(
        by_predicate=pl.col("method") == "pooled", named=True
    )
    assert row["mass_kg"] == pytest.approx(whole.theta[0, 0])
    assert row["mass_std_kg"] == pytest.approx(whole.std[0, 0])
    assert row["rows"] == estimates["pooled"].height == 3


def test_rls_is_its_last_state(log, machine):
    row = summarise_masses(*log, machine()).row(by_predicate=pl.col("method") == "rls", named=True)
    last = log[2]["rls"].row(-1, named=True)
    assert (row["mass_kg"], row["mass_std_kg"]) == (last["mass_kg"], last["mass_std_kg"])


def test_windowed_methods_are_the_mean_weighted_by_what_each_window_knows(log, machine):
    frame = log[2]["ls"]
    weight = frame["mass_std_kg"] ** -2.0
    expected = (frame["mass_kg"] * weight).sum() / weight.sum()
    row = summarise_masses(*log, machine()).row(0, named=True)
    assert row["mass_kg"] == pytest.approx(expected)
    # windows overlap: the mean of hundreds is no twentieth of one
    assert row["mass_std_kg"] > frame["mass_std_kg"].min() / 10


def test_without_an_empty_mass_there_is_no_payload(log, machine):
    table = summarise_masses(*log, machine(body={"empty_mass_kg": None}))
    assert table["payload_kg"].null_count() == 5
    assert table["mass_kg"].null_count() == 0


def test_a_method_without_rows_has_no_mass(log, machine):
    excitation, gated, estimates = log
    nothing = gated.with_columns(accepted_x=pl.lit(value=False))
    empty = {method: frame.clear() for method, frame in estimates.items()}
    table = summarise_masses(excitation, nothing, empty, machine())
    assert table["mass_kg"].null_count() == 5
    assert table["rows"].to_list() == [0] * 5

"""Manoeuvres, and what each says when pooled."""

import numpy as np
import polars as pl
import pytest

from analysis.model.schema import PHASE, PHASES, build_frame
from analysis.model.settings import Settings
from analysis.stages.gating.gate import gate_windows, mark_samples_for_pooling
from analysis.stages.gating.segments import (
    assign_manoeuvre_numbers_to_samples,
    estimate_each_manoeuvre_by_pooling,
)

TRIP = ("standstill", "start", "brake", "standstill")


def phase_frame(*stretches):
    """Rows of (phase, samples); None is an unknown phase."""
    names = [name for name, samples in stretches for _ in range(samples)]
    return pl.DataFrame({"phase": pl.Series(names, dtype=PHASE)})


def ids(settings, *stretches):
    return assign_manoeuvre_numbers_to_samples(phase_frame(*stretches), settings).tolist()


def test_a_start_from_standstill_into_cruise_is_one_manoeuvre_and_braking_another():
    trip = (("standstill", 2), ("accelerating", 2), ("cruising", 1), ("braking", 2))
    assert ids(Settings(), *trip, ("standstill", 1)) == [0] * 5 + [1] * 2 + [2]


def test_where_braking_counts_as_driving_it_ends_no_manoeuvre():
    trip = (("standstill", 2), ("accelerating", 2), ("braking", 2), ("standstill", 1))
    assert ids(Settings(gate={"exclude_braking": False}), *trip) == [0] * 7


def test_each_kind_of_turn_is_its_own_manoeuvre():
    trip = (("cruising", 1), ("arc", 2), ("turning", 1), ("spinning", 2), ("cruising", 1))
    assert ids(Settings(), *trip) == [0, 1, 1, 2, 3, 3, 4]


def test_a_row_of_unknown_phase_is_in_none_and_parts_what_it_lies_between():
    trip = ((None, 2), ("cruising", 2), (None, 1), ("cruising", 2), (None, 1))
    assert ids(Settings(), *trip) == [-1, -1, 0, 0, -1, 1, 1, -1]
    assert ids(Settings()) == []


@pytest.fixture(scope="module")
def two_starts(drive, excitation_of):
    return excitation_of(drive(TRIP * 2, (1.5, 5.0, 2.0, 1.5) * 2))


def made(excitation, settings=None):
    settings = settings or Settings()
    gated = gate_windows(excitation, settings)
    return estimate_each_manoeuvre_by_pooling(excitation, gated, settings), gated


def test_each_start_gives_its_pooled_mass_and_braking_says_why_it_has_none(two_starts):
    table, _ = made(two_starts)
    weighed = table.filter(pl.col("mass_kg").is_not_null())
    assert weighed["phase"].to_list() == ["accelerating"] * 2
    assert weighed["reason"].to_list() == ["accepted"] * 2
    error = (weighed["mass_kg"] - 3614.0).abs()
    assert (error < 4 * weighed["mass_std_kg"]).all()
    assert (weighed["mass_std_kg"] < 100).all()
    braking = table.filter(phase="braking")
    assert braking.height == 2
    assert (braking["reason"] == "braking").all()


def test_times_and_counts_of_the_segments_are_those_of_their_rows(two_starts):
    table, gated = made(two_starts)
    numbers = assign_manoeuvre_numbers_to_samples(two_starts, Settings())
    used = mark_samples_for_pooling(two_starts, gated, Settings())
    t_ns = two_starts["t_ns"].to_numpy()
    for row in table.iter_rows(named=True):
        mine = np.flatnonzero(numbers == row["segment_id"])
        assert (row["start_t_ns"], row["end_t_ns"]) == (t_ns[mine[0]], t_ns[mine[-1]])
        assert row["samples"] == mine.size
        assert row["samples_accepted"] == used[mine].sum()
        assert (row["reason"] == "accepted") == (row["samples_accepted"] > 0)
    assert table["samples"].sum() == (numbers >= 0).sum()


def test_without_an_accepted_window_every_segment_has_a_reason_and_no_mass(two_starts):
    table, _ = made(two_starts, Settings(gate={"threshold_nat": 50.0}))
    assert table.height > 0
    assert "mass_kg" not in table.columns or table["mass_kg"].null_count() == table.height
    assert "accepted" not in table["reason"].to_list()
    assert table["reason"].null_count() == 0


def test_a_refused_stretch_of_braking_that_counts_as_driving_says_what_the_gate_said(two_starts):
    braking = two_starts.with_columns(phase=pl.lit("braking", dtype=PHASE))
    table, _ = made(braking, Settings(gate={"exclude_braking": False, "threshold_nat": 50.0}))
    assert table["phase"].to_list() == ["braking"]
    assert table["reason"].to_list() == ["low_information"]


@pytest.mark.parametrize("phase", PHASES)
def test_a_stretch_of_one_phase_is_named_after_it_and_refused_for_what_it_is(phase):
    n = 400
    frame = build_frame(
        "excitation",
        {
            "t_ns": np.arange(n) * 10_000_000,
            "force_x_N": np.full(n, 5.0),
            "regressor_acc_x_m_s2": np.zeros(n),
            "speed_x_m_s": np.ones(n),
            "phase": pl.Series([phase] * n),
        },
    )
    table, _ = made(frame)
    assert table["phase"].to_list() == [phase]
    refusal = {
        "standstill": "standstill",
        "braking": "braking",
        "spinning": "turning",
        "arc": "turning",
        "turning": "turning",
    }
    assert table["reason"].to_list() == [refusal.get(phase, "warming_up")]


def test_samples_that_determine_no_mass_leave_null_and_never_nan(two_starts):
    flat = two_starts.with_columns(regressor_acc_x_m_s2=pl.lit(0.0))
    gated = gate_windows(two_starts, Settings())
    table = estimate_each_manoeuvre_by_pooling(flat, gated, Settings())
    assert (table["samples_accepted"] > 0).any()
    assert table["mass_kg"].null_count() == table.height

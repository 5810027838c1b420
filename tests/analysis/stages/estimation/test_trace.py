"""The chosen estimators over the accepted windows, as frames."""

import numpy as np
import polars as pl
import pytest

from analysis.model.settings import Settings
from analysis.stages.estimation.method_estimates import trace_estimates
from analysis.stages.gating.gate import gate_windows, mark_samples_for_pooling
from analysis.stages.gating.segments import (
    assign_manoeuvre_numbers_to_samples,
    estimate_each_manoeuvre_by_pooling,
)
from tests.analysis.settings_by_name import settings_of

TRIP = ("standstill", "start", "brake", "standstill")


@pytest.fixture(scope="module")
def two_starts(drive, excitation_of):
    return excitation_of(drive(TRIP * 2, (1.5, 5.0, 2.0, 1.5) * 2))


def traced(excitation, **settings):
    settings = settings_of(**settings)
    gated = gate_windows(excitation, settings)
    return trace_estimates(excitation, gated, settings), gated


def test_windowed_methods_have_a_row_an_accepted_window(two_starts):
    frames, gated = traced(two_starts)
    accepted = gated.filter("accepted_x")["t_ns"]
    for method in ("ls", "fgls", "tls"):
        assert frames[method]["t_ns"].equals(accepted)
        assert frames[method].null_count().sum_horizontal().item() == 0


def test_a_recursion_is_fed_no_window_that_braking_follows_before_it_could_be_seen(two_starts):
    frames, gated = traced(two_starts, methods=("rls", "rtls"))
    accepted = np.flatnonzero(gated["accepted_x"])
    braking = np.flatnonzero((two_starts["phase"] == "braking").fill_null(False))
    # the span of the speed rate and the moving mean, 0.1 s each
    settled = [k for k in accepted if not ((braking >= k) & (braking < k + 20)).any()]
    assert 0 < len(settled) < accepted.size
    for frame in frames.values():
        assert frame["t_ns"].to_list() == two_starts["t_ns"].to_numpy()[settled].tolist()
    welcome, gated = traced(two_starts, methods=("rls",), exclude_braking=False)
    assert welcome["rls"]["t_ns"].equals(gated.filter("accepted_x")["t_ns"])


def test_every_method_weighs_the_machine(two_starts):
    frames, _ = traced(two_starts)
    for frame in frames.values():
        last = frame.row(-1, named=True)
        assert last["mass_kg"] == pytest.approx(3614.0, rel=0.05)
        assert last["friction_x_N_s_m"] == pytest.approx(2891.0, rel=0.05)


def test_a_row_of_ls_is_the_least_squares_of_the_window_that_ends_there(two_starts):
    frames, gated = traced(two_starts)
    end = int(np.flatnonzero(gated["accepted_x"])[57])
    window = two_starts[end - 319 : end + 1]
    A = window.select("regressor_acc_x_m_s2", "speed_x_m_s").to_numpy()
    theta = np.linalg.lstsq(A, window["force_x_N"].to_numpy())[0]
    row = frames["ls"].row(57, named=True)
    assert row["t_ns"] == two_starts["t_ns"][end]
    assert (row["mass_kg"], row["friction_x_N_s_m"]) == pytest.approx(tuple(theta), rel=1e-9)


def test_pooled_agrees_with_the_segments(two_starts):
    frames, gated = traced(two_starts)
    table = estimate_each_manoeuvre_by_pooling(two_starts, gated, Settings()).drop_nulls("mass_kg")
    names = ["mass_kg", "mass_std_kg", "friction_x_N_s_m", "residual_rms_N", "condition_1"]
    assert frames["pooled"].select(names).equals(table.select(names))
    assert frames["pooled"].height == 2


def test_pooled_stands_at_the_last_sample_it_used(two_starts):
    frames, gated = traced(two_starts)
    used = mark_samples_for_pooling(two_starts, gated, Settings())
    numbers = np.where(used, assign_manoeuvre_numbers_to_samples(two_starts, Settings()), -1)
    last = [int(np.flatnonzero(numbers == i)[-1]) for i in np.unique(numbers[used])]
    assert frames["pooled"]["t_ns"].to_list() == two_starts["t_ns"][last].to_list()


def test_the_methods_are_those_of_the_settings_in_their_order(two_starts):
    frames, _ = traced(two_starts, methods=("tls", "ls"))
    assert list(frames) == ["tls", "ls"]


def test_coulomb_adds_its_columns(two_starts):
    frames, _ = traced(two_starts)
    assert "coulomb_x_N" not in frames["ls"].columns
    frames, _ = traced(two_starts, coulomb=True)
    for frame in frames.values():
        assert {"coulomb_x_N", "coulomb_x_std_N"} <= set(frame.columns)


def test_the_options_of_the_methods_are_those_of_the_settings(two_starts):
    few, _ = traced(two_starts)
    other, _ = traced(two_starts, forgetting=0.95, fgls_floor=1.0, acc_m_s2=0.2, methods=tuple(few))
    for method in ("rls", "fgls", "tls"):
        assert not few[method]["mass_kg"].equals(other[method]["mass_kg"])
    assert few["ls"].equals(other["ls"])


def test_nothing_accepted_gives_empty_frames_with_their_columns(two_starts):
    frames, _ = traced(two_starts, threshold_nat=50.0)
    for frame in frames.values():
        assert frame.height == 0
        assert {"t_ns", "mass_kg", "mass_std_kg"} <= set(frame.columns)
        assert frame["mass_kg"].dtype == pl.Float64


def test_a_recursion_begins_anew_with_each_load(two_starts):
    """From a change on it is what it would be in a log of its own, and before it as without."""
    settings = settings_of(methods=("rls", "rtls"))
    gated = gate_windows(two_starts, settings)
    begin = two_starts.height // 2
    whole = trace_estimates(two_starts, gated, settings)
    parted = trace_estimates(two_starts, gated, settings, load_start_rows=[begin])
    window = settings.gate.window_samples
    second = gated[begin:].with_columns(
        (pl.col("accepted_x") & (pl.int_range(pl.len()) >= window - 1)).alias("accepted_x")
    )
    alone = trace_estimates(two_starts[begin:], second, settings)
    early = pl.col("t_ns") < two_starts["t_ns"][begin]
    for method in ("rls", "rtls"):
        masses = [each[method].filter(early)["mass_kg"] for each in (parted, whole)]
        assert masses[0].len() > 0
        assert masses[0].equals(masses[1])
        found, expected = parted[method].filter(~early)["mass_kg"], alone[method]["mass_kg"]
        assert expected.len() > 0
        assert found.to_list() == expected.to_list()
        assert not whole[method].filter(~early)["mass_kg"].equals(found)

"""What is made for the screen alone: breaks, spans, transitions, bins, ranges."""

import polars as pl

from analysis import Provenance, Run, Settings
from analysis.model.schema import PHASE
from recordings.rrd.display_frames import (
    choose_axis_range_without_outliers,
    is_run_drawn_decimated,
    list_displayed_columns,
    make_display_frames,
)
from recordings.rrd.recording_table import TABS
from recordings.rrd.recording_views import View
from recordings.rrd.stored_names import STATE

S = 10**9
ESTIMATES = {"mass_kg": 5.0, "mass_std_kg": 2.0}


def _view(name: str) -> View:
    return next(view for tab in TABS for view in tab.views if view.name == name)


def _run(**frames: pl.DataFrame) -> Run:
    settings = Settings(align={"rate_hz": 1.0})
    named = {name.replace("__", "/"): frame for name, frame in frames.items()}
    return Run(named, Provenance(settings=settings))


def _estimates(*t_s: int) -> pl.DataFrame:
    return pl.DataFrame({"t_ns": [t * S for t in t_s]}).with_columns(
        **{name: pl.lit(value) for name, value in ESTIMATES.items()}
    )


def test_estimates_that_do_not_follow_each_other_get_an_empty_row_between_them():
    shown = make_display_frames(_run(estimates__ls=_estimates(0, 1, 7, 8)))["display/estimates/ls"]
    assert shown["t_ns"].to_list() == [0, S, S + 1, 7 * S, 8 * S, 8 * S + 1]
    assert shown["mass_kg"].to_list() == [5.0, 5.0, None, 5.0, 5.0, None]
    assert shown["mass_std_kg_squared"].to_list() == [4.0, 4.0, None, 4.0, 4.0, None]


def test_estimates_that_stand_alone_are_dotted_and_stretches_are_not():
    run = _run(estimates__pooled=_estimates(0, 7, 20), estimates__ls=_estimates(0, 1, 2, 3))
    shown = make_display_frames(run)
    drawn = {each.label: each.dotted for each in list_displayed_columns(_view("Mass"), run, shown)}
    assert drawn == {"pooled": True, "ls": False}


def test_a_manoeuvre_is_held_from_its_start_to_its_end_and_no_further():
    segments = pl.DataFrame(
        {
            "start_t_ns": [0, 10 * S],
            "end_t_ns": [4 * S, 12 * S],
            "phase": pl.Series(["accelerating", "cruising"], dtype=PHASE),
            **{name: [value, None] for name, value in ESTIMATES.items()},
        }
    )
    shown = make_display_frames(_run(segments=segments))
    held = shown["display/segments"]
    assert held["t_ns"].to_list() == [0, 4 * S, 4 * S + 1, 10 * S, 12 * S, 12 * S + 1]
    assert held["mass_kg"].to_list() == [5.0, 5.0, None, None, None, None]
    lane = shown["display/states/manoeuvre_phase"]
    assert lane["t_ns"].to_list() == [0, 4 * S + 1, 10 * S, 12 * S + 1]
    assert lane[STATE].to_list() == ["accelerating", None, "cruising", None]


def test_a_state_is_kept_only_where_it_changes_and_ends_with_the_log():
    phases = ["standstill", "standstill", None, None, "cruising", "cruising"]
    excitation = pl.DataFrame(
        {"t_ns": [t * S for t in range(6)], "phase": pl.Series(phases, dtype=PHASE)}
    )
    lane = make_display_frames(_run(excitation=excitation))["display/states/phase"]
    assert lane["t_ns"].to_list() == [0, 2 * S, 4 * S, 6 * S]
    assert lane[STATE].to_list() == ["standstill", None, "cruising", None]


def test_a_hole_has_no_state_also_where_one_row_of_many_is_kept():
    times = [t * S for t in (0, 10, 20, 300, 310)]
    phases = pl.Series(["standstill"] * 5, dtype=PHASE)
    run = _run(excitation=pl.DataFrame({"t_ns": times, "phase": phases}))
    lane = make_display_frames(run)["display/states/phase"]
    assert lane[STATE].to_list() == ["standstill", None, "standstill", None]
    assert lane["t_ns"].to_list()[2] == 300 * S


def test_the_threshold_is_a_line_over_the_whole_log_with_its_value_in_the_legend(drives):
    run = drives(60.0)
    shown = make_display_frames(run)
    line = shown["display/threshold/gate.threshold_nat"]
    assert line["threshold"].to_list() == [0.7, 0.7]
    labels = [each.label for each in list_displayed_columns(_view("Information index"), run, shown)]
    assert labels == [
        "index of the window",
        "mutual information by nearest neighbours",
        "index of the window, yaw",
        "mutual information by nearest neighbours, yaw",
        "threshold 0.7 nat",
    ]


def test_a_long_log_is_drawn_by_a_few_thousand_bins_with_mean_and_extremes(drives):
    run = drives(700.0)
    assert is_run_drawn_decimated(run)
    bins = make_display_frames(run)["display/excitation"]
    assert bins.height == 700
    force = run.frames["excitation"].filter(pl.col("t_ns") < S)["force_x_N"]
    first = bins.row(0, named=True)
    assert first["force_x_N_min"] == force.min()
    assert first["force_x_N_max"] == force.max()
    assert abs(first["force_x_N"] - force.mean()) < 1e-9


def test_mean_and_extremes_have_one_name_so_that_a_legend_has_one_entry(drives):
    run = drives(700.0)
    drawn = list_displayed_columns(_view("Force"), run, make_display_frames(run))
    assert [(each.column, each.label, each.faint) for each in drawn] == [
        ("force_x_N", "driving force, binned", False),
        ("force_x_N_min", "driving force, binned", True),
        ("force_x_N_max", "driving force, binned", True),
    ]


def test_a_bin_without_samples_stays_empty(drives):
    bins = make_display_frames(drives(700.0))["display/excitation"]
    gap = bins.filter(pl.col("t_ns").is_between(0.43 * 700 * S, 0.46 * 700 * S))
    assert gap.height > 15
    assert gap["force_x_N"].null_count() == gap.height


def test_a_few_wild_estimates_do_not_set_the_range_of_the_axis(drives):
    run = drives(120.0)
    assert run.frames["estimates/tls"]["mass_kg"].max() == 2.5e6
    low, high = choose_axis_range_without_outliers(_view("Mass"), run)
    assert 3000 < low < 3450
    assert 3550 < high < 4000


def test_numbers_that_are_all_alike_still_get_a_range_around_them():
    estimates = _estimates(0, 1).with_columns(mass_std_kg=pl.lit(None, pl.Float64))
    assert choose_axis_range_without_outliers(_view("Mass"), _run(estimates__ls=estimates)) == (
        4.75,
        5.25,
    )


def test_arcs_are_held_one_after_the_other_and_the_fits_that_span_them_are_left_to_the_text(drives):
    held = make_display_frames(drives(60.0))["display/planar"]
    assert held["t_ns"].to_list() == [5 * S, 9 * S, 9 * S + 1, 15 * S, 19 * S, 19 * S + 1]
    assert held["com_x_m"].to_list() == [0.13, 0.13, None, 0.13, 0.13, None]


def test_without_an_arc_the_fit_of_all_motion_is_held_over_its_span(drives):
    run = drives(60.0)
    joint = run.frames["planar"].filter(kind="joint")
    held = make_display_frames(Run({**run.frames, "planar": joint}, run.provenance))[
        "display/planar"
    ]
    assert held["t_ns"].to_list() == [0, 50 * S, 50 * S + 1]

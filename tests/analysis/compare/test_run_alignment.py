"""Two runs on one time line, and the difference of what both have."""

import polars as pl
import pytest
from hypothesis import given
from hypothesis import strategies as st

from analysis import Provenance, Run, Settings
from analysis.compare.run_alignment import (
    match_manoeuvres_of_runs,
    shift_run_b_to_time_of_a,
    subtract_runs_in_common_rows,
)
from analysis.model.schema import PHASE

S = 10**9


def manoeuvres(*rows: tuple[float, float, str]) -> pl.DataFrame:
    starts, ends, phases = zip(*rows, strict=True) if rows else ((), (), ())
    return pl.DataFrame(
        {
            "start_t_ns": pl.Series([round(t * S) for t in starts], dtype=pl.Int64),
            "end_t_ns": pl.Series([round(t * S) for t in ends], dtype=pl.Int64),
            "phase": pl.Series(phases, dtype=PHASE),
        }
    )


def run(t0_s: int = 0, rate_hz: float = 1.0, **frames: pl.DataFrame) -> Run:
    about = Provenance(settings=Settings(align={"rate_hz": rate_hz}), t0_unix_ns=t0_s * S)
    return Run({name.replace("__", "/"): frame for name, frame in frames.items()}, about)


def signal(start_s: int, values: list[float]) -> pl.DataFrame:
    return pl.DataFrame(
        {"t_ns": [(start_s + i) * S for i in range(len(values))], "force_x_N": values}
    )


START, SPIN = "accelerating", "spinning"


def test_a_manoeuvre_that_one_log_lacks_pairs_with_nothing() -> None:
    a = manoeuvres((0, 3, START), (10, 18, START), (20, 22, SPIN), (30, 31, START))
    b = manoeuvres((5, 8, START), (20, 22, SPIN), (40, 41.1, START))
    assert match_manoeuvres_of_runs(a, b) == [(0, 0), (2, 1), (3, 2)]


def test_manoeuvres_of_another_phase_are_no_pair() -> None:
    assert match_manoeuvres_of_runs(manoeuvres((0, 3, START)), manoeuvres((0, 3, SPIN))) == []


@given(
    st.lists(st.tuples(st.floats(0.5, 9.0), st.sampled_from([START, SPIN])), min_size=1, max_size=9)
)
def test_a_log_pairs_with_itself_row_by_row(lengths: list[tuple[float, str]]) -> None:
    rows = [(20.0 * i, 20.0 * i + length, phase) for i, (length, phase) in enumerate(lengths)]
    table = manoeuvres(*rows)
    assert match_manoeuvres_of_runs(table, table) == [(i, i) for i in range(len(rows))]


def test_a_replay_of_the_same_log_is_placed_by_its_start_of_time() -> None:
    a, b = run(100, aligned=signal(0, [1.0])), run(103, aligned=signal(0, [1.0]))
    moved = shift_run_b_to_time_of_a(a, b, is_same_log=True)
    assert moved.frames["aligned"]["t_ns"].to_list() == [3 * S]
    assert moved.provenance.t0_unix_ns == a.provenance.t0_unix_ns


def test_each_manoeuvre_of_another_log_begins_where_its_counterpart_does() -> None:
    a = run(aligned=signal(0, [0.0] * 30), segments=manoeuvres((5, 8, START), (20, 23, START)))
    b = run(
        aligned=signal(0, [float(i) for i in range(40)]),
        segments=manoeuvres((10, 13, START), (32, 35, START)),
    )
    moved = shift_run_b_to_time_of_a(a, b, is_same_log=False).frames
    assert moved["segments"]["start_t_ns"].to_list() == [5 * S, 20 * S]
    placed = dict(moved["aligned"].drop_nulls().select(pl.col("t_ns") // S, "force_x_N").rows())
    assert (placed[5], placed[8], placed[20], placed[23]) == (10.0, 13.0, 32.0, 35.0)
    times = moved["aligned"]["t_ns"]
    assert times.is_sorted()
    assert times.n_unique() == times.len()


def test_a_line_does_not_cross_from_one_stretch_to_the_next() -> None:
    a = run(segments=manoeuvres((5, 8, START), (60, 63, START)))
    b = run(aligned=signal(0, [1.0] * 40), segments=manoeuvres((10, 13, START), (32, 35, START)))
    moved = shift_run_b_to_time_of_a(a, b, is_same_log=False).frames["aligned"]
    assert moved["force_x_N"].null_count() == 2


def test_without_manoeuvres_both_begin_together() -> None:
    a, b = run(100, aligned=signal(0, [1.0])), run(900, aligned=signal(0, [2.0]))
    assert shift_run_b_to_time_of_a(a, b, is_same_log=False).frames["aligned"][
        "t_ns"
    ].to_list() == [0]


def test_a_difference_is_b_less_a_where_both_have_a_sample() -> None:
    a, b = run(aligned=signal(0, [1.0, 2.0, 3.0])), run(aligned=signal(1, [5.0, 5.0, 5.0]))
    less = subtract_runs_in_common_rows(a, b).frames["aligned"]
    assert less.to_dict(as_series=False) == {"t_ns": [S, 2 * S], "force_x_N": [3.0, 2.0]}


def test_of_two_grids_only_common_instants_are_subtracted() -> None:
    fast = pl.DataFrame({"t_ns": [i * S // 2 for i in range(5)], "force_x_N": [1.0] * 5})
    slow = signal(0, [1.5, 1.5, 1.5])
    less = subtract_runs_in_common_rows(run(rate_hz=2.0, aligned=fast), run(aligned=slow)).frames[
        "aligned"
    ]
    assert less["t_ns"].to_list() == [0, S, 2 * S]


def test_manoeuvres_are_subtracted_where_the_middle_of_bs_lies_in_as() -> None:
    mass = [pl.Series("mass_kg", [100.0, 110.0])]
    a = run(segments=manoeuvres((0, 4, START), (10, 14, START)).with_columns(mass))
    b = run(segments=manoeuvres((1, 5, START), (15, 19, START)).with_columns(mass))
    less = subtract_runs_in_common_rows(a, b).frames["segments"]
    assert less["start_t_ns"].to_list() == [0]
    assert less["mass_kg"].to_list() == pytest.approx([0.0])

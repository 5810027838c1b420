"""Alignment of two runs: B on A's time line, manoeuvre by manoeuvre, and B minus A.

Replays of one log may differ in the start of their time. For two logs of the same manoeuvres, each
manoeuvre of B is shifted to the start of its counterpart in A.
"""

from collections.abc import Sequence
from typing import Final

import numpy as np
import polars as pl
from numpy.typing import NDArray

from analysis.model.run_record import Run

#: Cost of a manoeuvre without a counterpart: half that of a pair with a ratio of durations of 1.6.
_LEFT_OUT: Final = 0.25
_ROW: Final = "_row"


def match_manoeuvres_of_runs(
    segments_a: pl.DataFrame, segments_b: pl.DataFrame
) -> list[tuple[int, int]]:
    """Match the manoeuvres of two logs in order, by phase and duration.

    The alignment has the lowest cost (Needleman and Wunsch 1970): a pair costs |ln| of the ratio of
    its durations, and only manoeuvres of the same phase can be paired.

    Args:
        segments_a: frame `segments` with start_t_ns, end_t_ns, phase.
        segments_b: frame `segments` of the other log.

    Returns:
        Row in A and row in B of each pair.
    """
    cost = np.full((segments_a.height + 1, segments_b.height + 1), np.inf)
    steps = _LEFT_OUT * np.arange(segments_b.height + 1)
    cost[0] = steps
    pair = compute_manoeuvre_matching_costs(segments_a, segments_b)
    for row in range(segments_a.height):
        best = cost[row] + _LEFT_OUT
        best[1:] = np.minimum(best[1:], cost[row, :-1] + pair[row])
        # along the row, add the cost of leaving out manoeuvres of B
        cost[row + 1] = np.minimum.accumulate(best - steps) + steps
    found: list[tuple[int, int]] = []
    i, j = segments_a.height, segments_b.height
    while i and j:
        if cost[i, j] == cost[i - 1, j - 1] + pair[i - 1, j - 1]:
            i, j = i - 1, j - 1
            found.append((i, j))
        elif cost[i - 1, j] < cost[i, j - 1]:
            i -= 1
        else:
            j -= 1
    return found[::-1]


def compute_manoeuvre_matching_costs(
    segments_a: pl.DataFrame, segments_b: pl.DataFrame
) -> NDArray[np.float64]:
    """Cost (a, b) of matching two manoeuvres; infinite for different phases."""
    lengths = [
        np.log(np.maximum((each["end_t_ns"] - each["start_t_ns"]).to_numpy(), 1))
        for each in (segments_a, segments_b)
    ]
    phases = [each["phase"].cast(pl.String).to_numpy() for each in (segments_a, segments_b)]
    apart = np.abs(lengths[0][:, None] - lengths[1][None, :])
    return np.where(phases[0][:, None] == phases[1][None, :], apart, np.inf)


def shift_run_b_to_time_of_a(a: Run, b: Run, *, is_same_log: bool) -> Run:
    """Shift the times of run B to the time line of A.

    Args:
        a: run that defines the time line.
        b: run that is shifted.
        is_same_log: whether both are of the same samples; otherwise manoeuvres are matched, and
            unmatched ones left out.

    Returns:
        B, with times counted from the start of A.
    """
    about = b.provenance.model_copy(update={"t0_unix_ns": a.provenance.t0_unix_ns})
    zones = None if is_same_log else find_time_shifts_of_run_b(a, b)
    offset_ns = b.provenance.t0_unix_ns - a.provenance.t0_unix_ns if is_same_log else 0
    return Run(
        {name: shift_frame_times(each, zones, offset_ns) for name, each in b.frames.items()}, about
    )


def find_time_shifts_of_run_b(a: Run, b: Run) -> pl.DataFrame | None:
    """Spans of B's time with the shift of each; None if no manoeuvre matches."""
    tables = [run.frames.get("segments", pl.DataFrame()) for run in (a, b)]
    if any(table.is_empty() for table in tables):
        return None
    pairs = match_manoeuvres_of_runs(*tables)
    reach = [extend_spans_into_gaps(table) for table in tables]
    rows: list[dict[str, int]] = []
    for i, j in pairs:
        shift = int(tables[0]["start_t_ns"][i]) - int(tables[1]["start_t_ns"][j])
        (low_a, high_a), (low_b, high_b) = reach[0][i], reach[1][j]
        zone = {"from_ns": max(low_b, low_a - shift), "to_ns": min(high_b, high_a - shift)}
        rows.append({**zone, "shift_ns": shift})
    return pl.DataFrame(rows) if rows else None


def extend_spans_into_gaps(manoeuvres: pl.DataFrame) -> list[tuple[int, int]]:
    """Span of each manoeuvre to the middles of its gaps; a minute beyond the outer ones."""
    starts, ends = manoeuvres["start_t_ns"].to_list(), manoeuvres["end_t_ns"].to_list()
    halves = [(end + start) // 2 for end, start in zip(ends[:-1], starts[1:], strict=True)]
    minute = 60 * 10**9
    return list(zip([starts[0] - minute, *halves], [*halves, ends[-1] + minute], strict=True))


def shift_frame_times(
    frame: pl.DataFrame, shift_by_time_span: pl.DataFrame | None, offset_ns: int
) -> pl.DataFrame:
    """Shift the times of a frame, by a shift for each time span or by one offset."""
    times = [name for name in ("t_ns", "start_t_ns", "end_t_ns") if name in frame.columns]
    if not times:
        return frame
    if shift_by_time_span is None:
        return frame.with_columns(pl.col(name) + offset_ns for name in times)
    first = times[0]
    order = frame.with_row_index(_ROW).sort(first)
    placed = order.join_asof(
        shift_by_time_span, left_on=first, right_on="from_ns", strategy="backward"
    )
    inside = placed.filter(pl.col(first) < pl.col("to_ns")).sort(_ROW)
    moved = inside.with_columns(pl.col(name) + pl.col("shift_ns") for name in times)
    if first == "t_ns" and "axis" not in frame.columns:
        # an empty row at the end of a stretch, so that no plotted line connects it to the next
        ends = moved.group_by("from_ns").agg(pl.col(first).max() + 1)
        moved = pl.concat([moved, ends.select(first)], how="diagonal").sort(first)
    return moved.select(frame.columns)


def subtract_runs_in_common_rows(a: Run, b: Run) -> Run:
    """B minus A in common rows: rows at equal times, or of overlapping manoeuvres and loads.

    Args:
        a: baseline run.
        b: other run, in A's time (`shift_run_b_to_time_of_a`).

    Returns:
        A run with A's times and with differences in numeric columns, but no standard deviations,
        since the two runs share most of their errors.
    """
    period_ns = min(round(1e9 / run.provenance.settings.align.rate_hz) for run in (a, b))
    frames = {
        name: subtract_frames_in_common_rows(mine, b.frames[name], period_ns // 2)
        for name, mine in a.frames.items()
        if name in b.frames
    }
    return Run({name: frame for name, frame in frames.items() if frame.height}, a.provenance)


def subtract_frames_in_common_rows(
    a: pl.DataFrame, b: pl.DataFrame, tolerance_ns: int
) -> pl.DataFrame:
    """B minus A in the rows that both frames share."""
    shared = [name for name in a.columns if name in b.columns]
    numbers = [name for name in shared if a.schema[name].is_float() and b.schema[name].is_float()]
    by = [name for name in ("axis", "kind") if name in shared]
    held = "start_t_ns" in shared
    if not held and "t_ns" not in shared:
        return pl.DataFrame()
    time = (pl.col("start_t_ns") + pl.col("end_t_ns")) // 2 if held else pl.col("t_ns")
    left, right = (_add_row_key(each, time.alias("_at"), by) for each in (a, b))
    reach = None if held else tolerance_ns
    # B's own copy of the time shows whether rows of manoeuvres overlap
    renamed = (pl.col(name).alias(_make_name_in_run_b(name)) for name in numbers)
    theirs = right.select("_at", *by, pl.col("_at").alias("_their"), *renamed)
    joined = left.join_asof(
        theirs,
        on="_at",
        by=by or None,
        strategy="nearest",
        tolerance=reach,
        check_sortedness=False,
    )
    both = joined.filter(pl.col("_their").is_not_null())
    if held:
        both = both.filter(pl.col("_their").is_between(pl.col("start_t_ns"), pl.col("end_t_ns")))
    changed = [(pl.col(_make_name_in_run_b(name)) - pl.col(name)).alias(name) for name in numbers]
    rest = [name for name in a.columns if name not in numbers]
    return both.sort(_ROW).select(*rest, *changed)


def _add_row_key(
    frame: pl.DataFrame, time_column: pl.Expr, key_columns: Sequence[str]
) -> pl.DataFrame:
    """Sort a frame by time, with row number and key columns as text."""
    texts = [pl.col(name).cast(pl.String) for name in key_columns]
    return (
        frame.with_row_index(_ROW).with_columns(time_column, *texts).drop_nulls("_at").sort("_at")
    )


def _make_name_in_run_b(name: str) -> str:
    return f"_b_{name}"

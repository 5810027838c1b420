"""Make the frames that views of a run draw, which are not data.

A line must not cross a gap, so an empty row follows each stretch of rows; a manoeuvre is drawn over
its span; a state has a row where it changes; a long log has the mean and the extremes of every few
seconds. These frames are stored under `display/` and never read back.
"""

import itertools
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Final

import numpy as np
import polars as pl

from analysis.model.physical_units import NS
from analysis.model.run_record import Run
from recordings.report import colours
from recordings.report.number_text import format_unit_suffix
from recordings.rrd.recording_limits import LIMITS
from recordings.rrd.recording_table import TABS, list_frames_of_series
from recordings.rrd.recording_views import View, ViewKind, ViewSeries
from recordings.rrd.stored_names import STATE, split_frame_name_to_path

ROOT: Final = "display"
LANES: Final = f"{ROOT}/states"
#: Duration in ns beyond which a log is drawn decimated, in bins of 1 to 10 s.
LONG_NS: Final = 600 * NS
_ENDS: Final = ("min", "max")
#: Frames whose rows last from a start to an end; these are too few to be decimated.
_HELD: Final = ("segments", "planar", "loads", "manoeuvres", "cycles")
#: Frames whose rows may be too short for a line, such as a single start of a shift.
_SHORT: Final = ("loads", "manoeuvres", "cycles")


@dataclass(frozen=True, slots=True)
class DisplayColumn:
    """A line, band or lane to draw: column of a displayed frame, with its style."""

    frame: str
    column: str
    label: str
    colour: str = ""
    variance: str | None = None
    faint: bool = False
    dotted: bool = False
    """Whether its numbers stand alone, too far apart for a line."""
    wide: bool = False
    """Whether another line lies over it."""


def find_time_span_of_grid_ns(run: Run) -> tuple[int, int] | None:
    """Find the first and last `t_ns` of a run's grid; None if no frame has times."""
    for name in ("aligned", "excitation", "gate"):
        if name in run.frames and run.frames[name].height:
            times = run.frames[name]["t_ns"]
            return times[0], times[-1]
    return None


def is_run_drawn_decimated(run: Run) -> bool:
    """Whether a run is longer than `LONG_NS`, and therefore drawn decimated."""
    span = find_time_span_of_grid_ns(run)
    return span is not None and span[1] - span[0] > LONG_NS


def iter_view_series(view: View, run: Run) -> Iterator[tuple[ViewSeries, str]]:
    """Yield the series of a view for which this run has data, each with the name of its frame."""
    for series in view.series:
        for name in list_frames_of_series(series, run.frames):
            if _has_frame_values_for_series(series, select_rows_of_arcs(run.frames[name])):
                yield series, name


def _has_frame_values_for_series(series: ViewSeries, frame: pl.DataFrame) -> bool:
    """Whether the frame has values for the series."""
    if series.column not in frame.columns:
        return False
    column = frame[series.column]
    if column.dtype == pl.Boolean:
        return bool(column.any())
    # a log without dumps, as of a calibration, has only a cycle that was not dumped
    if series.frame == "cycles" and not (frame["quality"] != "not dumped").any():
        return False
    return column.null_count() < column.len()


def list_displayed_columns(
    view: View, run: Run, display_frames: Mapping[str, pl.DataFrame]
) -> tuple[DisplayColumn, ...]:
    """List the columns of this run that a view draws.

    Args:
        view: the view.
        run: the run.
        display_frames: frames of the run that are displayed.
    """
    drawn: list[DisplayColumn] = []
    for number, (series, name) in enumerate(iter_view_series(view, run)):
        if view.kind is ViewKind.STATES:
            drawn.append(DisplayColumn(_make_lane_entity_path(series), STATE, series.label))
            continue
        method = split_frame_name_to_path(name)[1] if series.frame == "estimates" else None
        label = " ".join(filter(None, (method, series.label)))
        colour = (
            colours.choose_method_colour(method) if method else colours.choose_line_colour(number)
        )
        frame = _make_display_column_name(name)
        variance = _make_variance_column_name(series.std_column) if series.std_column else None
        dotted = series.frame in _SHORT or should_draw_as_points(
            display_frames[frame][series.column]
        )
        extremes = (
            view.kind is ViewKind.LINES
            and _make_extreme_column_name(series.column, "min") in display_frames[frame].columns
        )
        # lines of the same name have one entry in a legend, in the colour of the first
        label += ", binned" if extremes else ""
        drawn.append(DisplayColumn(frame, series.column, label, colour, variance, dotted=dotted))
        ends = [_make_extreme_column_name(series.column, end) for end in _ENDS if extremes]
        drawn += [DisplayColumn(frame, end, label, colour, faint=True) for end in ends]
    if drawn and view.threshold is not None:
        value = f"{_read_threshold_setting_of_view(run, view):g}{format_unit_suffix(view.unit)}"
        label = f"threshold {value}"
        drawn.append(DisplayColumn(_make_threshold_frame_name(view), "threshold", label, "#d55e00"))
    return tuple(drawn)


def make_display_frames(run: Run, *, decimate: bool = True) -> dict[str, pl.DataFrame]:
    """Make the frames that are drawn, by name under `display/`, with `t_ns`.

    Args:
        run: the run.
        decimate: whether a long run is drawn by means and extremes of bins.
    """
    frames: dict[str, pl.DataFrame] = {}
    asked: dict[str, dict[str, pl.Expr]] = {}
    for view in dict.fromkeys(view for tab in TABS for view in tab.views):
        for series, name in iter_view_series(view, run):
            frame = select_rows_of_arcs(run.frames[name])
            if series.frame == "findings":
                frame = keep_shortest_of_overlapping_findings(frame, find_time_span_of_grid_ns(run))
            if view.kind is ViewKind.STATES:
                frames[_make_lane_entity_path(series)] = select_state_changes(
                    series, frame, find_grid_period_ns(run)
                )
            elif series.frame in _HELD:
                frames[_make_display_column_name(name)] = _repeat_rows_at_span_end(
                    select_numbers_to_draw(name, frame), frame["end_t_ns"]
                )
            else:
                asked.setdefault(name, {}).update(make_bin_expressions(view.kind, series))
            if view.threshold is not None and (span := find_time_span_of_grid_ns(run)) is not None:
                level = [_read_threshold_setting_of_view(run, view)] * 2
                frames[_make_threshold_frame_name(view)] = pl.DataFrame(
                    {"t_ns": span, "threshold": level}
                )
    for name, wanted in asked.items():
        if decimate and is_run_drawn_decimated(run):
            frames[_make_display_column_name(name)] = _bin_frame_of_run(
                run, name, list(wanted.values())
            )
        else:
            numbers = select_numbers_to_draw(name, run.frames[name])
            sparse = split_frame_name_to_path(name)[0] == "estimates"
            frames[_make_display_column_name(name)] = (
                insert_empty_rows_at_gaps(numbers, find_grid_period_ns(run)) if sparse else numbers
            )
    return frames


def choose_axis_range_without_outliers(view: View, run: Run) -> tuple[float, float] | None:
    """Choose the range of most values for a view that clips outliers; None to show all."""
    if not view.clips_outliers:
        return None
    drawn = list(iter_view_series(view, run))
    if not drawn:
        return None
    values = pl.concat([run.frames[name][series.column] for series, name in drawn])
    values = values.filter(values.is_finite())
    stds = [run.frames[name][series.std_column] for series, name in drawn if series.std_column]
    std = pl.concat(stds).filter(pl.concat(stds).is_finite()).median() if stds else None
    if values.is_empty():
        return None
    low, high = values.quantile(0.05), values.quantile(0.95)
    if low is None or high is None:
        return None
    margin = 0.25 * (high - low) + 2 * (float(std) if isinstance(std, float) else 0.0)
    margin = margin or 0.05 * abs(high) or 1.0
    return low - margin, high + margin


def _make_display_column_name(name: str) -> str:
    return f"{ROOT}/{name}"


def _make_lane_entity_path(series: ViewSeries) -> str:
    return f"{LANES}/{series.label}"


def _make_threshold_frame_name(view: View) -> str:
    return f"{ROOT}/threshold/{view.threshold}"


def _make_variance_column_name(std: str) -> str:
    return f"{std}_squared"


def _make_extreme_column_name(column: str, extreme: str) -> str:
    return f"{column}_{extreme}"


def _read_threshold_setting_of_view(run: Run, view: View) -> float:
    return float(run.provenance.settings.get_setting(str(view.threshold)))


def should_draw_as_points(numbers: pl.Series) -> bool:
    """Whether to draw points, since most values are isolated or in many short lines."""
    there = numbers.is_not_null().to_numpy()
    edges = np.diff(there, prepend=False, append=False)
    starts, ends = edges[:-1] & there, edges[1:] & there
    count, lines, alone = (int(each.sum()) for each in (there, starts, starts & ends))
    short = lines > LIMITS.many_lines and count <= LIMITS.short_line_points * lines
    return 2 * alone > count or short


def find_grid_period_ns(run: Run) -> int:
    """Compute the period of the grid in ns."""
    return round(NS / run.provenance.settings.align.rate_hz)


def select_numbers_to_draw(name: str, frame: pl.DataFrame) -> pl.DataFrame:
    """Select the numbers of a frame that a view draws, by time or start time, with variances."""
    family = split_frame_name_to_path(name)[0]
    shown = [s for tab in TABS for view in tab.views for s in view.series if s.frame == family]
    columns = dict.fromkeys(s.column for s in shown if s.column in frame.columns)
    numeric = [c for c in columns if frame.schema[c].is_float()]
    stds = dict.fromkeys(
        s.std_column for s in shown if s.std_column and s.std_column in frame.columns
    )
    time = "start_t_ns" if "start_t_ns" in frame.columns else "t_ns"
    return frame.select(
        pl.col(time).alias("t_ns"),
        *numeric,
        *((pl.col(std) ** 2).alias(_make_variance_column_name(std)) for std in stds),
    )


def insert_empty_rows_at_gaps(numbers: pl.DataFrame, period_ns: int) -> pl.DataFrame:
    """Insert an empty row after each stretch of consecutive rows."""
    step = pl.col("t_ns").shift(-1) - pl.col("t_ns")
    ends = numbers.filter((step > 1.5 * period_ns).fill_null(True)).select(pl.col("t_ns") + 1)
    return pl.concat([numbers, ends], how="diagonal").sort("t_ns")


def select_rows_of_arcs(planar_frame: pl.DataFrame) -> pl.DataFrame:
    """Select the arcs among planar fits, in order of time; else the fit of all motion."""
    if "kind" not in planar_frame.columns:
        return planar_frame
    arcs = planar_frame.filter(pl.col("kind") == "arc")
    return planar_frame.tail(1) if arcs.is_empty() else arcs


def _repeat_rows_at_span_end(numbers: pl.DataFrame, end_ns: pl.Series) -> pl.DataFrame:
    """Repeat each row at its end, followed by an empty row, so that it is drawn over its span."""
    ends = numbers.with_columns(end_ns.alias("t_ns"))
    breaks = ends.select(pl.col("t_ns") + 1)
    return pl.concat([numbers, ends, breaks], how="diagonal").sort("t_ns", maintain_order=True)


def keep_shortest_of_overlapping_findings(
    findings: pl.DataFrame, span: tuple[int, int] | None
) -> pl.DataFrame:
    """Order findings in time; where several overlap, keep the shortest one.

    Findings about the whole log fill the remaining time.
    """
    begin, end = span or (0, 0)
    rows = [
        (row["start_t_ns"], row["end_t_ns"], row["cause"])
        if row["start_t_ns"] is not None and row["end_t_ns"] is not None
        else (begin, end, row["cause"])
        for row in findings.sort("rank").iter_rows(named=True)
    ]
    edges = sorted({edge for start, stop, _ in rows for edge in (start, stop)})
    parts: list[tuple[int, int, str]] = []
    for start, stop in itertools.pairwise(edges):
        holding = [row for row in rows if row[0] <= start and stop <= row[1]]
        if holding:
            parts.append((start, stop - 1, min(holding, key=lambda row: row[1] - row[0])[2]))
    names = ("start_t_ns", "end_t_ns", "cause")
    types = (pl.Int64, pl.Int64, pl.String)
    return pl.DataFrame(parts, schema=dict(zip(names, types, strict=True)), orient="row")


def select_state_changes(series: ViewSeries, frame: pl.DataFrame, period_ns: int) -> pl.DataFrame:
    """Select the rows at which a state begins; null in gaps and after the last row."""
    column = pl.col(series.column)
    if frame.schema[series.column] == pl.Boolean:
        column = pl.when(column).then(pl.lit(series.column))
    column = column.cast(pl.String).alias(STATE)
    if "end_t_ns" in frame.columns:
        starts = frame.select(pl.col("start_t_ns").alias("t_ns"), column)
        ends = frame.select((pl.col("end_t_ns") + 1).alias("t_ns"))
    else:
        starts = frame.select("t_ns", column)
        step = pl.col("t_ns").shift(-1) - pl.col("t_ns")
        # a thinned frame has a longer period than the grid
        is_last = (step > 1.5 * step.median()).fill_null(value=True)
        ends = frame.filter(is_last).select(pl.col("t_ns") + period_ns)
    # if a manoeuvre ends when the next begins, the row of the start comes last
    states = pl.concat([ends, starts], how="diagonal").sort("t_ns", maintain_order=True)
    changed = pl.col(STATE).ne_missing(pl.col(STATE).shift(1))
    return states.filter(changed | (pl.int_range(pl.len()) == 0))


def _bin_frame_of_run(run: Run, name: str, bin_expressions: list[pl.Expr]) -> pl.DataFrame:
    span = find_time_span_of_grid_ns(run)
    assert span is not None
    width_ns = min(max(-(-(span[1] - span[0]) // (LIMITS.screen_bins * NS)), 1), 10) * NS
    # in bins narrower than the grid's period, most bins would be empty, and no line drawn
    width_ns = max(width_ns, find_grid_period_ns(run))
    return bin_frame_rows(run.frames[name], bin_expressions, span, width_ns)


def make_bin_expressions(drawing_type: ViewKind, series: ViewSeries) -> dict[str, pl.Expr]:
    """Make the expressions of the binned columns of a series."""
    numbers = pl.col(series.column)
    if drawing_type is ViewKind.BANDS:
        mean = {series.column: numbers.mean()}
        if series.std_column is None:
            return mean
        name = _make_variance_column_name(series.std_column)
        return mean | {name: (pl.col(series.std_column) ** 2).mean().alias(name)}
    ends = {"min": numbers.min(), "max": numbers.max()}
    named = {
        (name := _make_extreme_column_name(series.column, end)): ends[end].alias(name)
        for end in _ENDS
    }
    return {series.column: numbers.mean()} | named


def bin_frame_rows(
    frame: pl.DataFrame, expressions: list[pl.Expr], span: tuple[int, int], bin_width_ns: int
) -> pl.DataFrame:
    """Bin rows to a row at the middle of each bin, empty for bins without rows: lines end there."""
    start, end = span
    number = ((pl.col("t_ns") - start) // bin_width_ns).alias("bin")
    bins = pl.select(pl.int_range((end - start) // bin_width_ns + 1, dtype=pl.Int64).alias("bin"))
    binned = bins.join(frame.group_by(number).agg(expressions), on="bin", how="left").sort("bin")
    middle = (start + pl.col("bin") * bin_width_ns + bin_width_ns // 2).alias("t_ns")
    return binned.select(middle, pl.exclude("bin"))

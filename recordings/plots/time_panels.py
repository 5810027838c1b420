"""Draw panels over time: lines or envelopes, bands, lanes of states, and a marked moment.

Stretches with more samples than pixel columns are drawn in bins: the envelope and mean of a signal,
the median of an estimate, the fraction of time in each state.
"""

from collections.abc import Mapping, Sequence
from textwrap import wrap
from typing import TYPE_CHECKING

import numpy as np
import polars as pl

from analysis.model.physical_units import NS_PER_S
from analysis.model.run_record import Run
from estimators.arrays import Floats
from recordings.plots.plot_limits import LIMITS
from recordings.report import colours
from recordings.report.picture import draw_legend_above_axes
from recordings.rrd.display_frames import (
    LANES,
    DisplayColumn,
    bin_frame_rows,
    choose_axis_range_without_outliers,
    find_time_span_of_grid_ns,
    list_displayed_columns,
    should_draw_as_points,
)
from recordings.rrd.recording_properties import format_local_time
from recordings.rrd.recording_views import View, ViewKind
from recordings.rrd.stored_names import STATE

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import SubFigure


def draw_views_over_time(
    subfigure: "SubFigure",
    views: Sequence[View],
    run: Run,
    display_frames: Mapping[str, pl.DataFrame],
    at_s: float | None = None,
) -> None:
    """Draw views one below the other over seconds since the start.

    Args:
        subfigure: subfigure to draw on.
        views: views; those without data in this run are omitted.
        run: run to draw.
        display_frames: frames of the run that are displayed, not decimated.
        at_s: moment to mark.
    """
    span = find_time_span_of_grid_ns(run)
    found = [
        (view, drawn)
        for view in views
        if (drawn := list_displayed_columns(view, run, display_frames))
    ]
    if not found or span is None:
        subfigure.suptitle("nothing in this run can be drawn over time")
        return
    heights = [compute_relative_panel_height(view, drawn) for view, drawn in found]
    rows = subfigure.subplots(len(found), 1, sharex=True, squeeze=False, height_ratios=heights)[
        :, 0
    ]
    for axes, (view, drawn) in zip(rows, found, strict=True):
        axes.tick_params(labelsize=LIMITS.small_type_pt)
        if view.kind is ViewKind.STATES:
            _draw_state_lanes(axes, drawn, display_frames, span)
        else:
            _draw_series_lines(axes, view, drawn, display_frames, span)
            axes.set_ylim(choose_axis_range_without_outliers(view, run))
        if at_s is not None:
            axes.axvline(at_s, color="black", lw=0.8, ls="--", zorder=4)
    rows[-1].set_xlim(
        span[0] / NS_PER_S, max(span[1], span[0] + LIMITS.shortest_span_ns) / NS_PER_S
    )
    rows[-1].set_xlabel(
        f"s since {format_local_time(run.provenance)}", fontsize=LIMITS.small_type_pt
    )


def compute_relative_panel_height(view: View, display_columns: Sequence[DisplayColumn]) -> float:
    """Compute the height of a panel relative to that of a plot."""
    return 0.35 * len(display_columns) + 0.1 if view.kind is ViewKind.STATES else 1.0


def _draw_series_lines(
    axes: "Axes",
    view: View,
    display_columns: Sequence[DisplayColumn],
    display_frames: Mapping[str, pl.DataFrame],
    span: tuple[int, int],
) -> None:
    for each in display_columns:
        _draw_column_in_panel(axes, each, display_frames[each.frame], span)
    lane = "gate" if view.threshold else "phase"
    shade_state_times(axes, display_frames.get(f"{LANES}/{lane}"), colours.SHADED[lane])
    unit = view.title.removeprefix(view.name).strip()
    words = [*wrap(view.name, LIMITS.label_characters), *([unit] if unit else [])]
    axes.set_ylabel("\n".join(words), fontsize=LIMITS.small_type_pt)
    draw_legend_above_axes(axes)


def _draw_column_in_panel(
    axes: "Axes", display_column: DisplayColumn, frame: pl.DataFrame, span: tuple[int, int]
) -> None:
    value = pl.col(display_column.column)
    if frame.height > LIMITS.panel_max_points:
        # bins over the whole span: those without rows are empty, so that no line crosses a gap
        width_ns = max((span[1] - span[0]) // LIMITS.panel_bins, 1)
        if display_column.variance:
            # the median of an estimate, since a few values may be far off
            frame = bin_frame_rows(
                frame, [value.median(), pl.col(display_column.variance).median()], span, width_ns
            )
        else:
            ends = [value.min().alias("low"), value.max().alias("high")]
            frame = bin_frame_rows(frame, [value.mean(), *ends], span, width_ns)
            low, high = (convert_series_to_floats(frame[end]) for end in ("low", "high"))
            t_s = frame["t_ns"].to_numpy() / NS_PER_S
            axes.fill_between(t_s, low, high, color=display_column.colour, alpha=0.3, lw=0)
    t_s = frame["t_ns"].to_numpy() / NS_PER_S
    numbers = convert_series_to_floats(frame[display_column.column])
    dots = "." if should_draw_as_points(frame[display_column.column]) else ""
    axes.plot(
        t_s,
        numbers,
        dots + "-",
        color=display_column.colour,
        lw=0.8,
        ms=3,
        label=display_column.label,
    )
    if display_column.variance:
        std = np.sqrt(convert_series_to_floats(frame[display_column.variance]))
        axes.fill_between(
            t_s, numbers - std, numbers + std, color=display_column.colour, alpha=0.2, lw=0
        )


def convert_series_to_floats(column: pl.Series) -> Floats:
    """Convert a column to floats, NaN for missing values."""
    return column.cast(pl.Float64).fill_null(float("nan")).to_numpy()


def find_state_spans(state_series: pl.DataFrame) -> pl.DataFrame:
    """Find the stretches of each state: `t_ns` of the start, `until` of the end, and the state."""
    return state_series.with_columns(until=pl.col("t_ns").shift(-1)).drop_nulls()


def _draw_state_lanes(
    axes: "Axes",
    display_columns: Sequence[DisplayColumn],
    display_frames: Mapping[str, pl.DataFrame],
    span: tuple[int, int],
) -> None:
    """Draw a lane per series from top to bottom; fractions of time if states change often."""
    seconds: dict[str, float] = {}
    for number, each in enumerate(display_columns):
        spans = find_state_spans(display_frames[each.frame])
        bottom = float(len(display_columns) - 1 - number)
        totals = spans.group_by(STATE).agg((pl.col("until") - pl.col("t_ns")).sum())
        for state, total in totals.rows():
            seconds[state] = seconds.get(state, 0.0) + total
        if spans.height > LIMITS.lane_max_spans:
            _draw_stacked_state_fractions(axes, spans, span, bottom)
        else:
            _draw_state_bars(axes, spans, bottom)
    axes.set_ylim(0.0, float(len(display_columns)))
    labels = [each.label.replace("_", " ") for each in display_columns]
    axes.set_yticks(
        [len(display_columns) - 0.5 - n for n in range(len(display_columns))],
        labels,
        fontsize=LIMITS.small_type_pt,
    )
    for state in sorted(seconds, key=lambda state: -seconds[state])[: LIMITS.legend_max_states]:
        axes.plot(
            [], [], "s", color=_choose_state_colour(state), ms=5, label=state.replace("_", " ")
        )
    draw_legend_above_axes(axes)


def _choose_state_colour(state: str) -> str:
    return colours.make_colour_by_state().get(state, colours.OTHER)


def _draw_state_bars(axes: "Axes", state_spans: pl.DataFrame, lane_bottom: float) -> None:
    """Draw stretches of states as coloured bars in a lane."""
    for (state,), group in state_spans.group_by(STATE):
        start_s = group["t_ns"].to_numpy() / NS_PER_S
        length_s = (group["until"] - group["t_ns"]).to_numpy() / NS_PER_S
        pairs = list(zip(start_s, length_s, strict=True))
        axes.broken_barh(
            pairs, (lane_bottom + 0.08, 0.84), color=_choose_state_colour(str(state)), lw=0
        )


def _draw_stacked_state_fractions(
    axes: "Axes", state_spans: pl.DataFrame, time_span: tuple[int, int], lane_bottom: float
) -> None:
    """Draw the fraction of time of every state in each bin, stacked."""
    edges = np.linspace(time_span[0], time_span[1], LIMITS.lane_bins + 1)
    width = max(float(edges[1] - edges[0]), 1.0)
    base = np.full(LIMITS.lane_bins, lane_bottom + 0.08)
    starts, ends = state_spans["t_ns"].to_numpy(), state_spans["until"].to_numpy()
    names = state_spans[STATE].to_numpy()
    for state in [name for name in colours.make_colour_by_state() if name in set(names)]:
        chosen = names == state
        # differences of the time in the state before each edge are the time in each bin
        inside = _compute_covered_time_before_edges(starts[chosen], ends[chosen], edges)
        share = 0.84 * np.diff(inside) / width
        axes.bar(
            edges[:-1] / NS_PER_S,
            share,
            width / NS_PER_S,
            bottom=base,
            align="edge",
            color=_choose_state_colour(state),
            lw=0,
        )
        base = base + share


def _compute_covered_time_before_edges(
    span_starts: np.ndarray, span_ends: np.ndarray, bin_edges: np.ndarray
) -> np.ndarray:
    """Compute the total time of ordered, disjoint stretches before each edge."""
    before = np.concatenate([[0], np.cumsum(span_ends - span_starts)])
    number = np.searchsorted(span_starts, bin_edges, side="right")
    over = np.where(number > 0, np.maximum(span_ends[np.maximum(number - 1, 0)] - bin_edges, 0), 0)
    return before[number] - over


def shade_state_times(
    axes: "Axes", state_series: pl.DataFrame | None, shaded_states: tuple[str, ...]
) -> None:
    """Shade the times of the given states behind the lines, unless states change too often."""
    if state_series is None or state_series.height > LIMITS.lane_max_spans:
        return
    for (state,), group in (
        find_state_spans(state_series).filter(pl.col(STATE).is_in(shaded_states)).group_by(STATE)
    ):
        start_s = group["t_ns"].to_numpy() / NS_PER_S
        length_s = (group["until"] - group["t_ns"]).to_numpy() / NS_PER_S
        axes.broken_barh(
            list(zip(start_s, length_s, strict=True)),
            (0, 1),
            transform=axes.get_xaxis_transform(),
            color=_choose_state_colour(str(state)),
            alpha=0.15,
            lw=0,
            zorder=0,
        )


def draw_time_fractions_of_gate_reasons(axes: "Axes", run: Run) -> None:
    """Draw the fraction of time of each gate reason, the most frequent on top."""
    gate = run.frames.get("gate")
    if gate is None or not gate.height:
        axes.axis("off")
        return
    column = "reason_x" if "reason_x" in gate.columns else "reason_z"
    counts = gate[column].cast(pl.String).value_counts(sort=True).reverse()
    names, shares = counts[column].to_list(), 100.0 * counts["count"].to_numpy() / gate.height
    bars = axes.barh(
        [name.replace("_", " ") for name in names],
        shares,
        color=[_choose_state_colour(name) for name in names],
    )
    axes.bar_label(bars, [f" {share:.1f} %" for share in shares], fontsize=LIMITS.small_type_pt)
    axes.set_xlabel("share of the windows (%)", fontsize=LIMITS.small_type_pt)
    axes.set_xlim(0.0, 1.1 * float(shares.max()))
    axes.tick_params(labelsize=LIMITS.small_type_pt)

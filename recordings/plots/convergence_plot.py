"""Plot the convergence of mass estimates, with two standard deviations."""

from typing import TYPE_CHECKING

import numpy as np
import polars as pl
from numpy.typing import NDArray

from analysis.model.methods import RECURSIVE_METHODS
from analysis.model.physical_units import NS_PER_S
from analysis.model.run_record import Run
from recordings.plots.plot_limits import LIMITS
from recordings.plots.time_panels import convert_series_to_floats
from recordings.report import colours
from recordings.report.picture import draw_legend_above_axes
from recordings.rrd.display_frames import find_time_span_of_grid_ns

if TYPE_CHECKING:
    from matplotlib.axes import Axes

Rows = NDArray[np.float64]


def draw_convergence_of_estimates(axes: "Axes", run: Run, at_s: float | None = None) -> None:
    """Draw estimates ± 2σ over time for each load, and the answer ± 2 standard uncertainties.

    Args:
        axes: axes to draw on.
        run: run, or part of one.
        at_s: moment to mark.
    """
    bounds: list[float] = []
    starts = _find_starts_of_loads_ns(run)
    # with many loads, the starts of the recursions would cover everything else
    for method in RECURSIVE_METHODS if len(starts) <= LIMITS.recursion_max_loads else ():
        frame = run.frames.get(f"estimates/{method}")
        if frame is not None and frame.height and "mass_kg" in frame.columns:
            bounds += _draw_estimates_of_method(
                axes, frame, method, starts, NS_PER_S / run.provenance.settings.align.rate_hz
            )
    means = _draw_running_means_of_loads(axes, run)
    answers = draw_intervals_of_answer(axes, run)
    bounds += means + answers
    if at_s is not None:
        axes.axvline(at_s, color="black", lw=0.8, ls="--")
    span = find_time_span_of_grid_ns(run)
    if span is not None and span[0] < span[1]:
        # a load may extend beyond the drawn stretch
        axes.set_xlim(span[0] / NS_PER_S, span[1] / NS_PER_S)
    axes.set_ylabel("mass (kg)", fontsize=LIMITS.small_type_pt)
    axes.set_xlabel("s since the start", fontsize=LIMITS.small_type_pt)
    axes.tick_params(labelsize=LIMITS.small_type_pt)
    axes.grid(alpha=0.25, lw=0.5)
    known = [each for each in bounds if np.isfinite(each)]
    if not known:
        axes.text(0.5, 0.5, "no mass estimate", ha="center", transform=axes.transAxes)
        return
    # the range of most values, since a recursion may begin anywhere
    low, high = np.quantile(known, [0.05, 0.95])
    # includes the values that the estimates settle to, wherever those of a recursion are
    for each, inside in ((means, (0.05, 0.95)), (answers, (0.0, 1.0))):
        there = [number for number in each if np.isfinite(number)]
        if there:
            ends = np.quantile(there, inside)
            low, high = min(low, ends[0]), max(high, ends[1])
    room = LIMITS.range_margin_fraction * (high - low) or 0.05 * abs(high) or 1.0
    axes.set_ylim(low - room, high + room)
    draw_legend_above_axes(axes, 7)


def _find_starts_of_loads_ns(run: Run) -> list[int]:
    loads = run.frames.get("loads")
    return [] if loads is None else loads["start_t_ns"].sort().to_list()


def _draw_estimates_of_method(
    axes: "Axes", frame: pl.DataFrame, method: str, load_starts_ns: list[int], period_ns: float
) -> list[float]:
    rows = frame.filter(pl.col("mass_kg").is_not_null()).select("t_ns", "mass_kg", "mass_std_kg")
    if rows.is_empty():
        return []
    step = -(-rows.height // LIMITS.line_max_points)
    # the last of every few rows, which is what the estimate has settled to
    rows = rows.gather_every(step, offset=min(step, rows.height) - 1)
    t = rows["t_ns"].to_numpy()
    mass, std = (convert_series_to_floats(rows[name]) for name in ("mass_kg", "mass_std_kg"))
    # no line between loads, nor across times without accepted samples
    gaps = 1 + np.flatnonzero(np.diff(t) > 1.5 * step * period_ns)
    starts = np.union1d(np.searchsorted(t, load_starts_ns[1:]), gaps)
    mass = np.insert(mass, starts, np.nan)
    std, t_s = np.insert(std, starts, np.nan), np.insert(t / NS_PER_S, starts, np.nan)
    colour = colours.choose_method_colour(method)
    axes.plot(t_s, mass, color=colour, lw=1.0, label=f"{method} ± 2σ")
    axes.fill_between(t_s, mass - 2 * std, mass + 2 * std, color=colour, alpha=0.2, lw=0)
    return [*mass, *(mass - 2 * std)[mass.size // 4 :], *(mass + 2 * std)[mass.size // 4 :]]


def _draw_running_means_of_loads(axes: "Axes", run: Run) -> list[float]:
    """Draw the variance-weighted mean of each load after each of its manoeuvres."""
    frame = run.frames.get("manoeuvres")
    if frame is None:
        return []
    known = frame.filter(pl.col("mass_kg").is_not_null() & (pl.col("mass_std_kg") > 0.0))
    parts: list[Rows] = []
    for _, rows in known.group_by("load_id", maintain_order=True):
        mass, std = (convert_series_to_floats(rows[name]) for name in ("mass_kg", "mass_std_kg"))
        weight = np.cumsum(std**-2.0)
        mean = np.cumsum(mass * std**-2.0) / weight
        at_s = rows["end_t_ns"].to_numpy() / NS_PER_S
        # no line between loads
        parts += [np.array([at_s, mean, 2.0 / np.sqrt(weight)]), np.full((3, 1), np.nan)]
    if not parts:
        return []
    at_s, mean, bars = np.concatenate(parts, axis=1)
    many = known["load_id"].n_unique() > LIMITS.recursion_max_loads
    axes.errorbar(
        *(at_s, mean, bars),
        fmt="o-",
        ms=1.5 if many else 3,
        lw=0.8,
        elinewidth=0.4 if many else 0.8,
        color="#0b3d5c",
        label="mean of the manoeuvres so far ± 2σ",
    )
    return [*(mean - bars), *(mean + bars)]


def draw_intervals_of_answer(axes: "Axes", run: Run) -> list[float]:
    """Draw the answer of each load, and return the ends of the intervals in kg, for the axis."""
    loads = run.frames.get("loads")
    if loads is None:
        return []
    known = loads.drop_nulls(["mass_kg", "u_kg"])
    if not known.height:
        return []
    starts, ends, mass, u = (
        convert_series_to_floats(known[name])
        for name in ("start_t_ns", "end_t_ns", "mass_kg", "u_kg")
    )
    nothing = np.full(mass.size, np.nan)
    # a single artist for all loads, since a shift has hundreds
    t_s = np.column_stack([starts / NS_PER_S, ends / NS_PER_S, nothing]).ravel()
    low, middle, high = (
        np.column_stack([each, each, nothing]).ravel()
        for each in (mass - 2.0 * u, mass, mass + 2.0 * u)
    )
    axes.fill_between(t_s, low, high, color="black", alpha=0.12, lw=0)
    axes.plot(t_s, middle, color="black", lw=1.2, label="the answer ± 2u")
    return [*low, *high]

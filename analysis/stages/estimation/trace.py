"""Run the selected estimators over the accepted windows."""

from collections.abc import Sequence
from dataclasses import replace
from functools import cache
from itertools import pairwise
from typing import Any

import numpy as np
import polars as pl

from analysis.model.axes import (
    Axis,
    list_axes_allowed_by_channels,
    make_regressor_and_force,
    make_trace_columns,
)
from analysis.model.methods import METHODS, AxisNoise, FeedKind, Method
from analysis.model.schema import build_frame
from analysis.model.settings import Settings
from analysis.stages.gating.gate import mark_settled_windows
from analysis.stages.gating.segments import assign_pooled_manoeuvre_numbers_to_samples
from analysis.stages.noise.column_noise import (
    collect_axis_noise,
    estimate_attenuation_errors_of_windows,
    estimate_window_stds_by_column_noise,
)
from estimators.arrays import Floats, Ints
from estimators.estimate import Trace


def trace_estimates(
    excitation: pl.DataFrame,
    gated: pl.DataFrame,
    settings: Settings,
    noise: pl.DataFrame | None = None,
    load_start_rows: Sequence[int] = (),
) -> dict[str, pl.DataFrame]:
    """Estimate from every accepted window with every method of the settings.

    Args:
        excitation: frame with the regressor.
        gated: frame with the accepted windows.
        settings: settings with window, methods and their options.
        noise: noise of the columns, if known.
        load_start_rows: rows at which the load changes, where recursions restart.

    Returns:
        Frames `estimates` by method, accepted rows only; `pooled` has a row per manoeuvre.
    """
    axes_traced = {
        axis: _trace_methods(
            axis,
            excitation,
            gated,
            settings,
            collect_axis_noise(axis, settings, noise),
            load_start_rows,
        )
        for axis in list_axes_allowed_by_channels(excitation)
    }
    t_ns = excitation["t_ns"].to_numpy()
    return {
        method: _make_estimates_frame(
            {axis: traces[method] for axis, traces in axes_traced.items()}, t_ns
        )
        for method in settings.trace.methods
    }


def _trace_methods(
    axis: Axis,
    excitation: pl.DataFrame,
    gated: pl.DataFrame,
    settings: Settings,
    noise: AxisNoise,
    load_start_rows: Sequence[int],
) -> dict[str, Trace]:
    """Trace of each method over one axis, by name of the method."""
    A, f = make_regressor_and_force(axis, excitation, settings)
    window = settings.gate.window_samples

    @cache
    def inputs_for_feed(feed: FeedKind) -> tuple[Any, ...]:
        match feed:
            case FeedKind.WINDOWS:
                return window, gated[f"accepted_{axis.letter}"].to_numpy()
            case FeedKind.SETTLED:
                return window, mark_settled_windows(excitation, gated, settings, axis)
            case FeedKind.SEGMENTS:
                return (
                    assign_pooled_manoeuvre_numbers_to_samples(excitation, gated, settings, axis),
                )

    traces: dict[str, Trace] = {}
    for name in settings.trace.methods:
        method = METHODS[name]
        options = method.options(settings.trace, noise)
        if method.feed is FeedKind.SETTLED and load_start_rows:
            fed_by = (*inputs_for_feed(method.feed), options)
            traced = trace_each_load_separately(method, A, f, fed_by, load_start_rows)
        else:
            traced = method.estimator.estimate_along_log(
                A, f, *inputs_for_feed(method.feed), options
            )
        if method.feed is not FeedKind.SEGMENTS:
            unseen = estimate_attenuation_errors_of_windows(
                method, A, f, traced.index, traced.theta, settings, noise
            )
            std = traced.std
            if method.feed is FeedKind.WINDOWS:
                std = np.maximum(
                    std,
                    estimate_window_stds_by_column_noise(
                        A, f, window, traced.index, traced.theta, noise
                    ),
                )
            traced = replace(traced, std=np.hypot(std, unseen))
        traces[name] = traced
    return traces


def trace_each_load_separately(
    method: Method,
    A: Floats,
    f: Floats,
    window_arguments: tuple[Any, ...],
    load_start_rows: Sequence[int],
) -> Trace:
    """Run a recursive method over each load separately; no window spans a change of load."""
    window, accepted, options = window_arguments
    bounds = [0, *load_start_rows, f.size]
    parts: list[Trace] = []
    for begin, end in pairwise(bounds):
        inside = accepted[begin:end].copy()
        inside[: window - 1] = False
        traced = method.estimator.estimate_along_log(
            A[begin:end], f[begin:end], window, inside, options
        )
        parts.append(replace(traced, index=traced.index + begin))
    fields = ("index", "theta", "std", "residual_rms", "condition")
    joined = {name: np.concatenate([getattr(part, name) for part in parts]) for name in fields}
    longest = max(parts, key=lambda part: part.index.size)
    return replace(longest, **joined)


def _make_estimates_frame(traces: dict[Axis, Trace], t_ns: Ints) -> pl.DataFrame:
    """Frame `estimates` of one method, with the rows of all axes in order of time."""
    parts = [
        pl.DataFrame({"t_ns": t_ns[rows.index], **make_trace_columns(axis, rows)}).with_columns(
            **({"axis": pl.lit(axis.letter, pl.String)} if len(traces) > 1 else {})
        )
        for axis, rows in traces.items()
    ]
    frame = pl.concat(parts, how="diagonal").sort("t_ns", maintain_order=True)
    return build_frame("estimates", frame.to_dict())

"""Estimates of each method: along the log over the accepted windows, and over the whole of it."""

from collections.abc import Collection, Mapping, Sequence
from dataclasses import replace
from functools import cache
from itertools import pairwise
from typing import Any

import numpy as np
import polars as pl

from analysis.model.axes import (
    YAW_COLUMNS,
    Axis,
    X,
    Z,
    list_axes_allowed_by_channels,
    make_parameter_columns,
    make_regressor_and_force,
    make_trace_columns,
    read_parameters_and_stds,
    select_estimate_rows_of_axis,
)
from analysis.model.machine import Machine
from analysis.model.methods import METHODS, AxisNoise, FeedKind, Method, SummaryRule
from analysis.model.schema import build_frame, get_column_values
from analysis.model.settings import Settings
from analysis.model.verdict import Verdict
from analysis.model.windows import find_flagged_runs
from analysis.stages.gating.gate import mark_samples_for_pooling, mark_settled_windows
from analysis.stages.gating.segments import assign_pooled_manoeuvre_numbers_to_samples
from analysis.stages.motion.phases import TURNS
from analysis.stages.noise.column_noise import (
    collect_axis_noise,
    estimate_attenuation_errors_of_windows,
    estimate_window_stds_by_column_noise,
)
from estimators.arrays import Floats, Ints
from estimators.estimate import Trace
from estimators.methods.ls import average_over_windows_with_std


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
    for start, end in pairwise(bounds):
        inside = accepted[start:end].copy()
        inside[: window - 1] = False
        traced = method.estimator.estimate_along_log(
            A[start:end], f[start:end], window, inside, options
        )
        parts.append(replace(traced, index=traced.index + start))
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


def summarise_masses(
    excitation: pl.DataFrame,
    gated: pl.DataFrame,
    estimates: Mapping[str, pl.DataFrame],
    machine: Machine,
    noise: pl.DataFrame | None = None,
) -> pl.DataFrame:
    """Summarise the whole log in the frame `masses`, a row per method; nothing is withheld yet.

    Windowed methods give the weighted mean of their accepted windows, recursive ones their last
    state, `pooled` one fit over every accepted sample.

    Args:
        excitation: frame with the regressors.
        gated: frame with the accepted windows.
        estimates: frame `estimates` of each method.
        machine: machine file with settings and empty mass.
        noise: noise of the columns, if known.
    """
    columns: dict[str, Floats | pl.Series] = {"method": pl.Series(list(estimates), dtype=pl.String)}
    for axis in list_axes_allowed_by_channels(excitation):
        rows: dict[str, pl.DataFrame] = {
            method: select_estimate_rows_of_axis(axis, frame) for method, frame in estimates.items()
        }
        known = collect_axis_noise(axis, machine.settings, noise)
        totals = estimate_whole_log_parameters_and_stds(
            axis, excitation, gated, rows, machine.settings, known
        )
        columns |= make_parameter_columns(axis, *totals)
        suffix = "" if axis is X else "_z"
        columns[f"rows{suffix}"] = pl.Series([frame.height for frame in rows.values()])
        columns[f"withheld{suffix}"] = pl.Series([False] * len(rows))
    empty_kg = machine.machine.empty_mass_kg
    table = build_frame("masses", columns)
    payload = get_column_values(table, "mass_kg") - (np.nan if empty_kg is None else empty_kg)
    return build_frame("masses", {**table.to_dict(), "payload_kg": payload})


def withhold_masses(
    masses: pl.DataFrame, verdict: Verdict, contradicted_methods: Collection[str]
) -> pl.DataFrame:
    """Set the numbers that the verdict withholds to null.

    Args:
        masses: the frame `masses`.
        verdict: the verdict, which may withhold the x axis, the z axis or both.
        contradicted_methods: methods whose mass the log contradicts.
    """
    about_x = {*(name for pair in X.parameters for name in pair), "payload_kg"}
    about_z = {name for pair in Z.parameters for name in pair}
    hidden = (not verdict.can_weigh) | pl.col("method").is_in(list(contradicted_methods))
    columns = [
        *(pl.when(hidden).then(None).otherwise(n).alias(n) for n in about_x if n in masses.columns),
        hidden.alias("withheld"),
    ]
    if "withheld_z" in masses.columns:
        turns = pl.lit(not verdict.can_estimate_inertia)
        columns += [
            *(pl.when(turns).then(None).otherwise(n).alias(n) for n in about_z),
            turns.alias("withheld_z"),
        ]
    return build_frame("masses", masses.with_columns(columns).to_dict())


def fit_parameters_and_stds_to_accepted_samples(
    axis: Axis,
    excitation: pl.DataFrame,
    gated: pl.DataFrame,
    settings: Settings,
    noise: AxisNoise,
    method: Method = METHODS["pooled"],
) -> tuple[Floats, Floats]:
    """Fit every accepted sample of an axis; parameters and standard deviations, (p,) each."""
    A, f = make_regressor_and_force(axis, excitation, settings)
    used = mark_samples_for_pooling(excitation, gated, settings, axis)
    if not used.any():
        return np.full(A.shape[1], np.nan), np.full(A.shape[1], np.nan)
    options = method.options(settings.trace, noise)
    whole = method.estimator.estimate_along_log(A, f, np.where(used, 0, -1), options)
    return whole.theta[0], whole.std[0]


def estimate_whole_log_parameters_and_stds(
    axis: Axis,
    excitation: pl.DataFrame,
    gated: pl.DataFrame,
    estimates: Mapping[str, pl.DataFrame],
    settings: Settings,
    noise: AxisNoise,
) -> tuple[Floats, Floats]:
    """Parameters and stds of the whole log, (methods, p) each; NaN without an estimate."""
    A, f = make_regressor_and_force(axis, excitation, settings)
    t_ns = excitation["t_ns"].to_numpy()
    theta = np.full((len(estimates), A.shape[1]), np.nan)
    std = theta.copy()
    for row, (name, frame) in enumerate(estimates.items()):
        if frame.is_empty():
            continue
        method = METHODS[name]
        match method.summary:
            case SummaryRule.POOL:
                theta[row], std[row] = fit_parameters_and_stds_to_accepted_samples(
                    axis, excitation, gated, settings, noise, method
                )
            case SummaryRule.LAST:
                traced, traced_std = read_parameters_and_stds(axis, frame)
                theta[row], std[row] = traced[-1], traced_std[-1]
            case SummaryRule.MEAN:
                index = np.searchsorted(t_ns, frame["t_ns"].to_numpy()).astype(np.int64)
                windows = read_parameters_and_stds(axis, frame)
                unseen = estimate_attenuation_errors_of_windows(
                    method, A, f, index, windows[0], settings, noise
                )
                theta[row], std[row] = average_over_windows_with_std(
                    A, f, settings.gate.window_samples, index, *windows, unseen
                )
    return theta, std


def list_reasons_for_no_answer(
    excitation: pl.DataFrame, gated: pl.DataFrame, settings: Settings
) -> list[str]:
    """Reasons why an axis of the log has no estimate, a sentence each."""
    found = (
        explain_why_gate_accepted_nothing(excitation, gated, settings),
        explain_why_spins_are_unused(excitation, settings),
    )
    return [sentence for sentence in found if sentence]


def explain_why_spins_are_unused(excitation: pl.DataFrame, settings: Settings) -> str | None:
    """Sentence that names the channels missing for spins, if there are spins; else None."""
    spins = (excitation["phase"] == "spinning").fill_null(False).sum()
    missing = [name for name in YAW_COLUMNS if name not in excitation.columns]
    if spins < settings.gate.window_samples or not missing:
        return None
    remedies = {
        "torque_z_N_m": "channels.torque_z_N_m, or both wheel torques and machine.track_width_m",
        "yaw_acc_rad_s2": 'channels.yaw_acc_rad_s2 (derive = "d/dt yaw_rate_rad_s")',
    }
    wanted = " and ".join(remedies.get(name, f"channels.{name}") for name in missing)
    return f"the log has spins, but the inertia needs {wanted}"


def explain_why_gate_accepted_nothing(
    excitation: pl.DataFrame, gated: pl.DataFrame, settings: Settings
) -> str | None:
    """Sentence that names the obstacle if the gate accepted no window; else None."""
    if gated["accepted_x"].any():
        return None
    window_s = settings.gate.window_samples / settings.align.rate_hz
    rows_s = excitation.height / settings.align.rate_hz
    mean_s = (settings.smooth.samples - 1) / settings.align.rate_hz
    if rows_s < window_s:
        return f"the log lasts {rows_s:.2f} s, a window needs {window_s:.2f} s"
    if excitation.height < settings.gate.window_samples + settings.smooth.samples - 1:
        return (
            f"the log lasts {rows_s:.2f} s, a window needs {window_s:.2f} s and the moving mean "
            f"before it {mean_s:.2f} s"
        )
    phase = excitation["phase"]
    whole = phase.is_not_null()
    stretches = [("a gap", whole), ("a gap or a turn", whole & ~phase.is_in(TURNS))]
    if settings.gate.exclude_braking:
        stretches.append(("braking", whole & (phase != "braking")))
    for what, good in stretches:
        longest_s = count_rows_of_longest_true_run(good.fill_null(False)) / settings.align.rate_hz
        if longest_s < window_s:
            return (
                f"the longest stretch without {what} is {longest_s:.2f} s, "
                f"the window {window_s:.2f} s{_describe_remedy_if_rejected_for_braking(what)}"
            )
    reasons = gated["reason_x"].cast(pl.String)
    counts = reasons.filter(reasons != "warming_up").value_counts(sort=True)
    often = counts["reason_x"][0]
    remedy = _describe_remedy_if_rejected_for_braking(often)
    return f"no window was accepted, most often for: {often}{remedy}"


def _describe_remedy_if_rejected_for_braking(rejection_reason: str) -> str:
    if rejection_reason != "braking":
        return ""
    return "; if the force sensor measures the brakes, set settings.gate.exclude_braking = false"


def count_rows_of_longest_true_run(flags: pl.Series) -> int:
    """Longest run of true values, in rows."""
    first, last = find_flagged_runs(flags.to_numpy())
    lengths = last + 1 - first
    return int(lengths.max()) if lengths.size else 0

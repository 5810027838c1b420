"""Run the chosen estimators over the accepted windows."""

from dataclasses import replace
from typing import NamedTuple

import numpy as np
import polars as pl

from analysis.column_noise import column_noise, systematic
from analysis.gate import settled_windows
from analysis.regressor import Axis, X, axes, regressor, trace_columns
from analysis.schema import build
from analysis.segments import pooled_samples
from analysis.settings import Method, Settings
from estimators import fgls, huber, ls, pooled, rls, rtls, tls
from estimators.estimate import Ints, Trace


class Options(NamedTuple):
    """Of each method that has any."""

    rls: rls.RlsOptions
    fgls: fgls.FglsOptions
    tls: tls.TlsOptions
    rtls: rtls.RtlsOptions
    huber: huber.HuberOptions
    pooled: pooled.PooledOptions


def options_of(axis: Axis, settings: Settings) -> Options:
    """What the settings ask of each method on an axis."""
    noise = tls_noise(axis, settings)
    return Options(
        rls.RlsOptions(settings.trace.forgetting, settings.trace.directional_forgetting),
        fgls.FglsOptions(settings.trace.fgls_floor),
        noise,
        rtls.RtlsOptions(noise, settings.trace.forgetting),
        huber.HuberOptions(settings.trace.huber_bend),
        pooled.PooledOptions(column_noise(axis, settings)),
    )


def trace(
    excitation: pl.DataFrame, gated: pl.DataFrame, settings: Settings
) -> dict[Method, pl.DataFrame]:
    """Estimate from every accepted window with every method of the settings.

    Args:
        excitation: the regressor.
        gated: which windows are accepted.
        settings: window, methods and their options.

    Returns:
        By method: its `estimates` frame, accepted rows only; `pooled` has a row a manoeuvre.
    """
    axes_traced = {axis: _traces(axis, excitation, gated, settings) for axis in axes(excitation)}
    t_ns = excitation["t_ns"].to_numpy()
    return {
        method: _frame({axis: traces[method] for axis, traces in axes_traced.items()}, t_ns)
        for method in settings.trace.methods
    }


def _traces(
    axis: Axis, excitation: pl.DataFrame, gated: pl.DataFrame, settings: Settings
) -> dict[Method, Trace]:
    """Every method over one axis."""
    A, f = regressor(axis, excitation, settings)
    window = settings.gate.window_samples
    accepted = gated[f"accepted_{axis.letter}"].to_numpy()
    settled = settled_windows(excitation, gated, settings, axis)
    options = options_of(axis, settings)
    traces: dict[Method, Trace] = {}
    for method in settings.trace.methods:
        match method:
            case "ls":
                traced = ls.trace(A, f, window, accepted)
            case "rls":
                traced = rls.trace(A, f, window, settled, options.rls)
            case "fgls":
                traced = fgls.trace(A, f, window, accepted, options.fgls)
            case "tls":
                traced = tls.trace(A, f, window, accepted, options.tls)
            case "rtls":
                traced = rtls.trace(A, f, window, settled, options.rtls)
            case "huber":
                traced = huber.trace(A, f, window, accepted, options.huber)
            case "pooled":
                ids = pooled_samples(excitation, gated, settings, axis)
                traced = pooled.trace(A, f, ids, options.pooled)
        if method != "pooled":
            unseen = systematic(axis, method, A, f, traced.index, traced.theta, settings)
            traced = replace(traced, std=np.hypot(traced.std, unseen))
        traces[method] = traced
    return traces


def _frame(traced: dict[Axis, Trace], t_ns: Ints) -> pl.DataFrame:
    """One method's `estimates`: rows of all axes in order of time, each of one axis alone."""
    parts = [
        pl.DataFrame({"t_ns": t_ns[rows.index], **trace_columns(axis, rows)}).with_columns(
            **({"axis": pl.lit(axis.letter, pl.String)} if len(traced) > 1 else {})
        )
        for axis, rows in traced.items()
    ]
    frame = pl.concat(parts, how="diagonal").sort("t_ns", maintain_order=True)
    return build("estimates", frame.to_dict())


def tls_noise(axis: Axis, settings: Settings) -> tls.TlsOptions:
    """What the settings say of the noise of an axis' columns."""
    if axis is X:
        # Coulomb's sign is nearly exact
        return tls.TlsOptions(
            (settings.noise.acc_m_s2, settings.noise.speed_m_s, 1e-3),
            settings.noise.force_N,
        )
    return tls.TlsOptions(
        (settings.noise.yaw_acc_rad_s2, settings.noise.yaw_rate_rad_s),
        settings.noise.torque_z_N_m,
    )

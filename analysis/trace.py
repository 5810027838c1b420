"""Run the chosen estimators over the accepted windows."""

from typing import NamedTuple

import polars as pl

from analysis.regressor import straight, trace_columns
from analysis.schema import build
from analysis.segments import pooled_samples
from analysis.settings import Settings
from estimators import fgls, huber, ls, pooled, rls, rtls, tls
from estimators.trace import Trace


class Options(NamedTuple):
    """Of each method that has any."""

    rls: rls.RlsOptions
    fgls: fgls.FglsOptions
    tls: tls.TlsOptions
    rtls: rtls.RtlsOptions
    huber: huber.HuberOptions


def options_of(settings: Settings) -> Options:
    """What the settings ask of each method."""
    # Coulomb's sign is nearly exact
    noise = tls.TlsOptions(
        (settings.tls_noise_acc_m_s2, settings.tls_noise_speed_m_s, 1e-3),
        settings.tls_noise_force_N,
    )
    return Options(
        rls.RlsOptions(settings.forgetting, settings.directional_forgetting),
        fgls.FglsOptions(settings.fgls_floor),
        noise,
        rtls.RtlsOptions(noise, settings.forgetting),
        huber.HuberOptions(settings.huber_bend),
    )


def trace(
    excitation: pl.DataFrame, gated: pl.DataFrame, settings: Settings
) -> dict[str, pl.DataFrame]:
    """Estimate from every accepted window with every method of the settings.

    Args:
        excitation: the regressor.
        gated: which windows are accepted.
        settings: window, methods and their options.

    Returns:
        By method: its `estimates` frame, accepted rows only; `pooled` has a row a manoeuvre.
    """
    A, f = straight(excitation, settings)
    window = settings.window_samples
    accepted = gated["accepted_x"].to_numpy()
    options = options_of(settings)
    traces: dict[str, Trace] = {}
    for method in settings.methods:
        match method:
            case "ls":
                traced = ls.trace(A, f, window, accepted)
            case "rls":
                traced = rls.trace(A, f, window, accepted, options.rls)
            case "fgls":
                traced = fgls.trace(A, f, window, accepted, options.fgls)
            case "tls":
                traced = tls.trace(A, f, window, accepted, options.tls)
            case "rtls":
                traced = rtls.trace(A, f, window, accepted, options.rtls)
            case "huber":
                traced = huber.trace(A, f, window, accepted, options.huber)
            case "pooled":
                traced = pooled.trace(A, f, pooled_samples(excitation, gated, settings))
        traces[method] = traced
    t_ns = excitation["t_ns"].to_numpy()
    return {
        method: build("estimates", {"t_ns": t_ns[traced.index], **trace_columns(traced)})
        for method, traced in traces.items()
    }

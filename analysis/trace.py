"""Run the chosen estimators over the accepted windows."""

import polars as pl

from analysis.regressor import straight, trace_columns
from analysis.schema import build
from analysis.segments import pooled_samples
from analysis.settings import Settings
from estimators import fgls, huber, ls, pooled, rls, rtls, tls
from estimators.trace import Trace


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
    # Coulomb's sign is nearly exact
    noise = tls.TlsOptions(
        (settings.tls_noise_acc_m_s2, settings.tls_noise_speed_m_s, 1e-3),
        settings.tls_noise_force_N,
    )
    traces: dict[str, Trace] = {}
    for method in settings.methods:
        match method:
            case "ls":
                traced = ls.trace(A, f, window, accepted)
            case "rls":
                memory = rls.RlsOptions(settings.forgetting, settings.directional_forgetting)
                traced = rls.trace(A, f, window, accepted, memory)
            case "fgls":
                traced = fgls.trace(A, f, window, accepted, fgls.FglsOptions(settings.fgls_floor))
            case "tls":
                traced = tls.trace(A, f, window, accepted, noise)
            case "rtls":
                past = rtls.RtlsOptions(noise, settings.forgetting)
                traced = rtls.trace(A, f, window, accepted, past)
            case "huber":
                bend = huber.HuberOptions(settings.huber_bend)
                traced = huber.trace(A, f, window, accepted, bend)
            case "pooled":
                traced = pooled.trace(A, f, pooled_samples(excitation, gated, settings))
        traces[method] = traced
    t_ns = excitation["t_ns"].to_numpy()
    return {
        method: build("estimates", {"t_ns": t_ns[traced.index], **trace_columns(traced)})
        for method, traced in traces.items()
    }

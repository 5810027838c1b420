"""The answer: the mass over the whole log by each method, unless the verdict forbids it."""

from collections.abc import Mapping

import numpy as np
import polars as pl
from numpy.typing import NDArray

from analysis.gate import accepted_samples
from analysis.machine import Machine
from analysis.regressor import straight, theta_columns, theta_of
from analysis.schema import build, values
from analysis.settings import RECURSIVE
from estimators import pooled
from estimators.window_mean import mean_estimate

Floats = NDArray[np.float64]


def masses(
    excitation: pl.DataFrame,
    gated: pl.DataFrame,
    estimates: Mapping[str, pl.DataFrame],
    machine: Machine,
    *,
    weighs: bool,
) -> pl.DataFrame:
    """Summarise the log, a row a method.

    Windowed methods give the weighted mean of their accepted windows, recursive ones their last
    state, `pooled` one fit over every accepted sample.

    Args:
        excitation: the regressor.
        gated: which windows are accepted.
        estimates: `estimates` frames by method.
        machine: settings and empty mass.
        weighs: the verdict; without it every number is withheld.
    """
    settings = machine.settings
    A, f = straight(excitation, settings)
    t_ns = excitation["t_ns"].to_numpy()
    theta = np.full((len(estimates), A.shape[1]), np.nan)
    std = theta.copy()
    for row, (method, frame) in enumerate(estimates.items()):
        if not weighs or frame.is_empty():
            continue
        if method == "pooled":
            used = accepted_samples(excitation, gated, settings)
            whole = pooled.trace(A, f, np.where(used, 0, -1))
            theta[row], std[row] = whole.theta[0], whole.std[0]
        elif method in RECURSIVE:
            traced, traced_std = theta_of(frame)
            theta[row], std[row] = traced[-1], traced_std[-1]
        else:
            index = np.searchsorted(t_ns, frame["t_ns"].to_numpy()).astype(np.int64)
            theta[row], std[row] = mean_estimate(
                A, f, settings.window_samples, index, *theta_of(frame)
            )
    empty_kg = machine.machine.empty_mass_kg
    table = build(
        "masses",
        {
            "method": pl.Series(list(estimates), dtype=pl.String),
            **theta_columns(theta, std),
            "rows": np.array([frame.height for frame in estimates.values()]),
            "withheld": np.full(len(estimates), not weighs),
        },
    )
    payload = values(table, "mass_kg") - (np.nan if empty_kg is None else empty_kg)
    return build("masses", {**table.to_dict(), "payload_kg": payload})

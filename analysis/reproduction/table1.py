"""Table 1: the error of the mass by window length, against the Cramér–Rao bound of the windows.

The motion is solved once, as one period of the steady oscillation under the triangle of (7); each
trial is a window that starts at a random phase of it, with fresh sensor noise, the trailing moving
mean, and no gate. Every method sees the same samples: recursive least squares starts from OLS over
the first 0.2 s of the window and is read at its end.
"""

from collections.abc import Sequence
from typing import Final

import numpy as np
import polars as pl
from numpy.typing import NDArray

from analysis.reproduction import paper
from analysis.reproduction.drive import SteadyDrive, Windows
from analysis.reproduction.intervals import rms_interval
from analysis.simulation.scenario import SimulatedSensors
from estimators import fgls, ls, rls, tls

Floats = NDArray[np.float64]

#: The paper's, and total least squares on raw units.
METHODS: Final = (*paper.METHODS, "tls_raw")
_RLS_START_S: Final = 0.2
#: Samples to hold at once.
_BLOCK: Final = 400_000


def table_1(
    drive: SteadyDrive,
    sensors: SimulatedSensors,
    trials: int,
    *,
    smooth_samples: int = 10,
    windows_s: Sequence[float] = tuple(paper.TABLE_1_KG),
    methods: Sequence[str] = METHODS,
) -> pl.DataFrame:
    """Root mean square errors of the mass over many windows.

    Args:
        drive: the motion.
        sensors: rate, noise of single samples, seed.
        trials: windows of each length.
        smooth_samples: of the trailing moving mean.
        windows_s: lengths.
        methods: of `METHODS`.

    Returns:
        A row a length and method: `window_s`, `method`, `paper_kg` (null where it has none),
        `rmse_kg` with its 95 % interval `rmse_kg_low` and `rmse_kg_high`, `bias_kg` and its
        standard error `bias_std_kg`, `bound_kg` (r.m.s. of the windows' own bounds, from as many
        samples before the mean as the window has), `strict_bound_kg` (with the samples before it
        that its first means hold), `over_bound_1`, `trials` (that gave a mass).
    """
    rows: list[dict[str, object]] = []
    for window_s in windows_s:
        # a length's windows are the same whichever other lengths are asked for
        rng = np.random.default_rng([sensors.seed, round(window_s * 1e3)])
        bound_kg, strict_kg, errors = _trials(
            drive, sensors, window_s, smooth_samples, trials, methods, rng
        )
        printed = paper.by_method(paper.TABLE_1_KG.get(window_s))
        for method, error in errors.items():
            rmse, low, high = rms_interval(error, rng)
            known = error[np.isfinite(error)]
            rows.append(
                {
                    "window_s": window_s,
                    "method": method,
                    "paper_kg": printed.get(method),
                    "rmse_kg": rmse,
                    "rmse_kg_low": low,
                    "rmse_kg_high": high,
                    "bias_kg": float(known.mean()) if known.size else None,
                    "bias_std_kg": float(known.std() / np.sqrt(known.size)) if known.size else None,
                    "bound_kg": bound_kg,
                    "strict_bound_kg": strict_kg,
                    "over_bound_1": rmse / bound_kg,
                    "trials": known.size,
                }
            )
    return pl.DataFrame(rows, schema_overrides={"paper_kg": pl.Float64})


def raw_units(drive: SteadyDrive, sensors: SimulatedSensors, trials: int) -> pl.DataFrame:
    """`table_1` at 2 s and a noise under which total least squares needs scaled columns."""
    noisier = sensors.model_copy(update={"force_noise_N": 150.0, "acc_noise_m_s2": 0.03})
    return table_1(drive, noisier, trials, windows_s=(2.0,), methods=("tls", "tls_raw"))


def _trials(
    drive: SteadyDrive,
    sensors: SimulatedSensors,
    window_s: float,
    smooth_samples: int,
    trials: int,
    methods: Sequence[str],
    rng: np.random.Generator,
) -> tuple[float, float, dict[str, Floats]]:
    """R.m.s. of both bounds, and by method the errors (trials,), block by block."""
    samples = round(window_s * sensors.rate_hz)
    block = max(_BLOCK // samples, 1)
    bounds: list[Floats] = []
    errors: dict[str, list[Floats]] = {method: [] for method in methods}
    for first in range(0, trials, block):
        count = min(block, trials - first)
        seen = drive.windows(sensors, samples, smooth_samples, count, rng)
        bounds.append(np.stack([seen.bound_kg, seen.strict_bound_kg]))
        for method in methods:
            errors[method].append(_masses_kg(method, seen, sensors) - drive.mass_kg)
    bound_kg, strict_kg = np.sqrt((np.concatenate(bounds, axis=1) ** 2).mean(axis=1))
    return float(bound_kg), float(strict_kg), {m: np.concatenate(e) for m, e in errors.items()}


def _masses_kg(method: str, seen: Windows, sensors: SimulatedSensors) -> Floats:
    """The mass of every window, (trials,), NaN where it has none."""
    _, samples, parameters = seen.A.shape
    if method == "rls":
        start = round(_RLS_START_S * sensors.rate_hz)
        all_of_it = np.ones(samples, np.bool_)
        return np.array(
            [
                rls.trace(A, f, start, all_of_it).theta[-1, 0]
                for A, f in zip(seen.A, seen.f, strict=True)
            ]
        )
    A, f = seen.A.reshape(-1, parameters), seen.f.ravel()
    ends = np.zeros(f.size, np.bool_)
    ends[samples - 1 :: samples] = True
    match method:
        case "ls":
            traced = ls.trace(A, f, samples, ends)
        case "fgls":
            traced = fgls.trace(A, f, samples, ends)
        case "tls":
            noise = (sensors.acc_noise_m_s2, sensors.speed_noise_m_s)
            options = tls.TlsOptions(noise, sensors.force_noise_N)
            traced = tls.trace(A, f, samples, ends, options)
        case "tls_raw":
            traced = tls.trace(A, f, samples, ends, tls.TlsOptions((1.0, 1.0), 1.0))
        case _:
            raise ValueError(f"no method '{method}' in Table 1")
    return traced.theta[:, 0]

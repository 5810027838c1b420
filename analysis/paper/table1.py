"""Table 1: the error of the mass by window length, against the Cramér–Rao bound of the windows.

The motion is solved once, as one period of the steady oscillation under the triangle of (7); each
trial is a window that starts at a random phase of it, with fresh sensor noise, the trailing moving
mean, and no gate. Every method sees the same samples: recursive least squares starts from OLS over
the first 0.2 s of the window and is read at its end.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from math import log
from typing import Any, Final

import numpy as np
import polars as pl

from analysis.paper import printed_numbers
from analysis.paper.confidence_intervals import (
    RmsInterval,
    bootstrap_rms_and_interval,
    find_keys_of_lowest_error,
)
from analysis.paper.paper_excitation import MeasuredWindows, SteadyDrive
from analysis.paper.paper_limits import LIMITS
from analysis.paper.simulated_sources import OSCILLATION, Extract, RepetitionResults, SteadyStudy
from analysis.simulation.scenario.scenario import SimulatedSensors
from estimators.arrays import Floats
from estimators.methods import fgls, ls, rls, tls
from estimators.methods.rls import RlsOptions

#: The paper's methods, and total least squares in raw units.
METHODS: Final = (*printed_numbers.METHODS, "tls_raw")
#: Number of standard deviations that a normal error exceeds once in twenty times.
RARE: Final = 1.96
#: Length from which windows separate mass from friction: the paper's response time T.
LONG_S: Final = printed_numbers.RESPONSE_S


@dataclass(frozen=True, eq=False)
class Table1:
    """Table 1, compared with the printed one.

    Attributes:
        frame: frame of `compute_errors_by_window_length` for every length.
        printed_count: number of printed values.
        below_bound: number of printed values below the Cramér–Rao bound.
        improbably_large_count: number of printed values larger than `RARE` times ours.
        best_printed_s: length with the smallest printed error, by method.
        best_s: length with the smallest error of ours, by method.
        long_over_bound_1: smallest and largest error of LS and TLS over the bound, from `LONG_S`.
        long_rms_1: r.m.s. over these lengths of the method further from the bound, with its 95 %
            interval.
        long_reached: whether both reach the bound; None if there are too few windows to decide.
        forgetting_1: λ of RLS.
        memory_half_life_s: half-life of the memory of RLS.
        longest: row of RLS at the longest window.
        raw: row of TLS in raw units at the noise of `compute_errors_in_raw_units`.
        scaled: row of TLS on columns scaled by their noise, at the same noise.
    """

    frame: pl.DataFrame
    printed_count: int
    below_bound: int
    improbably_large_count: int
    best_printed_s: Mapping[str, float]
    best_s: Mapping[str, float]
    long_over_bound_1: tuple[float, float]
    long_rms_1: tuple[float, float, float]
    long_reached: bool | None
    forgetting_1: float
    memory_half_life_s: float
    longest: Mapping[str, Any]
    raw: Mapping[str, Any]
    scaled: Mapping[str, Any]


def make_table_1_mass_errors(extracts: RepetitionResults) -> Table1:
    """Compare the errors of all lengths with the printed ones."""
    table = pl.concat([extracts.get_only_result(extract) for extract in AT_LENGTH.values()])
    beside = table.filter(pl.col("paper_kg").is_not_null())
    ours = {
        str(method): find_keys_of_lowest_error(
            dict(part.select("window_s", "rmse_kg").iter_rows())
        )[0]
        for (method,), part in table.group_by("method", maintain_order=True)
    }
    long = table.filter((pl.col("window_s") >= LONG_S) & pl.col("method").is_in(["ls", "tls"]))
    over_bound = long["over_bound_1"].to_list()
    long_rms = compute_largest_rms_ratio_to_bound(long)
    forgetting = RlsOptions().forgetting
    noisier = {
        row["method"]: row for row in extracts.get_only_result(RAW_UNITS).iter_rows(named=True)
    }
    return Table1(
        frame=table,
        printed_count=beside.height,
        below_bound=beside.filter(pl.col("paper_kg") < pl.col("bound_kg")).height,
        improbably_large_count=beside.filter(pl.col("paper_kg") > RARE * pl.col("rmse_kg")).height,
        best_printed_s={
            method: find_keys_of_lowest_error(
                {at: row[i] for at, row in printed_numbers.TABLE_1_KG.items()}
            )[0]
            for i, method in enumerate(printed_numbers.METHODS)
        },
        best_s=ours,
        long_over_bound_1=(min(over_bound), max(over_bound)),
        long_rms_1=long_rms,
        long_reached=is_cramer_rao_bound_reached(max(over_bound), long_rms),
        forgetting_1=forgetting,
        memory_half_life_s=log(0.5) / log(forgetting) / SimulatedSensors().rate_hz,
        longest=table.filter(pl.col("method") == "rls").sort("window_s").row(-1, named=True),
        raw=noisier["tls_raw"],
        scaled=noisier["tls"],
    )


def compute_largest_rms_ratio_to_bound(long_window_errors: pl.DataFrame) -> RmsInterval:
    """R.m.s. of the errors over their bounds, of the worse method, with its χ² interval."""
    from scipy.stats import chi2

    by_method = long_window_errors.group_by("method", maintain_order=True).agg(
        square=(pl.col("over_bound_1") ** 2).mean(), windows=pl.col("trials").sum()
    )
    square, windows = by_method.sort("square").select("square", "windows").row(-1)
    tail = (1.0 - LIMITS.confidence_1) / 2.0
    low, high = (square * windows / chi2.ppf(share, windows) for share in (1.0 - tail, tail))
    return RmsInterval(square**0.5, float(low) ** 0.5, float(high) ** 0.5)


def is_cramer_rao_bound_reached(
    largest_ratio: float, rms_interval_1: tuple[float, float, float]
) -> bool | None:
    """Whether the bound is reached; None if the interval leaves it open."""
    _, low, high = rms_interval_1
    if low > LIMITS.reached_bound_ratio:
        return False
    return True if max(largest_ratio, high) <= LIMITS.reached_bound_ratio else None


def compute_errors_by_window_length(
    drive: SteadyDrive,
    sensors: SimulatedSensors,
    window_count: int,
    *,
    smooth_samples: int = 10,
    windows_s: Sequence[float] = tuple(printed_numbers.TABLE_1_KG),
    methods: Sequence[str] = METHODS,
) -> pl.DataFrame:
    """Root mean square errors of the mass over many windows.

    Args:
        drive: steady oscillation.
        sensors: sampling rate, noise of single samples, and seed.
        window_count: number of windows of each length.
        smooth_samples: length of the trailing moving mean.
        windows_s: window lengths.
        methods: methods of `METHODS`.

    Returns:
        A row a length and method: `window_s`, `method`, `paper_kg` (null where it has none),
        `rmse_kg` with its 95 % interval `rmse_kg_low` and `rmse_kg_high`, `bias_kg` and its
        standard error `bias_std_kg`, `bound_kg` (r.m.s. of the windows' own bounds, from as many
        samples before the mean as the window has), `strict_bound_kg` (with the samples before it
        that its first means hold), `over_bound_1`, `trials` (that gave a mass).
    """
    rows: list[dict[str, object]] = []
    for window_s in windows_s:
        # the windows of a length do not depend on the other lengths
        rng = np.random.default_rng([sensors.seed, round(window_s * 1e3)])
        bound_kg, strict_kg, errors = compute_cramer_rao_bounds_and_errors_kg(
            drive, sensors, window_s, smooth_samples, window_count, methods, rng
        )
        printed = printed_numbers.pair_table_values_with_methods(
            printed_numbers.TABLE_1_KG.get(window_s)
        )
        for method, error in errors.items():
            rmse, low, high = bootstrap_rms_and_interval(error, rng)
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


def compute_errors_in_raw_units(
    drive: SteadyDrive, sensors: SimulatedSensors, window_count: int
) -> pl.DataFrame:
    """Errors at 2 s with a noise for which total least squares needs scaled columns."""
    noisier = sensors.model_copy(update={"force_noise_N": 150.0, "acc_noise_m_s2": 0.03})
    return compute_errors_by_window_length(
        drive, noisier, window_count, windows_s=(2.0,), methods=("tls", "tls_raw")
    )


def compute_cramer_rao_bounds_and_errors_kg(
    drive: SteadyDrive,
    sensors: SimulatedSensors,
    window_s: float,
    smooth_samples: int,
    window_count: int,
    methods: Sequence[str],
    rng: np.random.Generator,
) -> tuple[float, float, dict[str, Floats]]:
    """R.m.s. of both bounds, and errors (windows,) by method, computed in blocks."""
    samples = round(window_s * sensors.rate_hz)
    block = max(LIMITS.block_samples // samples, 1)
    bounds: list[Floats] = []
    errors: dict[str, list[Floats]] = {method: [] for method in methods}
    for first in range(0, window_count, block):
        count = min(block, window_count - first)
        seen = drive.simulate_noisy_windows(sensors, samples, smooth_samples, count, rng)
        bounds.append(np.stack([seen.bound_kg, seen.strict_bound_kg]))
        for method in methods:
            errors[method].append(estimate_window_masses_kg(method, seen, sensors) - drive.mass_kg)
    bound_kg, strict_kg = np.sqrt((np.concatenate(bounds, axis=1) ** 2).mean(axis=1))
    return float(bound_kg), float(strict_kg), {m: np.concatenate(e) for m, e in errors.items()}


def estimate_window_masses_kg(
    method: str, windows: MeasuredWindows, sensors: SimulatedSensors
) -> Floats:
    """Mass (windows,) of every window, NaN if it has none."""
    _, samples, parameters = windows.A.shape
    if method == "rls":
        start = round(LIMITS.rls_start_s * sensors.rate_hz)
        all_of_it = np.ones(samples, np.bool_)
        return np.array(
            [
                rls.estimate_along_log(A, f, start, all_of_it).theta[-1, 0]
                for A, f in zip(windows.A, windows.f, strict=True)
            ]
        )
    A, f = windows.A.reshape(-1, parameters), windows.f.ravel()
    ends = np.zeros(f.size, np.bool_)
    ends[samples - 1 :: samples] = True
    match method:
        case "ls":
            traced = ls.estimate_along_log(A, f, samples, ends)
        case "fgls":
            traced = fgls.estimate_along_log(A, f, samples, ends)
        case "tls":
            noise = (sensors.acc_noise_m_s2, sensors.speed_noise_m_s)
            options = tls.TlsOptions(noise, sensors.force_noise_N)
            traced = tls.estimate_along_log(A, f, samples, ends, options)
        case "tls_raw":
            traced = tls.estimate_along_log(A, f, samples, ends, tls.TlsOptions((1.0, 1.0), 1.0))
        case _:
            raise ValueError(f"no method '{method}' in Table 1")
    return traced.theta[:, 0]


def _compute_errors_at_length(study: SteadyStudy, window_s: float) -> pl.DataFrame:
    return compute_errors_by_window_length(
        study.drive, study.sensors, study.windows, windows_s=(window_s,)
    )


def _compute_raw_unit_errors_of_study(study: SteadyStudy) -> pl.DataFrame:
    return compute_errors_in_raw_units(study.drive, study.sensors, study.windows)


#: The rows of each length.
AT_LENGTH: Final = {
    window_s: Extract(OSCILLATION, partial(_compute_errors_at_length, window_s=window_s))
    for window_s in printed_numbers.TABLE_1_KG
}
RAW_UNITS: Final = Extract(OSCILLATION, _compute_raw_unit_errors_of_study)

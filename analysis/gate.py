"""The gate: which windows are informative enough to estimate from, with a reason for each."""

import numpy as np
import polars as pl
from numpy.typing import NDArray
from scipy.constants import g as standard_gravity

from analysis.phases import beside_speed_rate, span_rows
from analysis.regressor import straight
from analysis.schema import REASON, build, values
from analysis.settings import Settings
from estimators import information, ls, neighbours

Floats = NDArray[np.float64]
Bools = NDArray[np.bool_]

_TURNS = ("spinning", "arc", "turning")


def gate(excitation: pl.DataFrame, settings: Settings) -> pl.DataFrame:
    """Judge the window of exactly `window_samples` rows that ends at each row.

    A window is refused when it contains a missing sample, a turn or (by setting) braking;
    standstill and cruise may be inside, since the step from standstill to start is the
    information. Then the gate of the settings decides: the index (11), the nearest-neighbour
    mutual information or the predicted deviation.

    Args:
        excitation: the regressor and the phases.
        settings: window, threshold, what is refused.

    Returns:
        `gate`, a row a row of `excitation`.
    """
    window = settings.window_samples
    A, f = straight(excitation, settings)
    n = f.size
    phase = excitation["phase"]
    # a row of unknown phase might be braking, and is in no manoeuvre
    missing = ~(np.isfinite(A).all(axis=1) & np.isfinite(f)) | phase.is_null().to_numpy()
    has_gap = windows_with(missing, window)
    complete = ~has_gap
    complete[: window - 1] = False

    rho, spread = information.window_correlation(A[:, 0].copy(), f, window)
    index = information.information_index(rho)
    condition = np.full(n, np.nan)
    predicted_std = np.full(n, np.nan)
    rows = np.flatnonzero(complete).astype(np.int64)
    if rows.size:
        predicted_std[rows], condition[rows] = ls.predicted_deviation(A, f, window, rows)

    moving = (phase != "standstill").fill_null(True).to_numpy()
    first = int(np.argmin(missing)) if n and not missing.all() else n
    # in the order of precedence: the first that holds is the reason
    refusals: dict[str, Bools] = {
        "warming_up": np.arange(n) < first + window - 1,
        "gap": has_gap,
        "saturated": windows_with(_saturated(excitation, settings), window),
        "turning": windows_with(phase.is_in(_TURNS).fill_null(False).to_numpy(), window),
        "braking": windows_with(_braking(phase, settings), window),
        "standstill": ~windows_with(moving, window),
        "slip": windows_with(_slipping(excitation, settings), window),
        "no_variance": np.isnan(rho),
        "negative_dependence": rho < 0,
    }
    columns = {
        "t_ns": excitation["t_ns"],
        "corr_x_1": np.where(complete & (spread > 0), rho, np.nan),
        "mi_x_nat": np.where(complete, index, np.nan),
        "predicted_std_x": predicted_std,
    }
    match settings.gate:
        case "information":
            poor = index < settings.threshold_nat
        case "variance":
            poor = ~(predicted_std <= settings.threshold_std_kg)
        case "ksg":
            # costly, so only where nothing else refuses the window
            left = np.flatnonzero(~np.any(list(refusals.values()), axis=0)).astype(np.int64)
            ksg = np.full(n, np.nan)
            ksg[left] = neighbours.window_mutual_information(
                A[:, 0].copy(), f, window, left, settings.ksg_neighbours
            )
            columns["ksg_x_nat"] = ksg
            poor = ~(ksg >= settings.threshold_nat)
    refusals["low_information"] = poor
    refusals["ill_conditioned"] = ~(condition <= settings.condition_max)
    reason = np.select(list(refusals.values()), list(refusals), "accepted")
    return build(
        "gate",
        {
            **columns,
            "accepted_x": reason == "accepted",
            "reason_x": pl.Series(reason, dtype=pl.String).cast(REASON),
        },
    )


def windows_with(flag: Bools, window: int) -> Bools:
    """Whether any of the `window` rows that end at each row is flagged (fewer at the start)."""
    count = np.concatenate([[0], np.cumsum(flag)])
    start = np.maximum(np.arange(flag.size) + 1 - window, 0)
    return count[1:] > count[start]


def samples_of(accepted: Bools, window: int) -> Bools:
    """Whether each row lies inside at least one accepted window."""
    # the windows that hold row k end at k … k + window - 1
    return windows_with(accepted[::-1], window)[::-1]


def accepted_samples(excitation: pl.DataFrame, gated: pl.DataFrame, settings: Settings) -> Bools:
    """The samples to pool, (rows,): inside an accepted window, not standing, not yet braking.

    What holds a standing machine is its brakes, which the wheel torques do not show: on a slope
    of 1° standstill alone would cost 150 kg of 3614. And the phase, which looks back, sees braking
    late by up to its span and the moving mean; a window must live with that on board, pooling
    need not.
    """
    used = samples_of(gated["accepted_x"].to_numpy(), settings.window_samples)
    phase = excitation["phase"]
    used &= (phase != "standstill").fill_null(True).to_numpy()
    if settings.exclude_braking:
        lag = span_rows(settings) + settings.smooth_samples
        braking = _braking(phase, settings)
        used &= ~windows_with(braking[::-1], lag)[::-1]
    return used


def _braking(phase: pl.Series, settings: Settings) -> Bools:
    if not settings.exclude_braking:
        return np.zeros(phase.len(), np.bool_)
    return (phase == "braking").fill_null(False).to_numpy()


def _saturated(excitation: pl.DataFrame, settings: Settings) -> Bools:
    if settings.saturation_force_N is None:
        return np.zeros(excitation.height, np.bool_)
    # a mean of clipped samples is the limit but for rounding
    limit = settings.saturation_force_N * (1.0 - 1e-9)
    return np.abs(values(excitation, "force_x_N")) >= limit


def _slipping(excitation: pl.DataFrame, settings: Settings) -> Bools:
    """Wheels that gain or lose speed otherwise than the accelerometer says.

    Gravity is taken out of the accelerometer where the pitch is known; on a slope without it, its
    share counts as disagreement. Without an accelerometer nothing slips.
    """
    if settings.slip_acc_m_s2 is None:
        return np.zeros(excitation.height, np.bool_)
    machine = values(excitation, "specific_force_x_m_s2")
    if "pitch_rad" in excitation.columns:
        # what local gravity differs from the standard's is far below any slip
        machine = machine - standard_gravity * np.sin(values(excitation, "pitch_rad"))
    wheels = values(excitation, "speed_rate_x_m_s2")
    return np.abs(wheels - beside_speed_rate(machine, settings)) > settings.slip_acc_m_s2

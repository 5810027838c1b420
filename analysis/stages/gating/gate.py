"""The gate: accept or reject each window by its information, with a reason."""

import numpy as np
import polars as pl

from analysis.model.axes import Axis, X, list_axes_allowed_by_channels, make_regressor_and_force
from analysis.model.schema import PHASE, REASON, build_frame, get_column_values
from analysis.model.settings import Settings
from analysis.model.windows import flag_windows_with_flagged_rows, mark_samples_in_accepted_windows
from analysis.stages.gating.gate_rules import (
    UNKNOWN,
    Codes,
    decide_window_acceptance,
    flag_rows_that_exclude_windows_by_reason,
    mark_braking_rows,
)
from analysis.stages.motion.phases import (
    average_acceleration_over_rate_span,
    compute_sign_of_yaw_rate_change,
    count_rows_in_speed_rate_span,
)
from analysis.stages.noise.column_noise import collect_axis_noise
from estimators.arrays import Bools, Floats, Ints
from estimators.methods import ls
from estimators.numerics import nearest_neighbours

#: Standard gravity, in m/s² (ISO 80000-3).
_STANDARD_GRAVITY_M_S2 = 9.80665


def gate_windows(
    excitation: pl.DataFrame, settings: Settings, noise: pl.DataFrame | None = None
) -> pl.DataFrame:
    """Judge the window of exactly `window_samples` rows that ends at each row, axis by axis.

    A window is rejected if it contains a missing sample, another motion than its axis is about (a
    turn for x, any travel for z) or, if so set, braking. Standstill and cruise may be inside, since
    the step from standstill to start is the information. The gate of the settings then decides by
    the index (11), the nearest-neighbour mutual information or the predicted deviation.

    Args:
        excitation: frame with the regressors and phases.
        settings: settings with window, thresholds and rejections.
        noise: noise of the columns; without it only that of the settings counts.

    Returns:
        `gate`: a row per row of `excitation`; columns of the z axis if the channels allow it.
    """
    columns: dict[str, Floats | pl.Series] = {"t_ns": excitation["t_ns"]}
    for axis in list_axes_allowed_by_channels(excitation):
        columns |= _make_gate_columns(axis, excitation, settings, noise)
    return build_frame("gate", columns)


def _make_gate_columns(
    axis: Axis, excitation: pl.DataFrame, settings: Settings, noise: pl.DataFrame | None
) -> dict[str, Floats | pl.Series]:
    """Columns of `gate` for one axis."""
    window, letter = settings.gate.window_samples, axis.letter
    A, f = make_regressor_and_force(axis, excitation, settings)
    n = f.size
    phase = encode_motion_phases_as_codes(excitation)
    # a row of unknown phase might be braking, and is in no manoeuvre
    missing = ~(np.isfinite(A).all(axis=1) & np.isfinite(f)) | (phase == UNKNOWN)
    complete = ~flag_windows_with_flagged_rows(missing, window)
    complete[: window - 1] = False
    rows = np.flatnonzero(complete).astype(np.int64)
    seen = ls.WindowStatistics(*(np.full(n, np.nan) for _ in ls.WindowStatistics._fields))
    known = collect_axis_noise(axis, settings, noise).moving_mean_covariance
    for whole, part in zip(
        seen, ls.compute_window_statistics(A, f, window, rows, known), strict=True
    ):
        whole[rows] = part

    first = int(np.argmin(missing)) if n and not missing.all() else n
    slips = mark_slipping_samples(
        get_column_values(excitation, "speed_rate_x_m_s2"),
        _compute_forward_acceleration_m_s2(excitation),
        settings,
    )
    brakes = mark_deceleration(axis, excitation, settings)
    flags = {
        "gap": missing,
        **flag_rows_that_exclude_windows_by_reason(axis, phase, f, brakes, slips, settings.gate),
    }

    def estimate_ksg_mutual_information(window_ends: Ints) -> Floats:
        return nearest_neighbours.estimate_window_mutual_information(
            A[:, 0].copy(), f, window, window_ends, settings.gate.ksg_neighbours
        )

    decided = decide_window_acceptance(
        axis,
        seen,
        np.arange(n) < first + window - 1,
        {why: flag_windows_with_flagged_rows(flag, window) for why, flag in flags.items()},
        estimate_ksg_mutual_information,
        settings.gate,
    )
    columns: dict[str, Floats | pl.Series] = {
        f"corr_{letter}_1": decided.corr,
        f"mi_{letter}_nat": decided.mi_nat,
        f"predicted_std_{letter}": decided.predicted_std,
        f"noise_share_{letter}_1": decided.noise_share,
    }
    if decided.ksg_nat is not None:
        columns[f"ksg_{letter}_nat"] = decided.ksg_nat
    reason = pl.Series(decided.reasons, dtype=REASON).gather(decided.chosen)
    return {**columns, f"accepted_{letter}": reason == "accepted", f"reason_{letter}": reason}


def encode_motion_phases_as_codes(excitation: pl.DataFrame) -> Codes:
    """Indices of the phases in `PHASES`, (rows,)."""
    codes = excitation["phase"].cast(PHASE).to_physical().cast(pl.UInt8)
    return (codes.fill_null(UNKNOWN) if codes.null_count() else codes).to_numpy()


def mark_samples_for_pooling(
    excitation: pl.DataFrame, gated: pl.DataFrame, settings: Settings, axis: Axis = X
) -> Bools:
    """Flags of samples to pool, (rows,): in an accepted window, and not standing or about to brake.

    A standing machine is held by its brakes, which wheel torques do not show: on a slope of 1°
    standstill alone would cost 150 kg of 3614. The phase detects braking late by up to its span and
    the moving mean; windows must accept that on board, pooling need not.
    """
    used = mark_samples_in_accepted_windows(
        gated[f"accepted_{axis.letter}"].to_numpy(), settings.gate.window_samples
    )
    used &= (excitation["phase"] != "standstill").fill_null(True).to_numpy()
    return used & ~mark_possible_braking(
        mark_excluded_braking(axis, excitation, settings), settings
    )


def reject_windows_with_excluded_rows(
    gated: pl.DataFrame, excluded_rows: Bools, rejection_reason: str, settings: Settings
) -> pl.DataFrame:
    """The gate, with accepted straight windows that contain one of these rows rejected.

    Args:
        gated: frame with the accepted windows.
        excluded_rows: (rows,) flags of the rows.
        rejection_reason: the reason.
        settings: settings with the window.
    """
    held = pl.Series(flag_windows_with_flagged_rows(excluded_rows, settings.gate.window_samples))
    accepted = pl.col("accepted_x")
    reason = (
        pl.when(held & accepted)
        .then(pl.lit(rejection_reason))
        .otherwise(pl.col("reason_x").cast(pl.String))
    )
    return gated.with_columns(accepted_x=accepted & ~held, reason_x=reason.cast(REASON))


def mark_settled_windows(
    excitation: pl.DataFrame, gated: pl.DataFrame, settings: Settings, axis: Axis = X
) -> Bools:
    """Flags of accepted windows without braking soon after, (rows,), which recursions are fed.

    A recursion keeps its last samples: the 0.2 s of braking that the phase detects late would cost
    it 17 kg of 3614. On board its estimate is delayed by that much.
    """
    accepted = gated[f"accepted_{axis.letter}"].to_numpy()
    return accepted & ~mark_possible_braking(
        mark_excluded_braking(axis, excitation, settings), settings
    )


def mark_possible_braking(is_braking: Bools, settings: Settings) -> Bools:
    """Flags of braking samples and those before that may brake undetected, (rows,)."""
    return flag_windows_with_flagged_rows(
        is_braking[::-1], count_rows_in_speed_rate_span(settings) + settings.smooth.samples
    )[::-1]


def mark_excluded_braking(axis: Axis, excitation: pl.DataFrame, settings: Settings) -> Bools:
    """Flags of the braking samples, (rows,); none if braking is not excluded."""
    if not settings.gate.exclude_braking:
        return np.zeros(excitation.height, np.bool_)
    return mark_deceleration(axis, excitation, settings)


def mark_deceleration(axis: Axis, excitation: pl.DataFrame, settings: Settings) -> Bools:
    """Whether speed, or yaw rate, decreases at each sample, (rows,), with or without brakes."""
    if axis is X:
        return mark_braking_rows(encode_motion_phases_as_codes(excitation))
    return (
        compute_sign_of_yaw_rate_change(get_column_values(excitation, "yaw_rate_rad_s"), settings)
        < 0
    )


def _compute_forward_acceleration_m_s2(excitation: pl.DataFrame) -> Floats:
    pitch = (
        get_column_values(excitation, "pitch_rad") if "pitch_rad" in excitation.columns else None
    )
    return subtract_gravity(get_column_values(excitation, "specific_force_x_m_s2"), pitch)


def subtract_gravity(specific_force: Floats, pitch: Floats | None) -> Floats:
    """Accelerometer without gravity if the pitch is known, (rows,) in m/s².

    On a slope without a pitch, gravity counts as disagreement with the wheels.
    """
    if pitch is None:
        return specific_force
    # what local gravity differs from the standard's is far below any slip
    return specific_force - _STANDARD_GRAVITY_M_S2 * np.sin(pitch)


def mark_slipping_samples(speed_rate: Floats, acceleration: Floats, settings: Settings) -> Bools:
    """Whether the wheels' acceleration differs from the accelerometer's, (rows,).

    Without an accelerometer no sample slips.

    Args:
        speed_rate: (rows,) acceleration of the wheels, in m/s².
        acceleration: (rows,) acceleration of the machine in m/s², preceded by the rows of one span.
        settings: settings with the limit of the difference, and the span.
    """
    limit = settings.gate.slip_acc_m_s2
    if limit is None:
        return np.zeros(speed_rate.size, np.bool_)
    mean = average_acceleration_over_rate_span(acceleration, settings)[-speed_rate.size :]
    return np.abs(speed_rate - mean) > limit

"""The gate: which windows are informative enough to estimate from, with a reason for each."""

import numpy as np
import polars as pl

from analysis.model.axes import Axis, X, available_axes, regressor
from analysis.model.schema import PHASE, REASON, build, values
from analysis.model.settings import Settings
from analysis.model.windows import flagged_windows, samples_in_windows
from analysis.stages.gating.gate_rules import UNKNOWN, Codes, decide_windows, flag_rows, is_braking
from analysis.stages.motion.phases import (
    average_like_speed_rate,
    speed_rate_span_rows,
    yaw_speeding_sign,
)
from analysis.stages.noise.column_noise import axis_noise
from estimators.arrays import Bools, Floats, Ints
from estimators.methods import ls
from estimators.numerics import nearest_neighbours

#: Standard gravity, in m/s² (ISO 80000-3).
_STANDARD_GRAVITY_M_S2 = 9.80665


def gate(
    excitation: pl.DataFrame, settings: Settings, noise: pl.DataFrame | None = None
) -> pl.DataFrame:
    """Judge the window of exactly `window_samples` rows that ends at each row, axis by axis.

    A window is refused when it contains a missing sample, another motion than its axis is about (a
    turn for x, any travel for z) or, by setting, braking; standstill may be inside, and cruise,
    since the step from standstill to start is the information. Then the gate of the settings
    decides: the index (11), the nearest-neighbour mutual information or the predicted deviation.

    Args:
        excitation: the regressors and the phases.
        settings: window, threshold, what is refused.
        noise: of the columns; without it, nothing is refused for noise but by the settings'.

    Returns:
        `gate`, a row a row of `excitation`; columns of the z axis where the channels allow it.
    """
    columns: dict[str, Floats | pl.Series] = {"t_ns": excitation["t_ns"]}
    for axis in available_axes(excitation):
        columns |= _judge_axis(axis, excitation, settings, noise)
    return build("gate", columns)


def _judge_axis(
    axis: Axis, excitation: pl.DataFrame, settings: Settings, noise: pl.DataFrame | None
) -> dict[str, Floats | pl.Series]:
    """The columns of one axis."""
    window, letter = settings.gate.window_samples, axis.letter
    A, f = regressor(axis, excitation, settings)
    n = f.size
    phase = phase_codes(excitation)
    # a row of unknown phase might be braking, and is in no manoeuvre
    missing = ~(np.isfinite(A).all(axis=1) & np.isfinite(f)) | (phase == UNKNOWN)
    complete = ~flagged_windows(missing, window)
    complete[: window - 1] = False
    rows = np.flatnonzero(complete).astype(np.int64)
    seen = ls.WindowStatistics(*(np.full(n, np.nan) for _ in ls.WindowStatistics._fields))
    known = axis_noise(axis, settings, noise).mean
    for whole, part in zip(seen, ls.window_statistics(A, f, window, rows, known), strict=True):
        whole[rows] = part

    first = int(np.argmin(missing)) if n and not missing.all() else n
    slips = find_slipping_samples(
        values(excitation, "speed_rate_x_m_s2"), _machine_acceleration(excitation), settings
    )
    brakes = _brakes_on_axis(axis, excitation, settings)
    flags = {"gap": missing, **flag_rows(axis, phase, f, brakes, slips, settings.gate)}

    def nearest(left: Ints) -> Floats:
        return nearest_neighbours.window_mutual_information(
            A[:, 0].copy(), f, window, left, settings.gate.ksg_neighbours
        )

    decided = decide_windows(
        axis,
        seen,
        np.arange(n) < first + window - 1,
        {why: flagged_windows(flag, window) for why, flag in flags.items()},
        nearest,
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
    return {
        **columns,
        f"accepted_{letter}": reason == "accepted",
        f"reason_{letter}": reason,
    }


def phase_codes(excitation: pl.DataFrame) -> Codes:
    """The phases as their places in `PHASES`, (rows,)."""
    codes = excitation["phase"].cast(PHASE).to_physical().cast(pl.UInt8)
    return (codes.fill_null(UNKNOWN) if codes.null_count() else codes).to_numpy()


def accepted_samples(
    excitation: pl.DataFrame, gated: pl.DataFrame, settings: Settings, axis: Axis = X
) -> Bools:
    """The samples to pool, (rows,): inside an accepted window, not standing, not yet braking.

    What holds a standing machine is its brakes, which the wheel torques do not show: on a slope
    of 1° standstill alone would cost 150 kg of 3614. And the phase, which looks back, sees braking
    late by up to its span and the moving mean; a window must live with that on board, pooling
    need not.
    """
    used = samples_in_windows(
        gated[f"accepted_{axis.letter}"].to_numpy(), settings.gate.window_samples
    )
    used &= (excitation["phase"] != "standstill").fill_null(True).to_numpy()
    return used & ~braking_within_sight(excluded_braking(axis, excitation, settings), settings)


def refuse_windows(gated: pl.DataFrame, rows: Bools, why: str, settings: Settings) -> pl.DataFrame:
    """The gate with the accepted windows of straight motion refused that hold one of these rows.

    Args:
        gated: which windows are accepted.
        rows: (rows,) flags.
        why: the reason.
        settings: the window.
    """
    held = pl.Series(flagged_windows(rows, settings.gate.window_samples))
    accepted = pl.col("accepted_x")
    reason = (
        pl.when(held & accepted).then(pl.lit(why)).otherwise(pl.col("reason_x").cast(pl.String))
    )
    return gated.with_columns(accepted_x=accepted & ~held, reason_x=reason.cast(REASON))


def settled_windows(
    excitation: pl.DataFrame, gated: pl.DataFrame, settings: Settings, axis: Axis = X
) -> Bools:
    """The accepted windows that no braking follows within sight, (rows,): what a recursion is fed.

    Unlike a window, a recursion keeps what it was fed last: the 0.2 s of braking that the phase
    sees late would cost it 17 kg of 3614. On board its estimate comes that much later.
    """
    accepted = gated[f"accepted_{axis.letter}"].to_numpy()
    return accepted & ~braking_within_sight(excluded_braking(axis, excitation, settings), settings)


def braking_within_sight(braking: Bools, settings: Settings) -> Bools:
    """The samples that brake, and those before them that may brake unseen."""
    return flagged_windows(braking[::-1], speed_rate_span_rows(settings) + settings.smooth.samples)[
        ::-1
    ]


def excluded_braking(axis: Axis, excitation: pl.DataFrame, settings: Settings) -> Bools:
    """The samples that brake, where braking is excluded."""
    if not settings.gate.exclude_braking:
        return np.zeros(excitation.height, np.bool_)
    return _brakes_on_axis(axis, excitation, settings)


def _brakes_on_axis(axis: Axis, excitation: pl.DataFrame, settings: Settings) -> Bools:
    if axis is X:
        return is_braking(phase_codes(excitation))
    return yaw_speeding_sign(values(excitation, "yaw_rate_rad_s"), settings) < 0


def _machine_acceleration(excitation: pl.DataFrame) -> Floats:
    pitch = values(excitation, "pitch_rad") if "pitch_rad" in excitation.columns else None
    return subtract_gravity(values(excitation, "specific_force_x_m_s2"), pitch)


def subtract_gravity(specific_force: Floats, pitch: Floats | None) -> Floats:
    """The accelerometer without gravity where the pitch is known, (rows,) in m/s².

    On a slope without it, gravity's share counts as disagreement with the wheels.
    """
    if pitch is None:
        return specific_force
    # what local gravity differs from the standard's is far below any slip
    return specific_force - _STANDARD_GRAVITY_M_S2 * np.sin(pitch)


def find_slipping_samples(speed_rate: Floats, acceleration: Floats, settings: Settings) -> Bools:
    """Whether wheels gain or lose speed otherwise than the accelerometer says, (rows,).

    Without an accelerometer nothing slips.

    Args:
        speed_rate: (rows,) of the wheels, in m/s².
        acceleration: (rows,) of the machine, in m/s², with the rows of the span before.
        settings: the disagreement that counts, and the span.
    """
    limit = settings.gate.slip_acc_m_s2
    if limit is None:
        return np.zeros(speed_rate.size, np.bool_)
    mean = average_like_speed_rate(acceleration, settings)[-speed_rate.size :]
    return np.abs(speed_rate - mean) > limit

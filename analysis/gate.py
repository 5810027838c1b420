"""The gate: which windows are informative enough to estimate from, with a reason for each."""

import numpy as np
import polars as pl
from numpy.typing import NDArray
from scipy.constants import g as standard_gravity

from analysis.labels import first_that_holds
from analysis.phases import TURNS, beside_speed_rate, span_rows, yaw_pace
from analysis.regressor import Axis, X, axes, regressor
from analysis.schema import REASON, build, values
from analysis.settings import Settings
from analysis.windows import samples_of, windows_with
from estimators import information, ls, neighbours

Floats = NDArray[np.float64]
Bools = NDArray[np.bool_]

#: What a window of the z axis may hold: in place the machine spins or stands.
_IN_PLACE = ("spinning", "standstill")


def gate(excitation: pl.DataFrame, settings: Settings) -> pl.DataFrame:
    """Judge the window of exactly `window_samples` rows that ends at each row, axis by axis.

    A window is refused when it contains a missing sample, another motion than its axis is about (a
    turn for x, any travel for z) or, by setting, braking; standstill may be inside, and cruise,
    since the step from standstill to start is the information. Then the gate of the settings
    decides: the index (11), the nearest-neighbour mutual information or the predicted deviation.

    Args:
        excitation: the regressors and the phases.
        settings: window, threshold, what is refused.

    Returns:
        `gate`, a row a row of `excitation`; columns of the z axis where the channels allow it.
    """
    columns: dict[str, Floats | pl.Series] = {"t_ns": excitation["t_ns"]}
    for axis in axes(excitation):
        columns |= _judged(axis, excitation, settings)
    return build("gate", columns)


def _judged(
    axis: Axis, excitation: pl.DataFrame, settings: Settings
) -> dict[str, Floats | pl.Series]:
    """The columns of one axis."""
    window, letter = settings.gate.window_samples, axis.letter
    A, f = regressor(axis, excitation, settings)
    n = f.size
    phase = excitation["phase"]
    # a row of unknown phase might be braking, and is in no manoeuvre
    missing = ~(np.isfinite(A).all(axis=1) & np.isfinite(f)) | phase.is_null().to_numpy()
    has_gap = windows_with(missing, window)
    complete = ~has_gap
    complete[: window - 1] = False

    rows = np.flatnonzero(complete).astype(np.int64)
    rho, spread, predicted_std, condition = (
        np.full(n, np.nan) for _ in ls.WindowStatistics._fields
    )
    seen = ls.window_statistics(A, f, window, rows)
    rho[rows], spread[rows], predicted_std[rows], condition[rows] = seen
    index = information.information_index(rho)

    first = int(np.argmin(missing)) if n and not missing.all() else n
    # in the order of precedence: the first that holds is the reason
    refusals: dict[str | None, Bools] = {
        "warming_up": np.arange(n) < first + window - 1,
        "gap": has_gap,
        **_refusals(axis, excitation, settings),
        "no_variance": np.isnan(rho),
        "negative_dependence": rho < 0,
    }
    columns: dict[str, Floats | pl.Series] = {
        f"corr_{letter}_1": np.where(complete & (spread > 0), rho, np.nan),
        f"mi_{letter}_nat": np.where(complete, index, np.nan),
        f"predicted_std_{letter}": predicted_std,
    }
    match settings.gate.index:
        case "information":
            poor = index < settings.gate.threshold_nat
        case "variance":
            x, z = settings.gate.threshold_std_kg, settings.gate.threshold_std_kg_m2
            poor = ~(predicted_std <= (x if axis is X else z))
        case "ksg":
            # costly, so only where nothing else refuses the window
            left = np.flatnonzero(~np.any(list(refusals.values()), axis=0)).astype(np.int64)
            ksg = np.full(n, np.nan)
            ksg[left] = neighbours.window_mutual_information(
                A[:, 0].copy(), f, window, left, settings.gate.ksg_neighbours
            )
            columns[f"ksg_{letter}_nat"] = ksg
            poor = ~(ksg >= settings.gate.threshold_nat)
    refusals["low_information"] = poor
    refusals["ill_conditioned"] = ~(condition <= settings.gate.condition_max)
    reason = first_that_holds(refusals, "accepted", REASON)
    return {
        **columns,
        f"accepted_{letter}": reason == "accepted",
        f"reason_{letter}": reason,
    }


def _refusals(axis: Axis, excitation: pl.DataFrame, settings: Settings) -> dict[str, Bools]:
    """What the motion in a window refuses it for, in the order of precedence."""
    window, phase = settings.gate.window_samples, excitation["phase"]
    moving = (phase != "standstill").fill_null(True).to_numpy()
    stands = ~windows_with(moving, window)
    braking = windows_with(_braking(axis, excitation, settings), window)
    if axis is X:
        clipped = _saturated(values(excitation, "force_x_N"), settings.gate.saturation_force_N)
        return {
            "saturated": windows_with(clipped, window),
            "turning": windows_with(phase.is_in(TURNS).fill_null(False).to_numpy(), window),
            "braking": braking,
            "standstill": stands,
            "slip": windows_with(_slipping(excitation, settings), window),
        }
    clipped = _saturated(values(excitation, "torque_z_N_m"), settings.gate.saturation_torque_z_N_m)
    travels = ~phase.is_in(_IN_PLACE).fill_null(True).to_numpy()
    return {
        "saturated": windows_with(clipped, window),
        "translating": windows_with(travels, window),
        "braking": braking,
        "standstill": stands,
    }


def accepted_samples(
    excitation: pl.DataFrame, gated: pl.DataFrame, settings: Settings, axis: Axis = X
) -> Bools:
    """The samples to pool, (rows,): inside an accepted window, not standing, not yet braking.

    What holds a standing machine is its brakes, which the wheel torques do not show: on a slope
    of 1° standstill alone would cost 150 kg of 3614. And the phase, which looks back, sees braking
    late by up to its span and the moving mean; a window must live with that on board, pooling
    need not.
    """
    used = samples_of(gated[f"accepted_{axis.letter}"].to_numpy(), settings.gate.window_samples)
    used &= (excitation["phase"] != "standstill").fill_null(True).to_numpy()
    return used & ~braking_within_sight(_braking(axis, excitation, settings), settings)


def settled_windows(
    excitation: pl.DataFrame, gated: pl.DataFrame, settings: Settings, axis: Axis = X
) -> Bools:
    """The accepted windows that no braking follows within sight, (rows,): what a recursion is fed.

    Unlike a window, a recursion keeps what it was fed last: the 0.2 s of braking that the phase
    sees late would cost it 17 kg of 3614. On board its estimate comes that much later.
    """
    accepted = gated[f"accepted_{axis.letter}"].to_numpy()
    return accepted & ~braking_within_sight(_braking(axis, excitation, settings), settings)


def braking_within_sight(braking: Bools, settings: Settings) -> Bools:
    """The samples that brake, and those before them that may brake unseen."""
    return windows_with(braking[::-1], span_rows(settings) + settings.smooth.samples)[::-1]


def _braking(axis: Axis, excitation: pl.DataFrame, settings: Settings) -> Bools:
    if not settings.gate.exclude_braking:
        return np.zeros(excitation.height, np.bool_)
    if axis is X:
        return (excitation["phase"] == "braking").fill_null(False).to_numpy()
    return yaw_pace(values(excitation, "yaw_rate_rad_s"), settings) < 0


def _saturated(force: Floats, limit: float | None) -> Bools:
    if limit is None:
        return np.zeros(force.size, np.bool_)
    # a mean of clipped samples is the limit but for rounding
    return np.abs(force) >= limit * (1.0 - 1e-9)


def _slipping(excitation: pl.DataFrame, settings: Settings) -> Bools:
    """Wheels that gain or lose speed otherwise than the accelerometer says.

    Gravity is taken out of the accelerometer where the pitch is known; on a slope without it, its
    share counts as disagreement. Without an accelerometer nothing slips.
    """
    if settings.gate.slip_acc_m_s2 is None:
        return np.zeros(excitation.height, np.bool_)
    machine = values(excitation, "specific_force_x_m_s2")
    if "pitch_rad" in excitation.columns:
        # what local gravity differs from the standard's is far below any slip
        machine = machine - standard_gravity * np.sin(values(excitation, "pitch_rad"))
    wheels = values(excitation, "speed_rate_x_m_s2")
    return np.abs(wheels - beside_speed_rate(machine, settings)) > settings.gate.slip_acc_m_s2

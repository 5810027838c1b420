"""Rules of the gate, shared by the windows of a log and the current window on board.

Everything is an array over windows or rows; on board, an array of one.
"""

from collections.abc import Callable, Mapping
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from analysis.model.axes import Axis, X
from analysis.model.schema import PHASES
from analysis.model.settings import GateSettings
from analysis.stages.motion.phases import TURNS, find_first_true_condition
from estimators.arrays import Bools, Floats, Ints
from estimators.methods.ls import WindowStatistics
from estimators.numerics.mutual_information import (
    correlation_to_gaussian_information,
    correlation_to_information_index,
)

Codes = NDArray[np.uint8]

#: The code of an unknown phase; the code of any other is its index in `PHASES`.
UNKNOWN: Final = 255
_BRAKING, _STANDSTILL = PHASES.index("braking"), PHASES.index("standstill")


def make_phase_code_mask(*phases: str) -> Bools:
    """Mask (256,) that is True at the codes of the given phases."""
    found = np.zeros(256, np.bool_)
    found[[PHASES.index(name) for name in phases]] = True
    return found


_TURNING: Final = make_phase_code_mask(*TURNS)
#: Phases that a window of the z axis may contain: those in which the machine does not travel.
_IN_PLACE: Final = make_phase_code_mask("spinning", "standstill")


class GateDecision(NamedTuple):
    """Decision of the gate on windows, (windows,) each; NaN for missing numbers.

    Attributes:
        corr: correlation of acceleration and force.
        mi_nat: the index (11).
        predicted_std: predicted standard deviation of mass or inertia.
        noise_share: fraction of noise in the part that only the acceleration explains.
        ksg_nat: nearest-neighbour mutual information; None unless it decides.
        reasons: possible reasons in order of precedence.
        chosen: index in `reasons` for each window.
    """

    corr: Floats
    mi_nat: Floats
    predicted_std: Floats
    noise_share: Floats
    ksg_nat: Floats | None
    reasons: tuple[str, ...]
    chosen: Codes


def flag_rows_that_exclude_windows_by_reason(
    axis: Axis,
    phase: Codes,
    force: Floats,
    is_braking: Bools,
    is_slipping: Bools,
    settings: GateSettings,
) -> dict[str, Bools]:
    """Flags of rows that exclude a window, by reason in order of precedence.

    Args:
        axis: straight motion or spins.
        phase: (rows,) codes of the phase.
        force: (rows,) force or yaw torque.
        is_braking: (rows,) whether travel or spin slows down.
        is_slipping: (rows,) whether the wheels slip.
        settings: settings of the gate, which say what excludes a window.

    Returns:
        Flags (rows,) by reason. `standstill` flags the rows in motion: a window without any has
        this reason.
    """
    limit = settings.saturation_force_N if axis is X else settings.saturation_torque_z_N_m
    # the mean of clipped samples equals the limit except for rounding
    clipped = np.abs(force) >= (np.inf if limit is None else limit * (1.0 - 1e-9))
    braking = is_braking if settings.exclude_braking else np.zeros_like(is_braking)
    moving = phase != _STANDSTILL
    if axis is X:
        turning = _TURNING[phase]
        return {
            "saturated": clipped,
            "turning": turning,
            "braking": braking,
            "standstill": moving,
            "slip": is_slipping,
        }
    travels = ~_IN_PLACE[phase]
    return {"saturated": clipped, "translating": travels, "braking": braking, "standstill": moving}


def mark_braking_rows(phase: Codes) -> Bools:
    """Flags of the rows with the phase braking, (rows,)."""
    return phase == _BRAKING


def decide_window_acceptance(
    axis: Axis,
    statistics: WindowStatistics,
    is_warming_up: Bools,
    holds_row_by_reason: Mapping[str, Bools],
    estimate_ksg_mutual_information: Callable[[Ints], Floats],
    settings: GateSettings,
) -> GateDecision:
    """Accept or reject each window, with the reason.

    Args:
        axis: straight motion or spins.
        statistics: statistics of each window, NaN for a window with a missing sample.
        is_warming_up: (windows,) whether the log has fewer rows so far than a window.
        holds_row_by_reason: (windows,) by reason, whether each window contains a row flagged `gap`
            or by `flag_rows_that_exclude_windows_by_reason`, in order of precedence.
        estimate_ksg_mutual_information: computes the mutual information of some windows by
            nearest neighbours, in nat.
        settings: the index and its threshold.
    """
    rho, spread, predicted_std, condition, _, noise_share = statistics
    index = correlation_to_information_index(rho)
    refusals = {
        "warming_up": is_warming_up,
        **{
            why: ~held if why == "standstill" else held for why, held in holds_row_by_reason.items()
        },
        "no_variance": np.isnan(rho),
        # (10) uses rho squared: either sign is information
        "negative_dependence": (rho < 0) & (settings.index != "gaussian"),
    }
    ksg = None
    match settings.index:
        case "information":
            poor = index < settings.threshold_nat
        case "gaussian":
            poor = correlation_to_gaussian_information(rho) < settings.threshold_nat
        case "variance":
            std_max = settings.threshold_std_kg if axis is X else settings.threshold_std_kg_m2
            poor = ~(predicted_std <= std_max)
        case "ksg":
            # costly, so only where nothing else rejects the window
            left = np.flatnonzero(~np.any(list(refusals.values()), axis=0)).astype(np.int64)
            ksg = np.full(rho.size, np.nan)
            if left.size:
                ksg[left] = estimate_ksg_mutual_information(left)
            poor = ~(ksg >= settings.threshold_nat)
    refusals["low_information"] = poor
    refusals["noise_limited"] = noise_share > settings.noise_share_max
    refusals["ill_conditioned"] = ~(condition <= settings.condition_max)
    return GateDecision(
        corr=np.where(spread > 0, rho, np.nan),
        mi_nat=index,
        predicted_std=predicted_std,
        noise_share=noise_share,
        ksg_nat=ksg,
        reasons=(*refusals, "accepted"),
        chosen=find_first_true_condition(list(refusals.values())),
    )

"""Check of a machine for drift since its calibration, with one known mass."""

from typing import Final

import numpy as np
from pydantic import ConfigDict
from pydantic.dataclasses import dataclass
from scipy.special import ndtr

from analysis.calibration.line.calibration import Calibration
from estimators.errors import DataError

_CONFIG: Final = ConfigDict(extra="forbid", allow_inf_nan=False)


@dataclass(frozen=True, slots=True, config=_CONFIG)
class CheckPoint:
    """Reading of a run with the known mass on board.

    Attributes:
        mass_kg: m̂ by the calibration's method; None without one.
        u_random_kg: random standard uncertainty of m̂; None if unknown.
        readings: number of readings in the mean.
    """

    mass_kg: float | None
    u_random_kg: float | None
    readings: int


@dataclass(frozen=True, slots=True, config=_CONFIG)
class DriftCheck:
    """The outcome.

    Attributes:
        drifted: whether the difference is beyond its limit; None where nothing could be compared.
        mass_kg: calibrated mass.
        difference_kg: of it to the known mass.
        u_kg: standard uncertainty of the difference.
        limit_kg: a difference up to this is no drift.
        p_1: probability of a difference as large without a drift: the risk of "drifted".
        matters_kg: the drift that is asked about.
        missed_1: probability that such a drift would have been missed: the risk of "not drifted".
        reason: why nothing could be compared, "" else.
    """

    drifted: bool | None
    mass_kg: float | None
    difference_kg: float | None
    u_kg: float | None
    limit_kg: float | None
    p_1: float | None
    matters_kg: float | None
    missed_1: float | None
    reason: str


def compare_known_mass_with_calibration(
    calibration: Calibration,
    reference_kg: float,
    reference_u_kg: float,
    machine_reading: CheckPoint,
    min_relevant_drift_kg: float | None = None,
) -> DriftCheck:
    """Compare a known mass with its calibrated mass.

    Args:
        calibration: calibration of the machine.
        reference_kg: known mass, including the machine if the calibration includes it.
        reference_u_kg: standard uncertainty of the known mass, independent of the calibration.
        machine_reading: reading of the machine.
        min_relevant_drift_kg: drift that must be detected; None for twice the limit.

    Raises:
        DataError: an uncertainty or drift is not a positive number.
    """
    if not (np.isfinite(reference_u_kg) and reference_u_kg >= 0.0):
        raise DataError(
            "check: the standard uncertainty of the known mass must be a number of at least 0 kg"
        )
    if min_relevant_drift_kg is not None and not min_relevant_drift_kg > 0.0:
        raise DataError("check: the drift limit must be above 0 kg")
    low, high = calibration.range_kg
    # a drifted machine may give a mass outside the range, so the known mass must be inside it
    if not low <= reference_kg <= high:
        return _make_drift_check_without_result(
            f"{reference_kg:g} kg is outside of the range, {low:g} to {high:g} kg"
        )
    if machine_reading.mass_kg is None or machine_reading.readings < 1:
        return _make_drift_check_without_result("no estimate")
    inversion = calibration.inversion.copy_with_common_uncertainty(reference_u_kg)
    run = (float(machine_reading.readings), machine_reading.u_random_kg or 0.0)
    mass = calibration.alpha_1 * machine_reading.mass_kg + calibration.beta_kg
    difference = mass - reference_kg
    u = inversion.compute_later_mass_u_kg(reference_kg, *run)
    limit = inversion.compute_half_interval_kg(reference_kg, calibration.confidence_1, *run)
    tail = inversion.compute_exceedance_probability(abs(difference), reference_kg, *run)
    matters = 2.0 * limit if min_relevant_drift_kg is None else min_relevant_drift_kg
    # the limit is fixed by now, so the probability of staying within it is that of a normal one
    missed = float(ndtr((limit - matters) / u) - ndtr((-limit - matters) / u))
    return DriftCheck(
        drifted=abs(difference) > limit,
        mass_kg=mass,
        difference_kg=difference,
        u_kg=u,
        limit_kg=limit,
        p_1=min(2.0 * tail, 1.0),
        matters_kg=matters,
        missed_1=missed,
        reason="",
    )


def _make_drift_check_without_result(reason: str) -> DriftCheck:
    return DriftCheck(None, None, None, None, None, None, None, None, reason)

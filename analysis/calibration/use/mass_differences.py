"""Differences of two masses of one log on a calibration line, whose level cancels.

Of the errors common to a log, the line absorbs the scale and those of the means of learnt priors;
the difference between their effects on this log and on the campaign remains.

The slope of a line of masses contains the gain and the forces that grow with the load (rolling
resistance, a sagging body): a campaign's logs have one load each, and cannot distinguish such a
force from load. A log of several loads can, so that a difference of its masses needs the gain
alone. A second estimate of the gain is the value of the line at its centre divided by the mass
there, apart from errors of forces in newtons, which are those of the learnt means. Both are
combined by their uncertainties.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from analysis.calibration.line.calibration import Calibration
from analysis.calibration.line.shared_errors import SharedErrors
from analysis.calibration.use.use_limits import LIMITS
from estimators.arrays import Floats

#: Coverage factor of 95 % for a normal distribution.
NORMAL: Final = 1.96


@dataclass(frozen=True)
class DifferenceOnLine:
    """Payloads calibrated by a line, (n,) each, in kg of mass.

    Attributes:
        payload_kg: calibrated payload.
        line_u_kg: uncertainty of the line.
        absorbed_u_kg: standard uncertainty absorbed by the line, in kg of m̂.
        driving_u_kg: standard uncertainty by driving differently from the campaign.
        shared_u_kg: part of `driving_u_kg` that is common to all payloads.
        abs_slope_1: magnitude of the slope.
    """

    payload_kg: Floats
    line_u_kg: Floats
    absorbed_u_kg: Floats
    driving_u_kg: Floats
    shared_u_kg: Floats
    abs_slope_1: float

    def compute_unabsorbed_common_u_kg(self, common_u_kg: Floats) -> Floats:
        """(n,) part of the common uncertainty that the line does not absorb, in kg of mass.

        The absorbed part is subtracted in quadrature; `common_u_kg` is in kg of m̂.
        """
        return np.sqrt(np.maximum(common_u_kg**2 - self.absorbed_u_kg**2, 0.0)) / self.abs_slope_1


def calibrate_mass_differences(
    calibration: Calibration,
    shared_errors: SharedErrors | None,
    payload_kinds_and_numbers: Sequence[tuple[str, int]],
    payload_kg: Floats,
) -> DifferenceOnLine:
    """Calibrate payloads, as differences of two masses, by a line.

    Args:
        calibration: calibration of masses, or of payloads with a level.
        shared_errors: the log's estimate of errors shared with its campaign; None corrects none.
        payload_kinds_and_numbers: (n,) kind (`MASS_KINDS`) and number of each payload.
        payload_kg: (n,) uncalibrated payloads; NaN if missing.
    """
    absolute = calibration.method == "joint_payload"
    gain = (
        make_difference_gain_by_slope(calibration)
        if absolute
        else estimate_difference_gain_by_slope_and_level(calibration, shared_errors)
    )
    slope, size = gain.slope_1, abs(gain.slope_1)
    level_kg = calibration.c0_kg if absolute else 0.0
    mass_kg = (payload_kg - level_kg) / slope
    none = np.zeros(len(payload_kinds_and_numbers))
    off_kg, absorbed_u_kg, driving_u_kg, shared_u_kg = none, none, none, none
    if shared_errors is not None and calibration.responses:
        centre_kg = calibration.centre_kg if absolute else 0.0
        nothing = np.zeros(len(shared_errors.terms))
        moved = np.array(
            [
                shared_errors.mass_responses_kg.get(each, nothing)
                for each in payload_kinds_and_numbers
            ]
        )
        of_level = shared_errors.compute_line_shifts_kg(calibration.responses, 1.0, 0.0)
        of_slope = shared_errors.compute_line_shifts_kg(calibration.responses, 0.0, 1.0)
        each = (1.0 - gain.by_level_1) * of_slope
        each = each + gain.by_level_1 * of_level / calibration.centre_kg
        line = np.outer(mass_kg - centre_kg, each) + (of_level if absolute else 0.0)
        is_corrected = np.array(
            [each in shared_errors.mass_responses_kg for each in payload_kinds_and_numbers]
        ) & np.isfinite(mass_kg)
        moved, line = (np.where(is_corrected[:, None], each, 0.0) for each in (moved, line))
        off = [
            shared_errors.compute_offset_from_line_kg_and_u_kg(*each)
            for each in zip(moved, line, strict=True)
        ]
        off_kg, driving_u_kg = (np.array(each) for each in zip(*off, strict=True))
        share = np.nan_to_num(np.abs(mass_kg)) / max(float(np.nansum(np.abs(mass_kg))), 1e-9)
        scale_kg = np.array(
            [shared_errors.scale_kg.get(each, 0.0) for each in payload_kinds_and_numbers]
        )
        absorbed_u_kg = np.hypot(
            share * shared_errors.compute_shared_part_of_log_u_kg(moved.sum(axis=0)), scale_kg
        )
        shared_u_kg = share * shared_errors.compute_shared_error_u_kg((moved - line).sum(axis=0))
    mass_kg = (payload_kg - off_kg - level_kg) / slope
    variance = gain.variance_1 * mass_kg**2
    if absolute:
        level, both, _ = calibration.covariance
        variance = level + 2.0 * both * mass_kg + variance
    return DifferenceOnLine(
        mass_kg,
        np.sqrt(np.maximum(variance, 0.0)) / size,
        absorbed_u_kg,
        driving_u_kg / size,
        shared_u_kg / size,
        size,
    )


@dataclass(frozen=True)
class DifferenceGain:
    """Gain: difference of two estimates over the difference of the masses.

    Attributes:
        slope_1: the gain.
        variance_1: variance of the gain, without errors of learnt means.
        by_level_1: weight of the line's level over its centre in the gain; its slope has the rest.
    """

    slope_1: float
    variance_1: float
    by_level_1: float


def make_difference_gain_by_slope(calibration: Calibration) -> DifferenceGain:
    """Gain by the slope of the line alone."""
    return DifferenceGain(calibration.c1_1, calibration.covariance[2], 0.0)


def estimate_difference_gain_by_slope_and_level(
    calibration: Calibration, shared_errors: SharedErrors | None
) -> DifferenceGain:
    """Gain of mass differences: slope and level of the line, weighted by uncertainty."""
    if shared_errors is None or not calibration.responses:
        return make_difference_gain_by_slope(calibration)
    at_kg, slope = calibration.centre_kg, calibration.c1_1
    level_variance, both, slope_variance = calibration.covariance
    # uncertainty of the line c0 + c1 m at its centre
    own = level_variance + 2.0 * both * at_kg + slope_variance * at_kg**2
    means_kg = shared_errors.compute_shared_error_u_kg(
        shared_errors.compute_line_shifts_kg(calibration.responses, 1.0, 0.0)
    )
    by_level, by_level_kg2 = calibration.level_kg / at_kg, max(own, 0.0) + means_kg**2
    variances = np.array(
        [by_level_kg2 / at_kg**2, slope_variance + (LIMITS.slope_by_load_std_1 * slope) ** 2]
    )
    if abs(by_level - slope) > LIMITS.slope_gain_max_std * float(np.sqrt(variances.sum())):
        return make_difference_gain_by_slope(calibration)
    share = float(variances[1] / variances.sum())
    variance = share**2 * max(own, 0.0) / at_kg**2 + (1.0 - share) ** 2 * float(variances[1])
    return DifferenceGain(share * by_level + (1.0 - share) * slope, variance, share)

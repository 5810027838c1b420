"""Differences of two masses of one log on a calibration's line: its level cancels.

Of what a log has in common, the line has taken with it the scale and what the means of learnt
priors have wrong; left of these is what they do to this log otherwise than to the campaign's.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from analysis.calibration.calibration import Calibration
from analysis.calibration.unlike import Unlike

Floats = NDArray[np.float64]

#: A normal distribution's 95 %.
NORMAL: Final = 1.96


@dataclass(frozen=True)
class OnLine:
    """Payloads on a line, (n,) each, in kg of mass.

    Attributes:
        payload_kg: on the line.
        line_kg: uncertainty of the line.
        taken_kg: what the line has taken with it, in kg of m̂, as a standard uncertainty.
        unlike_u_kg: uncertainty of what is left of that.
        shared_u_kg: the part of that that all have alike.
        size_1: of the slope.
    """

    payload_kg: Floats
    line_kg: Floats
    taken_kg: Floats
    unlike_u_kg: Floats
    shared_u_kg: Floats
    size_1: float

    def beside(self, common_kg: Floats) -> Floats:
        """(n,) what a log has in common, in kg of m̂, less what the line took, in kg of mass."""
        return np.sqrt(np.maximum(common_kg**2 - self.taken_kg**2, 0.0)) / self.size_1


def difference_on_line(
    calibration: Calibration,
    unlike: Unlike | None,
    numbers: Sequence[tuple[str, int]],
    payload_kg: Floats,
) -> OnLine:
    """Put payloads on the line.

    Args:
        calibration: of masses, or of payloads, whose line has a level.
        unlike: what the log says of errors that it shares; None takes nothing off.
        numbers: (n,) of `MOVED`, and which.
        payload_kg: (n,) by the log alone; NaN where there is none.
    """
    absolute = calibration.method == "joint_payload"
    slope, size = calibration.c1_1, abs(calibration.c1_1)
    level_kg = calibration.c0_kg if absolute else 0.0
    mass_kg = (payload_kg - level_kg) / slope
    none = np.zeros(len(numbers))
    off_kg, taken_kg, unlike_u_kg, shared_u_kg = none, none, none, none
    if unlike is not None and calibration.responses:
        centre_kg, level_1 = (calibration.centre_kg, 1.0) if absolute else (0.0, 0.0)
        nothing = np.zeros(len(unlike.terms))
        moved = np.array([unlike.moved_kg.get(each, nothing) for each in numbers])
        line = [unlike.line(calibration.responses, level_1, m - centre_kg) for m in mass_kg]
        told = np.array([each in unlike.moved_kg for each in numbers]) & np.isfinite(mass_kg)
        apart = np.where(told[:, None], moved - np.array(line), 0.0)
        off = [unlike.off_kg(each) for each in apart]
        off_kg, unlike_u_kg = (np.array(each) for each in zip(*off, strict=True))
        share = np.nan_to_num(np.abs(mass_kg)) / max(float(np.nansum(np.abs(mass_kg))), 1e-9)
        scale_kg = np.array([unlike.scale_kg.get(each, 0.0) for each in numbers])
        taken_kg = np.hypot(share * float(np.linalg.norm(moved[told].sum(axis=0))), scale_kg)
        shared_u_kg = share * unlike.off_kg(apart.sum(axis=0))[1]
    mass_kg = (payload_kg - off_kg - level_kg) / slope
    level, both, own = calibration.covariance
    variance = own * mass_kg**2
    if absolute:
        variance = level + 2.0 * both * mass_kg + variance
    return OnLine(
        mass_kg,
        np.sqrt(np.maximum(variance, 0.0)) / size,
        taken_kg,
        unlike_u_kg / size,
        shared_u_kg / size,
        size,
    )

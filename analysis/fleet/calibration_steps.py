"""Changes of zero and scale between successive calibrations of a machine."""

import datetime as dt
from collections.abc import Sequence
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from pydantic import BaseModel, ConfigDict

from analysis.fleet.fleet_limits import LIMITS

if TYPE_CHECKING:
    from analysis.calibration.line.calibration import Calibration


class FleetCalibration(BaseModel):
    """Calibration of a machine, reduced to the values that a fleet compares.

    Attributes:
        machine: name of the machine.
        id: id of the evidence.
        first: last day of the campaign, from which the calibration is valid.
        expires: last day of validity.
        method: estimator that the line belongs to.
        c0_kg: constant of m̂ = c0 + c1 m.
        c1_1: slope of the calibration line.
        covariance: (level variance, covariance, slope variance) of the line at its centre.
        centre_kg: mass at the centre of the line.
    """

    model_config = ConfigDict(frozen=True)

    machine: str
    id: str
    first: dt.date
    expires: dt.date
    method: str
    c0_kg: float
    c1_1: float
    covariance: tuple[float, float, float]
    centre_kg: float

    def predict_estimate_and_variance_kg(self, mass_kg: float) -> tuple[float, float]:
        """Estimate m̂ of a mass by the line, and its variance in kg²."""
        level, both, own = self.covariance
        off = mass_kg - self.centre_kg
        return self.c0_kg + self.c1_1 * mass_kg, level + 2.0 * both * off + own * off**2


class LineChange(NamedTuple):
    """Change between two successive calibrations.

    Attributes:
        before: the earlier calibration.
        after: the later calibration.
        offset_change_kg: change of m̂ midway between the centres of the two lines.
        offset_change_limit_kg: largest change that the uncertainty of both lines explains.
        slope_change_1: relative change of the slope.
        slope_change_limit_1: largest relative change that the uncertainty of both lines explains.
    """

    before: FleetCalibration
    after: FleetCalibration
    offset_change_kg: float
    offset_change_limit_kg: float
    slope_change_1: float
    slope_change_limit_1: float

    @property
    def has_line_moved(self) -> bool:
        """Whether either change exceeds its limit."""
        return (
            abs(self.offset_change_kg) > self.offset_change_limit_kg
            or abs(self.slope_change_1) > self.slope_change_limit_1
        )


def fit_fleet_calibration(
    machine: str, evidence: str, days: tuple[dt.date, dt.date], line: "Calibration"
) -> FleetCalibration:
    """Calibration of a machine from the id, first and last day and line of its evidence."""
    return FleetCalibration(
        machine=machine,
        id=evidence,
        first=days[0],
        expires=days[1],
        method=line.method,
        c0_kg=line.c0_kg,
        c1_1=line.c1_1,
        covariance=line.covariance,
        centre_kg=line.centre_kg,
    )


def find_line_changes(calibrations: Sequence[FleetCalibration]) -> list[LineChange]:
    """Changes between successive calibrations of the same machine and method."""
    found: list[LineChange] = []
    last: dict[tuple[str, str], FleetCalibration] = {}
    for each in sorted(calibrations, key=lambda c: (c.machine, c.first, c.id)):
        before = last.get((each.machine, each.method))
        last[each.machine, each.method] = each
        if before is not None:
            found.append(compare_calibration_lines(before, each))
    return found


def compare_calibration_lines(
    earlier_calibration: FleetCalibration, later_calibration: FleetCalibration
) -> LineChange:
    """Change of offset and slope between two calibrations."""
    middle = (earlier_calibration.centre_kg + later_calibration.centre_kg) / 2.0
    (old, old_kg2), (new, new_kg2) = (
        earlier_calibration.predict_estimate_and_variance_kg(middle),
        later_calibration.predict_estimate_and_variance_kg(middle),
    )
    slope = np.sqrt(earlier_calibration.covariance[2] + later_calibration.covariance[2]) / abs(
        earlier_calibration.c1_1
    )
    return LineChange(
        earlier_calibration,
        later_calibration,
        new - old,
        LIMITS.change_coverage_factor * float(np.sqrt(old_kg2 + new_kg2)),
        later_calibration.c1_1 / earlier_calibration.c1_1 - 1.0,
        LIMITS.change_coverage_factor * float(slope),
    )

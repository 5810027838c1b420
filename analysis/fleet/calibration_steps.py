"""From one calibration of a machine to the next: how its zero and its scale have moved."""

import datetime as dt
from collections.abc import Sequence
from typing import TYPE_CHECKING, Final, NamedTuple

import numpy as np
from pydantic import BaseModel, ConfigDict

if TYPE_CHECKING:
    from analysis.calibration.line.calibration import Calibration

#: Limits of a change, in standard uncertainties.
K: Final = 2.0


class FleetCalibration(BaseModel):
    """A calibration of a machine, as far as a fleet compares it.

    Attributes:
        machine: its name.
        id: of the evidence.
        first: last day of the campaign, the first that it is of.
        expires: its last day.
        method: whose line it is.
        c0_kg: constant of m̂ = c0 + c1 m.
        c1_1: slope of it.
        covariance: of the line at its centre: of the level, of both, of the slope.
        centre_kg: where that is.
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

    def estimate_at_mass(self, mass_kg: float) -> tuple[float, float]:
        """The estimate m̂ of a mass by the line, and its variance in kg²."""
        level, both, own = self.covariance
        off = mass_kg - self.centre_kg
        return self.c0_kg + self.c1_1 * mass_kg, level + 2.0 * both * off + own * off**2


class LineChange(NamedTuple):
    """Change from one calibration to the next.

    Attributes:
        before: the earlier one.
        after: the later one.
        zero_kg: change of m̂ in the middle of both.
        zero_limit_kg: a change up to this may be the uncertainty of both lines.
        scale_1: change of the slope, as a share.
        scale_limit_1: likewise.
    """

    before: FleetCalibration
    after: FleetCalibration
    zero_kg: float
    zero_limit_kg: float
    scale_1: float
    scale_limit_1: float

    @property
    def has_moved(self) -> bool:
        """Whether either is beyond its limit."""
        return abs(self.zero_kg) > self.zero_limit_kg or abs(self.scale_1) > self.scale_limit_1


def fit_fleet_calibration(
    machine: str, evidence: str, days: tuple[dt.date, dt.date], line: "Calibration"
) -> FleetCalibration:
    """A machine's calibration by the id of its evidence, and its first and last day."""
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


def line_changes(calibrations: Sequence[FleetCalibration]) -> list[LineChange]:
    """Changes between calibrations of one machine and method that follow each other."""
    found: list[LineChange] = []
    last: dict[tuple[str, str], FleetCalibration] = {}
    for each in sorted(calibrations, key=lambda c: (c.machine, c.first, c.id)):
        before = last.get((each.machine, each.method))
        last[each.machine, each.method] = each
        if before is not None:
            found.append(_change_of_line(before, each))
    return found


def _change_of_line(before: FleetCalibration, after: FleetCalibration) -> LineChange:
    middle = (before.centre_kg + after.centre_kg) / 2.0
    (old, old_kg2), (new, new_kg2) = before.estimate_at_mass(middle), after.estimate_at_mass(middle)
    slope = np.sqrt(before.covariance[2] + after.covariance[2]) / abs(before.c1_1)
    return LineChange(
        before,
        after,
        new - old,
        K * float(np.sqrt(old_kg2 + new_kg2)),
        after.c1_1 / before.c1_1 - 1.0,
        K * float(slope),
    )

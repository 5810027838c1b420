"""Loads that take turns, read as one load whose measured share of the force changes.

Where the direction changes from start to start, so does the sign of the acceleration, and with it
what a load transfer takes from the measured wheels: it looks like a load at every second start.
"""

from typing import NamedTuple

import numpy as np

from analysis.findings.constant_forces import explain_constant_force
from analysis.findings.finding_inputs import FindingInputs
from analysis.findings.whitened_rows import ProjectedEquation, force_system


class ShareOfForce(NamedTuple):
    """How the measured share of the force changes.

    Attributes:
        value: per m/s².
        std: its standard deviation.
        gain: by how much it raises twice the log likelihood of one load.
        worse: twice the log likelihood that loads with such a share have more than one load has.
        loads: how many there are otherwise.
    """

    value: float
    std: float
    gain: float
    worse: float
    loads: int


def compare_share_with_loads(inputs: FindingInputs) -> ShareOfForce | None:
    """One load with a share that changes, against the loads; None where there is one anyway."""
    fit, noise, motion = inputs.fit, inputs.column_noise, explain_constant_force(inputs).motion
    if fit is None or noise is None or motion is None or fit.count == 1 or not motion.both_ways:
        return None
    viscous, own_kg = max(fit.viscous, 0.0), inputs.sample_masses_kg(motion)
    one_kg = np.full_like(own_kg, np.median(own_kg[motion.used]))
    # with the share as well: loads that change otherwise than with the direction stay loads
    by_loads = ProjectedEquation.of(force_system(motion, noise, own_kg, viscous), ("driveline",))
    one = force_system(motion, noise, one_kg, viscous)
    before, after = ProjectedEquation.of(one, ()), ProjectedEquation.of(one, ("driveline",))
    square = before.square("driveline")
    if not square > 0.0:
        return None
    variance = min(by_loads.variance, after.variance)
    worse = after.square_left * after.variance - by_loads.square_left * by_loads.variance
    value = before.product("driveline") / square
    gain = value**2 * square * before.variance / variance
    std = (variance / (square * before.variance)) ** 0.5
    return ShareOfForce(value, std, gain, worse / variance, fit.count)

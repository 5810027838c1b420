"""Change of the slip of wheels and tracks with the load on them.

Slip κ = F / C, and the stiffness C grows with the weight that the wheels carry: of tyres on asphalt
and of tracks on sand nearly in proportion (Pacejka, Tire and Vehicle Dynamics, chapter 4; Wong,
Theory of Ground Vehicles, chapter 2), on clay hardly. With one stiffness for all loads a payload of
30 % was 8 % too large where tracks slip by 4 %.
"""

from typing import Final

import numpy as np

from analysis.weighing.column_inputs import ColumnInputs
from analysis.weighing.motion_samples import Floats
from analysis.weighing.nuisances import NUISANCES, Nuisance
from analysis.weighing.weighing_limits import LIMITS

(_SLIP,) = (term for term in NUISANCES if term.name == "slip_acceleration")


def _compute_loaded_minus_unloaded_slip_column(inputs: ColumnInputs) -> Floats:
    """Column (n,) of the slip F / (C m / m₀) minus that of the slip F / C."""
    return -inputs.relative_load / (1.0 + inputs.relative_load) * _SLIP.column(inputs)


#: Reduction by the load of the slip that the term `slip_acceleration` models equally for all loads.
SLIP_BY_LOAD: Final = Nuisance(
    "slip_by_load",
    "kg/N",
    _compute_loaded_minus_unloaded_slip_column,
    lambda e, s: LIMITS.slip_stiffness_by_load_1 * _SLIP.compute_prior_std(e, s),
    "reduction of wheel slip by the load, which presses the wheels onto the ground",
    "an accelerometer on the body",
    by_force=lambda m: m.relative_load * np.sign(m.speed) * m.wheel_acceleration,
    by_acceleration=lambda m: m.relative_load * np.sign(m.speed) * m.force,
    by_force_rate=lambda m: m.relative_load * m.ground_speed_ratio**2 * np.abs(m.speed),
    applies=_SLIP.applies,
    by_load=True,
)

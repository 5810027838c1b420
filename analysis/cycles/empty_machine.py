"""Whether the empty passes of a shift weigh what the machine file says that the empty machine does.

What is wrong with the mass of the empty machine is wrong with the loads as well: a scale, a side, a
slope that no channel tells.
"""

from typing import Final

import numpy as np

from analysis.cycles.passes import Passes
from analysis.machine import Machine
from analysis.uncertainty import combined, unknown_scale
from analysis.weighing.budget import budget
from analysis.weighing.equation import Floats
from analysis.weighing.joint_result import JointFit
from analysis.weighing.weigh import Weighing

#: The two masses differ by so many standard uncertainties of their difference, at most.
_AGREES: Final = 3.0
#: Relative standard uncertainty of a scale of which the machine file says nothing.
_UNKNOWN_SCALE: Final = 0.1


def states_of_passes(fit: JointFit, found: Passes) -> Floats:
    """(states, passes) by which masses of passes are those of states weighted."""
    assert fit.states is not None
    weights = np.zeros((fit.count, found.mass_kg.size))
    np.add.at(weights, (fit.states.of, found.of), found.share)
    return weights


def contradicted_empty_mass(weighing: Weighing | None, machine: Machine, found: Passes) -> str:
    """Why the loads are not to be trusted: the empty passes weigh something else; else nothing.

    Args:
        weighing: the joint fit.
        machine: its empty mass, and the scale.
        found: the passes.
    """
    body, empty = machine.machine, ~found.loaded
    if weighing is None or weighing.fit.states is None or body.empty_mass_kg is None:
        return ""
    if not empty.any():
        return ""
    share = np.where(empty, 1.0 / found.u_kg**2, 0.0)
    weights = states_of_passes(weighing.fit, found) @ (share / share.sum())
    sources = budget(weighing, machine, weights)
    mass_kg = float(weights @ weighing.fit.masses_kg) - body.rotating_mass_kg
    scale_kg = _UNKNOWN_SCALE * mass_kg if unknown_scale(sources) else 0.0
    u_kg, stated_u_kg = float(np.hypot(combined(sources), scale_kg)), body.empty_mass_u_kg or 0.0
    if abs(mass_kg - body.empty_mass_kg) <= _AGREES * float(np.hypot(u_kg, stated_u_kg)):
        return ""
    return (
        f"empty_mass: the empty machine weighs {mass_kg:,.0f} ± {u_kg:,.0f} kg here, and "
        f"{body.empty_mass_kg:,.0f} kg by its machine file"
    )

"""The empty passes of a shift: what they weigh, and what a clean bucket would."""

from typing import Final, NamedTuple

import numpy as np

from analysis.cycles.cycle_limits import LIMITS
from analysis.cycles.load_passes import Passes
from analysis.model.machine import Machine
from analysis.weighing.empty_mass_datum import EmptyMachine
from analysis.weighing.joint_result import JointFit
from analysis.weighing.weigh import Weighing
from estimators.arrays import Floats

#: What tells the scale of payloads.
BY_MACHINE_FILE: Final = "machine file"
BY_EMPTY_MACHINE: Final = "empty machine"
BY_CALIBRATION: Final = "calibration"


class ShiftScale(NamedTuple):
    """Where the scale of the payloads comes from.

    Attributes:
        told_by: what tells it; empty where nothing does.
        unknown: the sources that nothing tells, with commas.
        gain_1: mass of the empty machine in the log over that of the machine file, where it has u.
        gain_u_1: its standard uncertainty.
    """

    told_by: str = ""
    unknown: str = ""
    gain_1: float | None = None
    gain_u_1: float | None = None


def pass_weights_by_state(fit: JointFit, found: Passes) -> Floats:
    """(states, passes) by which masses of passes are those of states weighted."""
    assert fit.states is not None
    weights = np.zeros((fit.count, found.mass_kg.size))
    np.add.at(weights, (fit.states.membership, found.membership), found.share)
    return weights


def carried_variance(found: Passes) -> float:
    """Variance of what is carried back, in kg²: what empty passes differ by beyond their noise."""
    mass, u = found.mass_kg[~found.loaded], found.u_kg[~found.loaded]
    if mass.size < LIMITS.carried_min_passes:
        return 0.0
    # neighbours, since fuel is burnt
    return max(float(np.mean(np.diff(mass) ** 2 - u[1:] ** 2 - u[:-1] ** 2)) / 2.0, 0.0)


def cleanest(found: Passes) -> tuple[float, float]:
    """The mass of the machine with a clean bucket, and its uncertainty.

    The spread of empty passes is more than that of what they carry: quantiles are drawn towards the
    mean by the share of the variance that is noise.
    """
    mass, u = found.mass_kg[~found.loaded], found.u_kg[~found.loaded]
    if not mass.size:
        return float("nan"), float("nan")
    noise = float(np.mean(u**2))
    true = carried_variance(found)
    kept = float(np.sqrt(true / (true + noise))) if true + noise > 0 else 0.0
    middle = float(np.mean(mass))
    least = middle + kept * (float(np.quantile(mass, LIMITS.clean_bucket_quantile)) - middle)
    return least, float(np.sqrt(noise / mass.size + true * (1.0 - kept)))


def empty_machine(
    weighing: Weighing | None, machine: Machine, found: Passes
) -> EmptyMachine | None:
    """The empty machine as the empty passes weigh it; None where there is none.

    Args:
        weighing: the joint fit.
        machine: what is known of it.
        found: the passes.
    """
    empty = ~found.loaded
    if weighing is None or weighing.fit.states is None or not empty.any():
        return None
    share = np.where(empty, 1.0 / found.u_kg**2, 0.0)
    share /= share.sum()
    least_kg, least_u_kg = cleanest(found)
    carried_kg = max(float(share @ found.mass_kg) - least_kg, 0.0)
    # the noise of the passes is in their own masses
    noise_kg2 = float(np.mean(found.u_kg[empty] ** 2)) / int(empty.sum())
    own_kg2 = max(least_u_kg**2 - noise_kg2, 0.0)
    carried = carried_kg, float(np.sqrt(own_kg2 + (LIMITS.clean_bucket_u * carried_kg) ** 2))
    return EmptyMachine(
        weighing, machine, pass_weights_by_state(weighing.fit, found) @ share, carried
    )

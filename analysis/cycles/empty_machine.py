"""The empty machine as weighed by a shift's empty passes: mass, clean bucket and identity.

Fuel, mud or a fork instead of a bucket change the empty mass by a few percent; another machine has
a mass that differs by more.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final, NamedTuple

import numpy as np
import polars as pl

from analysis.cycles.cycle_limits import LIMITS
from analysis.cycles.load_passes import LoadPasses
from analysis.model.machine import Machine
from analysis.weighing.empty_mass_datum import EmptyMachine
from analysis.weighing.fuel_on_board import FuelOnBoard
from analysis.weighing.joint_result import JointFit
from analysis.weighing.weigh import Weighing
from estimators.arrays import Floats

#: Source of the scale of payloads: the empty mass in the machine file.
BY_MACHINE_FILE: Final = "machine file"
BY_EMPTY_MACHINE: Final = "empty machine"
BY_CALIBRATION: Final = "calibration"


@dataclass(frozen=True)
class EmptyMassJump:
    """A jump of the empty mass at the start of a log.

    Attributes:
        log: number of the log with the jump, from 0.
        before_kg: mass of the lightest starts before that log.
        after_kg: mass of the lightest starts from that log on.
    """

    log: int
    before_kg: float
    after_kg: float

    def make_warning_text(self, log_name: str) -> str:
        """Warning about the jump.

        Args:
            log_name: name of the log with the jump.
        """
        more = self.after_kg / self.before_kg - 1.0
        return (
            f"the empty machine weighs {self.before_kg:,.0f} kg before {log_name} and "
            f"{self.after_kg:,.0f} kg from then on ({more:+.0%}): the logs may come from two "
            "machines; review the logs of each machine separately"
        )


class ShiftScale(NamedTuple):
    """Source of the payloads' scale.

    Attributes:
        told_by: what determines the scale; "" if nothing does.
        unknown: factors of the scale without a stated uncertainty, separated by commas.
        gain_1: empty mass in the log over that of the machine file; None unless the machine file
            states the uncertainty of the empty mass.
        gain_u_1: standard uncertainty of `gain_1`.
    """

    told_by: str = ""
    unknown: str = ""
    gain_1: float | None = None
    gain_u_1: float | None = None


def compute_state_weights_of_passes(fit: JointFit, passes: LoadPasses) -> Floats:
    """(states, passes) weights of the states' masses in the passes' masses."""
    assert fit.states is not None
    weights = np.zeros((fit.mass_count, passes.mass_kg.size))
    np.add.at(weights, (fit.states.state_of_manoeuvre, passes.pass_of_manoeuvre), passes.share)
    return weights


def estimate_carry_back_variance_kg2(passes: LoadPasses) -> float:
    """Variance of the carry-back in kg²: variance of the empty passes beyond their noise."""
    mass, u = passes.drift_corrected_masses_kg[~passes.loaded], passes.u_kg[~passes.loaded]
    if mass.size < LIMITS.carried_min_passes:
        return 0.0
    # differences of successive passes, since the burnt fuel changes the mass
    return max(float(np.mean(np.diff(mass) ** 2 - u[1:] ** 2 - u[:-1] ** 2)) / 2.0, 0.0)


def estimate_clean_machine_mass_and_u_kg(passes: LoadPasses) -> tuple[float, float]:
    """Mass of the machine with a clean bucket, and its uncertainty, in kg.

    The empty passes scatter by noise as well as by carry-back, so the low quantile of their masses
    is shrunk towards the mean by the fraction of noise in the variance.
    """
    mass, u = passes.drift_corrected_masses_kg[~passes.loaded], passes.u_kg[~passes.loaded]
    if not mass.size:
        return float("nan"), float("nan")
    noise = float(np.mean(u**2))
    true = estimate_carry_back_variance_kg2(passes)
    kept = float(np.sqrt(true / (true + noise))) if true + noise > 0 else 0.0
    middle = float(np.mean(mass))
    least = middle + kept * (float(np.quantile(mass, LIMITS.clean_bucket_quantile)) - middle)
    return least, float(np.sqrt(noise / mass.size + true * (1.0 - kept)))


def weigh_empty_machine(
    weighing: Weighing | None, machine: Machine, passes: LoadPasses, fuel: FuelOnBoard | None = None
) -> EmptyMachine | None:
    """The empty machine as weighed by the empty passes; None without any.

    Args:
        weighing: the joint fit.
        machine: machine file.
        passes: the passes.
        fuel: fuel over the log, if known.
    """
    empty = ~passes.loaded
    if weighing is None or weighing.fit.states is None or not empty.any():
        return None
    share = passes.compute_averaging_weights_of_empty_passes(machine.machine.empty_mass_kg)
    share /= share.sum()
    least_kg, least_u_kg = estimate_clean_machine_mass_and_u_kg(passes)
    carried_kg = max(float(share @ passes.drift_corrected_masses_kg) - least_kg, 0.0)
    # the noise of the passes is already in the uncertainty of their masses
    noise_kg2 = float(np.mean(passes.u_kg[empty] ** 2)) / int(empty.sum())
    own_kg2 = max(least_u_kg**2 - noise_kg2, 0.0)
    carried = carried_kg, float(np.sqrt(own_kg2 + (LIMITS.clean_bucket_u * carried_kg) ** 2))
    weights = compute_state_weights_of_passes(weighing.fit, passes) @ share
    middles_ns = (passes.start_ns + passes.end_ns) / 2.0
    fuel_kg = (
        (0.0, 0.0)
        if fuel is None
        else fuel.estimate_fuel_mass_beyond_ticket_and_u_kg(middles_ns, share)
    )
    return EmptyMachine(weighing, machine, weights, carried, fuel_kg)


def find_machine_change_by_empty_mass(
    manoeuvres: pl.DataFrame, log_starts_ns: Sequence[int]
) -> EmptyMassJump | None:
    """Find the log from which on the empty machine has a different mass.

    Args:
        manoeuvres: the frame `manoeuvres`.
        log_starts_ns: (logs,) start of each log since the first aligned sample, ascending.

    Returns:
        The largest jump; None if there is none, or too few starts on either side.
    """
    known = manoeuvres.drop_nulls(["mass_kg", "mass_std_kg"])
    if known.is_empty():
        return None
    mass_kg, std_kg, start_ns = (
        known[name].to_numpy() for name in ("mass_kg", "mass_std_kg", "start_t_ns")
    )
    found: list[tuple[float, EmptyMassJump]] = []
    for number, border_ns in enumerate(log_starts_ns[1:], 1):
        later = start_ns >= border_ns
        sides = [
            compute_lightest_start_mean_and_std_kg(mass_kg[side], std_kg[side])
            for side in (~later, later)
        ]
        if sides[0] is None or sides[1] is None:
            continue
        (before_kg, u_kg), (after_kg, other_u_kg) = sides[0], sides[1]
        jump = abs(float(np.log(after_kg / before_kg)))
        surely = abs(after_kg - before_kg) > LIMITS.empty_mass_jump_u * float(
            np.hypot(u_kg, other_u_kg)
        )
        if jump > LIMITS.empty_mass_jump and surely:
            found.append((jump, EmptyMassJump(number, before_kg, after_kg)))
    return max(found, key=lambda each: each[0])[1] if found else None


def compute_lightest_start_mean_and_std_kg(
    mass_kg: Floats, std_kg: Floats
) -> tuple[float, float] | None:
    """Mass of the lightest starts and its standard deviation, in kg; None if none is empty."""
    if mass_kg.size < LIMITS.border_side_min_starts:
        return None
    low, high = (
        float(x)
        for x in np.quantile(mass_kg, [LIMITS.empty_start_quantile, LIMITS.loaded_start_quantile])
    )
    if low <= 0.0 or high < (1.0 + LIMITS.loaded_start_excess) * low:
        return None
    return low, float(np.median(std_kg))

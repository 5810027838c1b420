"""Drift of the empty mass over a log: a drift of the force's gain, since machines lose little."""

from dataclasses import dataclass

import numpy as np

from analysis.weighing.joint_result import JointFit
from analysis.weighing.motion_samples import Bools, Floats, Ints
from analysis.weighing.weighing_limits import LIMITS


@dataclass(frozen=True, slots=True)
class EmptyMassDrift:
    """Change of the empty machine's mass from the first to the last manoeuvre without a load.

    Attributes:
        change_1: change, as a fraction of the mean mass.
        u_1: standard uncertainty of the change, from the scatter of the masses.
        fuel_1: loss that burnt fuel explains.
        empty_states: load states of the empty machine, in order of time.
        nearby_1: (2, states) mass of the empty machine before and after each state, divided by its
            mean, minus 1.
    """

    change_1: float
    u_1: float
    fuel_1: float
    empty_states: tuple[int, ...]
    nearby_1: Floats

    @property
    def significance_threshold_1(self) -> float:
        """Threshold of the change, as a fraction of the mean mass.

        Smaller changes are explained by fuel and the scatter of the masses, or do not matter.
        """
        return self.fuel_1 + max(LIMITS.empty_drift_min_std * self.u_1, LIMITS.empty_drift_min_1)

    @property
    def is_significant(self) -> bool:
        """Whether the change exceeds its threshold."""
        return abs(self.change_1) > self.significance_threshold_1

    @property
    def gain_u_1(self) -> float:
        """Relative standard uncertainty of the force's gain due to the change."""
        return LIMITS.empty_drift_u_1 * abs(self.change_1)

    def compute_mass_responses_kg(self, masses_kg: Floats) -> Floats:
        """(3, masses) response of each mass to a gain with this drift, in kg.

        Row 0: the stated gain holds at one end of the log, but not known at which. Row 1: the gain
        follows the empty masses before and after each state. Row 2: half their change from before a
        state to after it. Rows 1 and 2 do not cancel in the ratio to the mean empty mass.
        """
        before_1, after_1 = self.nearby_1
        course_1 = (before_1 + after_1) / 2.0, (before_1 - after_1) / 2.0
        return np.vstack([np.full(masses_kg.size, self.gain_u_1), *course_1]) * masses_kg


def estimate_empty_mass_drift(fit: JointFit) -> EmptyMassDrift | None:
    """Estimate the drift; None unless enough manoeuvres without a load have masses above 0.

    A gain that drifts changes all masses alike. Payloads are differences to the empty masses
    nearby, which removes the drift from the tare, but not from the payload.
    """
    states, loads = fit.states, fit.previous_estimates.relative_loads
    if states is None or loads is None or not states.load_returns:
        return None
    light = ~loads.mark_loaded_manoeuvres_by_number(states.manoeuvre_ids)
    # a small load is light as well, but the empty machine before and after it is lighter
    light = np.flatnonzero(light & mark_local_mass_minima(fit.masses_kg[states.state_of_manoeuvre]))
    first = light[np.unique(states.state_of_manoeuvre[light], return_index=True)[1]]
    if first.size < LIMITS.empty_drift_min_states:
        return None
    masses_kg, third = fit.masses_kg[states.state_of_manoeuvre[np.sort(first)]], first.size // 3
    start, end = masses_kg[:third], masses_kg[-third:]
    mean_kg = float(np.mean(masses_kg))
    if not mean_kg > 0.0:  # a failed fit, which no drift explains
        return None
    # successive masses differ by noise and carry-back, and hardly by the drift
    scatter_kg = float(np.std(np.diff(masses_kg))) / np.sqrt(2.0)
    change_1 = float(np.mean(end) - np.mean(start)) / mean_kg
    u_1 = scatter_kg * np.sqrt(2.0 / third) / mean_kg
    hours = fit.motion.speed.size / fit.motion.rate_hz / 3600.0
    return EmptyMassDrift(
        change_1,
        u_1,
        LIMITS.fuel_loss_1_h * hours,
        tuple(states.state_of_manoeuvre[np.sort(first)].tolist()),
        find_empty_masses_before_and_after_states_kg(
            fit.masses_kg, states.state_of_manoeuvre, light
        )
        / mean_kg
        - 1.0,
    )


def find_empty_masses_before_and_after_states_kg(
    masses_kg: Floats, state_of_manoeuvre: Ints, empty_manoeuvres: Ints
) -> Floats:
    """(2, states) mass of the empty machine before and after each state, in kg.

    Args:
        masses_kg: (states,) mass of each state.
        state_of_manoeuvre: (manoeuvres,) load state of each manoeuvre.
        empty_manoeuvres: manoeuvres without a load, ascending.
    """
    number = np.arange(state_of_manoeuvre.size)
    before = empty_manoeuvres[(np.searchsorted(empty_manoeuvres, number, "right") - 1).clip(0)]
    after = empty_manoeuvres[
        np.searchsorted(empty_manoeuvres, number).clip(0, empty_manoeuvres.size - 1)
    ]
    count = np.bincount(state_of_manoeuvre)
    return np.vstack(
        [
            np.bincount(state_of_manoeuvre, masses_kg[state_of_manoeuvre[near]]) / count
            for near in (before, after)
        ]
    )


def mark_local_mass_minima(mass_kg: Floats) -> Bools:
    """Whether each mass is no larger than the different ones before and after it, (n,).

    Args:
        mass_kg: (n,) mass of each manoeuvre's load state, in order of time.
    """
    starts = np.flatnonzero(np.append(True, np.diff(mass_kg) != 0.0))
    loads_kg = mass_kg[starts]
    beside = np.concatenate([[np.inf], loads_kg, [np.inf]])
    lightest = (loads_kg <= beside[:-2]) & (loads_kg <= beside[2:])
    return np.repeat(lightest, np.diff(np.append(starts, mass_kg.size)))

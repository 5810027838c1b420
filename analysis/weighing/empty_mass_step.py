"""Step of the empty machine's mass within a log: a trailer or another bucket from some time on."""

from dataclasses import dataclass

import numpy as np
import polars as pl

from analysis.model.uncertainty_sources import STD_OF_MAD
from analysis.weighing.empty_mass_drift import mark_local_mass_minima
from analysis.weighing.motion_samples import Bools, Floats, Ints
from analysis.weighing.weighing_limits import LIMITS


@dataclass(frozen=True, slots=True)
class EmptyMassStep:
    """Step of the empty machine's mass, which stays until the log ends.

    Attributes:
        change_kg: mass after the step minus that before it.
        u_kg: its standard uncertainty, from the scatter of the masses.
        first_manoeuvre_after: index of the first manoeuvre after the step.
        at_s: start of that manoeuvre, in s since the first aligned sample.
    """

    change_kg: float
    u_kg: float
    first_manoeuvre_after: int
    at_s: float

    @property
    def text(self) -> str:
        """Sentence on the step, and on its effect on the payloads of cycles."""
        return (
            f"the empty machine {'gains' if self.change_kg > 0.0 else 'loses'} "
            f"{abs(self.change_kg):,.0f} ± {self.u_kg:,.0f} kg from {self.at_s:,.1f} s on: an "
            "attachment, a trailer, or another gain of the force; cycles are weighed against the "
            "empty machine of the same time"
        )


def find_empty_mass_step_of_manoeuvres(manoeuvres: pl.DataFrame) -> EmptyMassStep | None:
    """Find the step in the frame `manoeuvres`; None without one, or without masses."""
    if manoeuvres.is_empty() or manoeuvres["mass_kg"].null_count():
        return None
    columns = ("mass_kg", "mass_std_kg", "load_id", "start_t_ns", "end_t_ns")
    return find_empty_mass_step(*(manoeuvres[name].to_numpy() for name in columns))


def find_empty_mass_step(
    mass_kg: Floats, std_kg: Floats, state_of_manoeuvre: Ints, start_ns: Ints, end_ns: Ints
) -> EmptyMassStep | None:
    """Find the step; None unless the lightest states before and after differ far beyond scatter.

    It is put at the longest pause between the two states. A pause is possible if no manoeuvre
    before it is lighter than the first state, and none after it is lighter than the second.

    Args:
        mass_kg: (manoeuvres,) mass of each manoeuvre, in order of time.
        std_kg: (manoeuvres,) standard deviation of each mass.
        state_of_manoeuvre: (manoeuvres,) load state of each manoeuvre.
        start_ns: (manoeuvres,) start of each manoeuvre.
        end_ns: (manoeuvres,) end of each manoeuvre.
    """
    starts = np.flatnonzero(np.append(True, np.diff(state_of_manoeuvre) != 0))
    visit = np.cumsum(np.append(0, np.diff(state_of_manoeuvre) != 0))
    weight = 1.0 / std_kg**2
    total = np.bincount(visit, weight)
    visited_kg = np.bincount(visit, weight * mass_kg) / total
    light = np.flatnonzero(mark_local_mass_minima(visited_kg))
    empty_kg, least = visited_kg[light], LIMITS.empty_step_side_min_states
    if empty_kg.size < 2 * least:
        return None
    place = min(
        range(least, empty_kg.size - least + 1),
        key=lambda k: float(np.abs(_subtract_median_of_each_side(empty_kg, k)).sum()),
    )
    before_kg, after_kg = float(np.median(empty_kg[:place])), float(np.median(empty_kg[place:]))
    change_kg = after_kg - before_kg
    scatter_kg = max(
        STD_OF_MAD * float(np.median(np.abs(_subtract_median_of_each_side(empty_kg, place)))),
        float(np.median(1.0 / np.sqrt(total[light]))),
    )
    is_after = np.abs(empty_kg - after_kg) < np.abs(empty_kg - before_kg)
    if (
        min(before_kg, after_kg) <= 0.0  # a failed fit
        or abs(change_kg) < LIMITS.empty_step_min_std * scatter_kg
        or abs(change_kg) < LIMITS.empty_step_min_1 * before_kg
        or is_after[:place].any()
        or not is_after[place:].all()
    ):
        return None
    certain_before_and_after = (
        int(np.flatnonzero(visit == light[place - 1])[-1]),
        int(starts[light[place]]),
    )
    tolerance_kg = LIMITS.empty_drift_min_std * np.hypot(scatter_kg, std_kg)
    first_manoeuvre_after = _find_first_manoeuvre_after_step(
        mass_kg > before_kg - tolerance_kg,
        mass_kg > after_kg - tolerance_kg,
        np.append(0, start_ns[1:] - end_ns[:-1]),
        certain_before_and_after,
    )
    u_kg = scatter_kg * float(np.sqrt(1.0 / place + 1.0 / (empty_kg.size - place)))
    return EmptyMassStep(
        change_kg, u_kg, first_manoeuvre_after, float(start_ns[first_manoeuvre_after]) / 1e9
    )


def _subtract_median_of_each_side(empty_kg: Floats, step_index: int) -> Floats:
    sides = empty_kg[:step_index], empty_kg[step_index:]
    return np.concatenate([side - np.median(side) for side in sides])


def _find_first_manoeuvre_after_step(
    may_be_before: Bools,
    may_be_after: Bools,
    pause_ns: Ints,
    certain_before_and_after: tuple[int, int],
) -> int:
    """First manoeuvre after the step: the one that follows the longest possible pause.

    Args:
        may_be_before: (manoeuvres,) whether it is no lighter than the machine before the step.
        may_be_after: (manoeuvres,) whether it is no lighter than the machine after the step.
        pause_ns: (manoeuvres,) time since the previous manoeuvre.
        certain_before_and_after: last empty manoeuvre that is certainly before the step, and first
            one that is certainly after it.
    """
    last, first = certain_before_and_after
    places = [
        place
        for place in range(last + 1, first + 1)
        if may_be_before[last + 1 : place].all() and may_be_after[place:first].all()
    ]
    return max(places or range(last + 1, first + 1), key=lambda place: int(pause_ns[place]))

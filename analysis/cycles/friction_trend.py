"""Friction over a shift, part by part, with the masses known: what tells wear, or a colder morning.

Masses, and what else the joint fit says of the force, are those of the whole shift; of each part of
it the viscous friction is what is left. So the parts compare with each other; what they share (a
lag, slip) is in none of their deviations.
"""

from typing import NamedTuple

import numpy as np
import polars as pl

from analysis.cycles.cycle_limits import LIMITS
from analysis.model.axes import X, regressor
from analysis.model.physical_units import NS_PER_S
from analysis.model.settings import Settings
from analysis.weighing.load_states import means_by_state
from estimators.arrays import Floats


class FrictionPart(NamedTuple):
    """A part of a shift.

    Attributes:
        start_s: since the first sample.
        end_s: likewise.
        manoeuvres: in it.
        friction_N_s_m: viscous friction.
        std_N_s_m: its standard deviation, by how manoeuvres differ.
    """

    start_s: float
    end_s: float
    manoeuvres: int
    friction_N_s_m: float
    std_N_s_m: float


def friction_parts(
    excitation: pl.DataFrame, manoeuvres: pl.DataFrame, nuisances: pl.DataFrame, settings: Settings
) -> tuple[FrictionPart, ...]:
    """Fit F - m·a - what is constant = b·v in each part of a shift.

    Args:
        excitation: force, regressor, speed and phase.
        manoeuvres: load states and masses.
        nuisances: of the joint fit: constant, Coulomb friction, quadratic resistance and slip.
        settings: of the regressor.

    Returns:
        Parts with manoeuvres enough, in time; none where the shift has no mass.
    """
    if manoeuvres.is_empty() or manoeuvres["mass_kg"].null_count() or nuisances.is_empty():
        return ()
    crossed, squared = _manoeuvre_sums(excitation, manoeuvres, nuisances, settings)
    t_ns = excitation["t_ns"].to_numpy()
    middle = (manoeuvres["start_t_ns"] + manoeuvres["end_t_ns"]).to_numpy() / 2.0
    since_s = (middle - t_ns[0]) / NS_PER_S
    whole_s = float(t_ns[-1] - t_ns[0]) / NS_PER_S
    length_s = float(
        np.clip(
            whole_s / LIMITS.friction_parts,
            LIMITS.shortest_friction_part_s,
            LIMITS.longest_friction_part_s,
        )
    )
    found: list[FrictionPart] = []
    for number in range(int(np.ceil(whole_s / length_s))):
        begin, end = number * length_s, min((number + 1) * length_s, whole_s)
        inside = (since_s >= begin) & (since_s < end) & (squared > 0.0)
        count = int(inside.sum())
        if count < LIMITS.friction_min_manoeuvres:
            continue
        friction = float(crossed[inside].sum() / squared[inside].sum())
        # samples of one manoeuvre are wrong together
        apart = crossed[inside] - friction * squared[inside]
        variance = float(apart @ apart) / float(squared[inside].sum()) ** 2 * count / (count - 1)
        found.append(FrictionPart(begin, end, count, friction, float(np.sqrt(variance))))
    return tuple(found)


def _manoeuvre_sums(
    excitation: pl.DataFrame, manoeuvres: pl.DataFrame, nuisances: pl.DataFrame, settings: Settings
) -> tuple[Floats, Floats]:
    """(manoeuvres,) of speed times the force that is left, and of the speed's square."""
    A, force = regressor(X, excitation, settings)
    acceleration, speed = A[:, 0], A[:, 1]
    by_term: dict[str, float] = dict(nuisances.select("term", "posterior").iter_rows())
    way = np.sign(speed)
    rest = (
        force
        - by_term.get("const", 0.0)
        - by_term.get("direction", 0.0) * way
        - by_term.get("quadratic", 0.0) * speed * np.abs(speed)
        - by_term.get("slip", 0.0) * np.abs(speed) * force
    )
    driving = excitation["phase"].is_in(["accelerating", "cruising"]).fill_null(False).to_numpy()
    driving &= np.isfinite(rest) & np.isfinite(acceleration) & np.isfinite(speed)
    mass_kg = _state_masses(manoeuvres)
    t_ns = excitation["t_ns"].to_numpy()
    spans = manoeuvres.select("start_t_ns", "end_t_ns").iter_rows()
    crossed, squared = np.zeros(mass_kg.size), np.zeros(mass_kg.size)
    for number, (start, end) in enumerate(spans):
        first, last = np.searchsorted(t_ns, [start, end])
        rows = first + np.flatnonzero(driving[first : last + 1])
        left = rest[rows] - mass_kg[number] * acceleration[rows]
        crossed[number] = speed[rows] @ left
        squared[number] = speed[rows] @ speed[rows]
    return crossed, squared


def _state_masses(manoeuvres: pl.DataFrame) -> Floats:
    """(manoeuvres,) the mass of the load state of each."""
    state = manoeuvres["load_id"].to_numpy()
    weight = manoeuvres["mass_std_kg"].to_numpy() ** -2.0
    return means_by_state(manoeuvres["mass_kg"].to_numpy(), weight, state)[state]

"""The drive of a log as the joint fit has it: samples, masses, the force's model and its errors."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
import polars as pl

from analysis.cycles.energy_integrals import (
    EnergySamples,
    Floats,
    MotionErrors,
    PhaseIntegrals,
    PhaseSpan,
    drive_as_it_acts,
    energy_samples,
    integrate_phases,
    late_rows,
    without_brakes,
)
from analysis.cycles.energy_terms import (
    ForceModel,
    fitted_force,
    fitted_motion_errors,
    untold_coulomb,
)
from analysis.model.machine import Machine
from analysis.model.physical_units import NS_PER_S
from analysis.weighing.load_states import means_by_state


@dataclass(frozen=True)
class FittedDrive:
    """The samples of a log, and what the joint fit says of them.

    Attributes:
        samples: with the drive's stretches as the force acts.
        move_rows: by which the ends of those stretches are uncertain.
        mass_kg: (n,) of machine and load.
        rotating_kg: equivalent mass of what rotates.
        model: of the force, and its standard uncertainties.
        errors: of force and motion, and their standard uncertainties.
        coulomb_N: standard deviation of Coulomb friction that the fit has no term for.
        speed_u_1: relative standard uncertainty of the wheels' speed beside an accelerometer.
    """

    samples: EnergySamples
    move_rows: int
    mass_kg: Floats
    rotating_kg: float
    model: ForceModel
    model_u: ForceModel
    errors: MotionErrors
    errors_u: MotionErrors
    coulomb_N: float
    speed_u_1: float

    def integrate(self, spans: list[PhaseSpan]) -> PhaseIntegrals:
        """The integrals over each phase."""
        return integrate_phases(self.samples, spans, self.mass_kg, self.rotating_kg, self.errors)


def fit_drive(frames: Mapping[str, pl.DataFrame], machine: Machine) -> FittedDrive:
    """Take samples, masses and force of a log as the joint fit has them."""
    grids = frames["aligned"], frames["excitation"], frames["digging"]
    cycles, manoeuvres = frames["cycles"], frames["manoeuvres"]
    mass_kg = _sample_masses(energy_samples(*grids, machine), cycles, manoeuvres)
    model, model_u = fitted_force(frames, mass_kg, machine.settings.priors)
    errors, errors_u = fitted_motion_errors(frames["nuisances"], model, machine)
    samples = energy_samples(*grids, machine, model.offset)
    mass_kg = _sample_masses(samples, cycles, manoeuvres)
    samples = drive_as_it_acts(samples, errors.force_late_s)
    friction = model.viscous, model.direction
    by_accelerometer = machine.settings.forces.acceleration == "specific_force"
    return FittedDrive(
        without_brakes(samples, frames["excitation"], machine, mass_kg, *friction),
        max(late_rows(machine), 1),
        mass_kg,
        machine.machine.rotating_mass_kg,
        model,
        model_u,
        errors,
        errors_u,
        untold_coulomb(frames, mass_kg, machine),
        # a speed that is wrong beside an acceleration of the wheels is wrong in both
        machine.machine.wheel_radius_u_1 or 0.0 if by_accelerometer else 0.0,
    )


def _sample_masses(
    samples: EnergySamples, cycles: pl.DataFrame, manoeuvres: pl.DataFrame
) -> Floats:
    """(n,) mass of machine and load: of the nearest start with that load, growing while it digs."""
    state = manoeuvres["load_id"].to_numpy()
    weight = manoeuvres["mass_std_kg"].to_numpy() ** -2.0
    by_state = means_by_state(manoeuvres["mass_kg"].to_numpy(), weight, state)
    middle = (manoeuvres["start_t_ns"] + manoeuvres["end_t_ns"]).to_numpy() / 2.0
    order = np.argsort(middle)
    middle, level = middle[order], by_state[state][order]
    between = (middle[1:] + middle[:-1]) / 2.0
    mass_kg = level[np.searchsorted(between, samples.t_ns)]
    t_ns = samples.t_ns
    for row in cycles.iter_rows(named=True):
        if row["dig_t_ns"] is None or row["load_s"] is None:
            continue
        dug = row["dig_t_ns"] + np.array([0, int(row["load_s"] * NS_PER_S)])
        begin, first, last, end = np.searchsorted(t_ns, [row["start_t_ns"], *dug, row["end_t_ns"]])
        own = (middle >= row["start_t_ns"]) & (middle <= row["end_t_ns"])
        empty, loaded = row["empty_before_kg"], row["loaded_kg"]
        # of a cycle without a mass the starts on either side of the pile have theirs
        if empty is None or loaded is None:
            before, after = level[own & (middle < dug[0])], level[own & (middle > dug[1])]
            if not before.size or not after.size:
                continue
            empty, loaded = before[-1], after[0]
        filling = samples.digs[first:last]
        # the bucket fills while the machine pushes into the pile
        grown = np.cumsum(filling) / max(int(filling.sum()), 1)
        mass_kg[begin:first] = empty
        mass_kg[first:last] = empty + (loaded - empty) * grown
        mass_kg[last:end] = loaded
    return mass_kg

"""The drive of a log by the joint fit: samples, masses, force model and motion errors."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import polars as pl

from analysis.cycles.energy_integrals import (
    EnergySamples,
    MotionErrors,
    PhaseIntegrals,
    PhaseSpan,
    advance_force_samples,
    collect_energy_samples,
    compute_centred_speed_and_acceleration,
    count_trailing_mean_delay_rows,
    drop_driving_samples_under_brakes,
    integrate_energy_terms_over_phases,
)
from analysis.cycles.energy_terms import (
    ForceModel,
    estimate_unfitted_coulomb_std_newtons,
    read_force_model_and_u,
    read_motion_errors_and_u,
)
from analysis.model.machine import Machine
from analysis.model.physical_units import NS_PER_S
from analysis.weighing.load_states import compute_weighted_mean_mass_by_state_kg
from estimators.arrays import Floats, Ints


@dataclass(frozen=True)
class FittedDrive:
    """Samples of a log, with the results of the joint fit.

    Attributes:
        samples: samples, with driving stretches at the times when the force acts.
        move_rows: uncertainty of the ends of the driving stretches, in rows.
        mass_kg: (n,) mass of machine and load.
        rotating_kg: equivalent rotating mass.
        ground_N: (n,) force between tyres and ground without digging.
        model: force model, and its standard uncertainties.
        errors: errors of force and motion, and their standard uncertainties.
        coulomb_N: standard deviation of Coulomb friction if the fit has no such term; else 0.
        speed_u_1: relative standard uncertainty of the wheel speed if the acceleration is from an
            accelerometer; else 0.
    """

    samples: EnergySamples
    move_rows: int
    mass_kg: Floats
    rotating_kg: float
    ground_N: Floats
    model: ForceModel
    model_u: ForceModel
    errors: MotionErrors
    errors_u: MotionErrors
    coulomb_N: float
    speed_u_1: float

    def integrate_over_phases(self, spans: list[PhaseSpan]) -> PhaseIntegrals:
        """Integrals over each phase."""
        return integrate_energy_terms_over_phases(
            self.samples, spans, self.mass_kg, self.rotating_kg, self.errors, self.ground_N
        )


def compute_ground_force_newtons(
    excitation: pl.DataFrame, machine: Machine, mass_kg: Floats, model: ForceModel
) -> Floats:
    """Force that accelerates the masses against friction, including brakes, (n,) in N.

    Computed after the moving mean: slip depends on force and speed, and vibration in both would add
    up to work.
    """
    v, a = compute_centred_speed_and_acceleration(excitation, machine)
    resisted = model.viscous * v + model.direction * np.sign(v) + model.quadratic * v * np.abs(v)
    return mass_kg * a + model.constant_force_without_offset_newtons + resisted


def collect_fitted_drive(frames: Mapping[str, pl.DataFrame], machine: Machine) -> FittedDrive:
    """Collect the samples of a log, with masses and force model from the joint fit."""
    grids = frames["aligned"], frames["excitation"], frames["digging"]
    cycles, manoeuvres = frames["cycles"], frames["manoeuvres"]
    mass_kg = estimate_total_mass_of_samples_kg(
        collect_energy_samples(*grids, machine), cycles, manoeuvres
    )
    model, model_u = read_force_model_and_u(frames, mass_kg, machine.settings.priors)
    errors, errors_u = read_motion_errors_and_u(frames["nuisances"], model, machine)
    samples = collect_energy_samples(*grids, machine, model.offset)
    mass_kg = estimate_total_mass_of_samples_kg(samples, cycles, manoeuvres)
    samples = advance_force_samples(samples, errors.force_delay_s)
    friction = model.viscous, model.direction
    by_accelerometer = machine.settings.forces.acceleration == "specific_force"
    return FittedDrive(
        drop_driving_samples_under_brakes(
            samples, frames["excitation"], machine, mass_kg, *friction
        ),
        max(count_trailing_mean_delay_rows(machine), 1),
        mass_kg,
        machine.machine.rotating_mass_kg,
        compute_ground_force_newtons(frames["excitation"], machine, mass_kg, model),
        model,
        model_u,
        errors,
        errors_u,
        estimate_unfitted_coulomb_std_newtons(frames, mass_kg, machine),
        # with an acceleration from the wheels, both have the same relative error
        machine.machine.wheel_radius_u_1 or 0.0 if by_accelerometer else 0.0,
    )


def estimate_total_mass_of_samples_kg(
    samples: EnergySamples, cycles: pl.DataFrame, manoeuvres: pl.DataFrame
) -> Floats:
    """Mass of machine and load, (n,) in kg, by the nearest start; it grows during digging."""
    state = manoeuvres["load_id"].to_numpy()
    weight = manoeuvres["mass_std_kg"].to_numpy() ** -2.0
    by_state = compute_weighted_mean_mass_by_state_kg(
        manoeuvres["mass_kg"].to_numpy(), weight, state
    )
    middle = (manoeuvres["start_t_ns"] + manoeuvres["end_t_ns"]).to_numpy() / 2.0
    order = np.argsort(middle)
    starts = _StartMasses(middle[order], by_state[state][order])
    t_ns = samples.t_ns
    mass_kg = starts.look_up_masses_of_nearest_starts_kg(t_ns)
    for row in cycles.iter_rows(named=True):
        if row["dig_t_ns"] is None or row["load_s"] is None:
            continue
        start, end = row["start_t_ns"], row["end_t_ns"]
        digs, filled = row["dig_t_ns"], row["dig_t_ns"] + int(row["load_s"] * NS_PER_S)
        begin, first, last, stop = np.searchsorted(t_ns, [start, digs, filled, end])
        # the cycle's own starts before and after the pile, else those of the adjacent cycles
        before = starts.select_starts_between(
            start, digs, row["empty_before_kg"] or row["empty_after_kg"]
        )
        after = starts.select_starts_between(filled, end, row["loaded_kg"])
        if before is None or after is None:
            continue
        mass_kg[begin:first] = before.look_up_masses_of_nearest_starts_kg(t_ns[begin:first])
        mass_kg[last:stop] = after.look_up_masses_of_nearest_starts_kg(t_ns[last:stop])
        filling = samples.digs[first:last]
        # the bucket fills while the machine pushes into the pile
        grown = np.cumsum(filling) / max(int(filling.sum()), 1)
        empty, loaded = before.mass_kg[-1], after.mass_kg[0]
        mass_kg[first:last] = empty + (loaded - empty) * grown
    return mass_kg


class _StartMasses(NamedTuple):
    """Starts in order of time: the middle time of each, and the mean mass of its load state."""

    middle_ns: Floats
    mass_kg: Floats

    def select_starts_between(
        self, start_ns: int, end_ns: int, default_kg: float | None
    ) -> "_StartMasses | None":
        """Starts between two times; without any, one with mass `default_kg`, or None."""
        chosen = (self.middle_ns >= start_ns) & (self.middle_ns <= end_ns)
        if chosen.any():
            return _StartMasses(self.middle_ns[chosen], self.mass_kg[chosen])
        if default_kg is None:
            return None
        return _StartMasses(np.array([float(start_ns)]), np.array([default_kg]))

    def look_up_masses_of_nearest_starts_kg(self, t_ns: Ints) -> Floats:
        """Mass of the start nearest to each time, (n,) in kg."""
        halfway = (self.middle_ns[1:] + self.middle_ns[:-1]) / 2.0
        return self.mass_kg[np.searchsorted(halfway, t_ns)]

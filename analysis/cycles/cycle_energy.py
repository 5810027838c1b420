"""Energy of each cycle and phase: work of the drive, its parts and their uncertainties.

    work = kinetic + slope + friction + digging

Work is the energy at the wheels while the drive pushes, including turning. Kinetic is the part that
accelerates the masses, slope the part that lifts them, digging the part that a pile absorbs in
excess of friction, and friction the rest: rolling, driveline, slip and scrubbing. Braking is the
energy lost while the drive does not push, less the friction meanwhile; it comes from kinetic and
slope energy, and is not part of the sum. Masses, offset, lag, load transfer and friction are those
of the joint fit.
"""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from itertools import pairwise
from typing import Any, Final, NamedTuple

import numpy as np
import polars as pl

from analysis.cycles.cycle_limits import LIMITS
from analysis.cycles.energy_integrals import (
    EnergyIntegrals,
    Floats,
    PhaseIntegrals,
    PhaseSpan,
    delay_force_samples,
    sum_fuel_litres,
)
from analysis.cycles.energy_terms import (
    ForceModel,
    combine_relative_work_u_and_missing_settings,
    compute_relative_common_and_individual_mass_u,
    perturb_terms_one_by_one,
)
from analysis.cycles.fitted_drive import FittedDrive, collect_fitted_drive
from analysis.model.machine import Machine
from analysis.model.physical_units import NS_PER_S
from analysis.weighing.friction_warming import WARMING

#: Parts of an energy, in the order of all tables.
PARTS: Final = ("work", "kinetic", "slope", "friction", "digging", "braking")
#: Phases of a cycle, in time.
PHASES: Final = ("return", "load", "haul", "dump")
#: The whole cycle, or the whole shift.
WHOLE: Final = "whole"
#: Joules of a kilowatt hour.
J_PER_KWH: Final = 3.6e6


class EnergyAmount(NamedTuple):
    """An energy with its standard uncertainty, in kWh."""

    kWh: float
    u_kWh: float


class EnergyRow(NamedTuple):
    """Energies of a phase, a cycle or the shift, in kWh with their uncertainty.

    Attributes:
        cycle: number of the cycle; None for the whole shift.
        phase: one of `PHASES`, or `WHOLE`.
        work: work of the drive at the wheels.
        kinetic: part of the work that accelerates the masses.
        slope: part of the work that lifts the masses.
        friction: the remaining part of the work.
        digging: part of the work done on the pile.
        braking: energy taken out by brakes and motor.
        fuel_L: fuel burnt, in L; None without a fuel-rate channel.
    """

    cycle: int | None
    phase: str
    work: EnergyAmount
    kinetic: EnergyAmount
    slope: EnergyAmount
    friction: EnergyAmount
    digging: EnergyAmount
    braking: EnergyAmount
    fuel_L: float | None = None


class ShiftEnergy(NamedTuple):
    """Energies of a shift and its cycles.

    Attributes:
        rows: the shift, whole and by phase, then each cycle; a cycle with a gap or with incomplete
            phases has fewer rows or none.
        scale_unknown: missing settings, separated by commas, without which the uncertainties
            exclude the scale of the force.
        fuel_u_1: relative standard uncertainty of the fuel; None if not stated.
    """

    rows: tuple[EnergyRow, ...] = ()
    scale_unknown: str = ""
    fuel_u_1: float | None = None


#: Result for a log without masses.
NO_ENERGY: Final = ShiftEnergy()


def compute_shift_energy(
    frames: Mapping[str, pl.DataFrame], machine: Machine, long_gaps_ns: Sequence[tuple[int, int]]
) -> ShiftEnergy:
    """Compute the energy of each cycle and of the shift.

    Args:
        frames: frames of the run: aligned, excitation, digging, cycles, manoeuvres, loads,
            nuisances, budget.
        machine: machine of the replay.
        long_gaps_ns: see `cycles_lost_in_gaps.find_spans_of_missing_channels_ns`.

    Returns:
        The energies; without rows if there is no mass or no cycle.
    """
    manoeuvres = frames["manoeuvres"]
    spans = split_cycles_into_phases(frames["cycles"], long_gaps_ns)
    no_mass = frames["loads"]["mass_kg"].is_null().all()
    if not spans or no_mass or manoeuvres.is_empty() or manoeuvres["mass_kg"].null_count():
        return NO_ENERGY
    drive = collect_fitted_drive(frames, machine)
    found = drive.integrate_over_phases(spans)
    value = split_energy_by_phase_and_part_joules(found, drive.model)
    if value[:, PARTS.index("work")].sum() <= 0.0:
        return NO_ENERGY
    gain_u_1, unknown = combine_relative_work_u_and_missing_settings(machine)
    common_1, random_1 = compute_relative_common_and_individual_mass_u(frames)
    common = [
        *compute_energy_changes_by_term_u_joules(drive, spans, found, value),
        gain_u_1 * value,
    ]
    common.append(common_1 * compute_energy_change_by_mass_error_joules(found))
    random = estimate_random_energy_u_joules(found, value, drive.model, random_1, spans)
    fuel_L = sum_fuel_litres(drive.samples, spans)
    rows = _make_energy_rows(spans, value, np.array(common), random, fuel_L)
    return ShiftEnergy(rows, unknown, machine.machine.fuel_gain_u)


def compute_energy_changes_by_term_u_joules(
    drive: FittedDrive, spans: list[PhaseSpan], integrals: PhaseIntegrals, energy_J: Floats
) -> list[Floats]:
    """Changes of the energy by one standard uncertainty of each term, (phases, parts) in J each."""
    model = drive.model
    forces = [
        *perturb_terms_one_by_one(model, drive.model_u),
        shift_viscous_to_coulomb_friction(integrals, model, drive.coulomb_N),
    ]
    moved = [
        replace(drive, errors=each)
        for each in perturb_terms_one_by_one(drive.errors, drive.errors_u)
    ]
    earlier, later = (
        split_energy_by_phase_and_part_joules(
            replace(drive, samples=each).integrate_over_phases(spans), model
        )
        - energy_J
        for each in (delay_force_samples(drive.samples, way * drive.move_rows) for way in (-1, 1))
    )
    return [
        *(split_energy_by_phase_and_part_joules(integrals, each) - energy_J for each in forces),
        *(
            split_energy_by_phase_and_part_joules(each.integrate_over_phases(spans), model)
            - energy_J
            for each in moved
        ),
        # if the machine stands after one end, only the shift in the other direction has an effect
        np.where(abs(later) >= abs(earlier), later, -earlier),
        compute_energy_change_by_slope_joules(integrals, model),
        compute_energy_change_by_mean_residual_force_joules(integrals, energy_J, model),
        drive.speed_u_1 * compute_energy_change_by_speed_error_joules(energy_J),
    ]


def split_cycles_into_phases(
    cycles: pl.DataFrame, long_gaps_ns: Sequence[tuple[int, int]]
) -> list[PhaseSpan]:
    """Spans of the phases of the cycles that lack at most `energy_gap_s` of data.

    A cycle whose phases were not all seen is one span.
    """
    spans: list[PhaseSpan] = []
    for row in cycles.iter_rows(named=True):
        start, end = row["start_t_ns"], row["end_t_ns"]
        hidden_ns = sum(max(min(e, end) - max(s, start), 0) for s, e in long_gaps_ns)
        if hidden_ns > LIMITS.energy_gap_s * NS_PER_S:
            continue
        edges = list_phase_edges_ns(row)
        if edges is None:
            spans.append(PhaseSpan(row["cycle"], WHOLE, start, end))
            continue
        spans += [
            PhaseSpan(row["cycle"], phase, begin, stop)
            for phase, (begin, stop) in zip(PHASES, pairwise(edges), strict=True)
        ]
    return spans


def list_phase_edges_ns(cycle_row: Mapping[str, Any]) -> list[int] | None:
    """Start of each phase of a cycle and end of the last, in ns; None if some were not seen."""
    if cycle_row["dig_t_ns"] is None or cycle_row["load_s"] is None or cycle_row["haul_s"] is None:
        return None
    loaded = cycle_row["dig_t_ns"] + int(cycle_row["load_s"] * NS_PER_S)
    hauled = loaded + int(cycle_row["haul_s"] * NS_PER_S)
    edges = [cycle_row["start_t_ns"], cycle_row["dig_t_ns"], loaded, hauled, cycle_row["end_t_ns"]]
    return edges if sorted(edges) == edges else None


def split_energy_by_phase_and_part_joules(integrals: PhaseIntegrals, model: ForceModel) -> Floats:
    """Energy of each phase, split into `PARTS`, (phases, parts) in J."""
    drive, dig, slow = integrals.drive, integrals.dig, integrals.slow
    straight = compute_drive_work_by_phase_joules(drive, model)
    work = straight + integrals.turning_J
    slope = (
        drive["mass"]
        - integrals.kinetic_J
        + model.constant_force_without_offset_newtons * drive["offset"]
    )
    digging = compute_drive_work_by_phase_joules(
        dig, model
    ) - compute_friction_work_by_phase_joules(dig, model)
    friction = work - integrals.kinetic_J - slope - digging
    braking = -compute_inertia_and_friction_work_joules(slow, model)
    return np.stack([work, integrals.kinetic_J, slope, friction, digging, braking], axis=1)


def compute_drive_work_by_phase_joules(integrals: EnergyIntegrals, model: ForceModel) -> Floats:
    """Work of the drive: measured work minus the work of force errors, (phases,) in J."""
    return (
        integrals["force"]
        - model.transfer * integrals["transfer"]
        - model.gain_drift * integrals["gain_drift"]
        - model.offset * integrals["offset"]
    )


def compute_inertia_and_friction_work_joules(
    integrals: EnergyIntegrals, model: ForceModel
) -> Floats:
    """Work done on masses and fitted friction, (phases,) in J."""
    return (
        integrals["mass"]
        + model.constant_force_without_offset_newtons * integrals["offset"]
        + model.viscous * integrals["viscous"]
        + sum(getattr(model, name) * integrals[name] for name in WARMING)
        + model.direction * integrals["direction"]
        + model.quadratic * integrals["quadratic"]
    )


def compute_friction_work_by_phase_joules(integrals: EnergyIntegrals, model: ForceModel) -> Floats:
    """Work of the drive against friction and slip without a pile, (phases,) in J."""
    return compute_inertia_and_friction_work_joules(integrals, model) + integrals["slip"]


def compute_energy_change_by_slope_joules(integrals: PhaseIntegrals, model: ForceModel) -> Floats:
    """Uncertainty of the energy by the load transfer on slopes, (phases, parts) in J.

    The energies assume that a slope transfers load like an acceleration. The effect may be partial,
    so it is uncertain by its size over √3.
    """
    share = model.transfer / np.sqrt(3.0)
    work, dig = (share * of["transfer_slope"] for of in (integrals.drive, integrals.dig))
    nothing = np.zeros_like(work)
    return np.stack([work, nothing, nothing, work - dig, dig, nothing], axis=1)


def compute_energy_change_by_speed_error_joules(energy_J: Floats) -> Floats:
    """Change of the energy by a relative speed error of 1, (phases, parts) in J.

    Torque times wheel speed does not change; a larger speed makes the fitted masses smaller and the
    distance longer. The change of the kinetic energy equals that of the slope energy with opposite
    sign.
    """
    changed = np.zeros_like(energy_J)
    changed[:, PARTS.index("kinetic")] = energy_J[:, PARTS.index("kinetic")]
    changed[:, PARTS.index("slope")] = -energy_J[:, PARTS.index("kinetic")]
    return changed


def shift_viscous_to_coulomb_friction(
    integrals: PhaseIntegrals, model: ForceModel, additional_coulomb_N: float
) -> ForceModel:
    """Force model with more Coulomb and less viscous friction, with equal total work."""
    way_m, viscous = (integrals.drive[name].sum() for name in ("direction", "viscous"))
    less_N_s_m = additional_coulomb_N * way_m / viscous if viscous else 0.0
    return replace(
        model, direction=model.direction + additional_coulomb_N, viscous=model.viscous - less_N_s_m
    )


def compute_energy_change_by_mean_residual_force_joules(
    integrals: PhaseIntegrals, energy_J: Floats, model: ForceModel
) -> Floats:
    """Change of the energy by the mean unexplained force, (phases, parts) in J."""
    left_N = compute_unexplained_work_by_phase_joules(integrals, energy_J, model).sum() / max(
        integrals.drive["direction"].sum(), 1.0
    )
    dig, slow = left_N * integrals.dig["direction"], left_N * integrals.slow["direction"]
    nothing, slope = np.zeros_like(dig), left_N * integrals.drive["offset"]
    return np.stack([nothing, nothing, slope, -dig - slope, dig, slow], axis=1)


def compute_unexplained_work_by_phase_joules(
    integrals: PhaseIntegrals, energy_J: Floats, model: ForceModel
) -> Floats:
    """Work not explained by masses, fitted friction or digging, (phases,) in J."""
    explained = (
        compute_friction_work_by_phase_joules(integrals.drive, model)
        + energy_J[:, PARTS.index("digging")]
    )
    return compute_drive_work_by_phase_joules(integrals.drive, model) - explained


def compute_energy_change_by_mass_error_joules(integrals: PhaseIntegrals) -> Floats:
    """Change of the energy by a relative error of 1 of all masses, (phases, parts) in J."""
    lifted = integrals.drive["mass"] - integrals.kinetic_J
    dug = -integrals.dig["mass"]
    friction = -integrals.kinetic_J - lifted - dug
    nothing = np.zeros_like(lifted)
    return np.stack(
        [nothing, integrals.kinetic_J, lifted, friction, dug, -integrals.slow["mass"]], axis=1
    )


def estimate_random_energy_u_joules(
    integrals: PhaseIntegrals,
    energy_J: Floats,
    model: ForceModel,
    relative_mass_u: float,
    spans: list[PhaseSpan],
) -> Floats:
    """Random uncertainty between cycles, by masses and fit residual, (phases, parts) in J."""
    drive, dig = integrals.drive, integrals.dig
    left = compute_unexplained_work_by_phase_joules(integrals, energy_J, model)
    way_m = drive["direction"]
    number = np.unique([span.cycle for span in spans], return_inverse=True)[1]
    left_N = np.bincount(number, left) / np.maximum(np.bincount(number, way_m), 1.0)
    scatter_N = (
        float(left_N.std(ddof=1)) if left_N.size >= LIMITS.friction_scatter_min_cycles else 0.0
    )
    mass = abs(relative_mass_u * compute_energy_change_by_mass_error_joules(integrals))
    ways = np.zeros_like(energy_J)
    ways[:, PARTS.index("work")] = ways[:, PARTS.index("friction")] = way_m
    ways[:, PARTS.index("digging")] = dig["direction"]
    ways[:, PARTS.index("braking")] = integrals.slow["direction"]
    return np.hypot(mass, scatter_N * ways)


def _make_energy_rows(
    spans: list[PhaseSpan], energy_J: Floats, common_u_J: Floats, random_u_J: Floats, fuel_L: Floats
) -> tuple[EnergyRow, ...]:
    """Rows of the shift, whole and by phase, then of each cycle."""
    cycle = np.array([span.cycle for span in spans])
    phase = np.array([span.phase for span in spans])

    def make_row(cycle_number: int | None, name: str) -> EnergyRow:
        of = (phase == name) if name != WHOLE else np.ones(cycle.size, np.bool_)
        if cycle_number is not None:
            of = of & (cycle == cycle_number)
        # the random error is the same within a cycle, but independent between cycles
        own = np.unique(cycle[of], return_inverse=True)[1]
        by_cycle = [np.bincount(own, random_u_J[of, part]) for part in range(len(PARTS))]
        u = np.hypot(
            np.linalg.norm(common_u_J[:, of].sum(axis=1), axis=0),
            [float(np.linalg.norm(each)) for each in by_cycle],
        )
        energy = energy_J[of].sum(axis=0)
        pairs = zip(energy / J_PER_KWH, u / J_PER_KWH, strict=True)
        work, kinetic, slope, friction, digging, braking = (
            EnergyAmount(round(float(e), 7), round(float(w), 7)) for e, w in pairs
        )
        litres = float(fuel_L[of].sum())
        burnt_L = round(litres, 4) if np.isfinite(litres) else None
        return EnergyRow(
            cycle_number, name, work, kinetic, slope, friction, digging, braking, burnt_L
        )

    shift = [make_row(None, name) for name in (WHOLE, *PHASES)]
    own: list[EnergyRow] = []
    for number in np.unique(cycle).tolist():
        mine = phase[cycle == number].tolist()
        own += [
            make_row(number, WHOLE),
            *(make_row(number, name) for name in mine if name != WHOLE),
        ]
    return (*shift, *own)

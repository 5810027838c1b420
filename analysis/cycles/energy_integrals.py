"""Integrals of force, speed and acceleration over the phases of cycles, for their energies.

Each energy is linear in the parameters of the joint fit (offset of the force, load transfer,
friction), so that one pass over the samples gives both its value and its uncertainty.
"""

from dataclasses import dataclass, replace
from typing import Final, NamedTuple

import numpy as np
import polars as pl

from analysis.cycles.cycle_limits import LIMITS
from analysis.model.machine import Machine
from analysis.model.machine_body import Body
from analysis.model.physical_units import NS_PER_S, SECONDS_PER_HOUR
from analysis.model.schema import get_column_values
from analysis.stages.motion.forces import (
    compute_longitudinal_force,
    compute_regressor_acceleration,
    compute_yaw_torque,
)
from analysis.weighing.friction_warming import WARMING
from analysis.weighing.motion_samples import compute_ground_to_wheel_speed_ratio
from estimators.arrays import Bools, Floats, Ints


class PhaseSpan(NamedTuple):
    """A phase of a cycle: its first sample, and the first after it, in ns."""

    cycle: int
    phase: str
    start_ns: int
    end_ns: int


@dataclass(frozen=True)
class MotionErrors:
    """Errors of the measured force and speed relative to those at the ground.

    Attributes:
        force_delay_s: delay of the force behind the acceleration.
        speed_delay_s: delay of the speed behind the acceleration.
        slip_1_N: wheel slip per newton, as a fraction of the speed.
    """

    force_delay_s: float
    speed_delay_s: float
    slip_1_N: float


@dataclass(frozen=True)
class EnergySamples:
    """Samples of a log before the moving mean, (n,) each; 0 where unknown.

    Attributes:
        t_ns: time since the first sample.
        step_s: duration of each sample; 0 at a gap.
        force_N: measured force of all driven wheels.
        speed_m_s: speed of the wheels.
        acceleration_m_s2: acceleration that multiplies the mass, including gravity.
        turning_W: power of the yaw torque.
        progress: from -1/2 to 1/2 over the log, as in the joint fit.
        drives: whether the drive supplies energy.
        digs: whether the drive supplies energy in a digging start.
        fuel_L_h: fuel rate; None without a channel.
        slows: whether the machine moves without being driven or stopped by a pile.
    """

    t_ns: Ints
    step_s: Floats
    force_N: Floats
    speed_m_s: Floats
    acceleration_m_s2: Floats
    turning_W: Floats
    progress: Floats
    drives: Bools
    digs: Bools
    slows: Bools
    fuel_L_h: Floats | None = None


def collect_energy_samples(
    aligned: pl.DataFrame,
    excitation: pl.DataFrame,
    digging: pl.DataFrame,
    machine: Machine,
    offset_N: float = 0.0,
) -> EnergySamples:
    """Collect the samples of a log.

    The drive supplies energy where the smoothed force along the motion exceeds its noise, so that
    noise while coasting or standing adds no energy.

    Args:
        aligned: the grid, before the moving mean.
        excitation: frame with the smoothed force and the phases, on the same grid.
        digging: the frame `digging`.
        machine: machine file with wheel radius, force share and choice of acceleration.
        offset_N: offset of the measured force, which does no work.
    """
    t_ns = aligned["t_ns"].to_numpy()
    step_s = np.diff(t_ns, append=t_ns[-1:]) / NS_PER_S
    step_s = np.where(step_s > LIMITS.longest_sample_s, 0.0, step_s)
    speed = get_column_values(aligned, "speed_x_m_s")
    force = compute_longitudinal_force(aligned, machine.machine)
    acceleration = compute_regressor_acceleration(aligned, machine)
    known = np.isfinite(speed) & np.isfinite(force) & np.isfinite(acceleration)
    known &= ~aligned["gap"].to_numpy()
    smooth_N, smooth_m_s = (
        shift_trailing_mean_to_centre(excitation, name, machine)
        for name in ("force_x_N", "speed_x_m_s")
    )
    turning = np.where(known, compute_turning_power_watts(aligned, machine.machine), 0.0)
    stands, turns = (
        mark_phase_samples(excitation, name, machine, value_if_unknown=unknown)
        for name, unknown in (("standstill", True), ("spinning", False))
    )
    moves = known & ~stands
    smooth_N = smooth_N - offset_N
    reached_N = float(np.quantile(np.abs(smooth_N[moves]), 0.95)) if moves.any() else 0.0
    pushes = smooth_N * np.sign(smooth_m_s) > LIMITS.min_drive_force_fraction * reached_N
    drives = moves & np.where(turns, turning > 0.0, pushes)
    digs = np.zeros(t_ns.size, np.bool_)
    for start, end in digging.select("start_t_ns", "end_t_ns").iter_rows():
        first, last = np.searchsorted(t_ns, [start, end])
        # after a digging start it is the pile that stops the machine
        rests = np.flatnonzero(stands[last:])
        digs[first : last + (int(rests[0]) if rests.size else 0) + 1] = True
    return EnergySamples(
        t_ns,
        step_s,
        np.where(known, force, 0.0),
        np.where(known, speed, 0.0),
        np.where(known, acceleration, 0.0),
        turning,
        np.arange(t_ns.size) / max(t_ns.size, 1) - 0.5,
        drives,
        drives & digs,
        moves & ~drives & ~turns & ~digs,
        get_column_values(aligned, "fuel_rate_L_h") if "fuel_rate_L_h" in aligned.columns else None,
    )


def find_first_and_end_row_of_phases(samples: EnergySamples, spans: list[PhaseSpan]) -> Ints:
    """First row of each phase, and the row after its last, (phases, 2)."""
    ends = [(span.start_ns, span.end_ns) for span in spans]
    return np.searchsorted(samples.t_ns, ends).reshape(-1, 2)


def sum_fuel_litres(samples: EnergySamples, spans: list[PhaseSpan]) -> Floats:
    """Fuel of each phase in L, including standstill, (phases,); NaN if the rate is unknown."""
    if samples.fuel_L_h is None:
        return np.full(len(spans), np.nan)
    litres = np.nan_to_num(samples.fuel_L_h) * samples.step_s / SECONDS_PER_HOUR
    unknown_s = np.where(np.isnan(samples.fuel_L_h), samples.step_s, 0.0)
    fuel_L, lost_s = (
        np.array(
            [
                each[first:last].sum()
                for first, last in find_first_and_end_row_of_phases(samples, spans)
            ]
        )
        for each in (litres, unknown_s)
    )
    return np.where(lost_s > LIMITS.longest_sample_s, np.nan, fuel_L)


def drop_driving_samples_under_brakes(
    samples: EnergySamples,
    excitation: pl.DataFrame,
    machine: Machine,
    mass_kg: Floats,
    viscous_N_s_m: float,
    coulomb_N: float,
) -> EnergySamples:
    """Mark samples as not driven if brakes absorb more power than the drive supplies.

    The measured force does not include unmeasured brakes.

    Args:
        samples: samples of the log.
        excitation: frame with smoothed acceleration and speed.
        machine: machine file, for the length of the moving mean.
        mass_kg: (n,) mass of machine and load.
        viscous_N_s_m: viscous friction by the joint fit.
        coulomb_N: Coulomb friction by the joint fit.
    """
    speed, acceleration = compute_centred_speed_and_acceleration(excitation, machine)
    along = mass_kg * acceleration * np.sign(speed) + viscous_N_s_m * np.abs(speed) + coulomb_N
    spins = mark_phase_samples(excitation, "spinning", machine, value_if_unknown=False)
    braked = samples.drives & ~samples.digs & ~spins & (along < 0.0)
    return replace(samples, drives=samples.drives & ~braked, slows=samples.slows | braked)


def advance_force_samples(samples: EnergySamples, force_delay_s: float) -> EnergySamples:
    """Shift the driving stretches from the time of measurement to the time of action."""
    sampled = samples.step_s[samples.step_s > 0.0]
    rows = round(force_delay_s / float(np.median(sampled))) if sampled.size else 0
    return delay_force_samples(samples, -rows)


def delay_force_samples(samples: EnergySamples, delay_rows: int) -> EnergySamples:
    """Delay the driving stretches by a number of rows.

    The force of a motor falls gradually, so the end of a stretch is known to half the moving mean
    at best.
    """
    drives, digs, slows = (
        np.roll(each, delay_rows) for each in (samples.drives, samples.digs, samples.slows)
    )
    return replace(samples, drives=drives, digs=digs, slows=slows)


def compute_centred_speed_and_acceleration(
    excitation: pl.DataFrame, machine: Machine
) -> tuple[Floats, Floats]:
    """Speed, and acceleration that multiplies the mass, by the centred moving mean, (n,) each."""
    names = ("speed_x_m_s", "regressor_acc_x_m_s2")
    speed, acceleration = (
        shift_trailing_mean_to_centre(excitation, name, machine) for name in names
    )
    return speed, acceleration


def shift_trailing_mean_to_centre(
    excitation: pl.DataFrame, column_name: str, machine: Machine
) -> Floats:
    """Column after the trailing mean, advanced by half its length, (n,); 0 where unknown."""
    return np.roll(
        np.nan_to_num(get_column_values(excitation, column_name)),
        -count_trailing_mean_delay_rows(machine),
    )


def mark_phase_samples(
    excitation: pl.DataFrame, phase_column: str, machine: Machine, *, value_if_unknown: bool
) -> Bools:
    """Flags of the samples in a phase, (n,), corrected for the delay of the trailing mean."""
    found = (excitation["phase"] == phase_column).fill_null(value=value_if_unknown).to_numpy()
    return np.roll(found, -count_trailing_mean_delay_rows(machine))


def count_trailing_mean_delay_rows(machine: Machine) -> int:
    """Delay of the excitation's trailing mean, in rows."""
    return (machine.settings.smooth.samples - 1) // 2


def compute_turning_power_watts(aligned: pl.DataFrame, body: Body) -> Floats:
    """Power of the yaw torque, (n,) in W; 0 unless both sides are measured."""
    torque = compute_yaw_torque(aligned, body)
    if torque is None or "yaw_rate_rad_s" not in aligned.columns:
        return np.zeros(aligned.height)
    return np.nan_to_num(torque * get_column_values(aligned, "yaw_rate_rad_s"))


#: Integrals over each set of samples, in J per unit of their parameter; v is the wheel speed in
#: those with the force, otherwise the ground speed.
_TERMS: Final = (
    "force",  # ∫ F v
    "transfer",  # ∫ a F v
    "transfer_slope",  # of it, by gravity's part of a
    "gain_drift",  # ∫ progress F v
    "offset",  # ∫ v
    "mass",  # ∫ m a v, gravity included
    "viscous",  # ∫ v²
    *WARMING,  # ∫ share(progress) v²
    "direction",  # ∫ |v|
    "quadratic",  # ∫ |v|³
    "slip",  # ∫ F (v of the wheels - v of the ground)
)


@dataclass(frozen=True)
class EnergyIntegrals:
    """Integrals by phase, (phases,) each, over one set of samples, by name."""

    by_term: dict[str, Floats]

    def __getitem__(self, name: str) -> Floats:
        return self.by_term[name]


@dataclass(frozen=True)
class PhaseIntegrals:
    """Integrals of all phases.

    Attributes:
        drive: integrals over samples in which the drive supplies energy.
        dig: integrals over those of these samples that are in a digging start.
        slow: integrals over motion without drive.
        kinetic_J: kinetic energy added by the drive.
        turning_J: work of the yaw torque.
    """

    drive: EnergyIntegrals
    dig: EnergyIntegrals
    slow: EnergyIntegrals
    kinetic_J: Floats
    turning_J: Floats


def integrate_energy_terms_over_phases(
    samples: EnergySamples,
    spans: list[PhaseSpan],
    mass_kg: Floats,
    rotating_kg: float,
    motion_errors: MotionErrors,
    ground_N: Floats,
) -> PhaseIntegrals:
    """Integrate all energy terms over each phase.

    Args:
        samples: samples of the log.
        spans: spans of the phases.
        mass_kg: (n,) mass of machine and load, on the scale of the measured force.
        rotating_kg: equivalent rotating mass.
        motion_errors: errors of force and speed.
        ground_N: (n,) force between tyres and ground without digging.
    """
    force = advance_sample_column(samples, "force_N", motion_errors.force_delay_s)
    wheels = advance_sample_column(samples, "speed_m_s", motion_errors.speed_delay_s)
    # brakes cause slip as well, without a measured force
    slipping_N = np.where(samples.digs, force, ground_N)
    speed = wheels * compute_ground_to_wheel_speed_ratio(wheels, slipping_N, motion_errors.slip_1_N)
    step_s, fast = samples.step_s, np.abs(speed)
    # half the difference of the squares on either side, so that the gain of a stretch is the
    # difference between its ends
    squares = np.pad(speed**2, 1, mode="edge")
    gained = np.where(step_s > 0.0, (squares[2:] - squares[:-2]) / 4.0, 0.0)
    power = force * wheels
    speeds = np.pad(speed, 1, mode="edge")
    gained_speed = np.where(step_s > 0.0, (speeds[2:] - speeds[:-2]) / 2.0, 0.0)
    by_term = {
        "force": power * step_s,
        "transfer": samples.acceleration_m_s2 * power * step_s,
        "transfer_slope": (samples.acceleration_m_s2 * step_s - gained_speed) * power,
        "gain_drift": samples.progress * power * step_s,
        "offset": wheels * step_s,
        "mass": mass_kg * samples.acceleration_m_s2 * speed * step_s + rotating_kg * gained,
        "viscous": speed**2 * step_s,
        **{
            name: shape.share(samples.progress) * speed**2 * step_s
            for name, shape in WARMING.items()
        },
        "direction": fast * step_s,
        "quadratic": fast**3 * step_s,
        "slip": force * (wheels - speed) * step_s,
    }
    edges = find_first_and_end_row_of_phases(samples, spans)

    def integrate_samples(x: Floats, samples_of_set: Bools) -> Floats:
        total = np.append(0.0, np.cumsum(np.where(samples_of_set, x, 0.0)))
        return total[edges[:, 1]] - total[edges[:, 0]]

    def integrate_terms(samples_of_set: Bools) -> EnergyIntegrals:
        return EnergyIntegrals(
            {name: integrate_samples(by_term[name], samples_of_set) for name in _TERMS}
        )

    return PhaseIntegrals(
        integrate_terms(samples.drives),
        integrate_terms(samples.digs),
        integrate_terms(samples.slows),
        integrate_samples((mass_kg + rotating_kg) * gained, samples.drives),
        integrate_samples(samples.turning_W * step_s, samples.drives),
    )


def advance_sample_column(samples: EnergySamples, column_name: str, delay_s: float) -> Floats:
    """Column of the samples advanced by its delay, (n,)."""
    x: Floats = getattr(samples, column_name)
    if not delay_s:
        return x
    t_s = samples.t_ns / NS_PER_S
    return np.interp(t_s + delay_s, t_s, x)

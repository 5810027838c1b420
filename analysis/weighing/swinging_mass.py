"""A mass that swings relative to the machine: a hanging load, a liquid, a mast, a coupled wagon.

A mass m on a spring and a damper, driven by the acceleration a of the machine, moves relative to
the machine by y:

    y'' + 2 ζ ω y' + ω² y = -a        F = M a + m y'' + ...        M includes m

The force is thus not M a while the mass swings, for many seconds after a start if ζ is small, and a
single mass explains it by friction, delays and loads that the machine does not have (Abramson, The
Dynamic Behavior of Liquids in Moving Containers, NASA SP-106, chapter 6, for liquids; Den Hartog,
Mechanical Vibrations, chapter 3, for springs). Frequency and damping are those with the smallest
residual of the force; the masses are parameters of the joint fit.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import product
from typing import Final, NamedTuple, Self

import numpy as np

from analysis.stages.signals.grid_rate import count_rows_in_duration
from analysis.weighing.column_inputs import ColumnInputs
from analysis.weighing.fit_columns import RelativeLoads
from analysis.weighing.fitted_stretches import advance_signal_by_delay
from analysis.weighing.joint_result import JointFit
from analysis.weighing.motion_samples import Bools, Floats, Ints, MotionSamples
from analysis.weighing.nuisances import Nuisance
from analysis.weighing.stretch_means import list_indices_of_samples_in_whole_blocks
from analysis.weighing.weighing_limits import LIMITS
from analysis.weighing.wheel_kinematics import differentiate_wheel_speed
from estimators.interpreted import compiled_unless_short_log
from estimators.numerics.group_sums import fit_slope_of_each_group

#: Name of the budget entry of all terms.
BY_SWING: Final = "swing"


def _make_swinging_mass_term(term_name: str, *, by_load: bool) -> Nuisance:
    """Make the term of the mass at the mean load, or that of its growth with the load."""

    def make_column(inputs: ColumnInputs) -> Floats:
        assert inputs.swing_m_s2 is not None
        return inputs.swing_m_s2 * inputs.relative_load if by_load else inputs.swing_m_s2

    return Nuisance(
        term_name,
        "kg",
        make_column,
        lambda motion, _: LIMITS.swinging_mass_prior_share * motion.approximate_mass_kg,
        "a mass that swings relative to the machine: a hanging load, a liquid, a mast",
        "starts without jerks; pauses until nothing swings",
        # far above its frequency the mass stays where it is, and y'' is -a
        by_acceleration=lambda m: -m.relative_load if by_load else -np.ones(m.speed.size),
        applies=lambda motion: motion.swing_m_s2 is not None,
        by_load=by_load,
        source=BY_SWING,
    )


#: Added to a fit whose log shows a swinging mass.
SWINGING_MASS: Final = (
    _make_swinging_mass_term("swinging_mass", by_load=False),
    _make_swinging_mass_term("swinging_mass_by_load", by_load=True),
)


@dataclass(frozen=True, slots=True)
class SwingingMass:
    """How a mass swings relative to the machine.

    Attributes:
        frequency_hz: natural frequency at the mean mass of the machine.
        damping_1: damping ratio.
        growth_1: relative growth of the mass on the spring per relative growth of the machine's
            mass; 0 for a frequency that does not depend on the load, as that of a pendulum.
        restarts: whether the mass hangs still after each stop, as after a change of load.
        loads: relative masses of the manoeuvres.
        mass_kg: swinging mass at the mean load.
    """

    frequency_hz: float
    damping_1: float
    growth_1: float
    restarts: bool
    loads: RelativeLoads
    mass_kg: float = 0.0

    def add_swing_to_motion(self, motion: MotionSamples) -> MotionSamples:
        """Copy of the motion with the swing."""
        return replace(motion, swing_m_s2=self.compute_relative_acceleration_m_s2(motion))

    def compute_relative_acceleration_m_s2(self, motion: MotionSamples) -> Floats:
        """Acceleration y'' of the mass relative to the machine, (n,) in m/s²."""
        load = self.loads.look_up_relative_loads(motion.manoeuvre_of_sample)
        mass_ratio = (1.0 + self.growth_1 * load).clip(*LIMITS.swinging_mass_ratios)
        omega_1_s = 2.0 * np.pi * self.frequency_hz / np.sqrt(mass_ratio)
        stops = motion.earlier_stop_count
        number = motion.manoeuvre_of_sample if stops is None else stops
        is_still = (np.diff(number, prepend=number[:1]) != 0) & self.restarts
        return integrate_relative_acceleration_m_s2(
            motion.acceleration, omega_1_s, self.damping_1, is_still, motion.rate_hz
        )


def subtract_swing_force(motion: MotionSamples, fit: JointFit) -> MotionSamples:
    """Copy of the motion without the force of the swinging mass of a fit, if it has one."""
    if motion.swing_m_s2 is None:
        return motion
    common_kg, by_load_kg = (fit.estimate_of_term(term.name) for term in SWINGING_MASS)
    loads = fit.previous_estimates.relative_loads
    load = 0.0 if loads is None else loads.look_up_relative_loads(motion.manoeuvre_of_sample)
    swing_N = (common_kg + by_load_kg * load) * motion.swing_m_s2
    if fit.is_force_advanced_by_lag:  # the measured force is late
        delay_rows = fit.force_delay_s * motion.rate_hz
        swing_N = advance_signal_by_delay(swing_N, motion.stretch_of_sample, -delay_rows)
    return replace(motion, force=motion.force - swing_N)


@compiled_unless_short_log
def integrate_relative_acceleration_m_s2(
    acceleration: Floats, omega_1_s: Floats, damping_1: float, is_still: Bools, rate_hz: float
) -> Floats:
    """Acceleration y'' of a sprung mass relative to its base, (n,) in m/s².

    The trapezoidal rule (Newmark 1959, with β = 1/4), with the frequency warped so that the
    resonance is at ω.

    Args:
        acceleration: (n,) acceleration of the base in m/s².
        omega_1_s: (n,) natural frequency in rad/s, below π times the rate.
        damping_1: damping ratio.
        is_still: (n,) whether the mass hangs still before the sample.
        rate_hz: rate of the samples.
    """
    out = np.empty(acceleration.size)
    h, y, rate, second = 1.0 / rate_hz, 0.0, 0.0, 0.0
    for k in range(acceleration.size):
        if is_still[k]:
            y, rate, second = 0.0, 0.0, 0.0
        omega = 2.0 / h * np.tan(0.5 * h * omega_1_s[k])
        damping, stiffness = 2.0 * damping_1 * omega, omega * omega
        half_rate = rate + 0.5 * h * second
        ahead = y + h * rate + 0.25 * h * h * second
        following = -acceleration[k] - damping * half_rate - stiffness * ahead
        following /= 1.0 + 0.5 * h * damping + 0.25 * h * h * stiffness
        y = ahead + 0.25 * h * h * following
        rate = half_rate + 0.5 * h * following
        out[k] = second = following
    return out


def find_swinging_mass(motion: MotionSamples) -> SwingingMass | None:
    """Find a mass whose swinging explains the force; None if the log does not show one.

    The acceleration is that of the wheels: a body that pitches tilts an accelerometer.
    """
    if motion.by_accelerometer:
        acceleration = differentiate_wheel_speed(motion)
        # an unknown speed is 0, and would be a kick
        most_m_s2 = float(np.abs(acceleration[motion.is_fittable]).max(initial=0.0))
        motion = replace(motion, acceleration=acceleration.clip(-most_m_s2, most_m_s2))
    rows = _ResidualRows.from_motion(motion, LIMITS.swing_row_s)
    if rows is None:
        return None
    lowest_hz = LIMITS.swing_min_periods / rows.typical_drive_s
    highest_hz = motion.rate_hz / LIMITS.swing_min_samples_per_period
    tried_hz = [hz for hz in LIMITS.swing_frequencies_hz if lowest_hz <= hz <= highest_hz]
    most, hz, restarts = rows.find_largest_explained_share(tried_hz)
    ratio = LIMITS.swing_peak_ratio
    between_hz = max(hz / ratio, lowest_hz), hz * ratio
    rivals = [other_hz for other_hz in tried_hz if not hz / ratio < other_hz < hz * ratio]
    # too slow a grid, or too short drives, have few
    if most < LIMITS.swing_min_share or len(rivals) < LIMITS.swing_min_rivals:
        return None
    # longer rows have less noise of the acceleration, and hold all of a slow swing
    longer = _ResidualRows.from_motion(motion, LIMITS.swing_row_periods / hz) or rows
    found, fitted = longer.refine_swinging_mass(longer.make_swinging_mass(hz, restarts), between_hz)
    # the swing has hidden the loads on which its frequency depends
    longer = longer.copy_with_loads_beside_swing(fitted.force_N)
    found, _ = longer.refine_swinging_mass(replace(found, loads=longer.loads), between_hz)
    # what decays at once, or never, or has the frequency of a bound, is another force
    is_inside = _is_well_between(found.damping_1, LIMITS.swing_damping_range_1)
    is_inside &= _is_well_between(found.frequency_hz, between_hz)
    is_inside &= found.mass_kg > LIMITS.swinging_mass_min_share * motion.approximate_mass_kg
    if not (is_inside and longer.explains_differences_between_drives(found)):
        return None
    # a mass with another frequency explains little of what a mass that swings leaves
    rest = rows.copy_without_swing(found)
    left = rest.residual_square / rows.residual_square
    other, _, _ = rest.find_largest_explained_share(tried_hz)
    return found if 1.0 - left >= LIMITS.swing_min_share_ratio * left * other else None


def _is_well_between(value: float, bounds: tuple[float, float]) -> bool:
    """Whether a value is not at its bounds."""
    margin = 1.0 + LIMITS.swing_difference_step
    return bounds[0] * margin < value < bounds[1] / margin


@dataclass(frozen=True)
class _ResidualRows:
    """Force that masses by manoeuvre, friction, delay and stiffness leave unexplained.

    Attributes:
        motion: the samples up to the last row.
        sample: (rows, block) samples of each row, which is their mean.
        manoeuvre: (rows,) index of the row's manoeuvre.
        acceleration: (rows,) in m/s².
        force: (rows,) in N.
        terms: (rows, k) columns of the terms that need no swinging mass.
        known: (rows, k) orthonormal form of these columns without masses.
        residual_N: (rows,) force without masses and these terms.
        loads: relative masses of the manoeuvres.
    """

    motion: MotionSamples
    sample: Ints
    manoeuvre: Ints
    acceleration: Floats
    force: Floats
    terms: Floats
    known: Floats
    residual_N: Floats
    loads: RelativeLoads

    @classmethod
    def from_motion(cls, motion: MotionSamples, row_s: float) -> Self | None:
        """Rows of so many seconds of the first manoeuvres; None if there are too few."""
        block = count_rows_in_duration(row_s, motion.rate_hz)
        sample = list_indices_of_samples_in_whole_blocks(motion.stretch_of_sample, block)
        sample = sample[: LIMITS.swing_max_rows * block].reshape(-1, block)
        number, acceleration = motion.manoeuvre_of_sample, motion.acceleration
        accelerates = np.unique(number[sample[acceleration[sample].mean(axis=1) != 0.0, 0]])
        sample = sample[np.isin(number[sample[:, 0]], accelerates)]
        if not sample.size:
            return None
        motion = motion.cut_to_first_stretches(int(motion.stretch_of_sample[sample[-1, 0]]) + 1)
        ids, manoeuvre = np.unique(number[sample[:, 0]], return_inverse=True)
        if ids.size < LIMITS.swing_min_manoeuvres:
            return None
        jerk, bend = differentiate_means_twice(motion.acceleration, block, motion.rate_hz)
        inputs = motion.acceleration, motion.force, motion.speed, jerk, bend, motion.travelled_m
        acceleration, force, speed, jerk, bend, travelled_m = (
            x[sample].mean(axis=1) for x in inputs
        )
        one_way = motion.direction[sample[:, 0]]
        constant, drag = np.ones(speed.size), speed * np.abs(speed)
        ground = travelled_m, travelled_m**2, one_way * travelled_m, one_way * travelled_m**2
        terms = [speed, constant, one_way, drag, jerk, bend, *ground]
        loads = RelativeLoads.from_masses(ids, np.ones(ids.size), (0.0, 0.0))
        assert loads is not None
        scaled = np.column_stack([x / max(np.linalg.norm(x), np.finfo(float).tiny) for x in terms])
        nothing = np.empty((speed.size, 0))
        rows = cls(motion, sample, manoeuvre, acceleration, force, scaled, nothing, force, loads)
        free = np.column_stack([rows.subtract_masses(x) for x in scaled.T])
        basis, sizes, _ = np.linalg.svd(free, full_matrices=False)
        rows = replace(rows, known=basis[:, sizes > LIMITS.swing_rounding_1 * sizes[0]])
        residual_N = rows.subtract_known(force)
        if not np.linalg.norm(residual_N) > LIMITS.swing_rounding_1 * np.linalg.norm(force):
            return None  # the terms explain all of it
        rows = replace(rows, residual_N=residual_N)
        return rows.copy_with_loads_beside_swing(np.zeros(speed.size))

    @property
    def typical_drive_s(self) -> float:
        """Median duration of a manoeuvre's rows, in s."""
        rows_s = np.bincount(self.manoeuvre) * self.sample.shape[1] / self.motion.rate_hz
        return float(np.median(rows_s))

    def subtract_masses(self, column: Floats) -> Floats:
        """Subtract from a column what a mass of each manoeuvre explains (Frisch, Waugh, Lovell)."""
        return column - self.acceleration * self.fit_masses_kg(column)[self.manoeuvre]

    def fit_masses_kg(self, force: Floats) -> Floats:
        """Mass of each manoeuvre, (manoeuvres,) in kg, that explains a force alone."""
        return fit_slope_of_each_group(self.acceleration, self.manoeuvre, force)

    def subtract_known(self, column: Floats) -> Floats:
        """Subtract masses and known terms from a column."""
        left = self.subtract_masses(column)
        return left - self.known @ (self.known.T @ left)

    def copy_with_loads_beside_swing(self, swing_N: Floats) -> Self:
        """Copy with the relative masses of the manoeuvres beside a swing's force (rows,)."""
        force = self.force - swing_N
        free = np.column_stack([self.subtract_masses(x) for x in self.terms.T])
        weights = np.linalg.lstsq(free, self.subtract_masses(force), rcond=None)[0]
        masses_kg = self.fit_masses_kg(force - self.terms @ weights)
        loads = RelativeLoads.from_masses(self.loads.manoeuvre_ids, masses_kg, (0.0, 0.0))
        return self if loads is None else replace(self, loads=loads)

    def make_swinging_mass(self, frequency_hz: float, restarts: bool) -> SwingingMass:
        """A mass with the damping of the search, whose frequency does not depend on the load."""
        return SwingingMass(frequency_hz, LIMITS.swing_damping_1, 0.0, restarts, self.loads)

    @property
    def residual_square(self) -> float:
        """Sum of the residual's squares, in N²."""
        return float(self.residual_N @ self.residual_N)

    def copy_without_swing(self, mass: SwingingMass) -> Self:
        """Copy whose residual is without what a mass explains."""
        return replace(self, residual_N=self.residual_N - self.fit_swing(mass).unknown_N)

    def find_largest_explained_share(
        self, frequencies_hz: Sequence[float]
    ) -> tuple[float, float, bool]:
        """Find the mass that explains the largest share of the residual's squares.

        Returns:
            The share, the frequency in Hz, and whether the mass hangs still after each stop.
        """
        left: list[tuple[float, float, bool]] = []
        for hz, restarts in product(frequencies_hz, (True, False)):
            mass = self.make_swinging_mass(hz, restarts)
            left.append((self.copy_without_swing(mass).residual_square, hz, restarts))
        least, hz, restarts = min(left, default=(self.residual_square, 0.0, False))
        return 1.0 - least / self.residual_square, hz, restarts

    def explains_differences_between_drives(self, mass: SwingingMass) -> bool:
        """Whether a mass explains more than a force by the time in the drive, as of its gears."""
        first_sample = self.sample[:, 0]
        begin = np.full(self.loads.manoeuvre_ids.size, first_sample[-1])
        np.minimum.at(begin, self.manoeuvre, first_sample)
        steps_per_row = mass.frequency_hz / LIMITS.swing_time_periods / self.motion.rate_hz
        step = ((first_sample - begin[self.manoeuvre]) * steps_per_row).astype(np.int64)
        is_forwards = self.motion.direction[first_sample] > 0.0
        _, group = np.unique(2 * step + is_forwards, return_inverse=True)

        def subtract_means(force_N: Floats) -> Floats:
            return force_N - (np.bincount(group, force_N) / np.bincount(group))[group]

        swing_N = self.fit_swing(mass).unknown_N
        other_N = subtract_means(swing_N)
        square = float(other_N @ other_N)
        are_alike = square < LIMITS.swing_min_difference_share * float(swing_N @ swing_N)
        explained = float(other_N @ subtract_means(self.residual_N))
        return are_alike or explained > LIMITS.swing_min_difference_ratio * square

    def fit_swing(self, mass: SwingingMass) -> "_FittedSwing":
        """Fit the swinging mass at the mean load, and its growth with the relative load."""
        swing = mass.compute_relative_acceleration_m_s2(self.motion)[self.sample].mean(axis=1)
        columns = np.column_stack([swing, swing * self.loads.value[self.manoeuvre]])
        free = np.column_stack([self.subtract_known(x) for x in columns.T])
        masses_kg = np.linalg.lstsq(free, self.residual_N, rcond=None)[0].astype(np.float64)
        return _FittedSwing(masses_kg, columns @ masses_kg, free @ masses_kg)

    def refine_swinging_mass(
        self, start: SwingingMass, between_hz: tuple[float, float]
    ) -> tuple[SwingingMass, "_FittedSwing"]:
        """Refine frequency, damping and growth; the swinging mass, and its force."""
        from scipy.optimize import least_squares

        def make_from_logs(logs_and_growth: Floats) -> SwingingMass:
            hz, damping_1 = np.exp(logs_and_growth[:2]).tolist()
            growth_1 = float(logs_and_growth[2])
            return replace(start, frequency_hz=hz, damping_1=damping_1, growth_1=growth_1)

        slowest, fastest = np.log(between_hz).tolist()
        least_damping, most_damping = np.log(LIMITS.swing_damping_range_1).tolist()
        least_growth, most_growth = LIMITS.swinging_mass_growth_range_1
        solved = least_squares(
            lambda x: self.residual_N - self.fit_swing(make_from_logs(x)).unknown_N,
            np.array([np.log(start.frequency_hz), np.log(start.damping_1), start.growth_1]),
            bounds=(
                [slowest, least_damping, least_growth],
                [fastest, most_damping, most_growth],
            ),
            x_scale=LIMITS.swing_refining_steps,
            diff_step=np.full(3, LIMITS.swing_difference_step),
        )
        found = make_from_logs(solved.x)
        fitted = self.fit_swing(found)
        return replace(found, mass_kg=float(fitted.masses_kg[0])), fitted


class _FittedSwing(NamedTuple):
    """Force of a swinging mass as fitted.

    Attributes:
        masses_kg: (2,) swinging mass at the mean load, and its growth with the relative load.
        force_N: (rows,) its force.
        unknown_N: (rows,) the part of it that masses and known terms do not explain.
    """

    masses_kg: Floats
    force_N: Floats
    unknown_N: Floats


def differentiate_means_twice(
    acceleration: Floats, block: int, rate_hz: float
) -> tuple[Floats, Floats]:
    """First and second derivative of an acceleration averaged over blocks, (n,) each."""
    mean = np.full(block, 1.0 / block)
    jerk = np.gradient(np.convolve(acceleration, mean, "same")) * rate_hz
    return jerk, np.gradient(np.convolve(jerk, mean, "same")) * rate_hz

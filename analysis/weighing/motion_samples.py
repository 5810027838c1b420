"""Samples of straight motion on the grid before the moving mean, and where they may be fitted.

The trailing mean of the first moving samples includes standstill, where friction balances any
force: a start would then seem to have no Coulomb friction. So the fit uses the samples before the
mean, from the break-away on, and averages within a manoeuvre only.
"""

import math
from dataclasses import dataclass, field, fields, replace
from functools import cached_property
from typing import Any, Final, Protocol

import numpy as np
import polars as pl

from analysis.model.machine import Machine
from analysis.model.schema import get_column_values
from analysis.model.windows import flag_rows_near_flagged_rows
from analysis.stages.motion.forces import compute_longitudinal_force, compute_regressor_acceleration
from analysis.stages.signals.grid_rate import count_rows_in_duration
from analysis.weighing.fitted_stretches import (
    advance_signal_by_delay,
    assign_fitted_manoeuvre_numbers,
    assign_one_way_run_numbers,
    clear_stretch_numbers_at_noise_speed,
    compute_index_in_stretch,
    count_runs_so_far,
    extend_manoeuvres_to_break_away,
    find_manoeuvre_direction_of_samples,
    find_stretch_spans,
    integrate_path_positions_and_length_m,
    make_centred_ramp,
    mark_gear_changes,
    mark_rows_from_dig_to_standstill,
    mark_rows_without_data,
    number_manoeuvres_and_split_long_drives,
    read_gear_ratio,
    split_stretches_at_manoeuvres,
)
from analysis.weighing.weighing_limits import LIMITS
from estimators.arrays import Bools, Floats, Ints
from estimators.interpreted import compiled_unless_short_log

#: Smallest ratio of ground to wheel speed: wheels that slip more do not show the ground speed.
_LEAST_GROUND: Final = 0.5
_ARMS: Final = ("boom_rad", "bucket_rad")
#: Samples of a piece that is processed at once, so that it stays in the processor's cache.
_PIECE: Final = 32_768


def select_rows_of_array_fields(record: Any, rows: slice | Ints) -> dict[str, Any]:
    """Rows of each array of a dataclass, by the name of its field."""
    values = {each.name: getattr(record, each.name) for each in fields(record)}
    return {name: x[rows] for name, x in values.items() if isinstance(x, np.ndarray)}


class ColumnNoiseModel(Protocol):
    """Noise model of acceleration, speed and force."""

    def compute_covariance_of_means(self, samples_per_mean: int) -> Floats:
        """(3, 3) noise covariance of a trailing mean of `samples_per_mean` samples."""
        ...


@dataclass(frozen=True)
class CachedNoise:
    """Noise model `columns`, with its covariance cached by the length of the mean."""

    columns: ColumnNoiseModel
    _known: dict[int, Floats] = field(default_factory=dict)

    def compute_covariance_of_means(self, samples_per_mean: int) -> Floats:
        """(3, 3) noise covariance of a trailing mean of `samples_per_mean` samples."""
        if samples_per_mean not in self._known:
            covariance = self.columns.compute_covariance_of_means(samples_per_mean)
            self._known[samples_per_mean] = covariance
        return self._known[samples_per_mean]


@dataclass(frozen=True)
class MotionSamples:
    """The columns of f = m a + b v, (n,) each, and the manoeuvre of each sample.

    Attributes:
        acceleration: factor of the mass, in m/s².
        speed: in m/s.
        force: in N.
        stretch_of_sample: stretch number of each sample that may be fitted; -1 elsewhere.
        direction: 1 forwards, -1 in reverse, by manoeuvre.
        manoeuvre_of_sample: manoeuvre number: motion between two stands, or a part of a long drive.
        rate_hz: rate of the grid.
        specific_force: accelerometer along x in m/s²; None without one.
        without_gravity: `specific_force` minus gravity along x by the pitch; None without a pitch.
        wheel_acceleration: derivative of the wheel speed in m/s², if it is the acceleration.
        progress: from -1/2 to 1/2 over the log.
        driven_m: distance driven since the log began, in either direction.
        path_position_1: position on the path, from -1/2 to 1/2 where fitted.
        path_m: length of the path.
        by_accelerometer: whether the acceleration is from the accelerometer.
        force_share: fraction of the force at the measured wheels.
        empty_weight_N: weight of the empty machine in N, estimated if it is not stated.
        boom_and_bucket_angles_rad: measured angles, as hints of a load change.
        is_digging: whether each sample lies in a digging start; None if unknown.
        empty: whether the machine is stated to be empty at each sample; None if never stated.
        earlier_stop_count: number of earlier stops or gaps; loads change only there; or None.
        long_gap_count: number of earlier gaps that are as long as between two files.
        wheel_radius_u_1: relative standard uncertainty of the wheel radius; None if not stated.
        relative_gear_ratio: gear ratio over the largest of the fitted samples; None without one.
        has_single_load: whether the machine is known to carry one load throughout.
        has_measured_gravity: whether the acceleration includes gravity, by accelerometer or pitch.
        swing_m_s2: acceleration of a swinging mass relative to the machine; None without one.
    """

    acceleration: Floats
    speed: Floats
    force: Floats
    stretch_of_sample: Ints
    direction: Floats
    manoeuvre_of_sample: Ints
    rate_hz: float
    specific_force: Floats | None
    without_gravity: Floats | None
    wheel_acceleration: Floats | None
    progress: Floats
    driven_m: Floats
    path_position_1: Floats
    path_m: float
    by_accelerometer: bool
    force_share: float
    empty_weight_N: float
    boom_and_bucket_angles_rad: tuple[Floats, ...] = ()
    is_digging: Bools | None = None
    empty: Bools | None = None
    earlier_stop_count: Ints | None = None
    long_gap_count: Ints | None = None
    wheel_radius_u_1: float | None = None
    relative_gear_ratio: Floats | None = None
    has_single_load: bool = False
    has_measured_gravity: bool = False
    swing_m_s2: Floats | None = None

    def cut_to_first_stretches(self, stretch_count: int) -> "MotionSamples":
        """Cut the samples to the first stretches."""
        if not self.is_fittable.any() or int(self.stretch_of_sample.max()) < stretch_count:
            return self
        end = int(np.argmax(self.stretch_of_sample >= stretch_count))
        return replace(self._select_samples(slice(0, end)), progress=make_centred_ramp(end))

    def drop_samples_far_from_fitted(self, reach_s: float) -> "MotionSamples":
        """Drop samples that are more than `reach_s` from every fittable sample.

        Shifts of force or speed by up to `reach_s` still find the samples they need.
        """
        size = math.ceil(reach_s * self.rate_hz) + 1
        near = flag_rows_near_flagged_rows(self.is_fittable, size)
        return self._select_samples(np.flatnonzero(near))

    def _select_samples(self, selection: slice | Ints) -> "MotionSamples":
        """Select a subset of the samples."""
        own = select_rows_of_array_fields(self, selection)
        angles_rad = tuple(each[selection] for each in self.boom_and_bucket_angles_rad)
        return replace(self, boom_and_bucket_angles_rad=angles_rad, **own)

    @cached_property
    def pieces_split_between_stretches(self) -> tuple["MotionSamples", ...]:
        """Pieces of whole stretches, each with the surrounding samples that its means need."""
        spans = find_stretch_spans(self.stretch_of_sample)
        whole = np.flatnonzero(np.diff(spans[:, 0] // _PIECE)) + 1
        reach = math.ceil(LIMITS.piece_margin_s * self.rate_hz)
        found: list[MotionSamples] = []
        for stretches in np.split(np.arange(len(spans)), whole):
            start, end = int(spans[stretches[0], 0]), int(spans[stretches[-1], 1])
            piece = self._select_samples(slice(max(start - reach, 0), end + reach))
            stretch = piece.stretch_of_sample
            own = (stretch >= stretches[0]) & (stretch <= stretches[-1])
            found.append(replace(piece, stretch_of_sample=np.where(own, stretch, -1)))
        return tuple(found)

    def exclude_samples(self, is_excluded: Bools) -> "MotionSamples":
        """Exclude the flagged samples from the fit and renumber the stretches."""
        group = np.where(is_excluded, -1, self.stretch_of_sample)
        left = group >= 0
        group[left] = np.unique(group[left], return_inverse=True)[1]
        return replace(self, stretch_of_sample=group)

    def advance_force(self, delay_s: float) -> "MotionSamples":
        """Advance the force by its delay."""
        force = advance_signal_by_delay(self.force, self.stretch_of_sample, delay_s * self.rate_hz)
        return replace(self, force=force)

    def advance_speed(self, delay_s: float) -> "MotionSamples":
        """Advance the speed by its delay."""
        speed = advance_signal_by_delay(self.speed, self.stretch_of_sample, delay_s * self.rate_hz)
        return replace(self, speed=speed)

    @cached_property
    def index_in_stretch(self) -> Ints:
        """Number of earlier samples in the same stretch, (n,)."""
        return compute_index_in_stretch(self.stretch_of_sample)

    @cached_property
    def travelled_m(self) -> Floats:
        """Distance of each sample from the start of its stretch, (n,) in m."""
        way = np.cumsum(np.abs(self.speed)) / self.rate_hz
        return way - way[np.arange(way.size) - self.index_in_stretch]

    @cached_property
    def is_fittable(self) -> Bools:
        """Whether each sample may be fitted, (n,)."""
        return self.stretch_of_sample >= 0

    @cached_property
    def force_95_percentile_newtons(self) -> float:
        """95 % quantile of the force, in N."""
        return float(np.quantile(np.abs(self.force[self.is_fittable]), 0.95))

    @cached_property
    def speed_95_percentile_m_s(self) -> float:
        """95 % quantile of the speed, in m/s."""
        return float(np.quantile(np.abs(self.speed[self.is_fittable]), 0.95))

    @cached_property
    def mean_absolute_speed_m_s(self) -> float:
        """Mean of the absolute speed, in m/s."""
        return float(np.mean(np.abs(self.speed[self.is_fittable])))

    @cached_property
    def approximate_mass_kg(self) -> float:
        """95 % quantile of the force over that of the acceleration, in kg; 0 if undefined."""
        reached = float(np.quantile(np.abs(self.acceleration[self.is_fittable]), 0.95))
        return self.force_95_percentile_newtons / reached if reached else 0.0

    @property
    def has_enough_motion(self) -> bool:
        """Whether force, speed and acceleration are large enough to scale the priors."""
        return self.approximate_mass_kg > 0.0 and self.speed_95_percentile_m_s > 0.0

    @cached_property
    def manoeuvre_count(self) -> int:
        """Number of manoeuvres that may be fitted."""
        return int(np.unique(self.manoeuvre_of_sample[self.is_fittable]).size)

    @cached_property
    def separate_drive_count(self) -> int:
        """Number of drives with fittable samples; a load may change between any two."""
        stops = self.earlier_stop_count
        drive = self.manoeuvre_of_sample if stops is None else stops
        return int(np.unique(drive[self.is_fittable]).size)

    @cached_property
    def record_count(self) -> int:
        """Number of records, separated by gaps."""
        gaps = self.long_gap_count
        return 1 if gaps is None else int(np.unique(gaps[self.is_fittable]).size)

    @cached_property
    def is_short_path_bench_log(self) -> bool:
        """Whether the log is of a bench: motion back and forth on one short path."""
        driven_m = float(np.abs(self.speed).sum()) / self.rate_hz
        return self.drives_both_ways and 0.0 < self.path_m < min(
            LIMITS.bench_path_m, driven_m / LIMITS.bench_min_passes
        )

    @cached_property
    def drives_both_ways(self) -> bool:
        """Whether at least one manoeuvre goes forwards and at least one in reverse."""
        forwards = self.direction[self.is_fittable] > 0
        return bool(forwards.any() and not forwards.all())


def collect_motion_samples(
    aligned: pl.DataFrame,
    excitation: pl.DataFrame,
    gated: pl.DataFrame,
    machine: Machine,
    noise: ColumnNoiseModel,
    stop_count_of_sample: Ints,
    *,
    includes_braking: bool = True,
) -> MotionSamples:
    """Collect the samples of the manoeuvres that the gate found informative.

    Args:
        aligned: grid before the moving mean, with `digs` if known and `left_out` for excluded rows.
        excitation: frame with the phases of motion.
        gated: frame with the accepted windows.
        machine: machine file with wheels and settings.
        noise: noise of the columns.
        stop_count_of_sample: number of earlier stops, the only places where a load changes.
        includes_braking: whether to fit braking too, if the settings count it as driving.
    """
    settings = machine.settings
    speed = get_column_values(aligned, "speed_x_m_s")
    force = compute_longitudinal_force(aligned, machine.machine)
    acceleration = compute_regressor_acceleration(aligned, machine)
    known = np.isfinite(speed) & np.isfinite(force) & np.isfinite(acceleration)
    known &= ~aligned["gap"].to_numpy()
    speed = np.where(known, speed, 0.0)
    digs = mark_rows_from_dig_to_standstill(aligned, excitation, speed, settings)
    noise_m_s = LIMITS.moving_speed_std * float(np.sqrt(noise.compute_covariance_of_means(3)[1, 1]))
    moves_m_s = max(noise_m_s, LIMITS.moving_speed_m_s)
    smoothed_m_s = float(np.sqrt(noise.compute_covariance_of_means(settings.smooth.samples)[1, 1]))
    group = assign_fitted_manoeuvre_numbers(
        excitation, gated, machine, moves_m_s, smoothed_m_s, includes_braking=includes_braking
    )
    filtered = any(channel.is_derivative for channel in machine.channels.values())
    mixed = LIMITS.mixed_friction_filtered_samples if filtered else LIMITS.mixed_friction_samples
    settled = max(mixed, round(LIMITS.mixed_friction_s * settings.align.rate_hz))
    group = extend_manoeuvres_to_break_away(
        np.where(digs, -1, group),
        speed,
        moves_m_s,
        round(LIMITS.break_away_look_back_s * settings.align.rate_hz),
        settled,
    )
    # a margin to gaps: a lag shifts the force, and its derivative uses samples on both sides
    clear = count_rows_in_duration(LIMITS.gap_margin_s, settings.align.rate_hz)
    ratio = read_gear_ratio(aligned)
    silent = ~known | mark_rows_without_data(aligned)
    silent |= mark_gear_changes(aligned, ratio, settings.align.rate_hz)
    left_out = digs | flag_rows_near_flagged_rows(silent, clear)
    group = assign_one_way_run_numbers(np.where(left_out, -1, group), speed, mixed)
    group = clear_stretch_numbers_at_noise_speed(group, speed, noise_m_s)
    measured = _read_known_grid_column(aligned, "specific_force_x_m_s2", known)
    pitch = _read_known_grid_column(aligned, "pitch_rad", known)
    level = None
    if measured is not None and pitch is not None:
        level = measured - machine.machine.gravity_m_s2 * np.sin(pitch)
    manoeuvre = number_manoeuvres_and_split_long_drives(
        stop_count_of_sample,
        count_rows_in_duration(LIMITS.longest_manoeuvre_s, settings.align.rate_hz),
    )
    longest_hole = count_rows_in_duration(LIMITS.record_break_s, settings.align.rate_hz)
    long_gap_count = count_runs_so_far(~known, longest_hole)
    group = split_stretches_at_manoeuvres(group, manoeuvre)
    return MotionSamples(
        np.where(known, acceleration, 0.0),
        speed,
        np.where(known, force, 0.0),
        group,
        find_manoeuvre_direction_of_samples(group, speed),
        manoeuvre,
        settings.align.rate_hz,
        measured,
        level,
        _read_known_grid_column(aligned, "acc_x_m_s2", known)
        if machine.differentiates_wheel_speed
        else None,
        make_centred_ramp(speed.size),
        np.cumsum(np.abs(speed)) / settings.align.rate_hz,
        *integrate_path_positions_and_length_m(
            speed, group >= 0, long_gap_count, settings.align.rate_hz
        ),
        settings.forces.acceleration == "specific_force",
        machine.machine.force_share,
        estimate_empty_machine_gravity_force(machine, acceleration, force, group >= 0),
        tuple(get_column_values(aligned, name) for name in _ARMS if name in aligned.columns),
        aligned["digs"].to_numpy() if "digs" in aligned.columns else None,
        mark_samples_of_stated_empty_span(aligned, machine),
        stop_count_of_sample,
        long_gap_count,
        machine.machine.wheel_radius_u_1,
        None if ratio is None else ratio / ratio[group >= 0].max(initial=np.finfo(float).tiny),
        settings.loads.single_load,
        settings.forces.acceleration == "specific_force" or pitch is not None,
    )


@compiled_unless_short_log
def compute_ground_to_wheel_speed_ratio(speed: Floats, force: Floats, slip_1_N: float) -> Floats:
    """Ground speed over wheel speed, (n,), for a slip of κ = F / C."""
    return 1.0 / np.maximum(1.0 + slip_1_N * force * np.sign(speed), _LEAST_GROUND)


def estimate_empty_machine_gravity_force(
    machine: Machine, acceleration: Floats, force: Floats, used_samples: Bools
) -> float:
    """Weight of the empty machine in N; if not stated, estimated from force and acceleration."""
    body = machine.machine
    if body.empty_mass_kg is not None or not used_samples.any():
        return (body.empty_mass_kg or 0.0) * body.gravity_m_s2
    largest = (float(np.quantile(np.abs(x[used_samples]), 0.95)) for x in (force, acceleration))
    of_force, of_acceleration = largest
    return body.gravity_m_s2 * of_force / max(of_acceleration, 1e-3)


def mark_samples_of_stated_empty_span(aligned: pl.DataFrame, machine: Machine) -> Bools | None:
    """Flags (n,) of the time when the machine is empty by `settings.loads`; None if not set."""
    loads = machine.settings.loads
    if loads.empty_from_s is None or loads.empty_to_s is None:
        return None
    t_s = aligned["t_ns"].to_numpy() / 1e9
    return (t_s >= loads.empty_from_s) & (t_s <= loads.empty_to_s)


def _read_known_grid_column(aligned: pl.DataFrame, name: str, has_value: Bools) -> Floats | None:
    if name not in aligned.columns:
        return None
    return np.where(has_value, get_column_values(aligned, name), 0.0)

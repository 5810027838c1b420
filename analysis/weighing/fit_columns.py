"""The columns of the fit: means inside the stretches, thinned, and what noise is in them."""

import math
from dataclasses import dataclass, replace
from typing import Self

import numpy as np

from analysis.stages.signals.grid_rate import rows_in_duration
from analysis.weighing.haul_route import Route
from analysis.weighing.lever_arm import NO_SWING, BodySwing
from analysis.weighing.motion_samples import (
    Bools,
    ColumnNoiseModel,
    Floats,
    Ints,
    MotionSamples,
    first_of_stretch,
    last_of_stretch,
    rolling_fraction,
)
from analysis.weighing.nuisances import Moments, Nuisance
from analysis.weighing.weighing_limits import LIMITS
from estimators.numerics import group_sums
from estimators.numerics.fit_loss import group_rows
from estimators.numerics.group_mean import trailing_group_means
from estimators.numerics.group_sums import NoiseMoments
from estimators.threads import map_in_threads


def are_masses_possible(mass_kg: Floats) -> Bools:
    """(n,) which masses a machine can have beside the others: none carries its own mass."""
    return (mass_kg > 0.0) & (mass_kg < LIMITS.max_mass_over_median * np.median(mass_kg))


@dataclass(frozen=True, slots=True)
class RelativeLoads:
    """The mass that each manoeuvre moves over a reference mass, less 1.

    Attributes:
        unit: (units,) numbers of the manoeuvres, ascending.
        value: (units,) of each.
        weight_shares: of the constant force and of Coulomb friction, what is expected to be in
            proportion to the weight.
    """

    unit: Ints
    value: Floats
    weight_shares: tuple[float, float]

    @classmethod
    def from_masses(
        cls, unit: Ints, mass_kg: Floats, weight_shares: tuple[float, float]
    ) -> Self | None:
        """Relate (units,) masses to their mean; None where they are no masses.

        One that is none is taken for a usual one: it would be the contrast of all loads.
        """
        mass_kg = np.where(are_masses_possible(mass_kg), mass_kg, np.median(mass_kg))
        reference_kg = float(np.mean(mass_kg))
        if not reference_kg > 0.0:
            return None
        value = np.clip(
            mass_kg / reference_kg - 1.0,
            -LIMITS.largest_relative_load,
            LIMITS.largest_relative_load,
        )
        return cls(unit, value, weight_shares)

    def standardised_load_of(self, unit: Ints) -> Floats:
        """Relative load of these manoeuvres, over the root mean square of all."""
        return self.relative_load_of(unit) / max(float(np.sqrt(np.mean(self.value**2))), 1e-9)

    def is_loaded_in(self, unit: Ints) -> Bools:
        """Whether samples of these manoeuvres haul, (n,)."""
        return self.relative_load_of(unit) > float(
            np.quantile(self.value, LIMITS.load_contrast_quantiles).mean()
        )

    def relative_load_of(self, unit: Ints) -> Floats:
        """Relative load of samples of these manoeuvres, (n,); unknown ones take the one before."""
        place = np.searchsorted(self.unit, unit, "right") - 1
        return self.value[place.clip(0, self.unit.size - 1)]


@dataclass(frozen=True, slots=True)
class PreviousEstimates:
    """Estimates of earlier rounds, on which columns that are products depend.

    Attributes:
        lag_s: how late the force is.
        slip_1_N: share of the ground's speed that a newton makes the wheels slip.
        transfer_s2_m: share of the force that the measured wheels gain a m/s² of acceleration.
        offset_N: what the measured force is too large by.
        slip_s_m: what slip costs, as a share of the force a m/s.
        speed_late_s: how late the speed is, by the wheels.
        motion_gain: share of the acceleration's own part, without gravity's, that is added to it.
        swing: what a swinging body adds to the accelerometer.
        relative_loads: of the load states; None where there is one.
        route: between where they are loaded and dumped; None where none is dumped.
        uneven_1_s: how much the ground's force differs from stretch to stretch, in variances of the
            noise of a second.
    """

    lag_s: float = 0.0
    slip_1_N: float = 0.0
    transfer_s2_m: float = 0.0
    offset_N: float = 0.0
    slip_s_m: float = 0.0
    speed_late_s: float = 0.0
    motion_gain: float = 0.0
    swing: BodySwing = NO_SWING
    relative_loads: RelativeLoads | None = None
    route: Route | None = None
    uneven_1_s: float = 0.0

    def ground_force(self, motion: MotionSamples) -> Floats:
        """The force on the ground, (n,) in N, of a motion whose force is in time."""
        gain = 1.0 + self.transfer_s2_m * motion.acceleration
        return (motion.force - self.offset_N) / np.maximum(gain, LIMITS.load_transfer_min_gain)


@dataclass(frozen=True)
class FitRows:
    """Rows of the fit, weighted by the number of samples of each mean.

    Attributes:
        A: (rows, 2 + terms) columns: acceleration, speed, terms.
        f: (rows,) force.
        group: (rows,) stretch.
        direction: (rows,) of each stretch.
        noise: what noise adds to the normal equations.
        shortest: stretches of fewer rows tell nothing of their own.
        terms: whose columns they are.
    """

    A: Floats
    f: Floats
    group: Ints
    direction: Floats
    noise: NoiseMoments
    shortest: int
    terms: tuple[Nuisance, ...]

    def select_terms(self, terms: tuple[Nuisance, ...]) -> "FitRows":
        """Select the columns of some of the terms."""
        if terms == self.terms:
            return self
        at = np.array([0, 1, *(2 + self.terms.index(term) for term in terms)])
        parts = self.A[:, at], self.noise.gram[:, at[:, None], at], self.noise.cross[:, at]
        # in the order of what was made so: sums depend on it to their last bits
        A, gram, cross = (np.ascontiguousarray(part) for part in parts)
        return replace(self, A=A, noise=NoiseMoments(gram, cross), terms=terms)


@dataclass(frozen=True)
class FitColumns:
    """Columns before averaging, for means of any length.

    Attributes:
        pieces: of the log.
        terms: the nuisances.
        found: by earlier rounds.
        rate_hz: of the grid.
    """

    pieces: list["_PieceColumns"]
    terms: tuple[Nuisance, ...]
    found: PreviousEstimates
    rate_hz: float

    @classmethod
    def from_motion(
        cls,
        motion: MotionSamples,
        noise: ColumnNoiseModel,
        terms: tuple[Nuisance, ...],
        found: PreviousEstimates,
    ) -> Self:
        """Make the columns; the arguments are those of `averages`."""
        pieces = map_in_threads(
            lambda piece: _make_piece_columns(piece, noise, terms, found), list(motion.pieces)
        )
        return cls(pieces, terms, found, motion.rate_hz)

    def average_to_rows(self, noise: ColumnNoiseModel, samples: int) -> FitRows:
        """Average them over so many samples."""
        pieces = map_in_threads(lambda piece: _average_piece(piece, samples), self.pieces)
        return _weigh_piece_rows(
            pieces, noise, self.terms, samples, self.found.uneven_1_s, self.rate_hz
        )


def average_columns(
    motion: MotionSamples,
    noise: ColumnNoiseModel,
    terms: tuple[Nuisance, ...],
    samples: int,
    found: PreviousEstimates,
) -> FitRows:
    """Average the columns with the force moved back by its lag.

    Args:
        motion: the samples.
        noise: of acceleration, speed and force.
        terms: the nuisances.
        samples: longest mean.
        found: by earlier rounds.
    """
    # a piece at a time: the columns of a whole shift are many
    pieces = map_in_threads(
        lambda piece: _average_piece(_make_piece_columns(piece, noise, terms, found), samples),
        list(motion.pieces),
    )
    return _weigh_piece_rows(pieces, noise, terms, samples, found.uneven_1_s, motion.rate_hz)


def _weigh_piece_rows(
    pieces: list["_PieceMeans"],
    noise: ColumnNoiseModel,
    terms: tuple[Nuisance, ...],
    samples: int,
    uneven_1_s: float,
    rate_hz: float,
) -> FitRows:
    """Weigh the rows of all pieces.

    Args:
        pieces: of the log.
        noise: of acceleration, speed and force.
        terms: the nuisances.
        samples: longest mean.
        uneven_1_s: how much stretches' constants differ (`PreviousEstimates`).
        rate_hz: of the grid.
    """
    A = np.concatenate([piece.A for piece in pieces])
    f = np.concatenate([piece.f for piece in pieces])
    counts = np.concatenate([piece.count for piece in pieces])
    # lengths are few and short: counting them is quicker than sorting all rows
    occurs = np.bincount(counts) > 0
    lengths, which = np.flatnonzero(occurs), (np.cumsum(occurs) - 1)[counts]
    covariances = np.stack([noise.covariance(int(length)) for length in lengths])
    weight = _row_weights(A[:, :2], f, covariances, which)
    ends_at = np.cumsum([piece.f.size for piece in pieces])[:-1]
    added = map_in_threads(
        lambda each: _noise_moments(terms, each[0], covariances, each[1], each[2]),
        list(zip(pieces, np.split(which, ends_at), np.split(weight, ends_at), strict=True)),
    )
    A *= weight[:, None]
    f *= weight
    group = np.concatenate([piece.group for piece in pieces])
    if uneven_1_s:
        _whiten_constants(A, f, group, uneven_1_s / rate_hz * mean_stride(samples))
    return FitRows(
        A,
        f,
        group,
        np.concatenate([piece.raw.direction for piece in pieces]),
        NoiseMoments(*(np.concatenate(each) for each in zip(*added, strict=True))),
        max(rows_in_duration(LIMITS.shortest_stretch_s, rate_hz) // mean_stride(samples), 6),
        terms,
    )


def _whiten_constants(A: Floats, f: Floats, group: Ints, ratio: float) -> None:
    """Take off each stretch's mean as much as its constant is unknown (random intercepts).

    Args:
        A: (rows, p) columns, changed in place.
        f: (rows,) likewise.
        group: (rows,) stretch.
        ratio: variance of the constants over that of a row.
    """
    for part in group_rows(group):
        off = 1.0 - 1.0 / np.sqrt(1.0 + ratio * part.size)
        A[part] -= off * A[part].mean(axis=0)
        f[part] -= off * f[part].mean()


@dataclass(frozen=True, slots=True)
class _PieceColumns:
    """Columns of a piece, (terms + 3, n), with its force and the stretch of each sample."""

    values: Floats
    group: Ints
    raw: Moments


@dataclass(frozen=True, slots=True)
class _PieceMeans:
    """Means of a piece: columns, force, stretch and length of each, and its last sample."""

    A: Floats
    f: Floats
    group: Ints
    count: Ints
    raw: Moments


def _make_piece_columns(
    motion: MotionSamples,
    noise: ColumnNoiseModel,
    terms: tuple[Nuisance, ...],
    found: PreviousEstimates,
) -> _PieceColumns:
    """Make the columns of a piece."""
    in_time = motion.shift_force(found.lag_s)
    if found.speed_late_s:
        # what a late speed does to friction goes with the motion, which a specific force is not
        in_time = in_time.shift_speed(found.speed_late_s)
    force, acting, speed = in_time.force, found.ground_force(in_time), in_time.speed
    acceleration = motion.acceleration
    if found.motion_gain:
        own = acceleration if motion.without_gravity is None else motion.without_gravity
        acceleration = acceleration + found.motion_gain * own
    loads = found.relative_loads
    if found.swing.lever_s2 and motion.specific_force is not None:
        # springs give way in proportion to the mass
        by_load = 1.0 if loads is None else 1.0 + loads.relative_load_of(motion.unit)
        swing_m_s2 = found.swing.swing_m_s2(motion.specific_force, motion.rate_hz)
        acceleration = acceleration - by_load * swing_m_s2
    wheels, zeros = motion.wheel_acceleration, np.zeros(speed.size)
    force_std = float(np.sqrt(noise.covariance(1)[2, 2]))
    raw = Moments(
        acceleration,
        zeros if wheels is None else wheels,
        speed,
        rolling_fraction(speed, acting, found.slip_1_N),
        acting,
        _force_rate(force, motion.rate_hz, force_std, whole=wheels is not None),
        motion.direction,
        motion.progress,
        _samples_since_start(motion.group) / motion.rate_hz,
        zeros if loads is None else loads.relative_load_of(motion.unit),
        zeros if loads is None else loads.standardised_load_of(motion.unit),
        motion.place_1,
        _distance_from_start(motion),
        *_route_positions(motion, found),
        found.slip_s_m,
        found.transfer_s2_m,
        (0.0, 0.0) if loads is None else loads.weight_shares,
    )
    group = _drop_first_samples(motion.group, math.ceil(abs(found.lag_s) * motion.rate_hz))
    values = np.empty((len(terms) + 3, group.size))
    values[0], values[1], values[-1] = raw.acceleration, raw.speed, force
    for place, term in enumerate(terms, start=2):
        values[place] = term.column(raw)
    return _PieceColumns(values, group, raw)


def _average_piece(piece: _PieceColumns, samples: int) -> _PieceMeans:
    """Average the columns of a piece, not weighted."""
    kept = np.flatnonzero(_thin_stretches(piece.group, mean_stride(samples)))
    means, count = trailing_group_means(piece.values, piece.group, samples, kept)
    return _PieceMeans(
        means[:, :-1], means[:, -1], piece.group[kept], count, piece.raw.select_rows(kept)
    )


def mean_stride(samples: int) -> int:
    """Every so many-th mean of so many samples is fitted."""
    return max(1, samples // LIMITS.rows_per_mean)


def _samples_since_start(group: Ints) -> Ints:
    """How many samples of its stretch are before each, (n,)."""
    row = np.arange(group.size)
    return row - np.maximum.accumulate(np.where(first_of_stretch(group), row, 0))


def _distance_from_start(motion: MotionSamples) -> Floats:
    """How far each sample is from the begin of its stretch, (n,) in m."""
    way = np.cumsum(np.abs(motion.speed)) / motion.rate_hz
    return way - way[np.arange(way.size) - _samples_since_start(motion.group)]


def _route_positions(motion: MotionSamples, found: PreviousEstimates) -> tuple[Floats, float]:
    """Where each sample is on the route, (n,), and how long that is; 0 where there is none."""
    loads, route = found.relative_loads, found.route
    if loads is None or route is None:
        return np.zeros(motion.speed.size), 0.0
    return route.position(motion), route.length_m


def _drop_first_samples(group: Ints, lag: int) -> Ints:
    """The stretches without their first samples, whose force is from before the break-away."""
    return np.where((_samples_since_start(group) >= lag) | last_of_stretch(group), group, -1)


def _thin_stretches(group: Ints, stride: int) -> Bools:
    """Every so many-th sample of each stretch, and the last of one that has fewer."""
    since = _samples_since_start(group)
    short = last_of_stretch(group) & (since < stride - 1)
    return (group >= 0) & ((since % stride == stride - 1) | short)


def _row_weights(A: Floats, force: Floats, covariances: Floats, which: Ints) -> Floats:
    """Square roots of the rows' weights: the first means of a start are of few samples."""
    mass, friction = np.linalg.lstsq(A, force, rcond=None)[0]
    gradient = np.array([mass, friction, -1.0])
    variances = np.array([gradient @ covariance @ gradient for covariance in covariances])
    if not variances[-1] > 0.0:  # noise that adds up to none is that of every row
        return np.ones(which.size)
    return np.sqrt(variances[-1] / np.maximum(variances[which], variances[-1]))


def _force_rate(force: Floats, rate_hz: float, noise_N: float, *, whole: bool) -> Floats:
    """The derivative of the force in N/s, 0 where it is no more than noise.

    Args:
        force: (n,) in N.
        rate_hz: of the grid.
        noise_N: standard deviation of a sample.
        whole: also where it is small, if next to nothing of it is noise: what slip takes from the
            wheels' acceleration is all of it, and without small values masses were 0.3 % off where
            wheels slip by 2 %.
    """
    half = rows_in_duration(LIMITS.force_rate_half_width_s, rate_hz)
    steps = (
        np.arange(half, -half - 1, -1) * rate_hz / float(2 * (np.arange(1, half + 1) ** 2).sum())
    )
    rate = np.convolve(force, steps, "same")
    std = noise_N * float(np.sqrt(steps @ steps))
    clear = LIMITS.force_rate_min_std if half == 1 else LIMITS.clear_force_rate_std
    if whole and float(np.sqrt(np.mean(rate**2))) > clear * std:
        return rate
    return np.where(np.abs(rate) > LIMITS.force_rate_min_std * std, rate, 0.0)


def _noise_moments(
    terms: tuple[Nuisance, ...],
    piece: _PieceMeans,
    covariances: Floats,
    which: Ints,
    weight: Floats,
) -> tuple[Floats, Floats]:
    """Noise terms of AᵀA and Aᵀf by acceleration, speed and force, by stretch.

    Args:
        terms: the nuisances.
        piece: the rows.
        covariances: (kinds, 3, 3) of means of so many samples.
        which: (rows,) the kind of each.
        weight: (rows,) that rows are multiplied by.
    """
    ids, index = np.unique(piece.group, return_inverse=True)
    # derivatives of the columns by acceleration, speed and force; the others are 0
    slopes, places = [weight, weight], [(0, 0), (1, 1)]
    for j, term in enumerate(terms, start=2):
        for channel, by in enumerate((term.by_acceleration, term.by_speed, term.by_force)):
            if by is not None:
                slopes.append(by(piece.raw) * weight)
                places.append((j, channel))
    return group_sums.noise_moments(
        np.stack(slopes),
        np.array(places, np.int64),
        covariances,
        which,
        index,
        (ids.size, 2 + len(terms)),
    )

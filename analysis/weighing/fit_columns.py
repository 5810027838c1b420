"""Columns of the fit: thinned means inside the stretches, and the noise in them."""

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Self

import numpy as np

from analysis.stages.signals.grid_rate import count_rows_in_duration
from analysis.weighing.body_swing import NO_SWING, BodySwing
from analysis.weighing.column_inputs import ColumnInputs
from analysis.weighing.fitted_stretches import (
    compute_index_in_stretch,
    find_stretch_spans,
    mark_stretch_ends,
)
from analysis.weighing.force_hysteresis import PlayHysteresis, compute_sign_of_force_change
from analysis.weighing.force_rate import (
    add_force_derivatives_to_covariances,
    differentiate_force,
    differentiate_force_by_widest_parabolas,
    differentiate_force_twice,
)
from analysis.weighing.haul_route import HaulRoute
from analysis.weighing.load_limits import LIMITS as LOAD_LIMITS
from analysis.weighing.motion_samples import (
    Bools,
    ColumnNoiseModel,
    Floats,
    Ints,
    MotionSamples,
    compute_ground_to_wheel_speed_ratio,
)
from analysis.weighing.nuisances import Nuisance
from analysis.weighing.weighing_limits import LIMITS
from estimators.interpreted import compiled_with_array_form
from estimators.numerics import group_sums
from estimators.numerics.group_mean import fill_trailing_group_means
from estimators.numerics.group_sums import NoiseMoments
from estimators.threads import map_in_threads


def mark_plausible_masses(mass_kg: Floats) -> Bools:
    """Mark plausible masses, (n,): positive, and not far above the median."""
    return (mass_kg > 0.0) & (mass_kg < LOAD_LIMITS.max_mass_over_median * np.median(mass_kg))


@dataclass(frozen=True, slots=True)
class RelativeLoads:
    """Relative deviation of each manoeuvre's total mass from the mean.

    Attributes:
        manoeuvre_ids: (manoeuvres,) numbers of the manoeuvres, ascending.
        value: (manoeuvres,) mass of each manoeuvre divided by the mean, minus 1.
        weight_shares: expected fractions of the constant force and of Coulomb friction that are
            proportional to the weight.
    """

    manoeuvre_ids: Ints
    value: Floats
    weight_shares: tuple[float, float]

    @classmethod
    def from_masses(
        cls, manoeuvre_numbers: Ints, mass_kg: Floats, weight_shares: tuple[float, float]
    ) -> Self | None:
        """Relate (manoeuvres,) masses to their mean; None if the mean is not positive.

        An implausible mass is replaced by a typical one, since it would dominate the contrast of
        all loads.
        """
        mass_kg = np.where(mark_plausible_masses(mass_kg), mass_kg, np.median(mass_kg))
        reference_kg = float(np.mean(mass_kg))
        if not reference_kg > 0.0:
            return None
        value = np.maximum(mass_kg / reference_kg - 1.0, LIMITS.least_relative_load)
        return cls(manoeuvre_numbers, value, weight_shares)

    @property
    def rms_relative_load(self) -> float:
        """Root mean square of the relative loads, above 0."""
        return max(float(np.sqrt(np.mean(self.value**2))), 1e-9)

    def mark_loaded_manoeuvres_by_number(self, manoeuvre_numbers: Ints) -> Bools:
        """Whether each manoeuvre is heavier than midway between light and heavy ones, (n,)."""
        return self.look_up_relative_loads(manoeuvre_numbers) > float(
            np.quantile(self.value, LIMITS.load_contrast_quantiles).mean()
        )

    def look_up_relative_loads(self, manoeuvre_numbers: Ints) -> Floats:
        """Deviation of each manoeuvre, (n,); for an unknown one that of the manoeuvre before it."""
        # samples come in runs of one manoeuvre
        first = np.flatnonzero(np.diff(manoeuvre_numbers, prepend=manoeuvre_numbers[:1] - 1))
        place = np.searchsorted(self.manoeuvre_ids, manoeuvre_numbers[first], "right") - 1
        value = self.value[place.clip(0, self.manoeuvre_ids.size - 1)]
        return np.repeat(value, np.diff(np.append(first, manoeuvre_numbers.size)))


@dataclass(frozen=True, slots=True)
class PreviousEstimates:
    """Estimates of earlier rounds that nonlinear columns depend on.

    Attributes:
        force_delay_s: delay of the force.
        slip_1_N: wheel slip per newton, as a fraction of the ground speed.
        load_transfer_s2_m: fraction of the force that load transfer adds to the measured wheels per
            m/s².
        offset_N: offset of the measured force.
        slip_s_m: cost of slip, as a fraction of the force per m/s.
        speed_delay_s: delay of the speed, from the wheels.
        motion_gain: relative correction added to the acceleration without gravity.
        swing: effect of a swinging body on the accelerometer.
        relative_loads: relative loads of the load states; None with one state.
        route: route between loading and dumping; None if nothing is dumped.
        play: play of the force's hysteresis; None without hysteresis.
        ground_variance_ratio_1_s: variance of the ground force between stretches over that of the
            noise of one second.
    """

    force_delay_s: float = 0.0
    slip_1_N: float = 0.0
    load_transfer_s2_m: float = 0.0
    offset_N: float = 0.0
    slip_s_m: float = 0.0
    speed_delay_s: float = 0.0
    motion_gain: float = 0.0
    swing: BodySwing = NO_SWING
    relative_loads: RelativeLoads | None = None
    route: HaulRoute | None = None
    play: PlayHysteresis | None = None
    ground_variance_ratio_1_s: float = 0.0

    def estimate_ground_force_newtons(self, motion: MotionSamples) -> Floats:
        """Force on the ground, (n,) in N; the force of `motion` must be corrected for its delay."""
        gain = 1.0 + self.load_transfer_s2_m * motion.acceleration
        return (motion.force - self.offset_N) / np.maximum(gain, LIMITS.load_transfer_min_gain)


@dataclass(frozen=True)
class FitRows:
    """Rows of the fit, weighted by the number of samples of each mean.

    Attributes:
        A: (rows, 2 + terms) columns: acceleration, speed and terms.
        f: (rows,) force in N.
        group: (rows,) number of the stretch.
        direction: (rows,) driving direction of the stretch.
        noise: expected contribution of noise to the normal equations.
        shortest: minimum number of rows of a stretch with a term of its own.
        terms: nuisances, one per column after the first two.
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
        # contiguous, as if made from these terms alone: the last bits of sums depend on the layout
        gram = np.ascontiguousarray(self.noise.gram[:, at[:, None], at])
        noise = NoiseMoments(gram, np.take(self.noise.cross, at, axis=1))
        return replace(self, A=np.take(self.A, at, axis=1), noise=noise, terms=terms)


@dataclass(frozen=True)
class FitColumns:
    """Columns of the joint fit at every sample, from which rows of means of any length are made.

    Attributes:
        pieces: columns of each piece of the log.
        terms: nuisance terms, one per column after acceleration and speed.
        previous_estimates: estimates of earlier rounds, on which the columns depend.
        rate_hz: rate of the grid.
    """

    pieces: list["_PieceColumns"]
    terms: tuple[Nuisance, ...]
    previous_estimates: PreviousEstimates
    rate_hz: float

    @classmethod
    def from_motion(
        cls,
        motion: MotionSamples,
        noise: ColumnNoiseModel,
        terms: tuple[Nuisance, ...],
        previous_estimates: PreviousEstimates,
    ) -> Self:
        """Make the columns; the arguments are those of `average_and_weight_fit_columns`."""

        def make_columns(piece: MotionSamples) -> _PieceColumns:
            fitted = find_fitted_samples_with_advanced_force(
                piece, previous_estimates.force_delay_s
            )
            return make_columns_of_piece(piece, fitted, noise, terms, previous_estimates)

        pieces = map_in_threads(make_columns, list(motion.pieces_split_between_stretches))
        return cls(pieces, terms, previous_estimates, motion.rate_hz)

    def average_and_weight_columns(
        self, noise: ColumnNoiseModel, max_samples_per_mean: int
    ) -> FitRows:
        """Average the columns over at most `max_samples_per_mean` samples, and weight the means."""
        return average_and_weight_columns_of_pieces(
            self.pieces.__getitem__,
            [piece.group for piece in self.pieces],
            noise,
            self.terms,
            max_samples_per_mean,
            self.previous_estimates.ground_variance_ratio_1_s,
            self.rate_hz,
        )


def average_and_weight_fit_columns(
    motion: MotionSamples,
    noise: ColumnNoiseModel,
    terms: tuple[Nuisance, ...],
    max_samples_per_mean: int,
    previous_estimates: PreviousEstimates,
) -> FitRows:
    """Average and weight the columns, with the force advanced by its delay.

    Args:
        motion: the samples.
        noise: noise of acceleration, speed and force.
        terms: the nuisances.
        max_samples_per_mean: number of samples in the longest mean.
        previous_estimates: estimates of earlier rounds.
    """
    pieces = motion.pieces_split_between_stretches
    fitted = [
        find_fitted_samples_with_advanced_force(piece, previous_estimates.force_delay_s)
        for piece in pieces
    ]
    return average_and_weight_columns_of_pieces(
        lambda piece_index: make_columns_of_piece(
            pieces[piece_index], fitted[piece_index], noise, terms, previous_estimates
        ),
        [piece.stretch_of_sample[own] for piece, own in zip(pieces, fitted, strict=True)],
        noise,
        terms,
        max_samples_per_mean,
        previous_estimates.ground_variance_ratio_1_s,
        motion.rate_hz,
    )


def average_and_weight_columns_of_pieces(
    make_columns: Callable[[int], "_PieceColumns"],
    groups: list[Ints],
    noise: ColumnNoiseModel,
    terms: tuple[Nuisance, ...],
    max_samples_per_mean: int,
    ground_variance_ratio_1_s: float,
    rate_hz: float,
) -> FitRows:
    """Average and weight the columns of all pieces.

    Args:
        make_columns: function that makes the columns of the piece with this index; called piece by
            piece, since the columns of a whole shift are large.
        groups: for each piece, stretch of each fitted sample.
        noise: noise of acceleration, speed and force.
        terms: the nuisances.
        max_samples_per_mean: number of samples in the longest mean.
        ground_variance_ratio_1_s: see `PreviousEstimates`.
        rate_hz: rate of the grid.
    """
    stride = compute_samples_between_fitted_means(max_samples_per_mean)
    kept = [np.flatnonzero(select_every_nth_sample(group, stride)) for group in groups]
    ends = np.cumsum([each.size for each in kept]).tolist()
    places = [slice(end - each.size, end) for each, end in zip(kept, ends, strict=True)]
    A, f = np.empty((ends[-1], 2 + len(terms))), np.empty(ends[-1])
    counts = np.empty(f.size, np.int64)

    def average_piece(piece_index: int) -> tuple[Ints, ColumnInputs]:
        piece, own, rows = make_columns(piece_index), kept[piece_index], places[piece_index]
        counts[rows] = fill_trailing_group_means(
            piece.A, piece.group, max_samples_per_mean, own, A[rows]
        )
        fill_trailing_group_means(
            piece.f[None], piece.group, max_samples_per_mean, own, f[rows, None]
        )
        return piece.group[own], piece.raw.select_rows(own)

    pieces = map_in_threads(average_piece, range(len(places)))
    # there are few lengths: counting them is quicker than sorting all rows
    occurs = np.bincount(counts) > 0
    lengths, which = np.flatnonzero(occurs), (np.cumsum(occurs) - 1)[counts]
    covariances = np.stack([noise.compute_covariance_of_means(int(length)) for length in lengths])
    weight = compute_square_roots_of_row_weights(A[:, :2], f, covariances, which)
    has_rate_noise = pieces[0][1].force_rate_parabola is not None
    covariances = add_force_derivatives_to_covariances(
        covariances, noise, rate_hz, lengths.tolist(), has_rate_noise=has_rate_noise
    )

    def weight_rows_and_sum_noise_moments(piece_index: int) -> tuple[Floats, Floats]:
        (group, raw), rows = pieces[piece_index], places[piece_index]
        A[rows] *= weight[rows, None]
        f[rows] *= weight[rows]
        if ground_variance_ratio_1_s:
            ratio = ground_variance_ratio_1_s / rate_hz * stride
            whiten_random_intercepts_in_place(A[rows], f[rows], group, ratio)
        return sum_noise_moments_by_stretch(
            terms, group, raw, covariances, which[rows], weight[rows]
        )

    added = map_in_threads(weight_rows_and_sum_noise_moments, range(len(places)))
    return FitRows(
        A,
        f,
        np.concatenate([group for group, _ in pieces]),
        np.concatenate([raw.direction for _, raw in pieces]),
        NoiseMoments(*(np.concatenate(each) for each in zip(*added, strict=True))),
        max(count_rows_in_duration(LIMITS.shortest_stretch_s, rate_hz) // stride, 6),
        terms,
    )


def whiten_random_intercepts_in_place(
    A: Floats, f: Floats, stretch_of_row: Ints, variance_ratio: float
) -> None:
    """Subtract from each stretch the part of its mean that a random intercept explains.

    Args:
        A: (rows, p) columns, changed in place.
        f: (rows,) force, changed in place.
        stretch_of_row: (rows,) number of the stretch.
        variance_ratio: variance of the intercepts over that of a row.
    """
    for first, end in find_stretch_spans(stretch_of_row).tolist():
        off = 1.0 - 1.0 / np.sqrt(1.0 + variance_ratio * (end - first))
        subtract_fraction_of_mean_in_place(A[first:end], off)
        f[first:end] -= off * f[first:end].mean()


def _subtract_fraction_of_mean_vectorised(A: Floats, fraction: float) -> None:
    A -= fraction * A.mean(axis=0)


@compiled_with_array_form(_subtract_fraction_of_mean_vectorised)
def subtract_fraction_of_mean_in_place(A: Floats, fraction: float) -> None:
    """Subtract a fraction of the mean of each column of A (n, p)."""
    rows, p = A.shape
    off = np.zeros(p)
    for k in range(rows):
        for c in range(p):
            off[c] += A[k, c]
    for c in range(p):
        off[c] = fraction * (off[c] / rows)
    for k in range(rows):
        for c in range(p):
            A[k, c] -= off[c]


@dataclass(frozen=True, slots=True)
class _PieceColumns:
    """Columns (2 + terms, n), force and stretch of a piece's fitted samples, and their inputs."""

    A: Floats
    f: Floats
    group: Ints
    raw: ColumnInputs


def make_columns_of_piece(
    motion: MotionSamples,
    fitted_samples: Ints,
    noise: ColumnNoiseModel,
    terms: tuple[Nuisance, ...],
    previous_estimates: PreviousEstimates,
) -> _PieceColumns:
    """Make the columns of a piece's fitted samples; delays and means also use other samples."""
    in_time = motion.advance_force(previous_estimates.force_delay_s)
    if previous_estimates.speed_delay_s:
        # the effect of a late speed on friction depends on the motion, not on the specific force
        in_time = in_time.advance_speed(previous_estimates.speed_delay_s)
    force, speed = in_time.force, in_time.speed
    acting = previous_estimates.estimate_ground_force_newtons(in_time)
    acceleration = motion.acceleration
    if previous_estimates.motion_gain:
        own = acceleration if motion.without_gravity is None else motion.without_gravity
        acceleration = acceleration + previous_estimates.motion_gain * own
    loads = previous_estimates.relative_loads
    zeros = np.zeros(motion.speed.size)
    relative_load = (
        zeros if loads is None else loads.look_up_relative_loads(motion.manoeuvre_of_sample)
    )
    if previous_estimates.swing.lever_s2 and motion.specific_force is not None:
        # springs deflect in proportion to the mass
        swing_m_s2 = previous_estimates.swing.compute_swing_acceleration_m_s2(
            motion.specific_force, motion.rate_hz
        )
        acceleration = acceleration - (1.0 + relative_load) * swing_m_s2
    wheels = motion.wheel_acceleration
    if wheels is None:
        force_std = float(np.sqrt(noise.compute_covariance_of_means(1)[2, 2]))
        force_rate, parabola = differentiate_force(force, motion.rate_hz, force_std), None
    else:
        force_rate, parabola = differentiate_force_by_widest_parabolas(force, motion.rate_hz, noise)
    raw = ColumnInputs(
        acceleration,
        zeros if wheels is None else wheels,
        speed,
        compute_ground_to_wheel_speed_ratio(speed, acting, previous_estimates.slip_1_N),
        acting,
        force_rate,
        zeros if motion.by_accelerometer else differentiate_force_twice(force, motion.rate_hz),
        zeros
        if previous_estimates.play is None
        else compute_sign_of_force_change(force, previous_estimates.play),
        motion.direction,
        motion.progress,
        motion.index_in_stretch / motion.rate_hz,
        relative_load,
        relative_load if loads is None else relative_load / loads.rms_relative_load,
        motion.path_position_1,
        motion.travelled_m,
        *find_route_positions_and_length_m(motion, previous_estimates),
        zeros if motion.relative_gear_ratio is None else motion.relative_gear_ratio,
        previous_estimates.slip_s_m,
        previous_estimates.load_transfer_s2_m,
        0.0 if previous_estimates.play is None else previous_estimates.play.by_force_1_N,
        (0.0, 0.0) if loads is None else loads.weight_shares,
        parabola,
        motion.swing_m_s2,
        find_heading_from_dump(motion, previous_estimates),
    ).select_rows(fitted_samples)
    A = np.empty((2 + len(terms), fitted_samples.size))
    A[0], A[1] = raw.acceleration, raw.speed
    for place, term in enumerate(terms, start=2):
        A[place] = term.column(raw)
    return _PieceColumns(A, force[fitted_samples], motion.stretch_of_sample[fitted_samples], raw)


def compute_samples_between_fitted_means(max_samples_per_mean: int) -> int:
    """Number of samples from one fitted mean to the next."""
    return max(1, max_samples_per_mean // LIMITS.rows_per_mean)


def find_route_positions_and_length_m(
    motion: MotionSamples, previous_estimates: PreviousEstimates
) -> tuple[Floats, float]:
    """Position of each sample on the route, (n,), and the route's length in m.

    Both are 0 without a route.
    """
    loads, route = previous_estimates.relative_loads, previous_estimates.route
    if loads is None or route is None:
        return np.zeros(motion.speed.size), 0.0
    return route.compute_relative_distances_to_dump(motion), route.length_m


def find_heading_from_dump(
    motion: MotionSamples, previous_estimates: PreviousEstimates
) -> Floats | None:
    """Heading of each sample, (n,): 1 with the front away from the nearest dump, else -1.

    None if gravity is measured, if there is no route, or if the route is so short that the terms of
    the starts also describe its ground.
    """
    route = previous_estimates.route
    if motion.has_measured_gravity or route is None:
        return None
    if previous_estimates.relative_loads is None or route.length_m < LOAD_LIMITS.grade_min_route_m:
        return None
    return route.compute_headings_from_dump(motion)


def find_fitted_samples_with_advanced_force(motion: MotionSamples, force_delay_s: float) -> Ints:
    """Indices of fitted samples, without those within the force's delay of a stretch's start."""
    fitted, lag = motion.is_fittable, math.ceil(abs(force_delay_s) * motion.rate_hz)
    if lag:
        fitted = fitted & (
            (motion.index_in_stretch >= lag) | mark_stretch_ends(motion.stretch_of_sample)
        )
    return np.flatnonzero(fitted)


def select_every_nth_sample(stretch_of_sample: Ints, stride: int) -> Bools:
    """Flags of every `stride`-th sample of each stretch, or of the last of a shorter one, (n,)."""
    since = compute_index_in_stretch(stretch_of_sample)
    short = mark_stretch_ends(stretch_of_sample) & (since < stride - 1)
    return (stretch_of_sample >= 0) & ((since % stride == stride - 1) | short)


def compute_square_roots_of_row_weights(
    A: Floats, force: Floats, covariances: Floats, covariance_index_of_row: Ints
) -> Floats:
    """Square root of each row's weight, (rows,): the first means of a start have few samples."""
    mass, friction = np.linalg.lstsq(A, force, rcond=None)[0]
    gradient = np.array([mass, friction, -1.0])
    variances = np.array([gradient @ covariance @ gradient for covariance in covariances])
    if not variances[-1] > 0.0:  # without noise all rows weigh the same
        return np.ones(covariance_index_of_row.size)
    return np.sqrt(variances[-1] / np.maximum(variances[covariance_index_of_row], variances[-1]))


def sum_noise_moments_by_stretch(
    terms: tuple[Nuisance, ...],
    stretch_of_row: Ints,
    column_inputs: ColumnInputs,
    covariances: Floats,
    covariance_index_of_row: Ints,
    weight_roots: Floats,
) -> tuple[Floats, Floats]:
    """Sum, by stretch, the noise in AᵀA and Aᵀf due to acceleration, speed and force.

    Args:
        terms: the nuisances.
        stretch_of_row: (rows,) stretch of each row.
        column_inputs: means that the columns are made of.
        covariances: (lengths, parabolas, 5, 5) noise covariance of the means of each length, by
            `add_force_derivatives_to_covariances`.
        covariance_index_of_row: (rows,) index of each row's length.
        weight_roots: (rows,) square root of each row's weight.
    """
    ids, index = np.unique(stretch_of_row, return_inverse=True)
    parabola = column_inputs.force_rate_parabola
    if parabola is not None:
        covariance_index_of_row = covariance_index_of_row * covariances.shape[1] + parabola
    # derivatives of the columns by the channels; the others are 0
    slopes, places = [weight_roots, weight_roots], [(0, 0), (1, 1)]
    for j, term in enumerate(terms, start=2):
        by_rate = None if parabola is None else term.by_force_rate
        by_bend = term.by_force_bend
        derivatives = (term.by_acceleration, term.by_speed, by_rate, by_bend, term.by_force)
        for channel, by in enumerate(derivatives):
            if by is not None:
                slopes.append(by(column_inputs) * weight_roots)
                places.append((j, channel))
    return group_sums.sum_noise_moments(
        np.stack(slopes),
        np.array(places, np.int64),
        covariances.reshape(-1, 5, 5),
        covariance_index_of_row,
        index,
        (ids.size, 2 + len(terms)),
    )

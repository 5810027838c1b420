"""Least squares (6) for the parameters that a motion determines; the others are NaN.

Rank-deficient least squares always has a solution of minimum norm, whose values are meaningless.
Here only the base columns are fitted, A φ = A_base (C φ) (see `identifiability`), which is ordinary
least squares of full rank. Some parameters may have a normal prior: results of earlier stages, or
further forces of a machine (offset, Coulomb friction). These are fitted whether the motion
determines them or not, and do not count in what it determines. Everything except the residuals is
computed from the triangular factors of [A f].
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from estimators.arrays import Floats, Ints
from estimators.errors import DataError, suggest_choice
from estimators.methods.attenuation import compute_attenuation_by_noise_source
from estimators.methods.method_limits import LIMITS as METHOD_LIMITS
from estimators.numerics.autocorrelation import (
    compute_autocovariance_loss,
    compute_std_widening_factor,
    estimate_pooled_autocorrelation,
)
from estimators.numerics.small_systems import (
    invert_positive_definite,
    make_noise_bound_in_each_direction,
    solve_least_squares_by_svd,
)
from estimators.planar.base_estimate import BaseEstimate, Prior
from estimators.planar.blockwise_qr import (
    BLOCK,
    Blocks,
    compute_blockwise_residuals,
    compute_triangular_factors,
    sum_sandwich_meat,
)
from estimators.planar.identifiability import find_identifiable_parameters
from estimators.planar.planar_fit_limits import LIMITS


def fit(
    A: Blocks,
    f: Floats,
    parameters: Sequence[str],
    stretch_of_sample: Ints | None = None,
    prior: Prior | None = None,
    noise: Floats | None = None,
    noise_mixing: Floats | None = None,
) -> BaseEstimate:
    """Estimate the parameters that one or several motions determine.

    Force and torque have different units and noise, so the axes are weighted by their residuals,
    iterated until the weights converge; relative to the priors they are also weighted by the
    correlation time of the residuals. Residuals of different axes are assumed independent.

    Args:
        A: (n, k, p) regressor of k axes, samples in time order; an array, or built in blocks.
        f: (n, k) force or torque.
        parameters: (p,) names of the columns.
        stretch_of_sample: (n,) stretch of the log of each sample, negative for excluded samples,
            which may be NaN; None for a single stretch.
        prior: prior of parameters from earlier stages, or of small ones.
        noise: (k, p) r.m.s. noise of the columns of each axis, of one source each within an axis.
            Parameters below the noise are not determined, see `identify`; attenuation is corrected,
            with part of the correction counted as uncertainty, see `attenuation`. None takes A as
            exact.
        noise_mixing: (k, p, p) by axis, loading of each column on the noise of each column, 1 on
            its own; if not given, columns have independent noise. A term proportional to a column
            shares its noise, and both are attenuated together.

    Raises:
        DataError: shapes that do not match, NaN, or an unknown name among the priors.
    """
    n, k, p = A.shape
    if f.shape != (n, k) or len(parameters) != p:
        raise DataError(
            f"a regressor of shape {A.shape} needs forces of shape {(n, k)} and {p} names; "
            f"got {f.shape} and {len(parameters)}"
        )
    prior = prior or Prior((), np.zeros((k, 0)), np.zeros((0, 0)))
    for name in prior.names:
        if name not in parameters:
            raise DataError(
                f"no parameter '{name}' for a prior; {suggest_choice(name, parameters)}"
            )
    stretch_of_sample = np.zeros(n, np.int64) if stretch_of_sample is None else stretch_of_sample
    used = stretch_of_sample >= 0
    samples = int(used.sum())
    R = compute_triangular_factors(A, f, used)
    if not np.isfinite(R[..., -1]).all() and np.isfinite(R[..., :-1]).all():
        raise DataError("the forces hold NaN or infinity; exclude these samples")

    given = np.array([list(parameters).index(name) for name in prior.names], np.int64)
    free = np.setdiff1d(np.arange(p), given)
    names = [parameters[int(i)] for i in free]
    shared = np.broadcast_to(np.eye(p), (k, p, p)) if noise_mixing is None else noise_mixing
    all_noise = None if noise is None else propagate_noise_rms_to_columns(noise, shared)[free]
    found = find_identifiable_parameters(R[..., free], names, all_noise, samples * k)
    columns = np.concatenate([free[found.base], given])
    added = samples * np.square(np.zeros((k, p)) if noise is None else noise)
    # a column of little motion, whose parameter has a prior, is nearly all noise
    added = np.minimum(added, LIMITS.max_noise_fraction * np.square(R[..., :-1]).sum(axis=1))
    system = _WeightedSystem(R[..., columns], R[..., -1], added, shared[:, columns], prior, samples)
    fitted = system.solve_with_correlation_times(np.ones(k))
    coefficients = place_values_in_columns(fitted.theta, columns, p)
    residual = compute_blockwise_residuals(A, f, used, coefficients)
    losses = compute_autocovariance_losses(A, columns, stretch_of_sample)
    correlations = compute_residual_autocorrelations_by_axis(stretch_of_sample, residual, losses)
    if given.size and samples and np.isfinite(fitted.theta).all():
        # a prior is worth as many samples as are independent
        lasting = [max(2.0 * float(each.sum()) - 1.0, 1.0) for each in correlations]
        fitted = system.solve_with_correlation_times(np.array(lasting))
        coefficients = place_values_in_columns(fitted.theta, columns, p)
        residual = compute_blockwise_residuals(A, f, used, coefficients)
        correlations = compute_residual_autocorrelations_by_axis(
            stretch_of_sample, residual, losses
        )
    covariance = compute_sandwich_covariance(
        A, columns, stretch_of_sample, correlations, fitted, prior
    )

    single = np.append(found.identifiable[found.base], np.ones(given.size, np.bool_))
    here = columns[single]
    full = np.full((p, p), np.nan)
    full[np.ix_(here, here)] = covariance[np.ix_(single, single)]
    return BaseEstimate(
        identifiability=found,
        parameters=tuple(parameters),
        theta=place_values_in_columns(fitted.theta[single], here, p, np.nan),
        by_axis=place_values_in_columns(fitted.by_axis[:, single], here, p, np.nan),
        covariance=full,
        responses=place_values_in_columns(fitted.responses[:, single], here, p, np.nan),
        coefficients=coefficients,
        combination=fitted.theta[~single],
        combination_std=np.sqrt(np.diagonal(covariance))[~single],
        residual_rms=fitted.rms,
    )


def propagate_noise_rms_to_columns(noise_rms: Floats, noise_mixing: Floats) -> Floats:
    """R.m.s. noise (p,) of each column over the axes, of all its sources."""
    return np.sqrt(np.mean(np.einsum("kcs,ks->kc", noise_mixing**2, noise_rms**2), axis=0))


def place_values_in_columns(
    values: Floats, column_indices: Ints, p: int, fill_value: float = 0.0
) -> Floats:
    """Place values (…, r) in columns `column_indices` of p columns; the others are `fill_value`."""
    out = np.full((*values.shape[:-1], p), fill_value)
    out[..., column_indices] = values
    return out


@dataclass(frozen=True, slots=True)
class _FittedParameters:
    """Weighted least squares of r columns, the last q of which have a prior.

    Attributes:
        theta: (r,) estimates, corrected for attenuation.
        by_axis: (k, r) contributions of each axis.
        grams: (k, r, r) weighted AᵀA of each axis, without its noise.
        bread: (r, r) inverse of their sum with the priors.
        doubt: (r, r) covariance of the attenuation correction.
        responses: (q, r) response to one standard deviation of each prior.
        lasting: (k,) assumed correlation time of the residuals, in samples.
        rms: (k,) r.m.s. of the residuals.
        samples: number of samples of one axis.
    """

    theta: Floats
    by_axis: Floats
    grams: Floats
    bread: Floats
    doubt: Floats
    responses: Floats
    lasting: Floats
    rms: Floats
    samples: int

    @property
    def axis_weights(self) -> Floats:
        """(k,) weights of the axes."""
        return 1.0 / (self.rms * np.sqrt(self.lasting))


@dataclass(frozen=True, slots=True)
class _WeightedSystem:
    """System to solve: triangular factors A (k, s, r), f (k, s), noise, and the priors.

    The noise is n·σ² of its sources (k, p), and what each column has of them (k, r, p).
    """

    A: Floats
    f: Floats
    added: Floats
    loading: Floats
    prior: Prior
    samples: int

    def solve_with_correlation_times(self, correlation_times: Floats) -> _FittedParameters:
        """Fit with each sample's weight divided by the correlation time of its residual (k,)."""
        k, _, r = self.A.shape
        q = len(self.prior.names)
        if self.samples == 0 or r == 0:
            nothing = np.full((r, r), np.nan)
            rms = compute_axis_rms(self.f, self.samples) if self.samples else np.full(k, np.nan)
            return _FittedParameters(
                theta=np.full(r, np.nan),
                by_axis=np.full((k, r), np.nan),
                grams=np.full((k, r, r), np.nan),
                bread=nothing,
                doubt=nothing,
                responses=np.full((q, r), np.nan),
                lasting=correlation_times,
                rms=rms,
                samples=self.samples,
            )
        floor = (
            LIMITS.min_residual_fraction * np.sqrt((self.f**2).sum() / (self.samples * k)) or 1.0
        )
        rms = np.ones(k)
        theta = np.empty(0)
        for number in range(LIMITS.weight_max_rounds):
            # in the first round the weights are unknown, so priors cannot be weighted
            theta = self._solve_regularised(rms, correlation_times, with_prior=number > 0).sum(
                axis=0
            )
            before, rms = (
                rms,
                np.maximum(compute_axis_rms(self.f - self.A @ theta, self.samples), floor),
            )
            if (np.abs(rms / before - 1.0) < LIMITS.weight_tolerance).all():
                break
        by_axis = self._solve_regularised(rms, correlation_times)
        scale = 1.0 / (rms * np.sqrt(correlation_times))
        weighted = self.A * scale[:, None, None]
        grams = np.einsum("kqi,kqj->kij", weighted, weighted)
        whole = grams.sum(axis=0)
        precision = np.linalg.inv(self.prior.covariance)
        whole[r - q :, r - q :] += precision
        noise = self.added * scale[:, None] ** 2
        doubt = np.zeros((r, r))
        if noise.any():
            added = np.einsum("kis,ks,kjs->kij", self.loading, noise, self.loading)
            # in directions that only priors determine, noise may exceed the motion
            kept = make_noise_bound_in_each_direction(
                added.sum(axis=0), whole, LIMITS.max_noise_fraction
            )
            added = kept @ added @ kept.T
            sources = noise.ravel()
            loading = kept @ np.concatenate(list(self.loading), axis=1)
            drawn = [
                compute_attenuation_by_noise_source(whole, each, sources, loading)
                for each in by_axis
            ]
            by_axis = by_axis + np.stack([each.sum(axis=1) for each in drawn])
            taken: Floats = np.sum(drawn, axis=0)
            doubt = METHOD_LIMITS.uncertain_correction_fraction**2 * taken @ taken.T
            grams, whole = grams - added, whole - added.sum(axis=0)
        bread = invert_positive_definite(whole)
        theta = by_axis.sum(axis=0)
        std = np.linalg.cholesky(self.prior.covariance) if q else np.zeros((0, 0))
        responses = (bread[:, r - q :] @ precision @ std).T
        residual = compute_axis_rms(self.f - self.A @ theta, self.samples)
        return _FittedParameters(
            theta=theta,
            by_axis=by_axis,
            grams=grams,
            bread=bread,
            doubt=doubt,
            responses=responses,
            lasting=correlation_times,
            rms=np.maximum(residual, floor),
            samples=self.samples,
        )

    def _solve_regularised(
        self, axis_rms: Floats, correlation_times: Floats, *, with_prior: bool = True
    ) -> Floats:
        """Coefficients (k, r), a row per axis' force, by weighted least squares with the prior.

        Samples of an axis weigh 1/(rms² · lasting). The prior adds rows unless `with_prior` is
        false.
        """
        k, s, r = self.A.shape
        q = len(self.prior.names)
        scale = 1.0 / (axis_rms * np.sqrt(correlation_times))
        rows = (self.A * scale[:, None, None]).reshape(-1, r)
        wanted = np.zeros((k, s, k))
        for axis in range(k):
            wanted[axis, :, axis] = self.f[axis] * scale[axis]
        wanted = wanted.reshape(-1, k)
        if q and with_prior:
            root = np.linalg.inv(np.linalg.cholesky(self.prior.covariance))
            rows = np.concatenate([rows, np.concatenate([np.zeros((q, r - q)), root], axis=1)])
            wanted = np.concatenate([wanted, root @ self.prior.mean.T])
        size = np.linalg.norm(rows, axis=0)
        size = np.where(size > 0.0, size, 1.0)
        return (solve_least_squares_by_svd(rows / size, wanted) / size[:, None]).T


def compute_axis_rms(residual: Floats, samples: int) -> Floats:
    """R.m.s. (k,) of residuals given by their triangular factor (k, q)."""
    return np.sqrt((residual**2).sum(axis=1) / samples)


def compute_autocovariance_losses(
    A: Blocks, columns: Ints, stretch_of_sample: Ints
) -> list[Floats]:
    """Loss of autocovariance of each axis' residuals, caused by the fit."""
    k, used = A.shape[1], stretch_of_sample >= 0
    if not used.any():
        return [np.zeros((0, 0))] * k
    # θ is fitted to all series together, so that each has lost its share of the r columns; of a
    # long one that is nothing
    share = columns[: -(-columns.size // (k * np.unique(stretch_of_sample[used]).size))]
    if used.size > BLOCK:
        return [compute_autocovariance_loss(stretch_of_sample, None)] * k
    return [
        compute_autocovariance_loss(stretch_of_sample, axis)
        for axis in A[:].transpose(1, 0, 2)[..., share]
    ]


def compute_residual_autocorrelations_by_axis(
    stretch_of_sample: Ints, residual: Floats, losses: list[Floats]
) -> list[Floats]:
    """Residual autocorrelation of each axis, (lags,) each.

    They differ, since the noise of a derivative is correlated differently from that of a sensor.
    """
    return [
        estimate_pooled_autocorrelation(np.ascontiguousarray(axis), stretch_of_sample, None, loss)[
            0
        ]
        for axis, loss in zip(residual.T, losses, strict=True)
    ]


def compute_sandwich_covariance(
    A: Blocks,
    columns: Ints,
    stretch_of_sample: Ints,
    correlations: list[Floats],
    fitted_parameters: _FittedParameters,
    prior: Prior,
) -> Floats:
    """Sandwich covariance (r, r) with the priors and the uncertainty of the noise correction.

    It is never smaller than without correlation: a tapered correlation need not be positive
    definite.
    """
    r, q, k = columns.size, len(prior.names), len(fitted_parameters.rms)
    if r == 0 or fitted_parameters.samples == 0 or not np.isfinite(fitted_parameters.theta).all():
        return np.full((r, r), np.nan)
    if not np.isfinite(fitted_parameters.bread).all():
        # determined by rounding alone: no standard deviation can be given
        return np.full((r, r), np.nan)
    size = np.sqrt(np.diagonal(fitted_parameters.bread))
    weight = (fitted_parameters.axis_weights / np.sqrt(fitted_parameters.lasting))[:, None] * size
    B = sum_sandwich_meat(A, columns, stretch_of_sample, correlations, weight)
    bread = fitted_parameters.bread / np.outer(size, size)
    cover = bread @ B @ bread
    white = (fitted_parameters.grams / fitted_parameters.lasting[:, None, None]).sum(
        axis=0
    ) * np.outer(size, size)
    plain = bread @ white @ bread
    samples = float(fitted_parameters.samples * k)
    degrees_of_freedom = samples - float(fitted_parameters.lasting.max()) * float(
        np.trace(bread @ B)
    )
    if q:
        # a prior remains valid, however few independent residuals there are
        degrees_of_freedom = max(
            degrees_of_freedom, LIMITS.min_degrees_of_freedom_fraction * samples
        )
    if not degrees_of_freedom > 0.5:
        return np.full((r, r), np.nan)
    variance = np.maximum(
        np.diagonal(cover) * samples / degrees_of_freedom,
        np.diagonal(plain) * samples / max(samples - r, 1.0),
    )
    # of what its prior alone tells the log says nothing, to rounding
    std = np.sqrt(np.maximum(variance, 0.0)) * compute_std_widening_factor(
        fitted_parameters.samples * k, correlations[0]
    )
    # a tapered correlation, or a column that is nearly all noise, makes a variance negative
    shape = next((each for each in (cover, plain) if np.linalg.eigvalsh(each)[0] > 0.0), bread)
    own = np.diagonal(shape)
    stretch = std * size / np.sqrt(np.where(own > 0.0, own, np.inf))
    known_part = fitted_parameters.responses.T @ fitted_parameters.responses if q else 0.0
    return shape * np.outer(stretch, stretch) + known_part + fitted_parameters.doubt

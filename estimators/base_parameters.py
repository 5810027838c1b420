"""Least squares (6) for whatever a motion determines: a number for that, NaN for the rest.

Rank-deficient least squares always has a solution, of least norm, whose numbers mean nothing. Here
the base columns alone are fitted, A φ = A_base (C φ) (see `identifiability`), which is ordinary
least squares of full rank. All of it but the residuals comes from the triangular factors of [A f].
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from estimators.attenuation import DOUBT, attenuation
from estimators.autocorrelation import pooled_autocorrelation, widening
from estimators.blocks import BLOCK, Blocks, factors, residuals, sandwich_meat
from estimators.errors import DataError, nearest
from estimators.estimate import Floats, Ints
from estimators.identifiability import Identifiability, identify
from estimators.linear import inverse_spd, lstsq
from estimators.sandwich import deviations

#: Axes are weighted by their residuals, which rounding alone must not decide.
LEAST_RESIDUAL = 1e-9
#: The weights have settled when none changes by more than this share, …
SETTLED = 1e-3
#: … or after so many rounds.
MOST_ROUNDS = 30


@dataclass(frozen=True, slots=True)
class BaseEstimate:
    """What a motion tells of p parameters.

    Attributes:
        identifiability: what is determined of the parameters that were not known.
        parameters: (p,) names of all parameters.
        theta: (p,) their values; NaN where the motion does not determine them.
        covariance: (p, p) their covariance; NaN likewise.
        combination: (c,) values of `identifiability.combinations`.
        combination_std: (c,) their standard deviations.
        residual_rms: (k,) r.m.s. of the residuals of each axis, in its unit.
    """

    identifiability: Identifiability
    parameters: tuple[str, ...]
    theta: Floats
    covariance: Floats
    combination: Floats
    combination_std: Floats
    residual_rms: Floats

    @property
    def std(self) -> Floats:
        """(p,) standard deviations, NaN where the motion does not determine a parameter."""
        return np.sqrt(np.diagonal(self.covariance))

    def quotient(self, numerator: str, denominator: str) -> tuple[float, float]:
        """One parameter over another and its first-order deviation: a centre of mass is mc_x / m.

        NaN where the motion does not determine both.
        """
        i, j = self.parameters.index(numerator), self.parameters.index(denominator)
        ratio = self.theta[i] / self.theta[j]
        gradient = np.array([1.0, -ratio]) / self.theta[j]
        variance = gradient @ self.covariance[np.ix_([i, j], [i, j])] @ gradient
        return float(ratio), float(np.sqrt(variance))


def fit(
    A: Blocks,
    f: Floats,
    parameters: Sequence[str],
    segment_id: Ints | None = None,
    known: Mapping[str, tuple[float, float]] | None = None,
    noise: Floats | None = None,
) -> BaseEstimate:
    """Estimate what a motion, or several together, determine.

    The axes are weighted by their residuals, in rounds until the weights settle: newtons and newton
    metres have no common noise. Residuals of different axes are taken as independent.

    Args:
        A: (n, k, p) regressor of k axes, samples in time order; an array, or made by the block.
        f: (n, k) force or torque.
        parameters: (p,) names of the columns.
        segment_id: (n,) stretch of the log that each sample is from, negative for samples to leave
            out, which may be NaN; one stretch where none is given.
        known: value and standard deviation of parameters that stages before have told.
        noise: (k, p) r.m.s. noise of the columns of each axis, of one source each within an axis.
            What does not stand above it is not determined, see `identify`; what it draws the rest
            towards zero by is taken off, part of it counted as uncertainty, see `attenuation`.
            None takes A as exact.

    Raises:
        DataError: shapes that do not go together, NaN, or an unknown name among the known.
    """
    n, k, p = A.shape
    if f.shape != (n, k) or len(parameters) != p:
        raise DataError(
            f"a regressor of shape {A.shape} asks for forces {(n, k)} and {p} names; "
            f"got {f.shape} and {len(parameters)}"
        )
    known = known or {}
    for name in known:
        if name not in parameters:
            raise DataError(f"no parameter '{name}' to be known; {nearest(name, parameters)}")
    segment_id = np.zeros(n, np.int64) if segment_id is None else segment_id
    used = segment_id >= 0
    samples = int(used.sum())
    R = factors(A, f, used)
    if not np.isfinite(R[..., -1]).all() and np.isfinite(R[..., :-1]).all():
        raise DataError("the forces hold NaN or infinity; leave out the samples that miss")

    given = np.flatnonzero([name in known for name in parameters])
    values, stds = np.array([known[parameters[int(i)]] for i in given]).reshape(-1, 2).T
    free = np.setdiff1d(np.arange(p), given)
    names = [parameters[int(i)] for i in free]
    all_noise = None if noise is None else np.sqrt(np.mean(np.square(noise), axis=0))[free]
    found = identify(R[..., free], names, all_noise, samples * k)
    columns = free[found.base]
    added = samples * np.square(np.zeros((k, p)) if noise is None else noise)[:, columns]
    fitted = _weighted_fit(
        R[..., columns], R[..., -1] - R[..., given] @ values, R[..., given], added, samples
    )

    coefficients = np.zeros(p)
    coefficients[given], coefficients[columns] = values, fitted.theta
    residual = residuals(A, f, used, coefficients)
    covariance = _covariance(A, columns, segment_id, residual, fitted)
    # what an error of the known ones does to the fitted ones
    covariance = covariance + fitted.gain * stds**2 @ fitted.gain.T

    single = found.identifiable[found.base]
    here = columns[single]
    theta = np.full(p, np.nan)
    theta[given], theta[here] = values, fitted.theta[single]
    full = np.full((p, p), np.nan)
    full[np.ix_(given, given)] = np.diag(stds**2)
    full[np.ix_(here, here)] = covariance[np.ix_(single, single)]
    full[np.ix_(here, given)] = (fitted.gain * stds**2)[single]
    full[np.ix_(given, here)] = (fitted.gain * stds**2)[single].T
    return BaseEstimate(
        identifiability=found,
        parameters=tuple(parameters),
        theta=theta,
        covariance=full,
        combination=fitted.theta[~single],
        combination_std=np.sqrt(np.diagonal(covariance))[~single],
        residual_rms=fitted.rms,
    )


@dataclass(frozen=True, slots=True)
class _Fitted:
    """Weighted least squares of r base columns.

    Attributes:
        theta: (r,) the parameters, what noise draws them by taken off.
        gram: (r, r) weighted AᵀA without its noise.
        doubt: (r, r) covariance of what was taken off.
        gain: (r, g) what an error of each known parameter does to them.
        weight: (k,) of the axes.
        rms: (k,) r.m.s. of the residuals.
    """

    theta: Floats
    gram: Floats
    doubt: Floats
    gain: Floats
    weight: Floats
    rms: Floats


def _weighted_fit(A: Floats, f: Floats, given: Floats, added: Floats, samples: int) -> _Fitted:
    """Fit triangular factors: A (k, q, r), f (k, q), of the known ones (k, q, g), noise (k, r)."""
    k, _, r = A.shape
    if samples == 0 or r == 0:
        nothing = np.full((r, r), np.nan)
        gain = np.full((r, given.shape[-1]), np.nan)
        rms = _rms(f, samples) if samples else np.full(k, np.nan)
        return _Fitted(np.full(r, np.nan), nothing, nothing, gain, np.ones(k), rms)
    floor = LEAST_RESIDUAL * np.sqrt((f**2).sum() / (samples * k)) or 1.0
    rms = np.ones(k)
    theta = np.empty(0)
    for _ in range(MOST_ROUNDS):
        theta = _solve(A / rms[:, None, None], f[..., None] / rms[:, None, None])[:, 0]
        before, rms = rms, np.maximum(_rms(f - A @ theta, samples), floor)
        if (np.abs(rms / before - 1.0) < SETTLED).all():
            break
    weighted = A / rms[:, None, None]
    wide = np.concatenate([f[..., None], -given], axis=-1) / rms[:, None, None]
    solved = _solve(weighted, wide)
    gram = np.einsum("kqi,kqj->ij", weighted, weighted)
    noise = (added / rms[:, None] ** 2).sum(axis=0)
    doubt = np.zeros_like(gram)
    if noise.any():
        drawn = [attenuation(gram, x, noise) for x in np.ascontiguousarray(solved.T)]
        solved = solved + np.stack([each.sum(axis=1) for each in drawn], axis=-1)
        doubt = DOUBT**2 * drawn[0] @ drawn[0].T
        gram = gram - np.diag(noise)
    theta, gain = solved[:, 0], solved[:, 1:]
    return _Fitted(theta, gram, doubt, gain, 1.0 / rms, _rms(f - A @ theta, samples))


def _solve(A: Floats, f: Floats) -> Floats:
    """Least squares of stacked axes, columns scaled to unit norm: (k, q, r), (k, q, m): (r, m)."""
    rows = A.reshape(-1, A.shape[-1])
    scale = np.linalg.norm(rows, axis=0)
    return lstsq(rows / scale, f.reshape(-1, f.shape[-1])) / scale[:, None]


def _rms(residual: Floats, samples: int) -> Floats:
    """R.m.s. (k,) of the residuals whose triangular factor is (k, q)."""
    return np.sqrt((residual**2).sum(axis=1) / samples)


def _covariance(
    A: Blocks, columns: Ints, segment_id: Ints, residual: Floats, fitted: _Fitted
) -> Floats:
    """The sandwich (r, r), and what is uncertain of the noise that was taken off."""
    k, r = residual.shape[1], columns.size
    used = segment_id >= 0
    samples = int(used.sum()) * k
    if r == 0 or samples == 0 or not np.isfinite(fitted.theta).all():
        return np.full((r, r), np.nan)
    # θ is fitted to all series together, so that each has lost its share of the r columns; of a
    # long one that is nothing
    share = columns[: -(-r // (k * np.unique(segment_id[used]).size))]
    taken = A[:].transpose(1, 0, 2)[..., share] if used.size <= BLOCK else [None] * k
    # a derivative's noise is correlated otherwise than a sensor's: each axis has its own
    correlations = [
        pooled_autocorrelation(np.ascontiguousarray(axis), segment_id, lost)[0]
        for axis, lost in zip(residual.T, taken, strict=True)
    ]
    size = np.sqrt(np.diagonal(fitted.gram))
    weight = fitted.weight[:, None] / size
    B = sandwich_meat(A, columns, segment_id, correlations, weight)
    gram = fitted.gram / np.outer(size, size)
    rss = float(((residual * fitted.weight) ** 2).sum())
    std = deviations(gram, B, rss, float(samples)) * widening(samples, correlations[0])
    bread = inverse_spd(gram)
    if not np.isfinite(bread).all():
        # determined by rounding alone: no deviation can be told
        return np.full((r, r), np.nan)
    cover = bread @ B @ bread
    # a tapered correlation need not be positive definite
    shape: Floats = cover if np.linalg.eigvalsh(cover)[0] > 0.0 else bread
    stretch = std / size / np.sqrt(np.diagonal(shape))
    return shape * np.outer(stretch, stretch) + fitted.doubt

"""Least squares (6) for whatever a motion determines: a number for that, NaN for the rest.

Rank-deficient least squares always has a solution, of least norm, whose numbers mean nothing. Here
the base columns alone are fitted, A φ = A_base (C φ) (see `identifiability`), which is ordinary
least squares of full rank.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from estimators.autocorrelation import pooled_autocorrelation
from estimators.errors import DataError, nearest
from estimators.identifiability import Identifiability, identify
from estimators.linear import inverse_spd, lstsq
from estimators.sandwich import deviations, meat
from estimators.student import widening
from estimators.trace import Floats, Ints

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
    A: Floats,
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
        A: (n, k, p) regressor of k axes, samples in time order.
        f: (n, k) force or torque.
        parameters: (p,) names of the columns.
        segment_id: (n,) stretch of the log that each sample is from, negative for samples to leave
            out, which may be NaN; one stretch where none is given.
        known: value and standard deviation of parameters that stages before have told.
        noise: (p,) r.m.s. noise of the columns, see `identify`; None takes A as exact.

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
    if not np.isfinite(f[used]).all():
        raise DataError("the forces hold NaN or infinity; leave out the samples that miss")

    given = np.array([name in known for name in parameters])
    values = np.array([known[name][0] for name in parameters if name in known], np.float64)
    stds = np.array([known[name][1] for name in parameters if name in known], np.float64)
    free = np.flatnonzero(~given)
    names = [parameters[int(i)] for i in free]
    found = identify(A[used][..., free], names, None if noise is None else noise[free])
    base = A[..., free[found.base]]
    beta, covariance, weight, rms = _weighted_fit(base, f - A[..., given] @ values, segment_id)

    # what an error of the known ones does to the fitted ones
    given_rows = (A[used][..., given] * weight).reshape(f[used].size, values.size)
    gain = -_solve(base[used] * weight, given_rows)
    covariance = covariance + gain * stds**2 @ gain.T

    single = found.identifiable[found.base]
    here = free[found.base[single]]
    theta = np.full(p, np.nan)
    theta[given], theta[here] = values, beta[single]
    full = np.full((p, p), np.nan)
    full[np.ix_(given, given)] = np.diag(stds**2)
    full[np.ix_(here, here)] = covariance[np.ix_(single, single)]
    full[np.ix_(here, given)] = (gain * stds**2)[single]
    full[np.ix_(given, here)] = (gain * stds**2)[single].T
    return BaseEstimate(
        identifiability=found,
        parameters=tuple(parameters),
        theta=theta,
        covariance=full,
        combination=beta[~single],
        combination_std=np.sqrt(np.diagonal(covariance))[~single],
        residual_rms=rms,
    )


def _solve(A: Floats, f: Floats) -> Floats:
    """Least squares of stacked axes, columns scaled to unit norm: (n, k, r), (n·k, …) to (r, …)."""
    rows = A.reshape(A.shape[0] * A.shape[1], A.shape[2])
    scale = np.linalg.norm(rows, axis=0)
    return (lstsq(rows / scale, f).T / scale).T


def _weighted_fit(A: Floats, f: Floats, segment_id: Ints) -> tuple[Floats, Floats, Floats, Floats]:
    """θ (r,), its covariance (r, r), the weights (k, 1) of the axes and their r.m.s. (k,)."""
    k, r = A.shape[1:]
    used = segment_id >= 0
    rows, force = A[used], f[used]
    if force.size == 0:
        return np.full(r, np.nan), np.full((r, r), np.nan), np.ones((k, 1)), np.full(k, np.nan)
    if r == 0:
        return np.empty(0), np.empty((0, 0)), np.ones((k, 1)), np.sqrt((force**2).mean(0))
    floor = LEAST_RESIDUAL * np.sqrt((force**2).mean()) or 1.0
    rms = np.ones(k)
    for _ in range(MOST_ROUNDS):
        theta = _solve(rows / rms[:, None], (force / rms).reshape(-1))
        before, rms = rms, np.maximum(np.sqrt(((force - rows @ theta) ** 2).mean(0)), floor)
        if (np.abs(rms / before - 1.0) < SETTLED).all():
            break
    weight = 1.0 / rms[:, None]
    theta = _solve(rows * weight, (force / rms).reshape(-1))
    covariance = _covariance(A * weight, (f - A @ theta) / rms, segment_id)
    return theta, covariance, weight, np.sqrt(((force - rows @ theta) ** 2).mean(0))


def _covariance(A: Floats, residual: Floats, segment_id: Ints) -> Floats:
    """The sandwich (r, r) of k axes of one scale; an axis of a stretch is a series of its own."""
    k, r = A.shape[1:]
    used = segment_id >= 0
    # samples left out keep their place, so that a lag stays a lag across them
    series = np.where(used, segment_id * k + np.arange(k)[:, None], -1)
    labels = np.unique(segment_id[used])
    # θ is fitted to all series together, so that each has lost its share of the r columns
    share = A[:, :, : -(-r // (k * labels.size))].transpose(1, 0, 2)
    correlation, _ = pooled_autocorrelation(
        residual.T.reshape(-1), series.reshape(-1), share.reshape(k * used.size, -1)
    )
    size = np.sqrt((A[used] ** 2).sum((0, 1)))
    A = A / size
    B = np.zeros((r, r))
    for label in labels:
        first, last = np.flatnonzero(segment_id == label)[[0, -1]]
        for axis in range(k):
            columns = np.ascontiguousarray(A[:, axis])
            B += meat(columns, segment_id, label, first, last, correlation)
    gram = np.einsum("nki,nkj->ij", A[used], A[used])
    squares, samples = float((residual[used] ** 2).sum()), float(residual[used].size)
    std = deviations(gram, B, squares, samples) * widening(samples, correlation)
    bread = inverse_spd(gram)
    if not np.isfinite(bread).all():
        # determined by rounding alone: no deviation can be told
        return np.full((r, r), np.nan)
    cover = bread @ B @ bread
    # a tapered correlation need not be positive definite
    shape: Floats = cover if np.linalg.eigvalsh(cover)[0] > 0.0 else bread
    stretch = std / size / np.sqrt(np.diagonal(shape))
    return shape * np.outer(stretch, stretch)

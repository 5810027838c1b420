"""Least squares with normal priors on nuisance parameters, and what its uncertainty is made of.

The noise of the columns is taken off the normal equations (errors in variables: Fuller, Measurement
Error Models, 1987), the residuals' correlation goes into a sandwich that is combined with the
priors, and groups (starts, say) that disagree with each other, or that all miss the model in the
same way, widen the answer. Every part is kept by itself, for a budget.
"""

from dataclasses import dataclass
from typing import Final, NamedTuple

import numpy as np

from estimators.autocorrelation import pooled_autocorrelation, student_factor
from estimators.compiled import compiled
from estimators.estimate import Floats, Ints
from estimators.fit_loss import group_rows
from estimators.sandwich import meat

#: The share of the correction for the columns' noise that is uncertain.
DOUBT: Final = 0.25
#: Of a direction's sum of squares, noise is never taken to be more than this.
_LARGEST_NOISE_SHARE: Final = 0.5
#: Residuals that alternate average out, but never to less than this share of white ones' variance.
_LEAST_OF_WHITE: Final = 0.1
#: Groups disagree when the ratio of variances exceeds 1 by so many of its deviations.
_DISAGREE: Final = 2.5
#: What all groups miss alike counts from this ratio to its noise on.
_MISFIT: Final = 2.0
#: With fewer groups the deviation by the residuals counts so many times.
_FEW_GROUPS: Final = 3
_OF_FEW: Final = 2.0
_ROUNDS: Final = 4


@dataclass(frozen=True, slots=True)
class NoiseMoments:
    """What noise adds to the normal equations, by group in ascending order.

    Attributes:
        gram: (groups, p, p) added to AᵀA.
        cross: (groups, p) added to Aᵀf, by noise that a column shares with the response.
    """

    gram: Floats
    cross: Floats


@dataclass(frozen=True, slots=True)
class PriorFit:
    """Estimates, and the parts of their covariance.

    Attributes:
        theta: (p,) estimates.
        noise: (p, p) covariance from the residuals, correlated as they are.
        responses: (p, p) row j is what one standard deviation of prior j moves the estimates by.
        scatter: (p, p) covariance that groups which disagree add; 0 where they agree.
        misfit: (p, p) covariance that what all groups miss alike adds; likewise.
        doubt: (p,) what one standard deviation of the noise correction moves the estimates by.
        noise_share: largest share of noise in a direction of the columns.
        scatter_ratio: deviation of the first parameter from group to group over that which the
            residuals explain (Birge's ratio); NaN with one group.
        misfit_ratio: mean square of the residuals common to the groups over its noise; NaN below
            three groups.
        groups: how many groups told something of their own.
        residual: (n,) f - A θ, 0 where no group is.
        residual_rms: r.m.s. of the residuals.
    """

    theta: Floats
    noise: Floats
    responses: Floats
    scatter: Floats
    misfit: Floats
    doubt: Floats
    noise_share: float
    scatter_ratio: float
    misfit_ratio: float
    groups: int
    residual: Floats
    residual_rms: float

    @property
    def covariance(self) -> Floats:
        """(p, p) of everything together."""
        priors = self.responses.T @ self.responses
        doubt = np.outer(self.doubt, self.doubt)
        return self.noise + priors + self.scatter + self.misfit + doubt

    @property
    def std(self) -> Floats:
        """(p,) standard deviations."""
        return np.sqrt(np.diag(self.covariance))


@compiled
def noise_moments(
    slopes: Floats, covariances: Floats, which: Ints, group: Ints, groups: int
) -> tuple[Floats, Floats]:
    """Sum what noise of q channels adds to the normal equations of p columns.

    Args:
        slopes: (n, p, q) derivative of each column by each channel; the last channel is the
            response's.
        covariances: (kinds, q, q) of the channels' noise.
        which: (n,) the kind of each sample.
        group: (n,) the group of each sample, from 0.
        groups: how many there are.

    Returns:
        (groups, p, p) and (groups, p): see `NoiseMoments`.
    """
    n, p, q = slopes.shape
    gram, cross = np.zeros((groups, p, p)), np.zeros((groups, p))
    part = np.empty((p, q))
    for k in range(n):
        covariance, g = covariances[which[k]], group[k]
        for i in range(p):
            for y in range(q):
                total = 0.0
                for x in range(q):
                    total += slopes[k, i, x] * covariance[x, y]
                part[i, y] = total
            cross[g, i] += part[i, q - 1]
        for i in range(p):
            for j in range(p):
                total = 0.0
                for y in range(q):
                    total += part[i, y] * slopes[k, j, y]
                gram[g, i, j] += total
    return gram, cross


def fit(
    A: Floats,
    f: Floats,
    group: Ints,
    noise: NoiseMoments | None,
    prior_mean: Floats,
    prior_std: Floats,
    direction: Floats | None = None,
    shortest: int = 50,
) -> PriorFit:
    """Fit θ of A θ = f.

    Args:
        A: (n, p) columns; rows of no group may be anything but NaN.
        f: (n,) response.
        group: (n,) the group of each sample, contiguous, negative for none.
        noise: of the columns; None takes them as exact.
        prior_mean: (p,).
        prior_std: (p,), inf where nothing is known.
        direction: (n,) sign by which what a group misses is compared with the others; None: 1.
        shortest: groups of fewer samples tell nothing of their own.

    Returns:
        The fit; NaN throughout where the samples do not determine it.
    """
    used = group >= 0
    n, p = int(used.sum()), A.shape[1]
    if n <= p:
        return _nothing(p, f.size)
    scale = np.sqrt((A[used] ** 2).mean(axis=0))
    # a column that is 0 throughout is left to its prior
    scale = np.where(scale > 0.0, scale, 1.0)
    A = np.ascontiguousarray(np.where(used[:, None], A / scale, 0.0))
    f = np.where(used, f, 0.0)
    sums = _Sums.of(A, f, group, noise, scale)
    precision = np.where(np.isfinite(prior_std), (prior_std * scale) ** -2.0, 0.0)
    try:
        solved = _solved(A, f, group, sums, precision, precision * prior_mean * scale)
    except np.linalg.LinAlgError:
        return _nothing(p, f.size)
    theta, bread, gain, residual, correlation, white, share, kept = solved
    meats = np.sum(
        [
            meat(A, group, int(group[part[0]]), int(part[0]), int(part[-1]), correlation)
            for part in sums.rows
        ],
        axis=0,
    )
    # noise of the columns times the residuals, both of which last as long as the mean does
    alike = max(2.0 * float(correlation @ correlation) - 1.0, 1.0)
    meats += sums.noise_gram.sum(axis=0) * alike
    covariance = gain @ (_at_least(meats, sums.grams.sum(axis=0)) * white) @ gain.T
    covariance *= student_factor(max(n / alike - p, 1.0)) ** 2
    told = [i for i, part in enumerate(sums.rows) if part.size >= shortest]
    if len(told) < _FEW_GROUPS:
        # nothing tells what they miss alike, or how they scatter
        covariance *= _OF_FEW**2
    scores = (sums.crosses - kept * sums.noise_cross) - (
        sums.grams - kept * sums.noise_gram
    ) @ theta
    scatter, ratio = _between_groups(gain, scores[told], covariance)
    signs = np.ones(f.size) if direction is None else direction
    misfit, common = _common_misfit(gain, A, residual, [sums.rows[i] for i in told], signs)
    taken = sums.noise_gram.sum(axis=0) @ theta - sums.noise_cross.sum(axis=0)
    doubt = _doubt(kept) * gain @ taken
    units = np.outer(scale, scale)
    return PriorFit(
        theta / scale,
        covariance / units,
        (bread * np.sqrt(precision)).T / scale,
        scatter / units,
        misfit / units,
        doubt / scale,
        share,
        ratio,
        common,
        len(told),
        residual,
        float(np.sqrt(residual @ residual / n)),
    )


@dataclass(frozen=True, slots=True)
class _Sums:
    """The normal equations by group, and what noise adds to them, of scaled columns."""

    rows: list[Ints]
    grams: Floats
    crosses: Floats
    noise_gram: Floats
    noise_cross: Floats

    @classmethod
    def of(
        cls, A: Floats, f: Floats, group: Ints, noise: NoiseMoments | None, scale: Floats
    ) -> "_Sums":
        rows = group_rows(group)
        grams = np.stack([A[part].T @ A[part] for part in rows])
        crosses = np.stack([A[part].T @ f[part] for part in rows])
        if noise is None:
            return cls(rows, grams, crosses, np.zeros_like(grams), np.zeros_like(crosses))
        return cls(rows, grams, crosses, noise.gram / np.outer(scale, scale), noise.cross / scale)


class _Solved(NamedTuple):
    """Estimates, H⁻¹, H⁻¹ G S⁻¹, residuals, their correlation and variance, the noise's share."""

    theta: Floats
    bread: Floats
    gain: Floats
    residual: Floats
    correlation: Floats
    white: float
    share: float
    kept: float


def _solved(
    A: Floats, f: Floats, group: Ints, sums: _Sums, precision: Floats, believed: Floats
) -> _Solved:
    """Solve (G S⁻¹ G + P⁻¹) θ = G S⁻¹ b + P⁻¹ θ₀, S the covariance of what G θ misses of b.

    S is σ² AᵀA, by the residuals' long-run variance, and what is uncertain of the noise's
    correction: without it more samples of the same would outvote the priors with that error.

    Raises:
        LinAlgError: the samples do not determine it.
    """
    used = group >= 0
    n, p = int(used.sum()), A.shape[1]
    gram, cross = sums.grams.sum(axis=0), sums.crosses.sum(axis=0)
    added, shared = sums.noise_gram.sum(axis=0), sums.noise_cross.sum(axis=0)
    # the first residuals are the textbook's: from those of nothing fitted, three rounds are too few
    theta = np.linalg.lstsq(gram, cross, rcond=None)[0]
    first = f - A @ theta
    variance = float(first @ first) / n
    solved: _Solved | None = None
    for _ in range(_ROUNDS):
        if not variance > 0.0:
            raise np.linalg.LinAlgError("no residuals")
        share = _noise_share(added, gram + variance * np.diag(precision))
        kept = min(1.0, _LARGEST_NOISE_SHARE / share) if share > 0 else 1.0
        clean, bare = gram - kept * added, cross - kept * shared
        if solved is None:
            bread = np.linalg.inv(clean / variance + np.diag(precision))
            theta = bread @ (bare / variance + believed)
        weighed = _weighed(clean, gram, variance, _doubt(kept) * (added @ theta - shared))
        bread = np.linalg.inv(weighed @ clean + np.diag(precision))
        theta = bread @ (weighed @ bare + believed)
        residual = np.where(used, f - A @ theta, 0.0)
        # with few parameters to many samples, what the fit takes out is nothing
        correlation, _ = pooled_autocorrelation(residual, group, None)
        white = float(residual @ residual) / (n - p)
        solved = _Solved(theta, bread, bread @ weighed, residual, correlation, white, share, kept)
        variance = white * max(2.0 * float(correlation.sum()) - 1.0, 1.0)
    assert solved is not None
    return solved


def _doubt(kept: float) -> float:
    """The uncertain share of the noise; what was not taken off is doubted whole."""
    return DOUBT * kept + (1.0 - kept)


def _weighed(clean: Floats, gram: Floats, variance: float, doubted: Floats) -> Floats:
    """G S⁻¹ with S = σ² AᵀA and one error that is common to all samples."""
    S = variance * gram + np.outer(doubted, doubted)
    return np.linalg.solve(S + 1e-12 * np.trace(S) * np.eye(len(S)), clean).T


def _at_least(meats: Floats, gram: Floats) -> Floats:
    """The same where no direction has less than a share of what white residuals have.

    Correlations that are estimated may add up to a negative variance.
    """
    squares, vectors = np.linalg.eigh(gram)
    root = vectors * np.sqrt(np.maximum(squares, squares[-1] * 1e-12))
    half = np.linalg.solve(root, meats)
    of_white, directions = np.linalg.eigh(np.linalg.solve(root, half.T))
    if of_white[0] >= _LEAST_OF_WHITE:
        return meats
    kept = root @ directions
    return (kept * np.maximum(of_white, _LEAST_OF_WHITE)) @ kept.T


def _noise_share(noise: Floats, gram: Floats) -> float:
    """The largest share of noise in a direction of the columns."""
    if not noise.any():
        return 0.0
    try:
        root = np.linalg.cholesky(gram)
    except np.linalg.LinAlgError:
        return np.inf
    half = np.linalg.solve(root, noise)
    return float(np.linalg.eigvalsh(np.linalg.solve(root, half.T))[-1])


def _between_groups(gain: Floats, scores: Floats, covariance: Floats) -> tuple[Floats, float]:
    """What groups that disagree add, (p, p), and Birge's ratio of the first parameter."""
    count = len(scores)
    if count < 2:
        return np.zeros_like(covariance), float("nan")
    moved = scores @ gain.T
    between = moved.T @ moved * count / (count - 1)
    ratio = float(between[0, 0] / covariance[0, 0])
    if ratio <= 1.0 + _DISAGREE * np.sqrt(2.0 / (count - 1)):
        return np.zeros_like(covariance), float(np.sqrt(ratio))
    # every parameter grows as the first does: a full matrix of few groups is no covariance
    grown = covariance * (ratio * student_factor(count - 1.0) ** 2 - 1.0)
    return grown, float(np.sqrt(ratio))


def _common_misfit(
    gain: Floats, A: Floats, residual: Floats, rows: list[Ints], direction: Floats
) -> tuple[Floats, float]:
    """What all groups miss alike adds, (p, p), and the ratio of its mean square to its noise.

    Averaged over the groups from where each begins, residuals that are noise leave a share 1/groups
    of their variance. What is left beyond counts as one draw of an error with the correlation of
    that average: repeating it in every group does not average it out.
    """
    nothing = np.zeros_like(gain)
    if len(rows) < 3:
        return nothing, float("nan")
    length = int(np.median([part.size for part in rows]))
    each = np.full((len(rows), length), np.nan)
    for i, part in enumerate(rows):
        part = part[:length]
        each[i, : part.size] = residual[part] * direction[part[part.size // 2]]
    count = np.isfinite(each).sum(axis=0)
    known = count >= 2
    mean = np.nanmean(each[:, known], axis=0)
    left = float((np.nanvar(each[:, known], axis=0, ddof=1) / count[known]).mean())
    square = float((mean**2).mean())
    ratio = square / left if left > 0 else float("nan")
    if not ratio > _MISFIT:
        return nothing, ratio
    correlation, _ = pooled_autocorrelation(mean, np.zeros(mean.size, np.int64), None)
    typical = min(rows, key=lambda part: abs(part.size - length))
    one = np.ascontiguousarray(A[typical] * direction[typical[typical.size // 2]])
    zeros = np.zeros(typical.size, np.int64)
    spread = _at_least(meat(one, zeros, 0, 0, typical.size - 1, correlation), one.T @ one)
    spread *= square - left
    return gain @ (spread * len(rows) ** 2) @ gain.T, ratio


def _nothing(p: int, n: int) -> PriorFit:
    nan, square = np.full(p, np.nan), np.full((p, p), np.nan)
    no = float("nan")
    return PriorFit(
        nan, square, square, square, square, nan, no, no, no, 0, np.zeros(n), no
    )  # fmt: skip

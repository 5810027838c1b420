"""Least squares with normal priors on nuisance parameters, and what its uncertainty is made of.

The noise of the columns is taken off the normal equations (errors in variables: Fuller, Measurement
Error Models, 1987), the residuals' correlation goes into a sandwich that is combined with the
priors, and groups (starts, say) that disagree with each other, or that all miss the model in the
same way, widen the answer. Every part is kept by itself, for a budget.

The first parameter may have a level of its own by group, and scatter about it (a mixed model:
Laird & Ware 1982, Random-effects models for longitudinal data); the others are everyone's.
"""

from dataclasses import dataclass
from typing import Final, NamedTuple

import numpy as np

from estimators.autocorrelation import loss_of, pooled_autocorrelation, student_factor
from estimators.estimate import Floats, Ints
from estimators.group_sums import GroupSums, NoiseMoments
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
#: What the fit takes out of the residuals of fewer groups is put back.
_FEW_GROUPS: Final = 3
_ROUNDS: Final = 4


@dataclass(frozen=True, slots=True)
class Levels:
    """The first parameter's levels.

    Attributes:
        of: (groups,) level of each group, from 0, groups in ascending order.
        unit: (groups,) what scatters as one, from 0; a unit has one level.
        scatter: standard deviation of the units about their level.
        freedom: degrees of freedom by which that is known.
    """

    of: Ints
    unit: Ints
    scatter: float = 0.0
    freedom: float = np.inf

    @property
    def count(self) -> int:
        """How many levels there are."""
        return int(self.of.max()) + 1


@dataclass(frozen=True, slots=True)
class Grouping:
    """What is known of the groups of samples.

    Attributes:
        direction: (n,) sign by which what a group misses is compared with the others; None: 1.
        shortest: groups of fewer samples tell nothing of their own.
        levels: of the first parameter; None gives it one, and widens by groups that disagree.
        taken: (n, q) columns that were taken off each group's response and columns; None: none.
    """

    direction: Floats | None = None
    shortest: int = 50
    levels: Levels | None = None
    taken: Floats | None = None


@dataclass(frozen=True, slots=True)
class PriorFit:
    """Estimates, and the parts of their covariance.

    With levels of the first parameter, p counts each, and they come first.

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


def fit(
    A: Floats,
    f: Floats,
    group: Ints,
    noise: NoiseMoments | None,
    prior_mean: Floats,
    prior_std: Floats,
    grouping: Grouping | None = None,
) -> PriorFit:
    """Fit θ of A θ = f.

    Args:
        A: (n, p) columns; rows of no group may be anything but NaN.
        f: (n,) response.
        group: (n,) the group of each sample, contiguous, negative for none.
        noise: of the columns; None takes them as exact.
        prior_mean: (p,).
        prior_std: (p,), inf where nothing is known.
        grouping: what is known of the groups; None for its defaults.

    Returns:
        The fit; NaN throughout where the samples do not determine it.
    """
    grouping = Grouping() if grouping is None else grouping
    levels, direction = grouping.levels, grouping.direction
    used = group >= 0
    n, p = int(used.sum()), A.shape[1]
    count = 1 if levels is None else levels.count
    if n <= p + count:
        return _nothing(p + count - 1, f.size)
    scale = np.sqrt((A[used] ** 2).mean(axis=0))
    # a column that is 0 throughout is left to its prior
    scale = np.where(scale > 0.0, scale, 1.0)
    A = np.ascontiguousarray(np.where(used[:, None], A / scale, 0.0))
    f = np.where(used, f, 0.0)
    sums = GroupSums.of(A, f, group, noise, scale)
    one = np.zeros(len(sums.rows), np.int64)
    shape = _Shape(Levels(one, np.arange(one.size)) if levels is None else levels, p, scale[0])
    precision = np.where(np.isfinite(prior_std), (prior_std * scale) ** -2.0, 0.0)
    believed = precision * prior_mean * scale
    # a fit of few parameters takes nothing out of many groups
    taken = A if grouping.taken is None and len(sums.rows) < _FEW_GROUPS else grouping.taken
    try:
        solved = _solved(A, f, group, sums, shape, precision, believed, taken)
    except np.linalg.LinAlgError:
        return _nothing(p + count - 1, f.size)
    theta, bread, gain, residual, correlation, white, share, kept, turned = solved
    meats = np.stack(
        [
            meat(A, group, int(group[part[0]]), int(part[0]), int(part[-1]), correlation)
            for part in sums.rows
        ]
    )
    # noise of the columns times the residuals, both of which last as long as the mean does
    alike = max(2.0 * float(correlation @ correlation) - 1.0, 1.0)
    turns = turned.turns[shape.levels.unit]
    meats = turns @ (meats + sums.noise_gram * alike) @ turns.transpose(0, 2, 1)
    covariance = gain @ (_at_least(shape.square(meats), turned.gram) * white) @ gain.T
    covariance *= student_factor(max(n / alike - theta.size, 1.0)) ** 2
    told = [i for i, part in enumerate(sums.rows) if part.size >= grouping.shortest]
    own = shape.by_group(theta)
    cleaned = sums.grams - kept * sums.noise_gram
    scores = (sums.crosses - kept * sums.noise_cross) - np.einsum("gij,gj->gi", cleaned, own)
    spread = shape.rows(np.einsum("gij,gj->gi", turns, scores))[told]
    scatter = gain @ turned.scatter @ gain.T
    if levels is not None:
        scatter *= student_factor(levels.freedom) ** 2
    # what a unit's scatter does not explain: stretches within it disagree as well
    grown, ratio = _between_groups(gain, spread, covariance + scatter, count)
    scatter = scatter + grown
    signs = np.ones(f.size) if direction is None else direction
    common_gain = gain @ shape.wide(turns[told], shape.levels.of[told]) / max(len(told), 1)
    misfit, common = _common_misfit(common_gain, A, residual, [sums.rows[i] for i in told], signs)
    # where noise is nearly all there is, what was not taken off is doubted whole
    doubt = _doubt(kept) * gain @ turned.taken
    scale = shape.widened(scale)
    units = np.outer(scale, scale)
    return PriorFit(
        theta / scale,
        covariance / units,
        (bread * np.sqrt(shape.widened(precision))).T / scale,
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
class _Shape:
    """How p parameters of a group are those of the whole: a level first, then everyone's."""

    levels: Levels
    p: int
    scale: float

    def widened(self, values: Floats) -> Floats:
        """(p,) of a group as (wide,), the first for every level."""
        return np.concatenate([np.full(self.levels.count, values[0]), values[1:]])

    def by_group(self, theta: Floats) -> Floats:
        """(groups, p) parameters of each."""
        of = self.levels.of
        shared = np.broadcast_to(theta[self.levels.count :], (of.size, self.p - 1))
        return np.column_stack([theta[of], shared])

    def rows(self, values: Floats) -> Floats:
        """(groups, wide) of (groups, p)."""
        count, of = self.levels.count, self.levels.of
        out = np.zeros((of.size, count + self.p - 1))
        out[np.arange(of.size), of] = values[:, 0]
        out[:, count:] = values[:, 1:]
        return out

    def square(self, values: Floats, of: Ints | None = None) -> Floats:
        """The sum (wide, wide) of (groups, p, p)."""
        count, of = self.levels.count, self.levels.of if of is None else of
        out = np.zeros((count + self.p - 1, count + self.p - 1))
        np.add.at(out, (of, of), values[:, 0, 0])
        for j in range(1, self.p):
            np.add.at(out[:, count + j - 1], of, values[:, 0, j])
            np.add.at(out[count + j - 1], of, values[:, j, 0])
        out[count:, count:] = values[:, 1:, 1:].sum(axis=0)
        return out

    def wide(self, turns: Floats, of: Ints) -> Floats:
        """(wide, p) of (groups, p, p): what an error that all share does to the scores."""
        out = np.zeros((self.levels.count + self.p - 1, self.p))
        np.add.at(out, of, turns[:, 0])
        out[self.levels.count :] = turns[:, 1:].sum(axis=0)
        return out

    @property
    def of_units(self) -> Ints:
        """(units,) level of each."""
        out = np.zeros(int(self.levels.unit.max()) + 1, np.int64)
        out[self.levels.unit] = self.levels.of
        return out


@dataclass(frozen=True, slots=True)
class _Turned:
    """The normal equations of the whole, every unit weighted down by its scatter.

    A unit's scores G δ + e, δ the scatter, have the covariance S = σ² G + τ² g gᵀ with g the first
    column of G; G S⁻¹ = T / σ² with T = 1 - κ g e₁ᵀ, κ = ρ / (1 + ρ G₁₁) and ρ = τ² / σ².

    Attributes:
        turns: (units, p, p) T.
        clean: (wide, wide) T G, without noise.
        bare: (wide,) T Aᵀf, without noise.
        gram: (wide, wide) T G with it.
        taken: (wide,) what all noise does to the scores.
        scatter: (wide, wide) of the scores by τ alone.
    """

    turns: Floats
    clean: Floats
    bare: Floats
    gram: Floats
    taken: Floats
    scatter: Floats


def _turned(sums: GroupSums, shape: _Shape, kept: float, theta: Floats, variance: float) -> _Turned:
    levels, of = shape.levels, shape.of_units
    each = sums.by(levels.unit)
    clean = each.grams - kept * each.noise_gram
    bare = each.crosses - kept * each.noise_cross
    first = np.zeros((of.size, shape.p))
    first[levels.unit] = shape.by_group(theta)
    taken = np.einsum("uij,uj->ui", each.noise_gram, first) - each.noise_cross
    ratio = (levels.scatter * shape.scale) ** 2 / variance
    column = clean[:, :, 0]
    weight = ratio / (1.0 + ratio * np.maximum(column[:, 0], 0.0))
    turns = np.tile(np.eye(shape.p), (of.size, 1, 1))
    turns[:, :, 0] -= weight[:, None] * column
    moved = np.einsum("uij,uj->ui", turns, column)
    by_tau = variance * ratio * np.einsum("ui,uj->uij", moved, moved)
    full = each.grams - (ratio / (1.0 + ratio * each.grams[:, 0, 0]))[:, None, None] * np.einsum(
        "ui,uj->uij", each.grams[:, :, 0], each.grams[:, :, 0]
    )
    return _Turned(
        turns,
        shape.square(turns @ clean, of),
        _summed(np.einsum("uij,uj->ui", turns, bare), of, levels.count),
        shape.square(full, of),
        _summed(np.einsum("uij,uj->ui", turns, taken), of, levels.count),
        shape.square(by_tau, of),
    )


def _summed(values: Floats, of: Ints, count: int) -> Floats:
    """The sum (wide,) of (units, p)."""
    out = np.zeros(count + values.shape[1] - 1)
    np.add.at(out, of, values[:, 0])
    out[count:] = values[:, 1:].sum(axis=0)
    return out


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
    turned: _Turned


def _solved(
    A: Floats,
    f: Floats,
    group: Ints,
    sums: GroupSums,
    shape: _Shape,
    precision: Floats,
    believed: Floats,
    taken: Floats | None,
) -> _Solved:
    """Solve (G S⁻¹ G + P⁻¹) θ = G S⁻¹ b + P⁻¹ θ₀, S the covariance of what G θ misses of b.

    S is σ² AᵀA, by the residuals' long-run variance, and what is uncertain of the noise's
    correction: without it more samples of the same would outvote the priors with that error.

    Raises:
        LinAlgError: the samples do not determine it.
    """
    used = group >= 0
    n = int(used.sum())
    index = np.full(f.size, -1, np.int64)
    for i, part in enumerate(sums.rows):
        index[part] = i
    gram, cross = sums.grams.sum(axis=0), sums.crosses.sum(axis=0)
    added = sums.noise_gram.sum(axis=0)
    # the first residuals are the textbook's: from those of nothing fitted, three rounds are too few
    first = np.linalg.lstsq(gram, cross, rcond=None)[0]
    left = f - A @ first
    variance = float(left @ left) / n
    theta = shape.widened(np.asarray(first, np.float64))
    wide_precision, wide_believed = shape.widened(precision), shape.widened(believed)
    solved: _Solved | None = None
    loss = None if taken is None else loss_of(taken, group)
    for _ in range(_ROUNDS):
        if not variance > 0.0:
            raise np.linalg.LinAlgError("no residuals")
        share = _noise_share(added, gram + variance * np.diag(precision))
        kept = min(1.0, _LARGEST_NOISE_SHARE / share) if share > 0 else 1.0
        turned = _turned(sums, shape, kept, theta, variance)
        if solved is None:
            found = np.linalg.inv(turned.clean / variance + np.diag(wide_precision))
            theta = found @ (turned.bare / variance + wide_believed)
            turned = _turned(sums, shape, kept, theta, variance)
        weighed = _weighed(turned.clean, turned.gram, variance, _doubt(kept) * turned.taken)
        bread = np.asarray(
            np.linalg.inv(weighed @ turned.clean + np.diag(wide_precision)), np.float64
        )
        theta = bread @ (weighed @ turned.bare + wide_believed)
        own = shape.by_group(theta)
        residual = np.where(used, f - np.einsum("ni,ni->n", A, own[index]), 0.0)
        correlation, _ = pooled_autocorrelation(residual, group, taken, loss)
        white = float(residual @ residual) / (n - theta.size)
        gain = bread @ weighed
        solved = _Solved(theta, bread, gain, residual, correlation, white, share, kept, turned)
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


def _between_groups(
    gain: Floats, scores: Floats, covariance: Floats, levels: int
) -> tuple[Floats, float]:
    """What groups that disagree add, (p, p), and Birge's ratio of the first parameter."""
    count = len(scores)
    freedom = count - levels
    if freedom < 1:
        return np.zeros_like(covariance), float("nan")
    moved = scores @ gain.T
    between = (moved[:, :levels] ** 2).sum(axis=0) * count / freedom
    own = np.diag(covariance)[:levels]
    if not (own > 0.0).all():
        return np.zeros_like(covariance), float("nan")
    ratio = float((between / own).mean())
    if ratio <= 1.0 + _DISAGREE * np.sqrt(2.0 / freedom):
        return np.zeros_like(covariance), float(np.sqrt(ratio))
    # every parameter grows as the first does: a full matrix of few groups is no covariance
    grown = covariance * (ratio * student_factor(float(freedom)) ** 2 - 1.0)
    return grown, float(np.sqrt(ratio))


def _common_misfit(
    gain: Floats, A: Floats, residual: Floats, rows: list[Ints], direction: Floats
) -> tuple[Floats, float]:
    """What all groups miss alike adds, (wide, wide), and the ratio of its square to its noise.

    The gain (wide, p) is that of a score which every group has.
    Averaged over the groups from where each begins, residuals that are noise leave a share 1/groups
    of their variance. What is left beyond counts as one draw of an error with the correlation of
    that average: repeating it in every group does not average it out.
    """
    nothing = np.zeros((len(gain), len(gain)))
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

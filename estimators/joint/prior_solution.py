"""Least squares with normal priors, corrected for noise of the columns.

(G S⁻¹ G + P⁻¹) θ = G S⁻¹ b + P⁻¹ θ₀ with G the normal equations without the noise of the columns:
errors in variables (Fuller, Measurement Error Models, 1987). Units of one level scatter about it
(Laird & Ware 1982, Random-effects models for longitudinal data).
"""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from estimators.arrays import Floats, Ints
from estimators.interpreted import compiled_unless_short_log, compiled_with_array_form
from estimators.joint.gain_matrix import (
    DenseGain,
    Gain,
    is_level_elimination_worthwhile,
    solve_by_elimination,
)
from estimators.joint.joint_limits import LIMITS
from estimators.joint.random_intercepts import InterceptShape
from estimators.numerics.autocorrelation import estimate_pooled_autocorrelation
from estimators.numerics.bordered_matrix import BorderedMatrix
from estimators.numerics.group_sums import GroupSums
from estimators.numerics.small_systems import compute_largest_noise_fraction

#: Parts of a `BorderedMatrix`.
BorderedParts = tuple[Floats, Floats, Floats, Floats]


@dataclass(frozen=True, slots=True)
class WeightedNormalEquations:
    """Normal equations of all units, each weighted according to its scatter.

    The scores G δ + e of a unit, with scatter δ, have the covariance S = σ² G + τ² g gᵀ with g the
    first column of G; G S⁻¹ = T / σ² with T = 1 - κ g e₁ᵀ, κ = ρ / (1 + ρ G₁₁) and ρ = τ² / σ².

    Attributes:
        regressions: (units, p) κ g, regression of the scores on the first one, due to τ.
        clean: (wide, wide) T G without column noise.
        gram: (wide, wide) T G with column noise.
        scatter: (wide, wide) covariance of the scores due to τ.
        bare: (wide,) T Aᵀf without column noise.
        taken: (wide,) contribution of all column noise to the scores.
    """

    regressions: Floats
    clean: BorderedMatrix
    gram: BorderedMatrix
    scatter: BorderedMatrix
    bare: Floats
    taken: Floats

    @property
    def turns(self) -> Floats:
        """(units, p, p) T."""
        units, p = self.regressions.shape
        turns = np.tile(np.eye(p), (units, 1, 1))
        turns[:, :, 0] -= self.regressions
        return turns


def compute_weighted_normal_equations_of_units(
    units: GroupSums,
    intercept_shape: InterceptShape,
    level_of_unit: Ints,
    subtracted_noise_fraction: float,
    theta: Floats,
    variance: float,
) -> WeightedNormalEquations:
    """Normal equations of all units, each weighted by the scatter about its level, (units,)."""
    sums = units.grams, units.crosses, units.noise_gram, units.noise_cross
    tau = intercept_shape.levels.scatter * intercept_shape.scale
    regressions, clean, gram, scatter, bare, taken = compute_weighted_normal_equation_parts(
        sums,
        level_of_unit,
        intercept_shape.levels.level_count,
        subtracted_noise_fraction,
        theta,
        tau**2,
        variance,
    )
    return WeightedNormalEquations(
        regressions,
        BorderedMatrix(*clean),
        BorderedMatrix(*gram),
        BorderedMatrix(*scatter),
        bare,
        taken,
    )


@compiled_unless_short_log
def compute_weighted_normal_equation_parts(
    group_sums: tuple[Floats, Floats, Floats, Floats],
    level_of_unit: Ints,
    level_count: int,
    subtracted_noise_fraction: float,
    theta: Floats,
    scatter_square: float,
    variance: float,
) -> tuple[Floats, BorderedParts, BorderedParts, BorderedParts, Floats, Floats]:
    """Compute the attributes of `WeightedNormalEquations`, matrices by their parts.

    Args:
        group_sums: sums by unit: AᵀA, Aᵀf, and the noise contribution to each.
        level_of_unit: (units,) level of each unit.
        level_count: number of levels.
        subtracted_noise_fraction: fraction of the noise that is subtracted.
        theta: (wide,) parameters, the levels first.
        scatter_square: τ².
        variance: σ².
    """
    grams, crosses, noise_gram, noise_cross = group_sums
    ratio = scatter_square / variance
    units, p, _ = grams.shape
    wide = level_count + p - 1
    k = p - 1
    regressions = np.empty((units, p))
    clean_d, gram_d, scatter_d = np.zeros(level_count), np.zeros(level_count), np.zeros(level_count)
    clean_r, gram_r, scatter_r = (
        np.zeros((level_count, k)),
        np.zeros((level_count, k)),
        np.zeros((level_count, k)),
    )
    clean_b, gram_b, scatter_b = (
        np.zeros((k, level_count)),
        np.zeros((k, level_count)),
        np.zeros((k, level_count)),
    )
    clean_c, gram_c, scatter_c = np.zeros((k, k)), np.zeros((k, k)), np.zeros((k, k))
    bare, taken = np.zeros(wide), np.zeros(wide)
    place, own = np.arange(level_count - 1, wide), np.empty(p)
    g, c, moved, noisy = np.empty((p, p)), np.empty(p), np.empty(p), np.empty(p)
    for u in range(units):
        place[0] = level_of_unit[u]
        for i in range(p):
            own[i] = theta[place[i]]
            c[i] = crosses[u, i] - subtracted_noise_fraction * noise_cross[u, i]
            noisy[i] = -noise_cross[u, i]
        for i in range(p):
            for j in range(p):
                g[i, j] = grams[u, i, j] - subtracted_noise_fraction * noise_gram[u, i, j]
                # all sums side by side, as the matrix is symmetric
                noisy[j] += noise_gram[u, i, j] * own[i]
        weight = ratio / (1.0 + ratio * max(g[0, 0], 0.0))
        full = ratio / (1.0 + ratio * grams[u, 0, 0])
        for i in range(p):
            regressions[u, i] = weight * g[i, 0]
            moved[i] = g[i, 0] - weight * g[i, 0] * g[0, 0]
        for i in range(p):
            lost = weight * g[i, 0]
            bare[place[i]] += c[i] - lost * c[0]
            taken[place[i]] += noisy[i] - lost * noisy[0]
        level, heavy = level_of_unit[u], variance * ratio
        clean_d[level] += g[0, 0] - weight * g[0, 0] * g[0, 0]
        gram_d[level] += grams[u, 0, 0] - full * grams[u, 0, 0] * grams[u, 0, 0]
        scatter_d[level] += heavy * moved[0] * moved[0]
        for i in range(k):
            lost, gone = weight * g[i + 1, 0], full * grams[u, i + 1, 0]
            clean_r[level, i] += g[0, i + 1] - weight * g[0, 0] * g[0, i + 1]
            gram_r[level, i] += grams[u, 0, i + 1] - full * grams[u, 0, 0] * grams[u, i + 1, 0]
            scatter_r[level, i] += heavy * moved[0] * moved[i + 1]
            clean_b[i, level] += g[i + 1, 0] - lost * g[0, 0]
            gram_b[i, level] += grams[u, i + 1, 0] - gone * grams[u, 0, 0]
            scatter_b[i, level] += heavy * moved[i + 1] * moved[0]
            for j in range(k):
                clean_c[i, j] += g[i + 1, j + 1] - lost * g[0, j + 1]
                gram_c[i, j] += grams[u, i + 1, j + 1] - gone * grams[u, j + 1, 0]
                scatter_c[i, j] += heavy * moved[i + 1] * moved[j + 1]
    return (
        regressions,
        (clean_d, clean_r, clean_b, clean_c),
        (gram_d, gram_r, gram_b, gram_c),
        (scatter_d, scatter_r, scatter_b, scatter_c),
        bare,
        taken,
    )


def _subtract_fit_vectorised(
    A: Floats, f: Floats, group: Ints, theta: Floats, level_of_unit: Ints, level_count: int
) -> Floats:
    """Residuals f - A θ, with the level of each group's unit; 0 without a group."""
    A = np.where(group[:, None] >= 0, A, 0.0)
    left = f - A[:, 0] * theta[level_of_unit[group]]
    for column, value in zip(A.T[1:], theta[level_count:], strict=True):
        left -= column * value
    return np.where(group >= 0, left, 0.0)


@compiled_with_array_form(_subtract_fit_vectorised)
def compute_grouped_residuals(
    A: Floats, f: Floats, group: Ints, theta: Floats, level_of_unit: Ints, level_count: int
) -> Floats:
    """Residuals f - A θ, (n,); 0 for samples without a group (group < 0).

    Args:
        A: (n, p) columns.
        f: (n,) response.
        group: (n,) group of each sample, from 0.
        theta: (wide,) parameters, the levels first.
        level_of_unit: (groups,) level of each group.
        level_count: number of levels.
    """
    out = np.zeros(f.size)
    shared = theta[level_count:]
    for k in range(f.size):
        if group[k] >= 0:
            left = f[k] - A[k, 0] * theta[level_of_unit[group[k]]]
            for i in range(shared.size):
                left -= A[k, i + 1] * shared[i]
            out[k] = left
    return out


class SolutionParts(NamedTuple):
    """Estimates and their gain, residuals, their correlation and variance, noise fraction."""

    theta: Floats
    gain: Gain
    residual: Floats
    correlation: Floats
    white: float
    share: float
    kept: float
    turned: WeightedNormalEquations


class ProjectedColumns(NamedTuple):
    """Columns (n, q) projected out of each group, and their `compute_autocovariance_loss`."""

    columns: Floats | None
    autocovariance_loss: Floats


def solve_with_priors_iteratively(
    A: Floats,
    f: Floats,
    group: Ints,
    sums: GroupSums,
    scale: Floats,
    intercept_shape: InterceptShape,
    priors: tuple[Floats, Floats],
    projected: ProjectedColumns,
) -> SolutionParts:
    """Solve (G S⁻¹ G + P⁻¹) θ = G S⁻¹ b + P⁻¹ θ₀, with S the covariance of b - G θ.

    S is σ² AᵀA, with the long-run variance of the residuals, plus the uncertainty of the noise
    correction. The error of that correction is common to all samples: without its uncertainty, many
    samples would outweigh the priors even if the correction is wrong.

    Args:
        A: (n, p) columns.
        f: (n,) response.
        group: (n,) group of each sample.
        sums: sums of the scaled columns by group.
        scale: (p,) divisors of the columns; estimates and priors are for the scaled columns.
        intercept_shape: relation of a group's parameters to all parameters.
        priors: (p,) precisions P⁻¹, and (p,) P⁻¹ θ₀.
        projected: columns projected out of each group.

    Raises:
        LinAlgError: the samples do not determine the estimates.
    """
    n = int((group >= 0).sum())
    precision, believed = priors
    index = np.full(f.size, -1, np.int64)
    for i, part in enumerate(sums.rows):
        index[part] = i
    gram, cross = sums.grams.sum(axis=0), sums.crosses.sum(axis=0)
    added = sums.noise_gram.sum(axis=0)
    # start from the residuals of ordinary least squares, or three rounds would not be enough
    first = np.linalg.lstsq(gram, cross, rcond=None)[0]
    one_level = np.zeros(len(sums.rows), np.int64)
    left = compute_grouped_residuals(A, f, index, first / scale, one_level, 1)
    variance = float(left @ left) / n
    theta = intercept_shape.expand_to_levels(np.asarray(first, np.float64))
    wide_precision, wide_believed, wide_scale = map(
        intercept_shape.expand_to_levels, (precision, believed, scale)
    )
    solved: SolutionParts | None = None
    units, of_units, level_of_unit = (
        sums.sum_groups_by_unit(intercept_shape.levels.unit),
        intercept_shape.level_of_each_unit,
        intercept_shape.levels.membership,
    )
    for _ in range(LIMITS.solution_rounds):
        if not variance > 0.0:
            raise np.linalg.LinAlgError("no residuals")
        share = compute_largest_noise_fraction(added, gram + variance * np.diag(precision))
        kept = min(1.0, LIMITS.max_noise_fraction / share) if share > 0 else 1.0
        turned = compute_weighted_normal_equations_of_units(
            units, intercept_shape, of_units, kept, theta, variance
        )
        if solved is None:
            theta = solve_given_white_noise(turned, (wide_precision, wide_believed), variance)
            turned = compute_weighted_normal_equations_of_units(
                units, intercept_shape, of_units, kept, theta, variance
            )
        doubted = compute_uncertain_fraction_of_noise(kept) * turned.taken
        theta, gain = solve_given_error_common_to_samples(
            turned, (wide_precision, wide_believed), variance, doubted
        )
        residual = compute_grouped_residuals(
            A, f, index, theta / wide_scale, level_of_unit, intercept_shape.levels.level_count
        )
        correlation, _ = estimate_pooled_autocorrelation(residual, group, *projected)
        with np.errstate(over="ignore"):  # for parameters that only rounding determines
            white = float(residual @ residual) / (n - theta.size)
        solved = SolutionParts(theta, gain, residual, correlation, white, share, kept, turned)
        variance = white * max(2.0 * float(correlation.sum()) - 1.0, 1.0)
    assert solved is not None
    return solved


def solve_given_white_noise(
    equations: WeightedNormalEquations, priors: tuple[Floats, Floats], variance: float
) -> Floats:
    """Estimates (wide,) for white noise, S = σ² G, which the iteration starts from."""
    precision, believed = priors
    wanted = equations.bare / variance + believed
    if is_level_elimination_worthwhile(equations.clean):
        clean = equations.clean.multiply_by_number(1.0 / variance)
        m = clean.diagonal.size
        regular = BorderedMatrix(
            clean.diagonal + precision[:m],
            clean.right,
            clean.below,
            clean.corner + np.diag(precision[m:]),
        )
        return regular.solve(wanted)
    found = np.linalg.inv(equations.clean.to_dense() / variance + np.diag(precision))
    return found @ wanted


def solve_given_error_common_to_samples(
    equations: WeightedNormalEquations,
    priors: tuple[Floats, Floats],
    variance: float,
    common_error: Floats,
) -> tuple[Floats, Gain]:
    """Estimates (wide,) and gain for S = σ² AᵀA plus an error common to all samples."""
    if is_level_elimination_worthwhile(equations.clean):
        trace = variance * equations.gram.trace + float(common_error @ common_error)
        scores = (
            equations.gram,
            common_error / np.sqrt(variance),
            LIMITS.ridge_fraction * trace / variance,
        )
        return solve_by_elimination(equations.clean, scores, priors, equations.bare, variance)
    precision, believed = priors
    clean = equations.clean.to_dense()
    weighed = compute_weighted_gram(clean, equations.gram.to_dense(), variance, common_error)
    # columns beyond the range of a float have no finite estimate
    with np.errstate(invalid="ignore", over="ignore"):
        bread = np.asarray(np.linalg.inv(weighed @ clean + np.diag(precision)), np.float64)
        theta = bread @ (weighed @ equations.bare + believed)
        return theta, DenseGain(bread, bread @ weighed)


def compute_uncertain_fraction_of_noise(subtracted_noise_fraction: float) -> float:
    """Uncertain fraction of the noise; noise that is not subtracted is entirely uncertain."""
    return LIMITS.uncertain_correction_fraction * subtracted_noise_fraction + (
        1.0 - subtracted_noise_fraction
    )


def compute_weighted_gram(
    clean: Floats, gram: Floats, variance: float, uncertain_noise: Floats
) -> Floats:
    """G S⁻¹ (p, p), where S is σ² AᵀA plus an error common to all samples.

    Args:
        clean: (p, p) G, AᵀA less its noise.
        gram: (p, p) AᵀA.
        variance: σ² of a sample.
        uncertain_noise: (p,) common error of Aᵀf.
    """
    S = variance * gram + np.outer(uncertain_noise, uncertain_noise)
    return np.linalg.solve(S + LIMITS.ridge_fraction * np.trace(S) * np.eye(len(S)), clean).T

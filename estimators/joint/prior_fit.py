"""Least squares with normal priors on nuisance parameters, with a split uncertainty.

The estimates are those of `prior_solution`. The correlation of the residuals enters a sandwich
covariance that is combined with the priors. Groups (starts, say) that disagree with each other, or
that all deviate from the model in the same way, increase the uncertainty. Every part is kept
separately, for a budget.

The first parameter may have its own level by group, and scatter about it; the other parameters are
common to all groups.
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.linalg import toeplitz

from estimators.arrays import Floats, Ints
from estimators.joint.gain_matrix import Gain, raise_meats_to_white_noise_floor
from estimators.joint.joint_limits import LIMITS
from estimators.joint.posterior_fit import CommonResidual, PosteriorFit
from estimators.joint.prior_solution import (
    ProjectedColumns,
    SolutionParts,
    compute_uncertain_fraction_of_noise,
    solve_with_priors_iteratively,
)
from estimators.joint.random_intercepts import InterceptShape, RandomIntercepts
from estimators.numerics.autocorrelation import (
    compute_autocovariance_loss,
    compute_student_to_normal_ratio,
    estimate_pooled_autocorrelation,
)
from estimators.numerics.group_sums import GroupSums, NoiseMoments, compute_rms_scales_of_columns
from estimators.numerics.sandwich import compute_sandwich_meat
from estimators.threads import return_freed_memory_to_os


@dataclass(frozen=True, slots=True)
class Grouping:
    """Grouping of the samples.

    Attributes:
        direction: (n,) sign that makes the groups' residuals comparable; None means 1.
        shortest: smallest number of samples of a group that is compared with others.
        levels: levels of the first parameter; None uses one, and disagreement adds uncertainty.
        taken: (n, q) columns projected out of each group's response and columns; None for none.
        loss: `compute_autocovariance_loss` of the fit, if already computed.
    """

    direction: Floats | None = None
    shortest: int = 50
    levels: RandomIntercepts | None = None
    taken: Floats | None = None
    loss: Floats | None = None


@dataclass(frozen=True)
class _SolvedSamples:
    """Samples and their solution, from which its uncertainty is computed.

    Attributes:
        theta: (wide,) estimates, unscaled.
        A: (n, p) columns.
        group: (n,) group of each sample.
        sums: sums of the scaled columns by group.
        shape: relation of a group's parameters to all parameters.
        precision: (p,) prior precisions of the scaled columns.
        scale: (p,) divisors of the columns.
        grouping: how groups are compared.
        solved: the solution of the scaled columns.
    """

    theta: Floats
    A: Floats
    group: Ints
    sums: GroupSums
    shape: InterceptShape
    precision: Floats
    scale: Floats
    grouping: Grouping
    solved: SolutionParts

    def residual_rms(self) -> float:
        """R.m.s. of the residuals."""
        residual = self.solved.residual
        return float(np.sqrt(residual @ residual / int((self.group >= 0).sum())))

    @property
    def compared_group_numbers(self) -> list[int]:
        """Numbers of the groups with enough samples to be compared."""
        rows = self.sums.rows
        return [i for i, part in enumerate(rows) if part.size >= self.grouping.shortest]

    @property
    def residual_signs_by_direction(self) -> Floats:
        """(n,) signs that make the groups' residuals comparable."""
        given = self.grouping.direction
        return np.ones(self.solved.residual.size) if given is None else given

    def common_residual(self) -> CommonResidual | None:
        """Residual common to the groups that are compared; None if there are fewer than three."""
        rows = [self.sums.rows[i] for i in self.compared_group_numbers]
        return CommonResidual.average_groups(
            rows, self.solved.residual, self.residual_signs_by_direction
        )

    def to_posterior_fit(self) -> PosteriorFit:
        """The estimates with all parts of their uncertainty."""
        A, group, sums, shape, grouping = (self.A, self.group, self.sums, self.shape, self.grouping)
        theta, gain, residual, correlation, white, share, kept, turned = self.solved
        levels, n = grouping.levels, int((group >= 0).sum())
        meats = np.stack(
            [
                compute_sandwich_meat(
                    A, group, int(group[part[0]]), int(part[0]), int(part[-1]), correlation
                )
                for part in sums.rows
            ]
        ) / np.outer(self.scale, self.scale)
        # products of column noise and residuals, which are both correlated over the mean
        alike = max(2.0 * float(correlation @ correlation) - 1.0, 1.0)
        turns = turned.turns[shape.levels.unit]
        meats = turns @ (meats + sums.noise_gram * alike) @ turns.transpose(0, 2, 1)
        covariance = gain.propagate_covariance(
            raise_meats_to_white_noise_floor(shape.expand_group_matrices(meats), turned.gram, white)
        )
        covariance *= compute_student_to_normal_ratio(max(n / alike - theta.size, 1.0)) ** 2
        told = self.compared_group_numbers
        own = shape.select_group_parameters(theta)
        cleaned = sums.grams - kept * sums.noise_gram
        scores = (sums.crosses - kept * sums.noise_cross) - np.einsum("gij,gj->gi", cleaned, own)
        spread = shape.expand_group_rows(np.einsum("gij,gj->gi", turns, scores))[told]
        scatter = gain.propagate_covariance(turned.scatter)
        if levels is not None:
            scatter *= compute_student_to_normal_ratio(levels.degrees_of_freedom) ** 2
        # disagreement that the scatter of units does not explain: groups within a unit differ too
        count = shape.levels.level_count
        grown, ratio = estimate_between_group_covariance_and_birge_ratio(
            gain, spread, covariance + scatter, count
        )
        scatter = scatter + grown
        misfit, common = estimate_common_misfit_covariance_and_ratio_to_noise(
            gain,
            A,
            self.common_residual(),
            _InformativeGroups([sums.rows[i] for i in told], turns[told] / self.scale, shape, told),
            self.residual_signs_by_direction,
        )
        # noise that was not subtracted is entirely uncertain
        doubt = gain.apply_to_vector(turned.taken, compute_uncertain_fraction_of_noise(kept))
        scale = shape.expand_to_levels(self.scale)
        units = np.outer(scale, scale)
        return PosteriorFit(
            self.theta,
            covariance / units,
            (gain.bread * np.sqrt(shape.expand_to_levels(self.precision))).T / scale,
            scatter / units,
            misfit / units,
            doubt / scale,
            share,
            ratio,
            common,
            len(told),
            residual,
            self.residual_rms(),
        )


class PriorSolution:
    """Estimates whose uncertainty is computed on first use.

    Attributes:
        theta: (p,) estimates.
        residual: (n,) f - A θ; 0 for samples without a group.
        group: (n,) group of each sample, negative for none.
        residual_rms: r.m.s. of the residuals.
        noise_share: `PosteriorFit.noise_share`.
    """

    def __init__(self, samples: _SolvedSamples) -> None:
        self.theta = samples.theta
        self.residual, self.group = samples.solved.residual, samples.group
        self.residual_rms, self.noise_share = samples.residual_rms(), samples.solved.share
        self._samples: _SolvedSamples | None = samples
        self._fit: PosteriorFit | None = None

    @property
    def fit(self) -> PosteriorFit:
        """The estimates with all parts of their uncertainty."""
        if self._fit is None:
            assert self._samples is not None
            # release the samples, which are hundreds of megabytes for a shift
            self._fit, self._samples = self._samples.to_posterior_fit(), None
        return self._fit

    def compute_uncertainty_and_release_samples(self) -> None:
        """Compute the uncertainty now, to release samples of hundreds of megabytes for a shift."""
        _ = self.fit
        return_freed_memory_to_os()  # no larger block fits where they were

    @cached_property
    def misfit_ratio(self) -> float:
        """`PosteriorFit.misfit_ratio`, which needs no other part of the uncertainty."""
        if self._samples is None:
            return self.fit.misfit_ratio
        common = self._samples.common_residual()
        return float("nan") if common is None else common.ratio


@dataclass(frozen=True)
class UndeterminedFit:
    """Result of samples that do not determine the estimates.

    Attributes:
        theta: (p,) NaN.
        group: (n,) group of each sample, negative for none.
    """

    theta: Floats
    group: Ints

    @property
    def residual(self) -> Floats:
        """(n,) zeros."""
        return np.zeros(self.group.size)

    @property
    def residual_rms(self) -> float:
        """NaN."""
        return float("nan")

    noise_share = misfit_ratio = residual_rms

    def compute_uncertainty_and_release_samples(self) -> None:
        """Nothing is kept."""

    @property
    def fit(self) -> PosteriorFit:
        """A fit with NaN throughout."""
        p, no = self.theta.size, float("nan")
        square = np.full((p, p), np.nan)
        residual = self.residual
        return PosteriorFit(
            self.theta, square, square, square, square, self.theta, no, no, no, 0, residual, no
        )


#: Estimates whose uncertainty, `fit`, is computed on first use.
Solution = PriorSolution | UndeterminedFit


def solve_with_priors(
    A: Floats,
    f: Floats,
    group: Ints,
    noise: NoiseMoments | None,
    prior_mean: Floats,
    prior_std: Floats,
    grouping: Grouping | None = None,
) -> Solution:
    """Solve A θ = f for θ; the arguments are those of `fit`."""
    grouping = Grouping() if grouping is None else grouping
    levels = grouping.levels
    n, p = int((group >= 0).sum()), A.shape[1]
    count = 1 if levels is None else levels.level_count
    nothing = UndeterminedFit(np.full(p + count - 1, np.nan), group)
    if n <= p + count:
        return nothing
    A, f, scale = (
        np.ascontiguousarray(A),
        np.where(group >= 0, f, 0.0),
        compute_rms_scales_of_columns(A, group),
    )
    sums = GroupSums.sum_products_by_group(A, f, group, noise, scale)
    one = np.zeros(len(sums.rows), np.int64)
    shape = InterceptShape(
        RandomIntercepts(one, np.arange(one.size)) if levels is None else levels, p, scale[0]
    )
    precision = np.where(np.isfinite(prior_std), (prior_std * scale) ** -2.0, 0.0)
    believed = precision * prior_mean * scale
    # a fit of few parameters takes hardly anything out of many groups
    taken = A if grouping.taken is None and len(sums.rows) < LIMITS.few_groups else grouping.taken
    loss = compute_autocovariance_loss(group, taken) if grouping.loss is None else grouping.loss
    try:
        solved = solve_with_priors_iteratively(
            A, f, group, sums, scale, shape, (precision, believed), ProjectedColumns(taken, loss)
        )
    except np.linalg.LinAlgError:
        return nothing
    theta = solved.theta / shape.expand_to_levels(scale)
    return PriorSolution(
        _SolvedSamples(theta, A, group, sums, shape, precision, scale, grouping, solved)
    )


def fit(
    A: Floats,
    f: Floats,
    group: Ints,
    noise: NoiseMoments | None,
    prior_mean: Floats,
    prior_std: Floats,
    grouping: Grouping | None = None,
) -> PosteriorFit:
    """Fit θ in A θ = f.

    Args:
        A: (n, p) columns; rows without a group are ignored.
        f: (n,) response.
        group: (n,) group of each sample, contiguous, negative for none.
        noise: noise moments of the columns; None treats the columns as exact.
        prior_mean: (p,) prior means.
        prior_std: (p,) prior standard deviations; inf for no prior.
        grouping: how groups are compared; None uses the defaults.

    Returns:
        The fit; NaN throughout if the samples do not determine it.
    """
    return solve_with_priors(A, f, group, noise, prior_mean, prior_std, grouping).fit


@dataclass(frozen=True)
class _InformativeGroups:
    """Groups with enough samples to be compared.

    Attributes:
        rows: samples of each group.
        turns: (groups, p, p) transformation of each group's unscaled scores by the scatter.
        shape: relation of a group's parameters to all parameters.
        number: index of each group among all groups.
    """

    rows: list[Ints]
    turns: Floats
    shape: InterceptShape
    number: list[int]

    def scores_per_unit_of_common_residual(
        self, A: Floats, group_signs: Floats, group_length: int
    ) -> Floats:
        """(length, wide) scores caused by a common residual of 1 at each place in the groups."""
        count = self.shape.levels.level_count
        total = np.zeros((group_length, count + A.shape[1] - 1))
        for part, turn, number in zip(self.rows, self.turns, self.number, strict=True):
            inside = part[:group_length]
            own = A[inside] @ turn.T * group_signs[part[part.size // 2]]
            total[: inside.size, self.shape.levels.membership[number]] += own[:, 0]
            total[: inside.size, count:] += own[:, 1:]
        return total


def estimate_between_group_covariance_and_birge_ratio(
    gain: Gain, scores: Floats, covariance: Floats, levels: int
) -> tuple[Floats, float]:
    """Covariance by disagreement of groups, (p, p), and Birge ratio of the first parameter."""
    count = len(scores)
    degrees_of_freedom = count - levels
    if degrees_of_freedom < 1:
        return np.zeros_like(covariance), float("nan")
    moved = gain.apply_to_rows(scores)
    between = (moved[:, :levels] ** 2).sum(axis=0) * count / degrees_of_freedom
    own = np.diag(covariance)[:levels]
    if not (own > 0.0).all():
        return np.zeros_like(covariance), float("nan")
    ratio = float((between / own).mean())
    if ratio <= 1.0 + LIMITS.disagreeing_std * np.sqrt(2.0 / degrees_of_freedom):
        return np.zeros_like(covariance), float(np.sqrt(ratio))
    # all variances are scaled like that of the first: few groups determine no full covariance
    grown = covariance * (
        ratio * compute_student_to_normal_ratio(float(degrees_of_freedom)) ** 2 - 1.0
    )
    return grown, float(np.sqrt(ratio))


def estimate_common_misfit_covariance_and_ratio_to_noise(
    gain: Gain,
    A: Floats,
    common_residual: CommonResidual | None,
    informative_groups: _InformativeGroups,
    group_signs: Floats,
) -> tuple[Floats, float]:
    """Covariance due to a residual common to all groups, (wide, wide), and its ratio to noise.

    The excess over the noise counts as a single draw of an error with the correlation of the common
    residual, since its repetition in every group does not average it out.
    """
    wide = informative_groups.shape.levels.level_count + A.shape[1] - 1
    nothing = np.zeros((wide, wide))
    if common_residual is None:
        return nothing, float("nan")
    if not common_residual.ratio > LIMITS.common_misfit_ratio:
        return nothing, common_residual.ratio
    mean, length = common_residual.mean, common_residual.length
    correlation, _ = estimate_pooled_autocorrelation(mean, np.zeros(mean.size, np.int64), None)
    moved = gain.apply_to_rows(
        informative_groups.scores_per_unit_of_common_residual(A, group_signs, length)
    )
    lasts = toeplitz(np.concatenate([correlation, np.zeros(length)])[:length])
    return moved.T @ lasts @ moved * common_residual.excess, common_residual.ratio

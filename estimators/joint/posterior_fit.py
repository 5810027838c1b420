"""Estimates of a fit with normal priors, with the parts of their covariance."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from estimators.arrays import Floats, Ints


@dataclass(frozen=True)
class PosteriorFit:
    """Estimates, with the parts of their covariance.

    If the first parameter has levels, each of them counts in p, and they come first.

    Attributes:
        theta: (p,) estimates.
        noise: (p, p) covariance due to the residuals, including their correlation.
        responses: (p, p) row j is the response to one standard deviation of prior j.
        scatter: (p, p) additional covariance due to disagreeing groups; 0 if they agree.
        misfit: (p, p) additional covariance due to a residual common to all groups; 0 if there is
            none.
        doubt: (p,) response to one standard deviation of the noise correction.
        noise_share: largest fraction of noise in any direction of the columns.
        scatter_ratio: standard deviation of the first parameter between groups over the expected
            one (Birge ratio); NaN with one group.
        misfit_ratio: mean square of the residual common to the groups over its expectation; NaN
            with fewer than three groups.
        groups: number of groups that were compared.
        residual: (n,) f - A θ; 0 for samples without a group.
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

    @cached_property
    def covariance(self) -> Floats:
        """(p, p) total covariance."""
        # skip parameters without a prior, such as the levels
        informed = self.responses[self.responses.any(axis=1)]
        priors = informed.T @ informed
        doubt = np.outer(self.doubt, self.doubt)
        return self.noise + priors + self.scatter + self.misfit + doubt

    @cached_property
    def has_common_misfit(self) -> bool:
        """Whether a residual common to all groups adds to the covariance."""
        return bool(self.misfit.any())

    @cached_property
    def parameter_stds(self) -> Floats:
        """(p,) standard deviations; NaN if rounding makes the variance negative."""
        variance = np.diag(self.covariance)
        return np.sqrt(np.where(variance < 0.0, np.nan, variance))


@dataclass(frozen=True, slots=True)
class CommonResidual:
    """Residual that all groups have in common, aligned at their first samples.

    Attributes:
        mean: mean residual at each sample number that at least two groups have.
        length: median number of samples of a group.
        excess: mean square of `mean` minus that by noise.
        ratio: mean square of `mean` over its noise.
    """

    mean: Floats
    length: int
    excess: float
    ratio: float

    @classmethod
    def average_groups(
        cls, rows: list[Ints], residual: Floats, group_signs: Floats
    ) -> "CommonResidual | None":
        """Average the residuals of groups; None if there are fewer than three.

        Noise averaged over the groups keeps 1/groups of its variance.
        """
        if len(rows) < 3:
            return None
        length = int(np.median([part.size for part in rows]))
        each = np.full((len(rows), length), np.nan)
        for i, part in enumerate(rows):
            part = part[:length]
            each[i, : part.size] = residual[part] * group_signs[part[part.size // 2]]
        count = np.isfinite(each).sum(axis=0)
        known = count >= 2
        mean = np.nanmean(each[:, known], axis=0)
        left = float((np.nanvar(each[:, known], axis=0, ddof=1) / count[known]).mean())
        square = float((mean**2).mean())
        return cls(mean, length, square - left, square / left if left > 0 else float("nan"))

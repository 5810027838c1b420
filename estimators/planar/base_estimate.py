"""Normal priors of parameters, and estimates of the parameters determined by a motion."""

from dataclasses import dataclass, replace

import numpy as np

from estimators.arrays import Floats
from estimators.planar.identifiability import Identifiability


@dataclass(frozen=True, slots=True)
class Prior:
    """A normal prior for some of the parameters.

    Attributes:
        names: (q,) names of the parameters.
        mean: (k, q) contributions to the means by each axis' force; they add up.
        covariance: (q, q) covariance, positive definite.
    """

    names: tuple[str, ...]
    mean: Floats
    covariance: Floats

    @classmethod
    def make_zero_mean(cls, std_by_parameter: dict[str, float], axis_count: int) -> "Prior":
        """Independent prior with mean 0 and the given standard deviations."""
        variance = np.square(list(std_by_parameter.values()))
        return cls(
            tuple(std_by_parameter),
            np.zeros((axis_count, len(std_by_parameter))),
            np.diag(variance),
        )

    def select_axes_and_parameters(self, axes: slice, parameters: tuple[str, ...]) -> "Prior":
        """Prior restricted to some axes and some parameters."""
        kept = [n for n, name in enumerate(self.names) if name in parameters]
        return Prior(
            tuple(self.names[n] for n in kept),
            self.mean[axes][:, kept],
            self.covariance[np.ix_(kept, kept)],
        )

    def combine_with_prior(self, other_prior: "Prior") -> "Prior":
        """Combine two independent priors of different parameters."""
        mine, size = len(self.names), len(self.names) + len(other_prior.names)
        covariance = np.zeros((size, size))
        covariance[:mine, :mine], covariance[mine:, mine:] = self.covariance, other_prior.covariance
        mean = np.concatenate([self.mean, other_prior.mean], axis=1)
        return Prior(self.names + other_prior.names, mean, covariance)


@dataclass(frozen=True, slots=True)
class BaseEstimate:
    """Estimate of p parameters, as far as a motion determines them.

    Attributes:
        identifiability: which parameters without a prior are determined.
        parameters: (p,) names of all parameters.
        theta: (p,) estimates; this and the next three are NaN where the motion does not determine
            a parameter.
        by_axis: (k, p) contributions of each axis' force, on which a gain of that axis acts.
        covariance: (p, p) covariance.
        responses: (q, p) response to one standard deviation of each prior and of each added
            uncertainty; correlated priors are split into independent ones.
        coefficients: (p,) coefficients of the columns of A in the fit; 0 for excluded ones.
        combination: (c,) values of `identifiability.determined_combinations`.
        combination_std: (c,) standard deviations of `combination`.
        residual_rms: (k,) r.m.s. of the residuals of each axis, in its unit.
    """

    identifiability: Identifiability
    parameters: tuple[str, ...]
    theta: Floats
    by_axis: Floats
    covariance: Floats
    responses: Floats
    coefficients: Floats
    combination: Floats
    combination_std: Floats
    residual_rms: Floats

    @property
    def parameter_stds(self) -> Floats:
        """(p,) standard deviations, NaN where the motion does not determine a parameter."""
        return np.sqrt(np.diagonal(self.covariance))

    def copy_with_parameter_uncertainty(self, parameter: str, u: float) -> "BaseEstimate":
        """Add an uncertainty of a parameter that its residuals do not show.

        The other parameters respond in proportion to their covariance with it. The uncertainty is a
        further row of `responses`, and not part of `combination_std`.
        """
        at = self.parameters.index(parameter)
        moved = u * self.covariance[at] / self.covariance[at, at]
        return replace(
            self,
            covariance=self.covariance + np.outer(moved, moved),
            responses=np.vstack([self.responses, moved]),
        )

    def ratio_and_gradient(self, numerator: str, denominator: str) -> tuple[float, Floats]:
        """Ratio of two parameters, and its derivatives with respect to the parameters, (p,).

        NaN if the denominator is 0.
        """
        i, j = self.parameters.index(numerator), self.parameters.index(denominator)
        gradient = np.zeros(len(self.parameters))
        if self.theta[j] == 0.0:
            gradient[[i, j]] = np.nan
            return float("nan"), gradient
        ratio = float(self.theta[i] / self.theta[j])
        gradient[[i, j]] = np.array([1.0, -ratio]) / self.theta[j]
        return ratio, gradient

    def ratio_and_std(self, numerator: str, denominator: str) -> tuple[float, float]:
        """Ratio of two parameters with its first-order standard deviation, such as mc_x / m.

        NaN if the motion does not determine both.
        """
        ratio, gradient = self.ratio_and_gradient(numerator, denominator)
        both = np.flatnonzero(gradient)
        variance = gradient[both] @ self.covariance[np.ix_(both, both)] @ gradient[both]
        return ratio, float(np.sqrt(variance))

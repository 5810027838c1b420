"""A normal prior of parameters, and an estimate of whatever a motion determines."""

from dataclasses import dataclass

import numpy as np

from estimators.arrays import Floats
from estimators.planar.identifiability import Identifiability


@dataclass(frozen=True, slots=True)
class Prior:
    """A normal prior of some of the parameters.

    Attributes:
        names: (q,) which parameters.
        mean: (k, q) their means, by the axis whose force they were found from: they add up.
        covariance: (q, q) of them, positive definite.
    """

    names: tuple[str, ...]
    mean: Floats
    covariance: Floats

    @classmethod
    def around_zero(cls, std: dict[str, float], axes: int) -> "Prior":
        """Independent parameters that are 0 but for these standard deviations."""
        variance = np.square(list(std.values()))
        return cls(tuple(std), np.zeros((axes, len(std))), np.diag(variance))

    def joined_with(self, other: "Prior") -> "Prior":
        """Both, of different parameters that are independent of each other."""
        mine, size = len(self.names), len(self.names) + len(other.names)
        covariance = np.zeros((size, size))
        covariance[:mine, :mine], covariance[mine:, mine:] = self.covariance, other.covariance
        mean = np.concatenate([self.mean, other.mean], axis=1)
        return Prior(self.names + other.names, mean, covariance)


@dataclass(frozen=True, slots=True)
class BaseEstimate:
    """Estimate of p parameters, as far as a motion determines them.

    Attributes:
        identifiability: what is determined of the parameters that have no prior.
        parameters: (p,) names of all parameters.
        theta: (p,) their values; NaN where the motion does not determine them.
        by_axis: (k, p) what each axis' force adds to them, likewise: a gain of one axis acts on it.
        covariance: (p, p) their covariance; NaN likewise.
        responses: (q, p) what one standard deviation of each prior moves them by, likewise; the
            priors as `Prior.covariance` has them if they are independent.
        coefficients: (p,) what multiplies the columns of A in the fit, 0 for those left out.
        combination: (c,) values of `identifiability.combinations`.
        combination_std: (c,) their standard deviations.
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
    def std(self) -> Floats:
        """(p,) standard deviations, NaN where the motion does not determine a parameter."""
        return np.sqrt(np.diagonal(self.covariance))

    def slope(self, numerator: str, denominator: str) -> tuple[float, Floats]:
        """One parameter over another, and what it changes by with each parameter, (p,).

        NaN where the other one is 0.
        """
        i, j = self.parameters.index(numerator), self.parameters.index(denominator)
        gradient = np.zeros(len(self.parameters))
        if self.theta[j] == 0.0:
            gradient[[i, j]] = np.nan
            return float("nan"), gradient
        ratio = float(self.theta[i] / self.theta[j])
        gradient[[i, j]] = np.array([1.0, -ratio]) / self.theta[j]
        return ratio, gradient

    def quotient(self, numerator: str, denominator: str) -> tuple[float, float]:
        """One parameter over another and its first-order deviation: a centre of mass is mc_x / m.

        NaN where the motion does not determine both.
        """
        ratio, gradient = self.slope(numerator, denominator)
        both = np.flatnonzero(gradient)
        variance = gradient[both] @ self.covariance[np.ix_(both, both)] @ gradient[both]
        return ratio, float(np.sqrt(variance))

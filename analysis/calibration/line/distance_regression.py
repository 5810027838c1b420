"""A straight line with errors in both variables, of any covariance (ISO/TS 28037:2010)."""

from dataclasses import dataclass
from typing import Final

import numpy as np

from analysis.calibration.line.line_limits import LIMITS
from estimators.arrays import Floats
from estimators.errors import DataError

#: Steps below this fraction of the ordinates count as rounding.
_ROUNDING: Final = 16 * float(np.finfo(np.float64).eps)


@dataclass(frozen=True, eq=False)
class StraightLine:
    """y = intercept + slope x.

    Attributes:
        intercept: ordinate at x = 0.
        slope: slope of the line.
        covariance: (2, 2) covariance of intercept and slope.
        chi2: weighted sum of squared distances at the solution.
        degrees_of_freedom: number of points minus two.
        x: (points,) adjusted abscissae.
        residual: (points,) y minus the line at the unadjusted abscissae.
    """

    intercept: float
    slope: float
    covariance: Floats
    chi2: float
    degrees_of_freedom: int
    x: Floats
    residual: Floats

    def compute_x_at(self, y: Floats) -> Floats:
        """(values,) abscissae at which the line has these ordinates."""
        return (y - self.intercept) / self.slope


def fit_line_by_generalised_distance(
    x: Floats, y: Floats, x_cov: Floats, y_cov: Floats
) -> StraightLine:
    """Fit a straight line by generalised distance regression.

    It minimises the distances in x and y together. For given parameters the best abscissae have a
    closed form, x + b Ux Ω⁻¹ z with z = y - a - b x and Ω = Uy + b² Ux; it remains to minimise
    zᵀ Ω⁻¹ z, for which the Gauss-Newton steps are those of the standard's clauses 7 and 10.

    Args:
        x: (points,) abscissae.
        y: (points,) ordinates.
        x_cov: (points, points) covariance of x; zeros if x is exact, and singular if points share
            an abscissa.
        y_cov: (points, points) covariance of y, positive definite.

    Raises:
        DataError: fewer than two different abscissae, an invalid covariance, or no convergence.

    Source:
        ISO/TS 28037:2010, clauses 6 (exact x), 7 (uncorrelated) and 10 (any covariance).
    """
    if x.size < 2 or np.ptp(x) == 0.0:
        raise DataError(
            "straight line: all points have the same reference mass; at least two different "
            "masses are needed"
        )
    # relative to the centroid, the two parameters of a line are nearly independent
    x0, y0 = float(x.mean()), float(y.mean())
    rounding = _ROUNDING * float(np.abs(y).max()) * np.array([1.0, 1.0 / float(np.ptp(x))])
    x, y = x - x0, y - y0
    slope = float(x @ y / (x @ x))
    level = 0.0
    design = np.ones((x.size, 2))
    for _ in range(LIMITS.distance_max_iterations):
        residual = y - level - slope * x
        weight = _invert_covariance(y_cov + slope**2 * x_cov)
        adjusted = x + slope * (x_cov @ (weight @ residual))
        design[:, 1] = adjusted
        weighted = weight @ design
        covariance = np.linalg.inv(design.T @ weighted)
        step = covariance @ (weighted.T @ residual)
        level, slope = level + float(step[0]), slope + float(step[1])
        if (
            np.abs(step)
            <= np.maximum(LIMITS.distance_step_std * np.sqrt(np.diag(covariance)), rounding)
        ).all():
            break
    else:
        raise DataError(
            "straight line: the fit does not converge; check the uncertainties of readings and "
            "references"
        )
    residual = y - level - slope * x
    shift = np.array([[1.0, -x0], [0.0, 1.0]])
    return StraightLine(
        intercept=y0 + level - slope * x0,
        slope=slope,
        covariance=np.asarray(shift @ covariance @ shift.T, np.float64),
        chi2=float(residual @ weight @ residual),
        degrees_of_freedom=x.size - 2,
        x=adjusted + x0,
        residual=residual,
    )


def _invert_covariance(covariance: Floats) -> Floats:
    try:
        np.linalg.cholesky(covariance)
        return np.linalg.inv(covariance).astype(np.float64)
    except np.linalg.LinAlgError as error:
        raise DataError(
            "straight line: the covariance of estimates and reference masses is not positive "
            "definite; check u_kg and shared_u_kg of the campaign file"
        ) from error

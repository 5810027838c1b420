"""Whether the loads' means lie on a line: an F test against what scatters runs of one load."""

from typing import Final

import numpy as np
from scipy.special import fdtrc

from analysis.calibration.line.calibration import LackOfFit
from analysis.calibration.line.distance_regression import distance_regression
from analysis.calibration.line.line_model import DAY, RUN, Points, estimated_effects, scatter_of
from analysis.calibration.line.variance_components import restricted_likelihood

#: A ratio less likely than this is taken for a lack of fit.
LEVEL: Final = 0.05


def lack_of_fit(points: Points, day_known_kg: float | None) -> LackOfFit:
    """Compare a mean a load with the line.

    Args:
        points: means of runs.
        day_known_kg: deviation from day to day where it is known, in kg of m̂.
    """
    design = (points.load[:, None] == np.unique(points.load)[None, :]).astype(np.float64)
    loads, count = design.shape[1], points.y_kg.size
    names = estimated_effects(points, loads, day_known=day_known_kg is not None)
    above = loads - 2
    below = count - loads - (points.days - 1 if DAY in names else 0)
    against = "run to run, at the same load"
    if RUN not in names:
        below, against = points.within.freedom, "repeatability; run to run would look the same"
    if above < 1 or below < 1 or not names:
        return LackOfFit(
            None,
            None,
            None,
            "nothing: no load has two runs, nor a run two readings",
            separate=False,
        )
    scatter = scatter_of(points, names, day_known_kg)
    found = restricted_likelihood(
        points.y_kg, design, scatter.by_squares, scatter.known, points.within
    )
    y_cov = scatter.covariance(found.transformed(scatter.squares).value)
    x_cov = points.x_cov_kg2
    fitted = distance_regression(points.x_kg, points.y_kg, x_cov, y_cov)
    weight = np.linalg.inv(y_cov + fitted.slope**2 * x_cov)
    means = np.linalg.solve(design.T @ weight @ design, design.T @ weight @ points.y_kg)
    left = points.y_kg - design @ means
    ratio = max(fitted.chi2 - float(left @ weight @ left), 0.0) / above
    p = float(fdtrc(above, below, ratio))
    return LackOfFit(ratio, p, (above, below), against, separate=RUN in names)

"""Results of an estimator: the `Estimate` of one window, or the `Trace` of many windows."""

from dataclasses import dataclass

import numpy as np

from estimators.arrays import Floats, Ints


@dataclass(frozen=True, slots=True)
class Estimate:
    """The estimate of one window.

    Attributes:
        theta: (p,) parameters.
        std: (p,) their standard deviations.
        residual_rms: r.m.s. of f - A θ.
        condition: condition number of A, columns scaled to unit norm.
    """

    theta: Floats
    std: Floats
    residual_rms: float
    condition: float


@dataclass(frozen=True, slots=True)
class Trace:
    """Estimates at the accepted rows only.

    Attributes:
        index: (rows,) sample k at which each estimate ends.
        theta: (rows, p) parameters.
        std: (rows, p) their standard deviations.
        residual_rms: (rows,) r.m.s. of the residuals.
        condition: (rows,) condition number, columns scaled to unit norm.
        autocorrelation: (lags,) residual autocorrelation, pooled over the log, lag 0 first.
    """

    index: Ints
    theta: Floats
    std: Floats
    residual_rms: Floats
    condition: Floats
    autocorrelation: Floats

    @classmethod
    def empty(cls, parameter_count: int) -> "Trace":
        """The trace of a log without an accepted row."""
        none = np.empty(0)
        wide = np.empty((0, parameter_count))
        return cls(np.empty(0, np.int64), wide, wide.copy(), none, none.copy(), np.ones(1))

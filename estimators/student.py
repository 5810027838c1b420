"""How much wider few degrees of freedom make a 95 % interval.

Deviations are stated so that 1.96 of them are 95 %, however few residuals they rest on.
"""

from estimators.estimate import Floats

#: Fewer cannot be told apart from none: a factor beyond 1.6 stands for "hardly known".
_FEWEST = 3.0


def student_factor(freedom: float) -> float:
    """Student's t over the normal quantile at 95 %, by the expansion of Cornish and Fisher.

    Within 0.5 % from 3 degrees of freedom on; fewer count as 3.
    """
    x = 1.0 / max(freedom, _FEWEST)
    return 1.0 + x * (1.2104 + x * (1.4335 + x * (1.2904 + x * 0.89)))


def widening(samples: float, correlation: Floats) -> float:
    """The factor of a deviation whose scale comes from `samples` residuals of that correlation.

    So many of them count as one in a variance as their squared correlations add up to (Bartlett).
    """
    alike = 2.0 * float(correlation @ correlation) - float(correlation[0]) ** 2
    return student_factor(samples / alike)

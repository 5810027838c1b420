"""How values differ from one another beyond what is uncertain of each."""

from scipy.special import chdtrc

from estimators.estimate import Floats


def between_variance(value: Floats, weight: Floats, level: float) -> float:
    """Variance between values by the moments of their weighted squares.

    0 where chance makes them differ as much with a larger probability than `level` (DerSimonian and
    Laird 1986).

    Args:
        value: (n,) at least two.
        weight: (n,) one over the variance of each.
        level: of the chi-square test that they do not differ.
    """
    mean = float(weight @ value / weight.sum())
    squares, freedom = float(weight @ (value - mean) ** 2), value.size - 1
    if float(chdtrc(freedom, squares)) > level:
        return 0.0
    spare = float(weight.sum() - (weight @ weight) / weight.sum())
    return max(squares - freedom, 0.0) / spare

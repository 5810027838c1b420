"""The paper's calibration (19) as it is printed: references regressed on estimates."""

from typing import Final

import numpy as np
from numpy.typing import NDArray

#: A spread of estimates below this share of their size is rounding, not information.
_SPREAD_MIN: Final = 1e-9


def line_of_19(
    estimate_kg: NDArray[np.float64], reference_kg: NDArray[np.float64]
) -> tuple[float, float] | None:
    """Fit m_c = alpha m + beta by least squares.

    On load means it is nearly the line of `fit_calibration`; on single runs the noise of the
    estimates flattens it.

    Args:
        estimate_kg: (points,) m.
        reference_kg: (points,) m_c.

    Returns:
        alpha, and beta in kg; None where the estimates do not spread.

    Source:
        Equation (19).
    """
    x0, y0 = estimate_kg.mean(), reference_kg.mean()
    x, y = estimate_kg - x0, reference_kg - y0
    if np.abs(x).max() <= _SPREAD_MIN * np.abs(estimate_kg).max():
        return None
    alpha = float(x @ y / (x @ x))
    return alpha, float(y0 - alpha * x0)

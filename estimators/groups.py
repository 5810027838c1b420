"""Groups of samples: the fit, window or segment that each belongs to."""

import numpy as np

from estimators.estimate import Ints


def ids_of(group: Ints) -> Ints:
    """The groups that there are, ascending.

    Args:
        group: (n,) the group of each sample, negative for none.
    """
    used = group[group >= 0]
    steps = np.diff(used)
    # they mostly follow one another, and then need not be sorted
    if (steps < 0).any():
        return np.unique(used)
    return used[np.append(True, steps > 0)] if used.size else used

"""The trailing mean inside groups: shorter where a group has only begun, never across its start."""

import numpy as np

from estimators.compiled import compiled
from estimators.estimate import Floats, Ints


@compiled
def trailing_group_mean(x: Floats, group: Ints, samples: int) -> tuple[Floats, Ints]:
    """Average each sample with up to `samples` - 1 before it that adjoin it in its group.

    Args:
        x: (n,) values; where the group is negative they are not looked at.
        group: (n,) group of each sample, negative for none.
        samples: most samples in a mean.

    Returns:
        (n,) means, 0 where no group is, and (n,) how many samples each is of.
    """
    n = x.size
    mean = np.zeros(n)
    count = np.zeros(n, np.int64)
    # of the group so far, so that rounding does not add up over the log
    total = np.zeros(n + 1)
    begin = 0
    for k in range(n):
        if group[k] < 0:
            begin = k + 1
            total[begin] = 0.0
            continue
        if k > 0 and group[k] != group[k - 1]:
            begin = k
            total[begin] = 0.0
        total[k + 1] = total[k] + x[k]
        first = max(begin, k + 1 - samples)
        count[k] = k + 1 - first
        mean[k] = (total[k + 1] - total[first]) / count[k]
    return mean, count

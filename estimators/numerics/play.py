"""Play: hysteresis of fixed width, as with backlash or a sensor with friction.

Visintin, Differential Models of Hysteresis, 1994, ch. III.
"""

import numpy as np

from estimators.arrays import Floats
from estimators.interpreted import compiled_unless_short_log


@compiled_unless_short_log
def apply_play_hysteresis(signal: Floats, half_width: float) -> Floats:
    """Output (n,) of play: it follows the signal at a distance of at most `half_width`.

    Args:
        signal: (n,) input.
        half_width: distance at which the output begins to move, in the input's unit.

    Returns:
        (n,) output, which begins at the input.
    """
    out = np.empty(signal.size)
    for k in range(signal.size):
        y = signal[k] if k == 0 else out[k - 1]
        out[k] = min(max(y, signal[k] - half_width), signal[k] + half_width)
    return out

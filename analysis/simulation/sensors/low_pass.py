"""A first-order low-pass of signals that are known at any time."""

import math
from collections.abc import Callable, Mapping
from typing import Final

import numpy as np
from numpy.typing import NDArray

from analysis.simulation.scenario.waveforms import Floats

#: Between two steps of the filter a signal is taken for a straight line.
_STEP_S: Final = 0.001
_STEPS_A_LAG: Final = 10


def low_pass(
    signals: Callable[[NDArray[np.int64]], Mapping[str, Floats]],
    at_ns: NDArray[np.int64],
    lag_s: float,
) -> Mapping[str, Floats]:
    """Signals behind a first-order low-pass, at rest before the first of the times.

    Args:
        signals: columns (m,) at m times in ns.
        at_ns: (n,) times, ascending.
        lag_s: time constant; 0: the signals themselves.
    """
    if not lag_s or not at_ns.size:
        return signals(at_ns)
    from scipy.signal import lfilter

    step_ns = max(round(min(_STEP_S, lag_s / _STEPS_A_LAG) * 1e9), 1)
    grid_ns = np.arange(at_ns[0], at_ns[-1] + 2 * step_ns, step_ns)
    keeps = math.exp(-step_ns * 1e-9 / lag_s)
    # exact for a signal that is a straight line from step to step
    mean = (1.0 - keeps) * lag_s / (step_ns * 1e-9)
    taken = [1.0 - mean, mean - keeps]
    since_s, grid_s = (at_ns - grid_ns[0]) * 1e-9, (grid_ns - grid_ns[0]) * 1e-9
    made: dict[str, Floats] = {}
    for name, values in signals(grid_ns).items():
        first = float(values[0])
        filtered = lfilter(taken, [1.0, -keeps], values, zi=[(1.0 - taken[0]) * first])[0]
        made[name] = np.interp(since_s, grid_s, filtered)
    return made

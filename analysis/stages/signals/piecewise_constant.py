"""Signals that are constant between steps, such as a gear or a switch."""

import numpy as np

from analysis.model.physical_units import split_unit_from_name
from analysis.stages.signals.resample import interpolate_in_stretches
from analysis.stages.signals.signal_limits import LIMITS
from estimators.arrays import Floats, Ints


def is_piecewise_constant(channel_name: str, signal: Floats) -> bool:
    """Whether a channel is a pure number with few values that seldom changes.

    Args:
        channel_name: name of the channel, with its unit.
        signal: (n,) its readings.
    """
    _, unit = split_unit_from_name(channel_name)
    if unit is not None or not channel_name.endswith("_1") or signal.size < 2:
        return False
    changes = np.count_nonzero(np.diff(signal))
    return bool(
        changes <= LIMITS.step_max_fraction * signal.size
        and np.unique(signal).size <= LIMITS.step_max_values
    )


def drop_values_between_steps(
    t_ns: Ints, signal: Floats, instants_ns: Ints, values: Floats
) -> Floats:
    """Values (rows,) at ascending instants, NaN where the signal changes about the instant.

    When it changed between two readings is not known, and what lies between them is neither.

    Args:
        t_ns: (n,) stamps, strictly ascending.
        signal: (n,) readings.
        instants_ns: (rows,) instants.
        values: (rows,) interpolated or averaged values at them.
    """
    before = signal[np.maximum(np.searchsorted(t_ns, instants_ns, side="right") - 1, 0)]
    return np.where(np.isclose(values, before, rtol=1e-9, atol=0.0), before, np.nan)


def interpolate_channel(
    channel_name: str, t_ns: Ints, signal: Floats, instants_ns: Ints, longest_ns: float
) -> Floats:
    """Values (rows,) at ascending instants as `interpolate_in_stretches`; NaN between steps."""
    values = interpolate_in_stretches(t_ns, signal, instants_ns, longest_ns)
    if is_piecewise_constant(channel_name, signal):
        return drop_values_between_steps(t_ns, signal, instants_ns, values)
    return values

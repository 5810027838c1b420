"""Signals that are constant between steps, such as a gear or a switch."""

from collections.abc import Mapping

import numpy as np

from analysis.model.machine import Machine
from analysis.model.physical_units import split_unit_from_name
from analysis.stages.signals.mounting import Series
from analysis.stages.signals.resample import interpolate_in_stretches
from analysis.stages.signals.signal_limits import LIMITS
from estimators.arrays import Floats, Ints


def mark_piecewise_constant_channels(channels: Mapping[str, Series], machine: Machine) -> Machine:
    """Mark the channels that are constant between steps in this log.

    Args:
        channels: stamps and readings by channel.
        machine: machine file.
    """
    found = {
        name: machine.channels[name].copy_as_piecewise_constant()
        for name, (_, readings) in channels.items()
        if name in machine.channels and is_piecewise_constant(name, readings)
    }
    if not found:
        return machine
    return machine.model_copy(update={"channels": {**machine.channels, **found}})


def is_piecewise_constant(channel_name: str, readings: Floats) -> bool:
    """Whether a channel is a dimensionless number that has few values and seldom changes.

    Args:
        channel_name: name of the channel, with its unit.
        readings: (n,) its readings.
    """
    _, unit = split_unit_from_name(channel_name)
    if unit is not None or not channel_name.endswith("_1") or readings.size < 2:
        return False
    changes = np.count_nonzero(np.diff(readings))
    return bool(
        changes <= LIMITS.step_max_fraction * readings.size
        and np.unique(readings).size <= LIMITS.step_max_values
    )


def drop_values_between_steps(
    t_ns: Ints, readings: Floats, instants_ns: Ints, values: Floats
) -> Floats:
    """Values (rows,) at ascending instants, NaN where the signal changes about the instant.

    It is not known when the signal changed between two readings, and no value in between is true.

    Args:
        t_ns: (n,) stamps, strictly ascending.
        readings: (n,) readings.
        instants_ns: (rows,) instants.
        values: (rows,) interpolated or averaged values at them.
    """
    before = readings[np.maximum(np.searchsorted(t_ns, instants_ns, side="right") - 1, 0)]
    return np.where(np.isclose(values, before, rtol=1e-9, atol=0.0), before, np.nan)


def interpolate_between_steps(
    t_ns: Ints, readings: Floats, instants_ns: Ints, longest_ns: float
) -> Floats:
    """Values (rows,) of a piecewise constant signal at ascending instants; NaN between steps."""
    values = interpolate_in_stretches(t_ns, readings, instants_ns, longest_ns)
    return drop_values_between_steps(t_ns, readings, instants_ns, values)

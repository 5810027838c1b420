"""Default grid rate, window and moving mean, from the log's slowest channel.

The paper's log has a rate of 100 Hz, and its settings are numbers of samples at that rate. They
stand for durations: 10 samples for 0.1 s, 320 for 3.2 s. Grid rows between the samples of a slower
log add no information, but the uncertainty would count them.
"""

import math
from collections.abc import Mapping
from typing import Final

import numpy as np

from analysis.model.machine import Machine
from analysis.model.settings import AlignSettings, GateSettings, SmoothSettings
from analysis.model.windows import find_flagged_runs
from analysis.stages.signals import mounting, rates
from analysis.stages.signals.piecewise_constant import mark_piecewise_constant_channels
from analysis.stages.signals.signal_limits import LIMITS
from estimators.arrays import Ints

#: The paper's rate, in Hz: the highest that is chosen, also for logs that are only a little slower.
PAPER_HZ: Final[float] = AlignSettings.model_fields["rate_hz"].default
#: The paper's window and moving mean, in s.
_WINDOW_S: Final[float] = GateSettings.model_fields["window_samples"].default / PAPER_HZ
_MEAN_S: Final[float] = SmoothSettings.model_fields["samples"].default / PAPER_HZ


def choose_grid_rate_by_log(
    channels: Mapping[str, mounting.Series], machine: Machine
) -> tuple[Machine, list[str]]:
    """Set the grid rate, window and moving mean where the machine file does not give them.

    Channels that are constant between steps are marked as such.

    Args:
        channels: channels from `read_measured_channels`.
        machine: machine file; given settings are kept.

    Returns:
        The completed machine, and notes on values other than the paper's.
    """
    machine = mark_piecewise_constant_channels(channels, machine)
    settings = machine.settings
    slowest, own_hz = find_slowest_channel_and_rate_hz(channels, machine)
    rate_hz = settings.align.rate_hz
    chosen: dict[str, float] = {}
    if "rate_hz" not in settings.align.model_fields_set:
        rate_hz = PAPER_HZ if own_hz * LIMITS.other_rate_ratio > PAPER_HZ else own_hz
        chosen["align.rate_hz"] = rate_hz
    if "window_samples" not in settings.gate.model_fields_set:
        readings = math.ceil(LIMITS.window_min_readings * rate_hz / own_hz)
        chosen["gate.window_samples"] = count_rows_in_duration(_WINDOW_S, rate_hz, readings)
    if "samples" not in settings.smooth.model_fields_set:
        chosen["smooth.samples"] = count_rows_in_duration(_MEAN_S, rate_hz)
    differs = any(settings.get_setting(name) != value for name, value in chosen.items())
    settings = settings.copy_with_changes(chosen)
    said = f"{slowest} comes at {own_hz:.4g} Hz, so without a setting " + ", ".join(
        {
            "align.rate_hz": f"the grid is at {rate_hz:.4g} Hz",
            "gate.window_samples": f"a window is {settings.gate.window_samples} samples "
            f"({settings.gate.window_samples / rate_hz:.3g} s)",
            "smooth.samples": f"the moving mean {settings.smooth.samples}",
        }[name]
        for name in chosen
    )
    return machine.model_copy(update={"settings": settings}), [said] if differs else []


def count_rows_in_duration(seconds: float, rate_hz: float, min_rows: int = 1) -> int:
    """Number of grid rows in a duration, at least `min_rows`."""
    return max(round(seconds * rate_hz), min_rows)


def find_slowest_channel_and_rate_hz(
    channels: Mapping[str, mounting.Series], machine: Machine
) -> tuple[str, float]:
    """Name and rate in Hz of the slowest channel of the regressor.

    A gear or a switch, which is constant between its steps, does not count.
    """
    names = {
        source
        for regressor in rates.list_channel_sets_of_equations(machine)
        for name in regressor - {"direction_x_1"}
        for source in rates.find_source_channels(name, machine)
        if source in channels and not machine.is_piecewise_constant(source)
    }
    periods = {name: _find_longest_steady_period_ns(channels[name][0]) for name in names}
    slowest = max(sorted(periods), key=lambda name: periods[name])
    # six digits: no clock is better, and so the grid of an even log falls on its samples
    return slowest, float(f"{1e9 / periods[slowest]:.6g}")


def _find_longest_steady_period_ns(t_ns: Ints) -> float:
    """Period of a channel in ns; if it changes, as after a restart, the longest one of some time.

    At the usual rate alone, all readings at the slower one would be lost in gaps.
    """
    usual_ns = rates.compute_mean_period_without_gaps_ns(t_ns, 1e9 / PAPER_HZ)
    steps_ns = np.diff(t_ns)
    is_gap = steps_ns > rates.GAP_PERIODS * usual_ns
    longer_ns = [
        steps_ns[first : last + 1]
        for first, last in zip(*find_flagged_runs(is_gap), strict=True)
        if last - first + 1 >= LIMITS.slower_min_steps
    ]
    steady_ns = [each for each in longer_ns if _is_steady(each)]
    slower_ns = np.concatenate([steps_ns[:0], *steady_ns])
    if slower_ns.sum() <= LIMITS.slower_min_time_fraction * steps_ns.sum():
        return usual_ns
    return float(np.median(slower_ns))


def _is_steady(steps_ns: Ints) -> bool:
    """Whether nearly all steps are about equal."""
    ratio = steps_ns / np.median(steps_ns)
    limit = LIMITS.slower_steady_ratio
    return float(np.mean((ratio < limit) & (ratio > 1.0 / limit))) > LIMITS.slower_steady_fraction

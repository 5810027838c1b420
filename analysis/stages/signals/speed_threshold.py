"""Speeds that a sensor gives only above a threshold, and as 0 below it.

The pulses of a slow wheel are too far apart, and a GNSS receiver reports slow motion as standstill.
The step between 0 and the threshold is no acceleration: on either side of it the speed is unknown.
"""

from collections.abc import Mapping
from typing import Final

import numpy as np

from analysis.model.physical_units import NS_PER_S
from analysis.model.windows import find_flagged_runs
from analysis.stages.signals import filters, mounting
from analysis.stages.signals.signal_limits import LIMITS
from estimators.arrays import Floats, Ints

SPEEDS: Final = ("speed_x_m_s", "speed_left_m_s", "speed_right_m_s")


def estimate_zero_speed_threshold_m_s(readings_m_s: Floats) -> float:
    """Threshold in m/s below which a speed (n,) reads 0; 0 if it has none."""
    moves = readings_m_s != 0.0
    steps_m_s = np.abs(np.diff(readings_m_s))
    at_edges = moves[1:] != moves[:-1]
    inside = moves[1:] & moves[:-1]
    if np.count_nonzero(at_edges) < LIMITS.threshold_min_edges or not inside.any():
        return 0.0
    # the step from a reading of 0 equals the next reading
    least_m_s = float(np.quantile(steps_m_s[at_edges], LIMITS.threshold_edge_quantile))
    usual_m_s = float(np.quantile(steps_m_s[inside], LIMITS.threshold_step_quantile))
    below = float(np.mean(np.abs(readings_m_s[moves]) < least_m_s - usual_m_s))
    is_threshold = (
        LIMITS.threshold_min_steps * usual_m_s < least_m_s <= LIMITS.threshold_max_m_s
        and below <= LIMITS.threshold_max_below_fraction
    )
    return least_m_s if is_threshold else 0.0


def find_zero_speed_thresholds_m_s(channels: Mapping[str, mounting.Series]) -> dict[str, float]:
    """Thresholds in m/s of the speed channels that have one and whose drives are long enough.

    Args:
        channels: channels from `read_measured_channels`.
    """
    found = {
        name: estimate_zero_speed_threshold_m_s(x)
        for name, (t, x) in channels.items()
        if name in SPEEDS and compute_median_drive_duration_s(t, x) >= LIMITS.threshold_min_drive_s
    }
    return {name: threshold_m_s for name, threshold_m_s in found.items() if threshold_m_s}


def compute_median_drive_duration_s(t_ns: Ints, speed: Floats) -> float:
    """Median duration in s of the runs of nonzero readings; 0 if there are none."""
    first, last = find_flagged_runs(speed != 0.0)
    return float(np.median(t_ns[last] - t_ns[first])) / NS_PER_S if first.size else 0.0


def drop_zero_readings_beside_motion(
    channels: Mapping[str, mounting.Series], thresholds: Mapping[str, float]
) -> dict[str, mounting.Series]:
    """Drop the readings of 0 just before and after motion, so that the step becomes a gap."""
    out = dict(channels)
    for name in thresholds:
        t, x = channels[name]
        beside_ns = max(
            LIMITS.threshold_gap_s * NS_PER_S,
            LIMITS.threshold_gap_readings * filters.compute_median_period_ns(t),
        )
        kept = (x != 0.0) | (compute_time_to_nearest_motion_ns(t, x) > beside_ns)
        out[name] = t[kept], x[kept]
    return out


def compute_time_to_nearest_motion_ns(t_ns: Ints, speed: Floats) -> Floats:
    """Time from each reading to the nearest nonzero one, (n,) in ns."""
    moving_ns = t_ns[speed != 0.0]
    place = np.searchsorted(moving_ns, t_ns)
    before_ns = t_ns - moving_ns[(place - 1).clip(0)]
    after_ns = moving_ns[place.clip(0, moving_ns.size - 1)] - t_ns
    return np.minimum(np.abs(before_ns), np.abs(after_ns)).astype(np.float64)


def list_speed_threshold_notes(thresholds_m_s: Mapping[str, float]) -> list[str]:
    """Notes on speeds with a threshold."""
    return [
        f"{name} reads 0 below {threshold_m_s:.2g} m/s: its readings of 0 right before or after "
        "motion are left out, since the speed is not known there"
        for name, threshold_m_s in thresholds_m_s.items()
    ]

"""Linear interpolation and averages of signals between samples, never across a gap.

Stamps are integer nanoseconds throughout: a float holds unix time to a quarter of a microsecond.
"""

import numpy as np

from estimators.arrays import Floats, Ints
from estimators.interpreted import compiled_unless_short_log


def interpolate_in_stretches(
    t_ns: Ints, signal: Floats, instants_ns: Ints, max_gap_ns: float
) -> Floats:
    """Interpolate linearly between samples, except across gaps.

    Args:
        t_ns: (n,) stamps, strictly ascending.
        signal: (n,) samples.
        instants_ns: (rows,) instants, ascending.
        max_gap_ns: longest step that is not a gap.

    Returns:
        (rows,) values, NaN in gaps, before the first sample and after the last.
    """
    out = np.full(instants_ns.size, np.nan)
    _fill_interpolated_values(t_ns, np.ascontiguousarray(signal), instants_ns, int(max_gap_ns), out)
    return out


def average_about_instants(
    t_ns: Ints, signal: Floats, instants_ns: Ints, width_ns: int, max_gap_ns: float
) -> Floats:
    """Average the linear interpolation over a width about each instant, by exact integration.

    Near a gap, the first and the last sample, the width shrinks equally on both sides, so that no
    delay arises. Values are NaN where those of `interpolate_in_stretches` are.

    Args:
        t_ns: (n,) stamps, strictly ascending.
        signal: (n,) samples.
        instants_ns: (rows,) instants, ascending.
        width_ns: averaging width, half of it on either side.
        max_gap_ns: longest step that is not a gap.
    """
    out = np.full(instants_ns.size, np.nan)
    _fill_averages(
        t_ns, np.ascontiguousarray(signal), instants_ns, width_ns // 2, int(max_gap_ns), out
    )
    return out


@compiled_unless_short_log
def _fill_interpolated_values(
    t: Ints, signal: Floats, instants: Ints, max_gap: int, out: Floats
) -> None:
    last = t.size - 1
    i = 0
    for k in range(instants.size):
        while i < last and t[i + 1] <= instants[k]:
            i += 1
        since = instants[k] - t[i]
        if since == 0:
            out[k] = signal[i]
        elif since > 0 and i < last and t[i + 1] - t[i] <= max_gap:
            out[k] = signal[i] + (signal[i + 1] - signal[i]) * (since / (t[i + 1] - t[i]))


@compiled_unless_short_log
def _fill_averages(
    t: Ints, signal: Floats, instants: Ints, half_width: int, max_gap: int, out: Floats
) -> None:
    last = t.size - 1
    i = 0
    for k in range(instants.size):
        s = instants[k]
        while i < last and t[i + 1] <= s:
            i += 1
        if s < t[i] or (s > t[i] and (i == last or t[i + 1] - t[i] > max_gap)):
            continue
        left = i
        while t[left] > s - half_width and left > 0 and t[left] - t[left - 1] <= max_gap:
            left -= 1
        right = i if s == t[i] else i + 1
        while t[right] < s + half_width and right < last and t[right + 1] - t[right] <= max_gap:
            right += 1
        reach = min(half_width, s - t[left], t[right] - s)
        if reach <= 0:
            out[k] = signal[i]
            continue
        total = 0.0
        for j in range(left, right):
            a, b = max(t[j], s - reach), min(t[j + 1], s + reach)
            if a < b:
                slope = (signal[j + 1] - signal[j]) / (t[j + 1] - t[j])
                middle = signal[j] + slope * ((a - t[j]) + 0.5 * (b - a))
                total += middle * (b - a)
        out[k] = total / (2 * reach)

"""Lag of one signal behind another, by their correlation."""

import math
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from analysis.diagnosis.measured_channels import Series
from analysis.findings.finding_limits import LIMITS
from analysis.model.physical_units import NS_PER_S
from estimators.arrays import Floats


class SignalLag(NamedTuple):
    """Lag of one signal behind another, and their correlation at that lag and without one."""

    lag_s: float
    correlation_1: float
    correlation_without_lag_1: float


class _Deviations(NamedTuple):
    """Deviations of values from their mean, and the root of their mean square."""

    values: Floats
    std: float

    @classmethod
    def from_values(cls, values: Floats) -> "_Deviations":
        """Deviations of values, with the mean computed only once."""
        deviations = values - values.sum() / values.size
        return cls(deviations, math.sqrt(np.square(deviations).sum() / values.size))

    def compute_correlation_coefficient(self, other: "_Deviations") -> float:
        """Correlation coefficient, 0 where either is constant."""
        size = self.std * other.std
        return float(self.values @ other.values) / (self.values.size * size) if size else 0.0


def estimate_lag_of_signal(delayed: Floats, reference: Floats, step_s: float) -> SignalLag:
    """Find the lag of one signal behind another.

    Returns:
        The lag in s, the correlation at that lag, and the correlation without a lag.
    """
    longest = round(LIMITS.longest_delay_s / step_s)
    size = int(2 ** np.ceil(np.log2(delayed.size + longest)))
    spectrum = np.fft.rfft(delayed, size) * np.conj(np.fft.rfft(reference, size))
    product = np.fft.irfft(spectrum, size) / (np.linalg.norm(delayed) * np.linalg.norm(reference))
    # element k of the product is for a lag of k steps
    near = np.concatenate([product[-longest:], product[: longest + 1]])
    at = int(np.argmax(near))
    part = find_parabola_peak_offset_steps(near[at - 1 : at + 2]) if 0 < at < near.size - 1 else 0.0
    return SignalLag((at - longest + part) * step_s, float(near[at]), float(product[0]))


def estimate_lag_and_std_s(delayed: Series, reference: Series) -> tuple[float, float] | None:
    """Lag of one series behind another in s, and its standard deviation from parts of the log.

    None if the log is too short, or if the series are not correlated.
    """
    both = (delayed, reference)
    if any(stamps_ns.size < 2 for stamps_ns, _ in both):
        return None
    # steps of a quarter of the reported delay suffice, as the cost grows with the rate squared
    least_ns = LIMITS.source_delay_s * NS_PER_S / 4.0
    step_ns = max(least_ns, *(float(np.median(np.diff(stamps_ns))) for stamps_ns, _ in both))
    start_ns, end_ns = max(each[0][0] for each in both), min(each[0][-1] for each in both)
    end_ns = min(end_ns, start_ns + round(LIMITS.delay_search_span_s * NS_PER_S))
    longest = round(LIMITS.longest_source_delay_s * NS_PER_S / step_ns)
    times_ns = np.arange(start_ns, end_ns, step_ns)
    if longest < 1 or times_ns.size < 4 * longest * LIMITS.source_delay_parts:
        return None
    x, y = (np.interp(times_ns, *series) for series in both)
    starts = np.linspace(longest, times_ns.size - longest, LIMITS.source_delay_parts + 1).astype(
        int
    )
    shifts = range(-longest, longest + 1)
    lags: list[float] = []
    for start, end in pairwise(starts.tolist()):
        still = _Deviations.from_values(x[start:end])
        seen = np.array(
            [
                still.compute_correlation_coefficient(
                    _Deviations.from_values(y[start - k : end - k])
                )
                for k in shifts
            ]
        )
        at = int(np.argmax(seen))
        if seen[at] > LIMITS.source_correlation and 0 < at < seen.size - 1:
            lags.append(
                (at - longest + find_parabola_peak_offset_steps(seen[at - 1 : at + 2])) * step_ns
            )
    if len(lags) < LIMITS.source_delay_parts / 2:
        return None
    lag_s = np.array(lags) / NS_PER_S
    return float(lag_s.mean()), float(lag_s.std(ddof=1) / np.sqrt(lag_s.size))


def find_parabola_peak_offset_steps(values: Floats) -> float:
    """Place of the peak of a parabola through three values, in steps from the middle one."""
    before, here, after = values
    bend = before - 2.0 * here + after
    return float(np.clip(0.5 * (before - after) / bend, -0.5, 0.5)) if bend < 0.0 else 0.0

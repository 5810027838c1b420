"""Drift of each topic's clock against the recorder's: header stamps against log times.

Nothing is corrected by it. A header stamp is its log time less a latency, plus the drift of the two
clocks. Queues and pauses of the recorder only ever add to the latency, so the line is laid through
the least ones.
"""

from collections.abc import Mapping
from typing import Final, NamedTuple

import numpy as np
import polars as pl
from numpy.typing import NDArray

from analysis.model.uncertainty_sources import STD_OF_MAD
from estimators.arrays import Floats

#: Parts of a log, each of which gives the line one point.
_PARTS: Final = 24
#: With fewer parts, or samples in one, no standard deviation can be stated.
_FEWEST_PARTS: Final = 6
_FEWEST_IN_PART: Final = 8
#: A part's point is this quantile of its latencies: low, but no single sample decides it.
_QUANTILE: Final = 0.1
#: No recorder's stamps are finer, whatever their digits.
_RESOLUTION_S: Final = 1e-6
_SCHEMA: Final = {
    "topic": pl.String,
    "drift_ppm": pl.Float64,
    "drift_std_ppm": pl.Float64,
    "span_s": pl.Float64,
}


class RelativeDrift(NamedTuple):
    """Two topics, and how much faster the first one's clock runs than the second's, in ppm."""

    faster: str
    slower: str
    drift_ppm: float
    drift_std_ppm: float


def measure_clock_drifts(raw: Mapping[str, pl.DataFrame]) -> pl.DataFrame:
    """Measure the drift of each topic's header stamps against log time.

    The log is cut into 24 parts; the slope of the line through the parts' low latencies is the
    drift, and the scatter about it gives the standard deviation.

    Args:
        raw: frames by topic with log_time_ns, and header_stamp_ns (null or 0 if missing).

    Returns:
        A row per topic with enough header stamps: topic, drift_ppm (positive: its clock is faster
        than the recorder's), drift_std_ppm, span_s.
    """
    rows: list[tuple[str, float, float, float]] = []
    for topic, frame in raw.items():
        stamped = frame.filter(pl.col("header_stamp_ns").fill_null(0) != 0)
        if stamped.height < _FEWEST_PARTS * _FEWEST_IN_PART:
            continue
        log = stamped["log_time_ns"].to_numpy()
        # integers until differences are small: a float holds unix time to 0.25 µs
        time_s = (log - log.min()) / 1e9
        latency = log - stamped["header_stamp_ns"].to_numpy()
        latency_s = (latency - latency.min()) / 1e9
        line = _fit_line_below(time_s, latency_s)
        if line is not None:
            slope, std = line
            rows.append((topic, -slope * 1e6, std * 1e6, float(time_s.max())))
    return pl.DataFrame(rows, schema=_SCHEMA, orient="row")


def find_largest_relative_drift(drifts: pl.DataFrame) -> RelativeDrift | None:
    """The two topics whose clocks differ most, in standard deviations.

    Args:
        drifts: frame from `measure_clock_drifts`.

    Returns:
        None if fewer than two topics have a drift.
    """
    rows = drifts.sort("drift_ppm", descending=True).to_dicts()
    pairs = [
        RelativeDrift(
            fast["topic"],
            slow["topic"],
            fast["drift_ppm"] - slow["drift_ppm"],
            float(np.hypot(fast["drift_std_ppm"], slow["drift_std_ppm"])),
        )
        for i, fast in enumerate(rows)
        for slow in rows[i + 1 :]
    ]
    return max(pairs, key=lambda pair: pair.drift_ppm / pair.drift_std_ppm, default=None)


def _fit_line_below(time_s: Floats, latency_s: Floats) -> tuple[float, float] | None:
    """Slope of a line along the lowest latencies, and its standard deviation; None if too few."""
    span_s = float(time_s.max())
    if not span_s > 0:
        return None
    part = np.minimum((time_s / span_s * _PARTS).astype(int), _PARTS - 1)
    members = [np.flatnonzero(part == i) for i in range(_PARTS)]
    members = [each for each in members if each.size >= _FEWEST_IN_PART]
    if len(members) < _FEWEST_PARTS:
        return None
    slope = median_slope(*middles_and_quantiles_of_parts(time_s, latency_s, members, 0.5, 0.0))
    # anew without the slope: within a part it would choose the early or the late ones
    t, y = middles_and_quantiles_of_parts(time_s, latency_s, members, _QUANTILE, slope)
    slope = median_slope(t, y)
    residual = y - slope * t
    residual -= np.median(residual)
    # the normal distribution's ratio, and two parameters fitted
    scatter_s = STD_OF_MAD * float(np.median(np.abs(residual))) * np.sqrt(t.size / (t.size - 2))
    # the median of slopes is less precise than least squares by π/3 in variance
    std = scatter_s / float(np.sqrt(np.sum((t - t.mean()) ** 2))) * np.sqrt(np.pi / 3)
    return slope, max(float(std), _RESOLUTION_S / span_s)


def middles_and_quantiles_of_parts(
    time_s: Floats, latency_s: Floats, members: list[NDArray[np.int64]], q: float, slope: float
) -> tuple[Floats, Floats]:
    """Middle of each part in s, and quantile of its distances from a line through 0, (parts,)."""
    t = np.array([(time_s[each].min() + time_s[each].max()) / 2 for each in members])
    off = latency_s - slope * time_s
    return t, np.array([np.quantile(off[each], q) for each in members]) + slope * t


def median_slope(t: Floats, y: Floats) -> float:
    """Median of the slopes between all pairs of points (Theil-Sen)."""
    i, j = np.triu_indices(t.size, 1)
    return float(np.median((y[j] - y[i]) / (t[j] - t[i])))

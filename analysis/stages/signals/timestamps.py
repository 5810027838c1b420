"""Choice of the stamps that place samples in time: header stamps if usable, otherwise log time.

Header stamps that scatter while log time is regular were assigned late. Such samples are placed by
log time less its median delay, which keeps them in the header's clock.

The drift of each topic's clock against the recorder's is measured, but nothing is corrected for it.
A header stamp is its log time less a latency, plus the drift of the two clocks. Queues and pauses
of the recorder can only add to the latency, so the line is fitted to the lowest latencies.
"""

from collections.abc import Mapping
from typing import Final, NamedTuple

import numpy as np
import polars as pl
from numpy.typing import NDArray

from analysis.model.loss import Loss
from analysis.model.uncertainty_sources import STD_OF_MAD
from analysis.model.windows import find_flagged_runs
from analysis.stages.signals.signal_limits import LIMITS
from estimators.arrays import Floats

#: Clocks that start at boot count from 0: a time before 1990 is not a date.
FIRST_DATE_NS: Final = 20 * 365 * 86_400 * 10**9
_SCHEMA: Final = {
    "topic": pl.String,
    "drift_ppm": pl.Float64,
    "drift_std_ppm": pl.Float64,
    "span_s": pl.Float64,
}


class StampedTopics(NamedTuple):
    """Samples by topic with a time, and the clock that it comes from.

    Attributes:
        frames: by topic: unix_ns (ascending) and the fields.
        clocks: clock of each topic: "header", "log" or "table".
        losses: dropped or doubtful samples.
    """

    frames: dict[str, pl.DataFrame]
    clocks: dict[str, str]
    losses: list[Loss]


def assign_timestamps(raw_frames: Mapping[str, pl.DataFrame]) -> StampedTopics:
    """Assign `unix_ns` to every sample and sort by it.

    Args:
        raw_frames: frames by topic with log_time_ns, header_stamp_ns and fields.
    """
    losses: list[Loss] = []
    headers = {
        topic: are_header_stamps_usable(topic, frame, losses) for topic, frame in raw_frames.items()
    }
    changes_ns = {
        topic: compute_log_delay_change_ns(frame) if headers[topic] else 0.0
        for topic, frame in raw_frames.items()
    }
    # a recorder whose clock runs away does so for all topics alike
    least_ns = min(changes_ns.values(), key=abs, default=0.0)
    for topic, change_ns in changes_ns.items():
        if abs(change_ns - least_ns) > LIMITS.clock_jump_ns:
            headers[topic] = False
            losses.append(
                Loss(
                    source="stamps",
                    topic=topic,
                    what=f"header stamps move by {-change_ns / 1e9:+.3g} s against log time over "
                    "the log, so log time is used instead",
                )
            )
    # delay of log time behind the stamps that would place the samples of each topic
    behind_ns = {
        t: compute_median_log_delay_ns(frame) if headers[t] else 0.0
        for t, frame in raw_frames.items()
    }
    if max(behind_ns.values()) - min(behind_ns.values()) > LIMITS.clock_jump_ns:
        for topic in raw_frames:
            if abs(behind_ns[topic]) > LIMITS.clock_jump_ns:
                headers[topic] = False
                losses.append(
                    Loss(
                        source="stamps",
                        topic=topic,
                        what="header stamps come from another clock than the other topics' "
                        f"({abs(behind_ns[topic]) / 1e9:.3g} s from log time), so log time "
                        "is used instead",
                    )
                )
    placed: dict[str, pl.DataFrame] = {}
    labels: dict[str, str] = {}
    for topic, frame in raw_frames.items():
        column = "header_stamp_ns" if headers[topic] else "log_time_ns"
        of_table = topic == "table" or topic.startswith("table/")
        labels[topic] = "header" if headers[topic] else ("table" if of_table else "log")
        # each copy of a shift's frame is hundreds of megabytes
        kept = frame.filter(pl.col(column).is_not_null()) if frame[column].has_nulls() else frame
        scatter = measure_relative_sampling_jitter(frame) if headers[topic] else None
        if scatter is not None:
            labels[topic] = "log"
            kept = kept.with_columns(
                header_stamp_ns=pl.col("log_time_ns") - round(behind_ns[topic])
            )
            losses.append(
                Loss(
                    source="stamps",
                    topic=topic,
                    what=f"header stamps scatter by {scatter[0]:.0%} of their period and log time "
                    f"by {scatter[1]:.0%}, so log time less its median delay of "
                    f"{behind_ns[topic] / 1e6:.1f} ms is used instead",
                )
            )
        if headers[topic] and (kept[column] == 0).any():
            kept = kept.filter(pl.col(column) != 0)
        if kept.height < frame.height:
            losses.append(
                Loss(
                    source="stamps",
                    topic=topic,
                    what=f"{frame.height - kept.height} samples without a stamp were dropped",
                )
            )
        stamps = kept[column].to_numpy()
        back = np.minimum(np.diff(stamps), 0) if stamps.size else np.empty(0)
        if (back < 0).any():
            losses.append(
                Loss(
                    source="stamps",
                    topic=topic,
                    what=f"{int((back < 0).sum())} stamps go backwards (by up to "
                    f"{-int(back.min()) / 1e9:.3g} s); samples were sorted",
                )
            )
        named = kept.rename({column: "unix_ns"}).drop({"log_time_ns", "header_stamp_ns"} - {column})
        placed[topic] = named.sort("unix_ns", maintain_order=True) if back.any() else named
    return StampedTopics(placed, labels, losses)


def measure_relative_sampling_jitter(frame: pl.DataFrame) -> tuple[float, float] | None:
    """Scatter of the steps of header stamps and of log time, relative to their period.

    Args:
        frame: log_time_ns and header_stamp_ns of a topic, in recorded order.

    Returns:
        The two scatters; None if header stamps are regular enough, or log time is hardly better.
    """
    both = frame.select("log_time_ns", "header_stamp_ns").drop_nulls()
    if both.height < LIMITS.scatter_min_stamps:
        return None
    steps_ns = [both[name].sort().diff().drop_nulls().to_numpy() for name in both.columns]
    log, header = (steps.astype(np.float64) for steps in steps_ns)
    period_ns = float(np.median(log))
    if period_ns <= 0.0:
        return None
    # a pause of the recorder is in both
    usual, header = log[log < 3.0 * period_ns], header[header < 3.0 * period_ns]
    if header.size < log.size / 2:  # what is delivered in bursts has another period in the log
        return None
    of_log, of_header = float(np.std(usual)), float(np.std(header))
    if (
        of_header < LIMITS.header_scatter_fraction * period_ns
        or of_log > LIMITS.log_scatter_ratio * of_header
    ):
        return None
    return of_header / period_ns, of_log / period_ns


def are_header_stamps_usable(topic: str, frame: pl.DataFrame, losses: list[Loss]) -> bool:
    """Whether nearly all header stamps are set and none jumps back by a second."""
    stamps = frame["header_stamp_ns"].drop_nulls()
    stamps = stamps.filter(stamps != 0)
    if frame.height == 0 or stamps.len() < LIMITS.stamped_min_fraction * frame.height:
        if stamps.len() or frame["header_stamp_ns"].null_count() < frame.height:
            losses.append(
                Loss(
                    source="stamps",
                    topic=topic,
                    what=f"{frame.height - stamps.len()} of {frame.height} header stamps are not "
                    "set, so log time is used instead",
                )
            )
        return False
    stopped_ns = measure_longest_time_of_one_stamp_ns(frame)
    if stopped_ns > LIMITS.clock_jump_ns:
        losses.append(
            Loss(
                source="stamps",
                topic=topic,
                what=f"header stamps stay the same for {stopped_ns / 1e9:.3g} s of log time, so "
                "log time is used instead",
            )
        )
        return False
    steps = np.diff(stamps.to_numpy())
    if steps.size and steps.min() < -LIMITS.clock_jump_ns:
        losses.append(
            Loss(
                source="stamps",
                topic=topic,
                what=f"header stamps jump back by {-int(steps.min()) / 1e9:.3g} s, so log time is "
                "used instead",
            )
        )
        return False
    return True


def measure_longest_time_of_one_stamp_ns(frame: pl.DataFrame) -> float:
    """Longest log time in ns between successive messages with the same header stamp."""
    stamped = frame.select("log_time_ns", "header_stamp_ns").drop_nulls()
    log, header = (stamped[name].to_numpy() for name in stamped.columns)
    first, last = find_flagged_runs(np.diff(header) == 0)
    return float(np.max(log[last + 1] - log[first], initial=0))


def compute_log_delay_change_ns(frame: pl.DataFrame) -> float:
    """Change in ns of the least delay of log time behind header stamps, first to last quarter.

    A queue delays log time for a while; a clock that is set or that stops stays apart.
    """
    stamped = frame.select("log_time_ns", "header_stamp_ns").drop_nulls()
    quarter = stamped.height // 4
    if not quarter:
        return 0.0
    first, last = (
        (part["log_time_ns"] - part["header_stamp_ns"]).to_numpy().min()
        for part in (stamped.head(quarter), stamped.tail(quarter))
    )
    return float(last - first)


def compute_median_log_delay_ns(frame: pl.DataFrame) -> float:
    """Median delay of log time behind the header stamp, in ns; 0 if unknown."""
    behind = (frame["log_time_ns"] - frame["header_stamp_ns"]).median()
    return float(behind) if isinstance(behind, int | float) else 0.0


class RelativeDrift(NamedTuple):
    """Two topics, and how much faster the first one's clock runs than the second's, in ppm."""

    faster: str
    slower: str
    drift_ppm: float
    drift_std_ppm: float


def measure_clock_drifts_by_topic(
    raw_frames: Mapping[str, pl.DataFrame], clocks: Mapping[str, str] | None = None
) -> pl.DataFrame:
    """Measure the drift of each topic's header stamps against log time.

    The log is cut into 24 parts; the slope of the line through the parts' low latencies is the
    drift, and the scatter about it gives the standard deviation.

    Args:
        raw_frames: frames by topic with log_time_ns, and header_stamp_ns (null or 0 if missing).
        clocks: clock that places the samples of each topic; topics placed by log time are left out.

    Returns:
        A row per topic with enough header stamps: topic, drift_ppm (positive: its clock is faster
        than the recorder's), drift_std_ppm, span_s.
    """
    rows: list[tuple[str, float, float, float]] = []
    for topic, frame in raw_frames.items():
        if clocks is not None and clocks[topic] != "header":
            continue
        stamped = frame.filter(pl.col("header_stamp_ns").fill_null(0) != 0)
        if stamped.height < LIMITS.drift_min_parts * LIMITS.drift_part_min_samples:
            continue
        log = stamped["log_time_ns"].to_numpy()
        # integers until differences are small: a float holds unix time to 0.25 µs
        time_s = (log - log.min()) / 1e9
        latency = log - stamped["header_stamp_ns"].to_numpy()
        latency_s = (latency - latency.min()) / 1e9
        line = fit_minimum_latency_slope_and_std(time_s, latency_s)
        if line is not None:
            slope, std = line
            rows.append((topic, -slope * 1e6, std * 1e6, float(time_s.max())))
    return pl.DataFrame(rows, schema=_SCHEMA, orient="row")


def find_largest_relative_clock_drift(drifts: pl.DataFrame) -> RelativeDrift | None:
    """The two topics whose clock drifts differ most, in standard deviations.

    Args:
        drifts: frame from `measure_clock_drifts_by_topic`.

    Returns:
        The drift between them; None if fewer than two topics have a drift.
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


def fit_minimum_latency_slope_and_std(
    time_s: Floats, latency_s: Floats
) -> tuple[float, float] | None:
    """Slope of a line along the lowest latencies, and its standard deviation; None if too few."""
    span_s = float(time_s.max())
    if not span_s > 0:
        return None
    part = np.minimum((time_s / span_s * LIMITS.drift_parts).astype(int), LIMITS.drift_parts - 1)
    members = [np.flatnonzero(part == i) for i in range(LIMITS.drift_parts)]
    members = [each for each in members if each.size >= LIMITS.drift_part_min_samples]
    if len(members) < LIMITS.drift_min_parts:
        return None
    slope = estimate_median_slope(
        *compute_part_middles_and_quantiles(time_s, latency_s, members, 0.5, 0.0)
    )
    # choose again without the slope, which would prefer early or late samples within a part
    t, y = compute_part_middles_and_quantiles(
        time_s, latency_s, members, LIMITS.drift_latency_quantile, slope
    )
    slope = estimate_median_slope(t, y)
    residual = y - slope * t
    residual -= np.median(residual)
    # the normal distribution's ratio, and two parameters fitted
    scatter_s = STD_OF_MAD * float(np.median(np.abs(residual))) * np.sqrt(t.size / (t.size - 2))
    # the median of slopes is less precise than least squares by π/3 in variance
    std = scatter_s / float(np.sqrt(np.sum((t - t.mean()) ** 2))) * np.sqrt(np.pi / 3)
    return slope, max(float(std), LIMITS.stamp_resolution_s / span_s)


def compute_part_middles_and_quantiles(
    time_s: Floats,
    latency_s: Floats,
    part_samples: list[NDArray[np.int64]],
    quantile: float,
    slope: float,
) -> tuple[Floats, Floats]:
    """Middle time of each part, and its latency there at a quantile, (parts,) each, in s.

    The quantile is taken of the distances from a line through 0 with the given slope.
    """
    t = np.array([(time_s[each].min() + time_s[each].max()) / 2 for each in part_samples])
    off = latency_s - slope * time_s
    return t, np.array([np.quantile(off[each], quantile) for each in part_samples]) + slope * t


def estimate_median_slope(abscissae: Floats, ordinates: Floats) -> float:
    """Median of the slopes between all pairs of points (Theil-Sen)."""
    i, j = np.triu_indices(abscissae.size, 1)
    return float(np.median((ordinates[j] - ordinates[i]) / (abscissae[j] - abscissae[i])))

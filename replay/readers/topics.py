"""The table that `Log.topics` gives, and what log times say about a topic."""

from typing import Any, Final

import numpy as np
import polars as pl
from numpy.typing import NDArray

TOPICS_SCHEMA: Final = pl.Schema(
    {
        "topic": pl.String,
        "type": pl.String,
        "encoding": pl.String,
        "messages": pl.Int64,
        "start_ns": pl.Int64,
        "end_ns": pl.Int64,
        "rate_hz": pl.Float64,
        "longest_gap_s": pl.Float64,
        "fields": pl.List(pl.String),
        "problem": pl.String,
        "decoder": pl.String,
    }
)


def timing(log_times: NDArray[np.int64]) -> dict[str, Any]:
    """Count, ends, mean rate and longest gap of log times (n,) in ns and any order."""
    times = np.sort(log_times)
    count = int(times.size)
    start = int(times[0]) if count else None
    end = int(times[-1]) if count else None
    span_s = (int(times[-1]) - int(times[0])) / 1e9 if count else 0.0
    return {
        "messages": count,
        "start_ns": start,
        "end_ns": end,
        "rate_hz": (count - 1) / span_s if span_s > 0 else None,
        "longest_gap_s": int(np.diff(times).max()) / 1e9 if count > 1 else None,
    }

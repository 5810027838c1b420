"""Rows that follow each other as one moment: when it began, when it ended, what opens it."""

import shlex
from collections.abc import Sequence
from datetime import datetime
from pathlib import Path
from typing import Any, Final

import polars as pl

from estimators.errors import QueryError
from replay.frames.shape import LOG_TIME
from replay.frames.topic_source import SOURCE
from replay.query.recording_frames import AT_S

_KEY: Final = "key"
_KEY_DIGITS: Final = 12
OPENS: Final = "opens"


def moments(
    rows: pl.DataFrame, apart_s: float, recordings: Sequence[Path], fleet: str | None
) -> pl.DataFrame:
    """Put rows together that are close in time.

    Args:
        rows: with `at_s` or `log_time`; rows of several recordings with `source` or `key`.
        apart_s: rows that are at most so many seconds apart are of one moment.
        recordings: that were queried.
        fleet: the results that were.

    Returns:
        A row a moment: which recording or log, `from_s` and `to_s` (or `from` and `to`), `rows`,
        and, where a recording was queried, `opens`: the command that opens it.

    Raises:
        QueryError: the rows have no time.
    """
    time = next((name for name in (AT_S, LOG_TIME) if name in rows.columns), None)
    if time is None:
        raise QueryError(
            f"query: --moments needs {AT_S} (recordings) or {LOG_TIME} (topics) among the columns; "
            f"the query has {', '.join(rows.columns)}"
        )
    by = [name for name in (SOURCE, _KEY) if name in rows.columns]
    begin, end = ("from_s", "to_s") if time == AT_S else ("from", "to")
    apart: Any = apart_s if time == AT_S else pl.duration(microseconds=round(apart_s * 1e6))
    is_new = (pl.col(time).diff() > apart).fill_null(value=False).cum_sum()
    number = is_new.over(by) if by else is_new
    found = (
        rows.select(*by, time)
        .drop_nulls(time)
        .sort(*by, time)
        .with_columns(number.alias("moment"))
        .group_by(*by, "moment", maintain_order=True)
        .agg(
            pl.col(time).first().alias(begin),
            pl.col(time).last().alias(end),
            pl.len().alias("rows"),
        )
        .drop("moment")
    )
    opens = [opening(row, recordings, fleet) for row in found.iter_rows(named=True)]
    if not any(opens):
        return found
    return found.with_columns(pl.Series(OPENS, opens, dtype=pl.String))


def opening(row: dict[str, Any], recordings: Sequence[Path], fleet: str | None) -> str | None:
    """The command that opens a row or a moment; None where there is no recording of it."""
    at = next((row[n] for n in (AT_S, "from_s", LOG_TIME, "from") if row.get(n) is not None), None)
    if at is None:
        return None
    second = _iso(at) if isinstance(at, datetime) else f"{at:.3f}"
    if fleet is not None and row.get(_KEY):
        return f"payscope fleet open {shlex.quote(fleet)} {row[_KEY][:_KEY_DIGITS]} --at {second}"
    named = [str(each) for each in recordings]
    recording = named[0] if len(named) == 1 else row.get(SOURCE)
    if recording not in named:
        return None
    return f"payscope view {shlex.quote(str(recording))} --at {second}"


def _iso(time: datetime) -> str:
    return f"{time:%Y-%m-%dT%H:%M:%S.%f}Z"

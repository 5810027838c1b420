"""One topic out of several logs: parts that follow each other, or hold some messages both."""

from collections.abc import Mapping
from typing import Final

import polars as pl

from estimators.errors import LogError
from replay.logs import Log

#: Parts of one recording reach into each other by no more; what they reach further in is there
#: twice, or of another recording.
_OVERLAP_NS: Final = 1_000_000_000
#: Of the messages in such a stretch, at least so many are in both.
_MOSTLY: Final = 0.5
_STAMP: Final = "same_ns"


def merge_topics(topic: str, parts: Mapping[Log, pl.DataFrame]) -> pl.DataFrame:
    """One frame in log-time order; a message that two logs have counts once.

    A message is the same when its header stamp (its log time where it has none) and its fields are:
    two recorders of one topic stamp its arrival differently.

    Args:
        topic: its name.
        parts: by log: log_time_ns, header_stamp_ns and fields, in log-time order.

    Raises:
        LogError: two logs have the topic at one time, and other messages of it, which would be
            shuffled into one.
    """
    # a column of whole numbers in one table may have fractions in the next
    schema = pl.concat([frame.clear() for frame in parts.values()], how="vertical_relaxed").schema
    known = [(frame.cast(schema), log) for log, frame in parts.items() if frame.height]
    if not known:
        return pl.DataFrame(schema=schema)
    known.sort(key=lambda part: (part[0]["log_time_ns"][0], str(part[1].path)))
    whole: list[pl.DataFrame] = []
    for frame, log in known:
        for before, earlier in known[: len(whole)]:
            frame = _without_those_of(before, frame, topic, str(earlier.path), str(log.path))
        whole.append(frame)
    joint = pl.concat(whole, rechunk=False)
    # parts that follow each other stay where they are: of a shift they are a gigabyte
    if joint["log_time_ns"].is_sorted():
        return joint
    return joint.sort("log_time_ns", maintain_order=True)


def _without_those_of(
    before: pl.DataFrame, frame: pl.DataFrame, topic: str, earlier: str, later: str
) -> pl.DataFrame:
    """The messages that a log does not have from one that begins earlier."""
    if not frame.height:
        return frame
    start, end = frame["log_time_ns"][0], before["log_time_ns"][-1]
    if start > end:
        return frame
    time = pl.col("log_time_ns")
    # two recorders may each be late by a moment
    shared = frame.filter(time <= end + _OVERLAP_NS)
    theirs = before.filter(time >= start - _OVERLAP_NS)
    keys = [name for name in frame.columns if name not in ("log_time_ns", "header_stamp_ns")]
    new = _add_stamps(shared).join(
        _add_stamps(theirs), on=[*keys, _STAMP], how="anti", nulls_equal=True, maintain_order="left"
    )
    overlap_ns = min(end, frame["log_time_ns"][-1]) - start
    inside = shared.filter(time <= end).height
    if overlap_ns > _OVERLAP_NS and shared.height - new.height < _MOSTLY * inside:
        raise LogError(
            f"{later}: topic '{topic}' begins {(end - start) / 1e9:.3f} s before it ends in "
            f"{earlier}, with other messages; logs of one time line follow each other: replay "
            "these one by one"
        )
    return pl.concat([new.drop(_STAMP), frame.filter(time > end + _OVERLAP_NS)])


def _add_stamps(frame: pl.DataFrame) -> pl.DataFrame:
    header = pl.col("header_stamp_ns")
    own = pl.when(header.is_not_null() & (header != 0)).then(header)
    return frame.with_columns(own.otherwise(pl.col("log_time_ns")).alias(_STAMP))

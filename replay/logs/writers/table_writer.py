"""Simulated logs as tables."""

from pathlib import Path

import polars as pl

from analysis.simulation import SimulatedLog


def write_csv(log: SimulatedLog, path: Path) -> None:
    """Write `log` as CSV at `path`, where nothing is yet.

    `time_s` counts from the start of the campaign, so that the tables of all loads make one time
    line and every time is exact to the nanosecond, which unix seconds in a double are not. The
    other columns are the machine file's channels, numbers written so that they read back exactly.
    """
    topics = (frame.drop("log_time_ns") for frame in log.topics.values())
    table = next(topics)
    for topic in topics:
        table = table.join(topic, on="header_stamp_ns", how="full", coalesce=True)
    time_s = (pl.col("header_stamp_ns") - log.origin_unix_ns) / 1e9
    table.sort("header_stamp_ns").select(
        time_s.alias("time_s"), pl.exclude("header_stamp_ns")
    ).write_csv(path)

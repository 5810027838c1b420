"""Logs that need no second decoding: one that was read once, and one that never was a file."""

from pathlib import Path

import polars as pl
import pytest

from analysis.simulation import Scenario, simulate_campaign
from estimators.errors import LogError
from replay import Log, TimeAxis, open_log
from replay.inputs.derived_logs import CachedLog, MemoryLog
from tests.replay.sledge import sledge


def test_a_log_that_is_read_once_gives_the_same_again_without_its_file(tmp_path: Path) -> None:
    path = tmp_path / "s.csv"
    sledge(5.0).write_csv(path)
    with open_log(path, time=TimeAxis("time_s")) as log:
        once = CachedLog(log)
        first = once.read("table", ["force_N"])
        assert first.equals(log.read("table", ["force_N"]))
        topics = once.topics()
        path.unlink()
        assert once.read("table", ["force_N"]).equals(first)
        assert once.topics().equals(topics)
        assert once.losses() == log.losses()


@pytest.fixture(scope="module")
def log() -> MemoryLog:
    short = Scenario()
    campaign = short.campaign.model_copy(update={"loads_kg": (50.0,), "runs": 1})
    (simulated,) = simulate_campaign(short.model_copy(update={"campaign": campaign}))
    return MemoryLog(simulated)


def test_a_simulation_is_a_log_of_its_topics(log: MemoryLog) -> None:
    assert log.topics()["topic"].to_list() == ["imu", "torque", "speed"]
    read = log.read("speed", ["speed_left_m_s"])
    assert read.columns == ["log_time_ns", "header_stamp_ns", "speed_left_m_s"]
    assert read["log_time_ns"].is_sorted()
    begin, end = read["log_time_ns"][10], read["log_time_ns"][19]
    assert log.read("speed", ["speed_left_m_s"], begin, end).equals(read[10:20])


def test_an_unknown_topic_or_field_names_the_nearest(log: MemoryLog) -> None:
    with pytest.raises(LogError, match="did you mean 'speed'"):
        log.read("sped", [])
    with pytest.raises(LogError, match="did you mean 'speed_left_m_s'"):
        log.read("speed", ["speed_left"])


def test_a_simulation_is_described_by_the_columns_of_every_log(log: MemoryLog) -> None:
    topics = log.topics()
    assert topics.schema == Log.TOPICS_SCHEMA
    speed = topics.row(by_predicate=pl.col("topic") == "speed", named=True)
    times = log.read("speed", [])["log_time_ns"]
    assert (speed["messages"], speed["start_ns"], speed["end_ns"]) == (
        times.len(),
        times[0],
        times[-1],
    )
    assert speed["rate_hz"] == pytest.approx((times.len() - 1) / (times[-1] - times[0]) * 1e9)
    assert speed["longest_gap_s"] == pytest.approx(times.diff().max() / 1e9)

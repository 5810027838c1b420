"""A growing log keeps what later rows need, and no more, whatever its topics do."""

import numpy as np
import polars as pl
import pytest
from polars.testing import assert_frame_equal

from analysis.model.schema import build_frame
from analysis.online.growing_log import GrowingLog, copy_machine_with_causal_filters
from analysis.simulation import Scenario
from estimators.errors import DataError
from replay import load_machine, open_log
from replay.inputs.channel_inputs import list_channel_fields
from replay.simulation.simulate_logs import simulate_scenario_to_logs

#: Driving in s, repeated; longer than two of the times that a growing log keeps around a gap.
LENGTH_S, PIECE_S = 400.0, 5.0
#: The topic that is not always there.
TOPIC = "/wheels/torque"


@pytest.fixture(scope="module")
def topics(tmp_path_factory: pytest.TempPathFactory) -> dict[str, pl.DataFrame]:
    plan = Scenario.model_validate({"campaign": {"loads_kg": [150], "runs": 4}})
    path = simulate_scenario_to_logs(plan, tmp_path_factory.mktemp("driving") / "log.mcap")[0]
    with open_log(path) as log:
        frames = log.read_many(list_channel_fields(load_machine("cat262c.toml")))
    length_ns = max(int(np.ptp(frame["log_time_ns"].to_numpy())) for frame in frames.values())
    length_ns += 10_000_000
    stamps = ["log_time_ns", "header_stamp_ns"]
    end_ns = min(int(frame["log_time_ns"][0]) for frame in frames.values()) + LENGTH_S * 1e9
    return {
        topic: pl.concat(
            frame.with_columns(pl.col(stamps) + k * length_ns)
            for k in range(int(LENGTH_S * 1e9 / length_ns) + 1)
        ).filter(pl.col("log_time_ns") < end_ns)
        for topic, frame in frames.items()
    }


def take_in_pieces(topics: dict[str, pl.DataFrame], piece_s: float) -> tuple[pl.DataFrame, int]:
    """Rows of a log that grows, and the most samples that it kept."""
    log = GrowingLog(copy_machine_with_causal_filters(load_machine("cat262c.toml")))
    first = min(int(frame["log_time_ns"][0]) for frame in topics.values())
    rows, kept = [], 0
    for end_s in np.arange(piece_s, LENGTH_S + piece_s, piece_s):
        until, since = first + end_s * 1e9, first + (end_s - piece_s) * 1e9
        for topic, frame in topics.items():
            is_new = pl.col("log_time_ns").is_between(since, until, closed="left")
            log.append_topic_samples(topic, frame.filter(is_new))
        rows.append(log.compute_new_excitation_columns())
        kept = max(kept, log.kept_sample_count)
    rows.append(log.compute_new_excitation_columns(is_log_complete=True))
    return pl.concat(build_frame("excitation", new) for new in rows if new), kept


def time_s() -> pl.Expr:
    """Time of a topic's samples since its first."""
    return (pl.col("log_time_ns") - pl.col("log_time_ns").first()) / 1e9


@pytest.mark.parametrize("returns_s", [300.0, None])
def test_a_topic_that_is_missing_for_minutes_costs_no_more_than_the_ends_of_its_gap(
    topics: dict[str, pl.DataFrame], returns_s: float | None
) -> None:
    is_there = (time_s() < 60.0) | (time_s() >= (returns_s or np.inf))
    broken = topics | {TOPIC: topics[TOPIC].filter(is_there)}
    at_once, _ = take_in_pieces(broken, 2.0 * LENGTH_S)
    rows, kept = take_in_pieces(broken, PIECE_S)
    assert_frame_equal(rows, at_once, rel_tol=1e-9, abs_tol=1e-9)
    assert kept < samples_of_live_topics(topics, 140.0)


def samples_of_live_topics(topics: dict[str, pl.DataFrame], length_s: float) -> float:
    """Samples in so long: of a minute, the least gap that is no mere pause, and some seconds."""
    live = sum(frame.height for name, frame in topics.items() if name != TOPIC)
    return live * length_s / LENGTH_S


def test_a_topic_that_comes_minutes_late_costs_no_more_than_the_ends_of_the_wait(
    topics: dict[str, pl.DataFrame],
) -> None:
    late = topics | {TOPIC: topics[TOPIC].filter(time_s() >= 250.0)}
    at_once, _ = take_in_pieces(late, 2.0 * LENGTH_S)
    rows, kept = take_in_pieces(late, PIECE_S)
    assert_frame_equal(rows, at_once, rel_tol=1e-9, abs_tol=1e-9)
    assert kept < samples_of_live_topics(topics, 140.0)


def test_a_topic_that_never_comes_is_named_at_the_end(topics: dict[str, pl.DataFrame]) -> None:
    log = GrowingLog(copy_machine_with_causal_filters(load_machine("cat262c.toml")))
    for start_s in np.arange(0.0, LENGTH_S, PIECE_S):
        for topic in topics.keys() - {TOPIC}:
            is_new = time_s().is_between(start_s, start_s + PIECE_S, closed="left")
            log.append_topic_samples(topic, topics[topic].filter(is_new))
        assert not log.compute_new_excitation_columns()
    assert log.kept_sample_count < samples_of_live_topics(topics, 140.0)
    with pytest.raises(DataError, match=f"no message arrived on the topics {TOPIC}"):
        log.compute_new_excitation_columns(is_log_complete=True)

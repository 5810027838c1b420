"""Header stamps or log time, and what is done about bad ones."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from analysis.stages.signals.timestamps import assign_timestamps, measure_clock_drifts_by_topic

SECOND = 1_000_000_000
LOG = np.arange(200) * 10_000_000 + 1_700_000_000 * SECOND


def placed_one(raw_topic, log=LOG, header="same", name="/imu"):
    frames, labels, losses = assign_timestamps(
        {name: raw_topic(log, header, x=np.arange(log.size) * 1.0)}
    )
    return frames[name], labels[name], [loss.what for loss in losses]


def test_a_header_stamp_places_a_sample_where_there_is_one(raw_topic):
    frame, label, losses = placed_one(raw_topic, header=LOG - 3_000_000)
    assert label == "header"
    assert losses == []
    assert frame.columns == ["unix_ns", "x"]
    np.testing.assert_array_equal(frame["unix_ns"], LOG - 3_000_000)


@pytest.mark.parametrize(("name", "label"), [("/imu", "log"), ("table", "table")])
def test_log_time_places_what_has_no_header(raw_topic, name, label):
    frame, found, losses = placed_one(raw_topic, header=[None] * LOG.size, name=name)
    assert found == label
    assert losses == []
    np.testing.assert_array_equal(frame["unix_ns"], LOG)


def test_header_stamps_that_were_never_set_fall_back_to_log_time_and_say_so(raw_topic):
    frame, label, losses = placed_one(raw_topic, header=np.zeros_like(LOG))
    assert label == "log"
    assert losses == ["200 of 200 header stamps are not set, so log time is used instead"]
    assert frame.height == LOG.size


def test_a_few_unset_header_stamps_are_dropped_and_counted(raw_topic):
    header = LOG.copy()
    header[7] = 0
    frame, label, losses = placed_one(raw_topic, header=header)
    assert label == "header"
    assert losses == ["1 samples without a stamp were dropped"]
    assert frame.height == LOG.size - 1


def test_header_stamps_that_jump_back_by_a_second_are_another_clock(raw_topic):
    header = LOG.copy()
    header[100:] -= 5 * SECOND
    frame, label, losses = placed_one(raw_topic, header=header)
    assert label == "log"
    assert losses == ["header stamps jump back by 4.99 s, so log time is used instead"]
    np.testing.assert_array_equal(frame["unix_ns"], LOG)


def test_stamps_that_go_backwards_a_little_are_sorted_and_reported(raw_topic):
    header = LOG.copy()
    header[[50, 51]] = header[[51, 50]]
    frame, label, losses = placed_one(raw_topic, header=header)
    assert label == "header"
    assert losses == ["1 stamps go backwards (by up to 0.01 s); samples were sorted"]
    assert frame["unix_ns"].is_sorted()
    assert frame["x"][50:52].to_list() == [51.0, 50.0]


def test_log_times_that_jump_back_far_are_sorted_and_reported(raw_topic):
    log = LOG.copy()
    log[100:] -= 5 * SECOND
    frame, _, losses = placed_one(raw_topic, log, header=[None] * log.size)
    assert losses == ["1 stamps go backwards (by up to 4.99 s); samples were sorted"]
    assert frame["unix_ns"].is_sorted()


def test_headers_of_another_clock_are_not_mixed_with_log_times(raw_topic):
    raw = {
        "/imu": raw_topic(LOG, LOG - 3600 * SECOND, x=LOG * 1.0),
        "/can": raw_topic(LOG, [None] * LOG.size, y=LOG * 1.0),
    }
    frames, labels, losses = assign_timestamps(raw)
    assert labels == {"/imu": "log", "/can": "log"}
    assert [loss.topic for loss in losses] == ["/imu"]
    assert "another clock" in losses[0].what
    np.testing.assert_array_equal(frames["/imu"]["unix_ns"], LOG)


def test_headers_of_the_same_clock_stay_beside_log_times(raw_topic):
    raw = {
        "/imu": raw_topic(LOG, LOG - SECOND // 100, x=LOG * 1.0),
        "/can": raw_topic(LOG, [None] * LOG.size, y=LOG * 1.0),
    }
    _, labels, losses = assign_timestamps(raw)
    assert labels == {"/imu": "header", "/can": "log"}
    assert losses == []


@pytest.mark.parametrize(
    ("imu_s", "can_s", "labels"),
    [
        (-5, 0, {"/imu": "log", "/can": "header"}),
        (30, 0, {"/imu": "log", "/can": "header"}),
        (-5, 5, {"/imu": "log", "/can": "log"}),
        (-3600, -3605, {"/imu": "log", "/can": "log"}),
    ],
)
def test_headers_of_two_clocks_are_not_mixed(raw_topic, imu_s, can_s, labels):
    raw = {
        "/imu": raw_topic(LOG, LOG + imu_s * SECOND, x=LOG * 1.0),
        "/can": raw_topic(LOG, LOG + can_s * SECOND, y=LOG * 1.0),
    }
    frames, found, losses = assign_timestamps(raw)
    assert found == labels
    assert {loss.topic for loss in losses} == {t for t, label in labels.items() if label == "log"}
    np.testing.assert_array_equal(frames["/imu"]["unix_ns"], frames["/can"]["unix_ns"])


def set_clock_on(log):
    """A clock that is set from UTC to TAI in the middle."""
    return np.where(np.arange(log.size) < log.size // 2, log, log + 37 * SECOND)


def stop_clock(log):
    """A clock that stops after the first third."""
    return np.minimum(log, log[log.size // 3])


@pytest.mark.parametrize("clock", [set_clock_on, stop_clock])
def test_headers_of_a_clock_that_is_set_or_stops_are_not_used(raw_topic, clock):
    """A log whose times of recording were right was refused for its clocks, or for its units."""
    log = LOG[0] + np.arange(4_000) * (SECOND // 100)
    raw = {name: raw_topic(log, log - SECOND // 200, x=log * 1.0) for name in ("/imu", "/speed")}
    raw["/torque"] = raw_topic(log, clock(log), x=log * 1.0)
    frames, clocks, (lost,) = assign_timestamps(raw)
    assert clocks == {"/imu": "header", "/speed": "header", "/torque": "log"}
    assert "log time is used instead" in lost.what
    np.testing.assert_array_equal(frames["/torque"]["unix_ns"], log)
    drifts = measure_clock_drifts_by_topic(raw, clocks)
    assert set(drifts["topic"]) == {"/imu", "/speed"}


def test_a_clock_that_stops_late_is_not_used_even_if_it_is_that_of_all_topics(raw_topic):
    log = LOG[0] + np.arange(4_000) * (SECOND // 100)
    stopped = np.minimum(log, log[3_200])
    raw = {name: raw_topic(log, stopped, x=log * 1.0) for name in ("/imu", "/speed")}
    frames, clocks, losses = assign_timestamps(raw)
    assert clocks == {"/imu": "log", "/speed": "log"}
    assert all("stay the same for 7.99 s" in loss.what for loss in losses)
    assert frames["/imu"].height == log.size


def test_clocks_that_move_apart_both_ways_are_not_used(raw_topic):
    log = LOG[0] + np.arange(4_000) * (SECOND // 100)
    later = np.arange(4_000) >= 2_000
    raw = {
        "/imu": raw_topic(log, log + 5 * SECOND * later, x=log * 1.0),
        "/speed": raw_topic(log, log - SECOND // 2 * later, x=log * 1.0),
        "/torque": raw_topic(log, log, x=log * 1.0),
    }
    _, clocks, _ = assign_timestamps(raw)
    assert clocks == {"/imu": "log", "/speed": "header", "/torque": "header"}


def test_a_queue_that_delays_log_time_for_a_while_leaves_the_headers(raw_topic):
    log = LOG[0] + np.arange(4_000) * (SECOND // 100)
    late = log + np.where(abs(np.arange(4_000) - 2_000) < 500, 2 * SECOND, 0)
    raw = {"/imu": raw_topic(late, log, x=log * 1.0), "/speed": raw_topic(log, log, x=log * 1.0)}
    _, clocks, losses = assign_timestamps(raw)
    assert (clocks, losses) == ({"/imu": "header", "/speed": "header"}, [])


def test_a_shared_clock_other_than_the_recorders_is_kept(raw_topic):
    raw = {name: raw_topic(LOG, LOG - 3600 * SECOND, x=LOG * 1.0) for name in ("/imu", "/can")}
    _, labels, losses = assign_timestamps(raw)
    assert labels == {"/imu": "header", "/can": "header"}
    assert losses == []


def test_a_table_may_begin_at_any_time(raw_topic):
    log = np.arange(5)
    frame, _, losses = placed_one(raw_topic, log, header=[None] * 5, name="table")
    assert frame["unix_ns"].to_list() == [0, 1, 2, 3, 4]
    assert losses == []


def test_an_empty_topic_stays_empty(raw_topic):
    frame, label, losses = placed_one(raw_topic, LOG[:0])
    assert (frame.height, label, losses) == (0, "log", [])


@given(order=st.permutations(range(20)), header=st.booleans())
def test_samples_come_out_sorted_and_none_is_lost(raw_topic, order, header):
    log = LOG[list(order)]
    frame, _, _ = placed_one(raw_topic, log, "same" if header else [None] * 20)
    np.testing.assert_array_equal(frame["unix_ns"], LOG[:20])
    np.testing.assert_array_equal(frame["x"], np.argsort(order))


@given(st.floats(2.0, 3.0), st.integers(-5, 5), st.integers(0, 1000))
def test_headers_that_scatter_beside_an_even_log_are_placed_by_it(raw_topic, periods, lag_s, seed):
    dice = np.random.default_rng(seed)
    period_ns = int(LOG[1] - LOG[0])
    off_ns = dice.uniform(-0.5, 0.5, LOG.size) * periods * period_ns - 0.1 * lag_s * SECOND
    frame, label, losses = placed_one(raw_topic, header=LOG + off_ns.astype(np.int64))
    assert label == "log"
    assert "scatter" in losses[0]
    steps = np.diff(frame["unix_ns"].to_numpy())
    np.testing.assert_array_equal(steps, np.diff(LOG))
    # in the header's clock, and in the order of arrival
    mean_ns = float(np.mean(frame["unix_ns"].to_numpy() - (LOG - 0.1 * lag_s * SECOND)))
    assert abs(mean_ns) < 0.5 * periods * period_ns
    assert frame["x"].is_sorted()


@given(st.floats(0.0, 0.5), st.integers(0, 1000))
def test_headers_that_are_even_stay_whatever_the_log_does(raw_topic, periods, seed):
    dice = np.random.default_rng(seed)
    latency_ns = dice.exponential(3.0, LOG.size) * float(LOG[1] - LOG[0])
    log = np.maximum.accumulate(LOG + latency_ns.astype(np.int64))
    off_ns = dice.uniform(-0.5, 0.5, LOG.size) * periods * float(LOG[1] - LOG[0])
    _, label, _ = placed_one(raw_topic, log, header=LOG + off_ns.astype(np.int64))
    assert label == "header"


def test_headers_of_what_is_delivered_in_bursts_stay(raw_topic):
    # ten at once, a millisecond apart
    log = np.repeat(LOG[::10], 10) + np.tile(np.arange(10) * 1_000_000, LOG.size // 10)
    frame, label, losses = placed_one(raw_topic, log, header=LOG - 3_000_000)
    assert (label, losses) == ("header", [])
    np.testing.assert_array_equal(frame["unix_ns"], LOG - 3_000_000)

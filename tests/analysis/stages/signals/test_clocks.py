"""Drifts of header stamps against log time: seen where they are, and nowhere else."""

import numpy as np
import polars as pl
import pytest
from hypothesis import given
from hypothesis import strategies as st

from analysis.stages.signals.timestamps import (
    find_largest_relative_clock_drift,
    measure_clock_drifts_by_topic,
)
from tests.twins import mark_heavy_after

T0 = 1_700_000_000_000_000_000
SPAN_S = 150.0


def stamped(drift_ppm=0.0, seed=1, rate_hz=100.0, latency=None, span_s=SPAN_S):
    """A topic of which the clock runs so much faster than the recorder's."""
    generator = np.random.default_rng(seed)
    measured_s = np.arange(0.0, span_s, 1.0 / rate_hz)
    latency_s = (latency or jitter)(generator, measured_s)
    header_s = measured_s * (1.0 + drift_ppm * 1e-6)
    return pl.DataFrame(
        {
            "log_time_ns": T0 + np.round((measured_s + latency_s) * 1e9).astype(np.int64),
            "header_stamp_ns": T0 + np.round(header_s * 1e9).astype(np.int64),
        }
    )


def jitter(generator, measured_s):
    return 0.002 + 0.001 * generator.random(measured_s.size)


def queues(generator, measured_s):
    """An exponential latency, and every tenth second the recorder is away for 100 ms."""
    away = np.maximum(0.1 - measured_s % 10.0, 0.0)
    return 0.001 + generator.exponential(0.001, measured_s.size) + away


def batches(_, measured_s):
    """Messages arrive every 40 ms."""
    return np.ceil(measured_s / 0.04 + 0.5) * 0.04 - measured_s


def row(frame, topic="/a"):
    return measure_clock_drifts_by_topic({topic: frame}).row(0, named=True)


@pytest.mark.parametrize("latency", [jitter, queues, batches])
@pytest.mark.parametrize("rate_hz", [10.0, 100.0, 1000.0])
@pytest.mark.parametrize("drift_ppm", [-1000.0, -200.0, 200.0, 1000.0])
def test_a_drift_is_found_whatever_the_latency(drift_ppm, rate_hz, latency):
    found = row(stamped(drift_ppm, rate_hz=rate_hz, latency=latency))
    assert found["drift_ppm"] == pytest.approx(drift_ppm, abs=20.0)
    assert abs(found["drift_ppm"]) > 10 * found["drift_std_ppm"]
    assert found["span_s"] == pytest.approx(SPAN_S, abs=0.3)


@pytest.mark.heavy
@pytest.mark.parametrize("latency", mark_heavy_after(1, [jitter, queues]))
def test_the_standard_deviation_is_that_of_the_drift(latency):
    found = [row(stamped(seed=seed, latency=latency)) for seed in range(200)]
    off = np.array([each["drift_ppm"] / each["drift_std_ppm"] for each in found])
    assert 0.7 < np.sqrt(np.mean(off**2)) < 1.4
    assert np.abs(off).max() < 6.0
    assert max(abs(each["drift_ppm"]) for each in found) < 5.0


def test_a_hole_in_the_log_and_a_stamp_gone_wrong_change_nothing():
    frame = stamped(200.0)
    kept = np.delete(np.arange(frame.height), np.s_[4000:9000])
    frame = frame[kept].with_columns(
        header_stamp_ns=pl.when(pl.int_range(pl.len()) == 77)
        .then(pl.col("header_stamp_ns") + 3_000_000_000)
        .otherwise("header_stamp_ns")
    )
    assert row(frame)["drift_ppm"] == pytest.approx(200.0, abs=1.0)


def test_topics_without_a_clock_of_their_own_have_no_row():
    frame = stamped()
    raw = {
        "/none": frame.with_columns(header_stamp_ns=pl.lit(None, pl.Int64)),
        "/zero": frame.with_columns(header_stamp_ns=pl.lit(0, pl.Int64)),
        "/short": frame[:40],
        "/empty": frame[:0],
        "/once": frame.with_columns(log_time_ns=pl.lit(T0, pl.Int64)),
    }
    found = measure_clock_drifts_by_topic(raw)
    assert found.height == 0
    assert found.columns == ["topic", "drift_ppm", "drift_std_ppm", "span_s"]
    assert find_largest_relative_clock_drift(found) is None


def test_stamps_that_are_log_times_do_not_drift_and_their_deviation_is_not_zero():
    frame = stamped().with_columns(header_stamp_ns=pl.col("log_time_ns"))
    found = row(frame)
    assert found["drift_ppm"] == 0.0
    assert 0.0 < found["drift_std_ppm"] < 0.1


def test_clocks_that_run_apart_are_found_though_the_recorders_runs_wrong():
    """All run 500 ppm fast against the recorder's; the force's 200 ppm faster than that."""
    raw = {
        "/imu": stamped(500.0, seed=1),
        "/force": stamped(700.0, seed=2),
        "/speed": stamped(500.0, seed=3, rate_hz=10.0),
    }
    apart = find_largest_relative_clock_drift(measure_clock_drifts_by_topic(raw))
    assert apart is not None
    assert (apart.faster, apart.slower) in {("/force", "/imu"), ("/force", "/speed")}
    assert apart.drift_ppm == pytest.approx(200.0, abs=5.0)
    assert apart.drift_ppm > 10 * apart.drift_std_ppm
    same = find_largest_relative_clock_drift(
        measure_clock_drifts_by_topic({name: raw[name] for name in ("/imu", "/speed")})
    )
    assert same is not None
    assert same.drift_ppm < 5 * same.drift_std_ppm


@pytest.mark.heavy
@given(st.integers(0, 2**32 - 1), st.permutations(range(40)))
def test_the_order_of_the_rows_does_not_matter(seed, order):
    frame = stamped(50.0, seed=seed, rate_hz=5.0)
    parts = [frame[i * 15 : (i + 1) * 15] for i in range(50)]
    mixed = pl.concat([parts[i] for i in order] + parts[40:])
    assert row(mixed) == row(frame)

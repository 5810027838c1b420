"""Nine simulated starts of which every topic is sampled at its own rate and phase."""

from functools import cache

import numpy as np
import polars as pl

from analysis.diagnosis import CheckInputs, judge_log_by_checks
from analysis.model.verdict import Verdict
from analysis.simulation import Scenario, solve_motion
from analysis.stages.estimation.method_estimates import (
    summarise_masses,
    trace_estimates,
    withhold_masses,
)
from analysis.stages.gating.gate import gate_windows
from analysis.stages.motion.forces import compute_excitation
from analysis.stages.motion.smooth import smooth_by_trailing_mean
from analysis.stages.signals.align import align_channels_on_grid
from analysis.stages.signals.derive import derive_channels_in_si, read_measured_channels
from analysis.stages.signals.timestamps import assign_timestamps

STARTS = 9
TRUE_KG = 3614.0
T0_NS = 1_700_000_000_000_000_000
NOISE = {"force": 60.0, "speed": 0.005, "imu": 0.01}
FIELDS = {"force": "measured_force_x_N", "speed": "speed_x_m_s", "imu": "specific_force_x_m_s2"}
CHANNELS = {
    "force_x_N": {"topic": "/force", "field": "x"},
    "speed_x_m_s": {"topic": "/speed", "field": "x"},
    "specific_force_x_m_s2": {"topic": "/imu", "field": "x"},
}


@cache
def _motion():
    return solve_motion(Scenario(), 0.0)


def sampled(topic, rate_hz, phase_s=0.0, seed=1, noise=1.0, delay_s=0.0, jitter_s=0.0):
    """Stamps and samples of a topic over the whole campaign."""
    trial_s = _motion().duration_s
    t_s = np.arange(phase_s, STARTS * trial_s, 1.0 / rate_hz)
    generator = np.random.default_rng([seed, sorted(FIELDS).index(topic)])
    t_s = t_s + generator.uniform(-jitter_s, jitter_s, t_s.size)
    motion = _motion().sample_channels(np.maximum(t_s - delay_s, 0.0) % trial_s)
    x = getattr(motion, FIELDS[topic]) + noise * NOISE[topic] * generator.normal(size=t_s.size)
    return T0_NS + np.round(t_s * 1e9).astype(np.int64), x


def raw(seed=1, noise=1.0, **topics):
    """A log: by topic what differs from 100 Hz without phase, delay and jitter."""
    frames = {}
    for topic in FIELDS:
        t, x = sampled(
            topic, **{"rate_hz": 100.0, "seed": seed, "noise": noise} | topics.get(topic, {})
        )
        frames[f"/{topic}"] = pl.DataFrame({"log_time_ns": t, "header_stamp_ns": t, "x": x})
    return frames


def excitation(log, machine):
    """The log through every stage up to `forces`."""
    channels, _ = derive_channels_in_si(
        read_measured_channels(assign_timestamps(log)[0], machine)[0], machine
    )
    aligned, _ = align_channels_on_grid(channels, machine)
    return compute_excitation(smooth_by_trailing_mean(aligned, machine.settings.smooth), machine)


def pooled(log, machine, method="pooled"):
    """The mass of a method over the whole log, and its standard deviation, in kg."""
    excited = excitation(log, machine)
    settings = machine.settings
    gated = gate_windows(excited, settings)
    table = summarise_masses(excited, gated, trace_estimates(excited, gated, settings), machine)
    opinion = Verdict.from_frame(judge_log_by_checks(CheckInputs(excited, gated, machine)))
    table = withhold_masses(table, opinion, ())
    row = table.row(by_predicate=pl.col("method") == method, named=True)
    return row["mass_kg"], row["mass_std_kg"]

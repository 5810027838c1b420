"""Simulated starts through the stages from the grid on, without a file between."""

from collections.abc import Iterator

import numpy as np
import polars as pl
from scipy.signal import lfilter

from analysis import Machine
from analysis.model.run_record import Provenance, Run
from analysis.simulation import Scenario, SimulatedLog, simulate_campaign
from analysis.stages.motion.forces import compute_excitation
from analysis.stages.motion.smooth import smooth_by_trailing_mean
from analysis.stages.signals.align import align_channels_on_grid
from analysis.stages.signals.rates import ChannelSamples


def scenario(seed: int, **campaign: object) -> Scenario:
    """The default scenario with another seed and another campaign, unloaded."""
    base = Scenario()
    return base.model_copy(
        update={
            "campaign": base.campaign.model_copy(update={"loads_kg": (0.0,), **campaign}),
            "sensors": base.sensors.model_copy(update={"seed": seed}),
        }
    )


def coloured(samples: int, std: float, lasting_s: float, rate_hz: float, seed: int) -> np.ndarray:
    """First-order Gauss-Markov noise (samples,): correlation exp(-t / lasting_s)."""
    generator = np.random.default_rng([seed, samples])
    keep = np.exp(-1.0 / (lasting_s * rate_hz))
    steps = generator.normal(size=samples) * std * np.sqrt(1.0 - keep**2)
    steps[0] = generator.normal() * std
    return lfilter([1.0], [1.0, -keep], steps)


def excitation(
    log: SimulatedLog, machine: Machine, force_N: float = 0.0, lasting_s: float = 0.1
) -> pl.DataFrame:
    """A simulated log as the gate sees it, with coloured noise on the force beside the white."""
    plan = log.scenario
    stamps = log.topics["torque"]["header_stamp_ns"]
    noise_N = coloured(stamps.len(), force_N, lasting_s, plan.sensors.rate_hz, plan.sensors.seed)
    side_N_m = noise_N * plan.machine.force_share * plan.machine.wheel_radius_m / 2.0
    topics = {
        **log.topics,
        "torque": log.topics["torque"].with_columns(
            pl.col("torque_left_N_m", "torque_right_N_m") + pl.Series(side_N_m)
        ),
        "speed": log.topics["speed"].with_columns(
            speed_x_m_s=pl.mean_horizontal("speed_left_m_s", "speed_right_m_s")
        ),
    }
    wanted = {
        name: ChannelSamples(topic["header_stamp_ns"].to_numpy(), topic[name].to_numpy())
        for topic in topics.values()
        for name in topic.columns
        if name in machine.channels
    }
    aligned, _ = align_channels_on_grid(wanted, machine)
    return compute_excitation(smooth_by_trailing_mean(aligned, machine.settings.smooth), machine)


def cut(frame: pl.DataFrame, log: SimulatedLog, runs: int) -> Iterator[pl.DataFrame]:
    """The same in logs of so many runs."""
    t_ns = frame["t_ns"]
    start_ns = log.trials["start_ns"]
    period_ns = start_ns[1] - start_ns[0]
    rate = 1e9 / (t_ns[1] - t_ns[0])
    for first in range(0, log.trials.height - runs + 1, runs):
        begin = t_ns.search_sorted(first * period_ns)
        # the next run begins with a standstill, which ends the last braking
        yield frame.slice(begin, round((runs * period_ns * 1e-9 + 0.5) * rate))


def joined(*plans: Scenario, machine: Machine) -> tuple[Run, pl.DataFrame]:
    """All plans' logs on one time line, load by load: a run of `excitation`, and the true runs."""
    frames: list[pl.DataFrame] = []
    truths: list[pl.DataFrame] = []
    campaigns = [simulate_campaign(plan) for plan in plans]
    ends_ns = 0
    for log in (log for logs in zip(*campaigns, strict=True) for log in logs):
        start_ns = log.trials["start_ns"][0]
        frame = excitation(log, machine).with_columns(pl.col("t_ns") + ends_ns)
        truths.append(log.trials.with_columns(pl.col("start_ns", "end_ns") + (ends_ns - start_ns)))
        # a row without anything is the gap between two logs
        hole = frame.clear(1).with_columns(t_ns=frame["t_ns"].last() + 10_000_000)
        frames += [frame, hole]
        ends_ns = hole["t_ns"][0] + 60_000_000_000
    return Run({"excitation": pl.concat(frames)}, Provenance()), pl.concat(truths)

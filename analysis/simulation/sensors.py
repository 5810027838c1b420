"""Measure a motion as the instruments report it: noise, delay, bias, and the recorder's losses.

Every channel of every trial draws from its own stream of random numbers, so that one more trial,
load or channel leaves all others as they were.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Final, NamedTuple

import numpy as np
import polars as pl
from numpy.typing import NDArray

from analysis.simulation.motion import Channels
from analysis.simulation.scenario import Scenario
from analysis.simulation.waveforms import Floats

#: A stream's number is its place here: append, never insert.
_STREAMS: Final = (
    "torque_left_N_m",
    "torque_right_N_m",
    "speed_left_m_s",
    "speed_right_m_s",
    "specific_force_x_m_s2",
    "specific_force_y_m_s2",
    "specific_force_z_m_s2",
    "roll_rate_rad_s",
    "pitch_rate_rad_s",
    "yaw_rate_rad_s",
    "pitch_rad",
    "imu_latency",
    "torque_latency",
    "speed_latency",
    "roll_rad",
    "torque_left_drift",
    "torque_right_drift",
    "imu_dropout",
    "torque_dropout",
    "speed_dropout",
    "blackout",
)


@dataclass(frozen=True)
class Streams:
    """The random numbers of one log.

    Attributes:
        seed: of the scenario.
        load_index: which log of the campaign.
        trial: (n,) the trial that each sample belongs to, ascending; the rest after them is one.
    """

    seed: int
    load_index: int
    trial: NDArray[np.int64]

    def normal(self, stream: str, std: float) -> Floats:
        """White noise (n,) of standard deviation `std`."""
        return std * np.concatenate([g.standard_normal(n) for g, n in self._generators(stream)])

    def drift(self, stream: str, std: float, samples: float) -> Floats:
        """A stationary first-order Gauss-Markov process (n,): e-folding after `samples`."""
        if not std:
            return np.zeros(self.trial.size)
        from scipy.signal import lfilter

        keeps = math.exp(-1.0 / samples)
        steps = self.normal(stream, std)
        steps[1:] *= math.sqrt(1.0 - keeps * keeps)
        return lfilter([1.0], [1.0, -keeps], steps)

    def uniform(self, stream: str) -> Floats:
        """Numbers (n,) between 0 and 1."""
        return np.concatenate([g.random(n) for g, n in self._generators(stream)])

    def _generators(self, stream: str) -> list[tuple[np.random.Generator, int]]:
        trials, samples = np.unique(self.trial, return_counts=True)
        number = _STREAMS.index(stream)
        return [
            (
                np.random.default_rng(
                    np.random.SeedSequence(
                        self.seed, spawn_key=(self.load_index, int(trial), number)
                    )
                ),
                int(count),
            )
            for trial, count in zip(trials, samples, strict=True)
        ]


class _Signal(NamedTuple):
    """A channel: what it would read without white noise, the noise, and its resolution."""

    value: Floats
    noise: float
    lsb: float


def measure(
    scenario: Scenario,
    streams: Streams,
    stamp_ns: NDArray[np.int64],
    channels: Callable[[NDArray[np.int64]], Channels],
) -> dict[str, pl.DataFrame]:
    """Report a motion as the instruments would.

    Args:
        scenario: noise, bias, wheels and slope.
        streams: the random numbers of this log.
        stamp_ns: (n,) unix time of each measurement.
        channels: the motion at unix times.

    Returns:
        `imu`, `torque` and `speed`: `header_stamp_ns`, `log_time_ns`, and columns with the names,
        units and signs of a machine file's channels (pitch positive nose-up). Lost messages have
        no row.
    """
    sensors, log = scenario.sensors, scenario.log

    def before(delay_s: float) -> Channels:
        return channels(stamp_ns - round(delay_s * 1e9))

    signals = {
        "imu": _imu(scenario, before(sensors.imu_delay_s)),
        "torque": _torque(scenario, before(sensors.force_delay_s), streams),
        "speed": _speed(scenario, before(sensors.speed_delay_s)),
    }
    dark = _dark(scenario, streams, stamp_ns)
    frames: dict[str, pl.DataFrame] = {}
    for topic, columns in signals.items():
        latency_s = log.latency_s + log.latency_jitter_s * streams.uniform(f"{topic}_latency")
        recorded = ~dark
        if log.dropout_share:
            recorded &= streams.uniform(f"{topic}_dropout") >= log.dropout_share
        frames[topic] = pl.DataFrame(
            {
                "header_stamp_ns": stamp_ns,
                "log_time_ns": stamp_ns + np.rint(latency_s * 1e9).astype(np.int64),
                **{name: _read(streams, name, signal) for name, signal in columns.items()},
            }
        ).filter(recorded)
    return frames


def _read(streams: Streams, name: str, signal: _Signal) -> Floats:
    reading = signal.value + streams.normal(name, signal.noise)
    return np.rint(reading / signal.lsb) * signal.lsb if signal.lsb else reading


def _imu(scenario: Scenario, motion: Channels) -> dict[str, _Signal]:
    sensors, terrain = scenario.sensors, scenario.terrain
    x, y = sensors.imu_x_m, sensors.imu_y_m
    omega, turn = motion.yaw_rate_rad_s, motion.yaw_acc_rad_s2
    zero = np.zeros_like(omega)
    # at the IMU's place on the turning machine, in a field of gravity that a slope tilts
    force_x = motion.specific_force_x_m_s2 - omega * omega * x - turn * y
    force_y = motion.specific_force_y_m_s2 - omega * omega * y + turn * x
    force_z = zero + terrain.gravity_m_s2 * np.cos(terrain.slope_rad)
    uphill = np.sin(terrain.slope_rad)
    pitch = np.arcsin(uphill * np.cos(motion.heading_rad))
    # on level ground 0, not -0
    roll = np.arctan2(0.0 - uphill * np.sin(motion.heading_rad), np.cos(terrain.slope_rad))
    acc = (sensors.acc_noise_m_s2, sensors.acc_lsb_m_s2)
    gyro = (sensors.gyro_noise_rad_s, sensors.gyro_lsb_rad_s)
    bias = sensors.gyro_bias_rad_s
    return {
        "specific_force_x_m_s2": _Signal(force_x + sensors.acc_bias_m_s2, *acc),
        "specific_force_y_m_s2": _Signal(force_y, *acc),
        "specific_force_z_m_s2": _Signal(force_z, *acc),
        "roll_rate_rad_s": _Signal(zero + bias, *gyro),
        "pitch_rate_rad_s": _Signal(zero + bias, *gyro),
        "yaw_rate_rad_s": _Signal(omega + bias, *gyro),
        "pitch_rad": _Signal(pitch, sensors.pitch_noise_rad, sensors.angle_lsb_rad),
        "roll_rad": _Signal(roll, sensors.roll_noise_rad, sensors.angle_lsb_rad),
    }


def _torque(scenario: Scenario, motion: Channels, streams: Streams) -> dict[str, _Signal]:
    """(17) and (18) backwards; the noise of the sides adds up to that of their sum."""
    sensors, machine = scenario.sensors, scenario.machine
    lever_m = machine.force_share * machine.wheel_radius_m
    force = motion.measured_force_x_N * lever_m / 2
    turning = motion.measured_torque_z_N_m * lever_m / machine.track_width_m
    signals: dict[str, _Signal] = {}
    for side, sign in (("left", -1.0), ("right", 1.0)):
        torque = sensors.force_gain * (force + sign * turning) + sensors.force_bias_N * lever_m / 2
        drift = streams.drift(
            f"torque_{side}_drift",
            sensors.force_drift_N * lever_m / math.sqrt(2),
            sensors.force_drift_s * sensors.rate_hz,
        )
        noise = sensors.force_noise_N * lever_m / math.sqrt(2)
        signals[f"torque_{side}_N_m"] = _Signal(torque + drift, noise, sensors.torque_lsb_N_m)
    return signals


def _speed(scenario: Scenario, motion: Channels) -> dict[str, _Signal]:
    """Each side's ground speed, and on it the slip that its force takes.

    Slip κ = (v_wheel - v) / |v| = F / C with the longitudinal slip stiffness C: the linear range of
    a tyre (Pacejka, Tire and Vehicle Dynamics, chapter 1).
    """
    sensors, machine = scenario.sensors, scenario.machine
    # the mean of both sides has the scenario's noise
    noise = sensors.speed_noise_m_s * math.sqrt(2)
    signals: dict[str, _Signal] = {}
    for side, sign in (("left", -1.0), ("right", 1.0)):
        speed = motion.speed_x_m_s + sign * motion.yaw_rate_rad_s * machine.track_width_m / 2
        if machine.slip_stiffness_N:
            force = motion.force_x_N / 2 + sign * motion.torque_z_N_m / machine.track_width_m
            speed = speed + np.abs(speed) * force / (machine.slip_stiffness_N / 2)
        signals[f"speed_{side}_m_s"] = _Signal(speed, noise, sensors.speed_lsb_m_s)
    return signals


def _dark(scenario: Scenario, streams: Streams, stamp_ns: NDArray[np.int64]) -> NDArray[np.bool_]:
    """Where nothing is recorded (n,): stretches that begin at any sample with one probability."""
    log = scenario.log
    if not log.blackout_every_s:
        return np.zeros(stamp_ns.shape, np.bool_)
    period_s = 1.0 / scenario.sensors.rate_hz
    begins = streams.uniform("blackout") < -math.expm1(-period_s / log.blackout_every_s)
    since = np.where(begins, stamp_ns, np.int64(-(2**62)))
    return stamp_ns - np.maximum.accumulate(since) < round(log.blackout_s * 1e9)

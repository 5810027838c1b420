"""What the instruments report of a motion: noise, delay, bias, and the recorder's latency.

Every channel of every run draws from its own stream of random numbers, so that one more run, load
or channel leaves all others as they were.
"""

import math
from dataclasses import dataclass
from typing import Final

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
)


@dataclass(frozen=True)
class Streams:
    """The random numbers of one log.

    Attributes:
        seed: of the scenario.
        load_index: which log of the campaign.
        run: (n,) the run that each sample belongs to, ascending; the rest after them is a run, too.
    """

    seed: int
    load_index: int
    run: NDArray[np.int64]

    def normal(self, stream: str, std: float) -> Floats:
        """White noise (n,) of standard deviation `std`."""
        return std * np.concatenate([g.standard_normal(n) for g, n in self._generators(stream)])

    def uniform(self, stream: str) -> Floats:
        """Numbers (n,) between 0 and 1."""
        return np.concatenate([g.random(n) for g, n in self._generators(stream)])

    def _generators(self, stream: str) -> list[tuple[np.random.Generator, int]]:
        runs, samples = np.unique(self.run, return_counts=True)
        number = _STREAMS.index(stream)
        return [
            (
                np.random.default_rng(
                    np.random.SeedSequence(self.seed, spawn_key=(self.load_index, int(run), number))
                ),
                int(count),
            )
            for run, count in zip(runs, samples, strict=True)
        ]


def measure(
    scenario: Scenario,
    streams: Streams,
    stamp_ns: NDArray[np.int64],
    now: Channels,
    delayed: Channels,
) -> dict[str, pl.DataFrame]:
    """Report a motion as the instruments would.

    Args:
        scenario: noise, bias, wheels and slope.
        streams: the random numbers of this log.
        stamp_ns: (n,) unix time of each measurement.
        now: the channels at these times.
        delayed: the channels that the torque sensors report then: `force_delay_s` older.

    Returns:
        `imu`, `torque` and `speed`: `header_stamp_ns`, `log_time_ns`, and columns with the names,
        units and signs of a machine file's channels (pitch positive nose-up).
    """
    frames: dict[str, pl.DataFrame] = {}
    for topic, signals in _signals(scenario, now, delayed).items():
        latency_s = scenario.log.latency_s + scenario.log.latency_jitter_s * streams.uniform(
            f"{topic}_latency"
        )
        frames[topic] = pl.DataFrame(
            {
                "header_stamp_ns": stamp_ns,
                "log_time_ns": stamp_ns + np.rint(latency_s * 1e9).astype(np.int64),
                **{
                    name: value + streams.normal(name, std)
                    for name, (value, std) in signals.items()
                },
            }
        )
    return frames


def _signals(
    scenario: Scenario, now: Channels, delayed: Channels
) -> dict[str, dict[str, tuple[Floats, float]]]:
    """Each topic's channels: what they would read without noise, and the noise."""
    sensors, machine, terrain = scenario.sensors, scenario.machine, scenario.terrain
    pitch = np.full(now.speed_x_m_s.shape, terrain.slope_rad)
    zero = np.zeros_like(pitch)
    # (17) for each side, which carries half; the noise of the sides adds up to that of their sum
    lever_m = machine.force_share * machine.wheel_radius_m
    torque = (
        delayed.measured_force_x_N * lever_m / 2,
        sensors.force_noise_N * lever_m / math.sqrt(2),
    )
    # the mean of both sides has the scenario's noise
    speed = (now.speed_x_m_s, sensors.speed_noise_m_s * math.sqrt(2))
    gravity_x = terrain.gravity_m_s2 * np.sin(pitch)
    gravity_z = terrain.gravity_m_s2 * np.cos(pitch)
    return {
        "imu": {
            "specific_force_x_m_s2": (
                now.acc_x_m_s2 + gravity_x + sensors.acc_bias_m_s2,
                sensors.acc_noise_m_s2,
            ),
            "specific_force_y_m_s2": (zero, sensors.acc_noise_m_s2),
            "specific_force_z_m_s2": (gravity_z, sensors.acc_noise_m_s2),
            "roll_rate_rad_s": (zero, sensors.gyro_noise_rad_s),
            "pitch_rate_rad_s": (zero, sensors.gyro_noise_rad_s),
            "yaw_rate_rad_s": (zero, sensors.gyro_noise_rad_s),
            "pitch_rad": (pitch, sensors.pitch_noise_rad),
        },
        "torque": {"torque_left_N_m": torque, "torque_right_N_m": torque},
        "speed": {"speed_left_m_s": speed, "speed_right_m_s": speed},
    }

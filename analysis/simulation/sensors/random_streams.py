"""Independent random streams of a scenario, one for each channel and trial."""

import math
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from estimators.arrays import Floats

#: Names of the streams; the index is the number of a stream: append, never insert.
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
    "imu_phase",
    "torque_phase",
    "speed_phase",
    "imu_stamp",
    "torque_stamp",
    "speed_stamp",
    "imu_swap",
    "torque_swap",
    "speed_swap",
    "vibration_in_phase",
    "vibration_in_quadrature",
    "start_throttle",
    "start_coulomb",
    "boom_rad",
    "bucket_rad",
    "boom_latency",
    "boom_dropout",
    "boom_phase",
    "boom_stamp",
    "boom_swap",
    "odometry_speed",
    "odometry_yaw",
    "odometry_latency",
    "odometry_dropout",
    "odometry_phase",
    "odometry_stamp",
    "odometry_swap",
    "gnss_north",
    "gnss_east",
    "gnss_latency",
    "gnss_dropout",
    "gnss_phase",
    "gnss_stamp",
    "gnss_swap",
    "shift_operator",
    "shift_load",
    "shift_carry_back",
    "shift_idle",
    "shift_recorder",
    "shift_damage",
    "shift_pour",
    "travel",
)


def make_random_generator(
    seed: int, load_index: int, trial_or_start: int, stream: str
) -> np.random.Generator:
    """Random generator of a stream in one trial, or at one start, of a log.

    Args:
        seed: seed of the scenario.
        load_index: index of the log in the campaign.
        trial_or_start: number of the trial or start.
        stream: name of the stream, one of `_STREAMS`.
    """
    key = (load_index, trial_or_start, _STREAMS.index(stream))
    return np.random.default_rng(np.random.SeedSequence(seed, spawn_key=key))


@dataclass(frozen=True)
class RandomStreams:
    """Random numbers for the samples of one topic.

    Attributes:
        seed: seed of the scenario.
        load_index: index of the log in the campaign.
        trial: (n,) trial of each sample, ascending; the rest at the end counts as a trial.
    """

    seed: int
    load_index: int
    trial: NDArray[np.int64]

    def draw_white_noise(self, stream: str, std: float) -> Floats:
        """White noise (n,) of standard deviation `std`."""
        return std * np.concatenate(
            [g.standard_normal(n) for g, n in self._make_generators_and_counts(stream)]
        )

    def draw_gauss_markov_drift(
        self, stream: str, std: float, correlation_samples: float
    ) -> Floats:
        """Stationary first-order Gauss-Markov process (n,), decaying in `correlation_samples`."""
        if not std:
            return np.zeros(self.trial.size)
        from scipy.signal import lfilter

        keeps = math.exp(-1.0 / correlation_samples)
        steps = self.draw_white_noise(stream, std)
        steps[1:] *= math.sqrt(1.0 - keeps * keeps)
        return lfilter([1.0], [1.0, -keeps], steps)

    def draw_uniform_0_to_1_per_sample(self, stream: str) -> Floats:
        """Uniform numbers (n,) between 0 and 1."""
        return np.concatenate([g.random(n) for g, n in self._make_generators_and_counts(stream)])

    def _make_generators_and_counts(self, stream: str) -> list[tuple[np.random.Generator, int]]:
        trials, samples = np.unique(self.trial, return_counts=True)
        return [
            (make_random_generator(self.seed, self.load_index, int(trial), stream), int(count))
            for trial, count in zip(trials, samples, strict=True)
        ]

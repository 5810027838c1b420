"""Hysteresis of the force: it reads less while it rises and more while it falls.

Pressures, motor currents, strain gauges and gears under load lag behind the force by a fixed amount
in either direction, whatever its rate: play (Visintin, Differential Models of Hysteresis, 1994). No
delay and no filter models this. The force rises at a start and falls at a coast, so that masses
come out too small: play of ± 1 % of the largest force made them 0.5 to 2 % too small, by up to five
of their uncertainties. The residual jumps where the force reverses, so that a log shows hysteresis.
"""

from typing import Final, NamedTuple

import numpy as np

from analysis.model.prior_settings import PriorSettings
from analysis.stages.signals.grid_rate import count_rows_in_duration
from analysis.weighing.motion_samples import ColumnNoiseModel, Floats, MotionSamples
from analysis.weighing.nuisances import Nuisance
from analysis.weighing.weighing_limits import LIMITS
from estimators.numerics.play import apply_play_hysteresis


def compute_hysteresis_half_loop_prior_std_newtons(
    motion: MotionSamples, priors: PriorSettings
) -> float:
    """Prior standard deviation of half the width of the hysteresis loop, in N."""
    return (
        priors.hysteresis_share or LIMITS.hysteresis_prior_share
    ) * motion.force_95_percentile_newtons


#: Added to a fit whose log shows hysteresis, or whose machine file expects it.
HYSTERESIS: Final = Nuisance(
    "hysteresis",
    "N",
    lambda m: -m.force_rises_1,
    compute_hysteresis_half_loop_prior_std_newtons,
    "a force that reads less while it rises and more while it falls: friction in the sensor, or "
    "between it and the wheels",
    "a force without hysteresis: wheel torque instead of pressure or current",
    # noise that makes the force appear to rise is also in the force itself
    by_force=lambda m: np.full(m.force.size, -m.rises_by_force_1_N),
)


class PlayHysteresis(NamedTuple):
    """Play and length of the mean by which a reversal of the force is distinguished from noise.

    Attributes:
        half_N: half of the change by which the force must go back for a reversal, in N.
        mean: number of samples of the mean whose noise is well below `half_N`.
        by_force_1_N: derivative of the direction with respect to a fitted mean of the force.
    """

    half_N: float
    mean: int
    by_force_1_N: float


def choose_hysteresis_width_and_mean_length(
    motion: MotionSamples, noise: ColumnNoiseModel, samples_per_mean: int
) -> PlayHysteresis:
    """Choose a play in proportion to the largest force, and the shortest mean with little noise.

    Args:
        motion: the samples.
        noise: noise of acceleration, speed and force.
        samples_per_mean: length of the fitted means.
    """
    longest = count_rows_in_duration(LIMITS.hysteresis_mean_s, motion.rate_hz)
    half_N = LIMITS.hysteresis_turn_share * motion.force_95_percentile_newtons
    noise_N, mean = 0.0, longest
    for mean in (*(1 << k for k in range(longest.bit_length() - 1)), longest):
        noise_N = LIMITS.hysteresis_turn_std * float(
            np.sqrt(noise.compute_covariance_of_means(mean)[2, 2])
        )
        if noise_N <= half_N:
            break
    half_N = max(half_N, noise_N)
    return PlayHysteresis(half_N, mean, min(samples_per_mean / mean, 1.0) / half_N)


def compute_sign_of_force_change(force: Floats, play: PlayHysteresis) -> Floats:
    """Sign of the change of the force, (n,): 1 rising, -1 falling, in between after a reversal."""
    before = play.mean // 2
    padded = np.pad(force, (before, play.mean - 1 - before), mode="edge")
    smooth = np.convolve(padded, np.full(play.mean, 1.0 / play.mean), "valid")
    return (smooth - apply_play_hysteresis(smooth, play.half_N)) / play.half_N

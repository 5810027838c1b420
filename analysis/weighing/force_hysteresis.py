"""Hysteresis of the force: it reads less while it rises and more while it falls.

Pressures, motor currents, strain gauges and gears under load lag behind the force by a fixed amount
in either direction, whatever its rate: play (Visintin, Differential Models of Hysteresis, 1994). No
delay and no filter describes that. A start rises to its force and a coast falls from it, so that
masses are too small: play of ± 1 % of the largest force made them 0.5 to 2 % too small, by up to
five of their uncertainties. The residual jumps wherever the force turns, so a log shows it plainly.
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
    """Prior standard deviation of half the loop, in N."""
    return (
        priors.hysteresis_share or LIMITS.hysteresis_prior_share
    ) * motion.force_95_percentile_newtons


#: Added to a fit whose log shows hysteresis, or whose machine file expects it.
HYSTERESIS: Final = Nuisance(
    "hysteresis",
    "N",
    lambda m: -m.force_rises_1,
    compute_hysteresis_half_loop_prior_std_newtons,
    "a force that reads less while it rises and more while it falls: friction in its sensor or "
    "behind it",
    "a force without hysteresis: a torque at the wheels instead of a pressure or a current",
    # noise that makes the force rise is in the force as well
    by_force=lambda m: np.full(m.force.size, -m.rises_by_force_1_N),
)


class PlayHysteresis(NamedTuple):
    """Width and mean length by which a turning force is distinguished from its noise.

    Attributes:
        half_N: half of the change after which the force has turned, in N.
        mean: samples of the mean that keeps the noise below it.
        by_force_1_N: derivative of the direction by a fitted mean of the force.
    """

    half_N: float
    mean: int
    by_force_1_N: float


def choose_hysteresis_width_and_mean_length(
    motion: MotionSamples, noise: ColumnNoiseModel, mean_samples: int
) -> PlayHysteresis:
    """Choose a share of the largest force, and the shortest mean whose noise is well below it.

    Args:
        motion: the samples.
        noise: noise of acceleration, speed and force.
        mean_samples: length of the fitted means.
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
    return PlayHysteresis(half_N, mean, min(mean_samples / mean, 1.0) / half_N)


def compute_sign_of_force_change(force: Floats, play: PlayHysteresis) -> Floats:
    """Whether the force (n,) rises (1), falls (-1) or has just turned (between), (n,)."""
    before = play.mean // 2
    padded = np.pad(force, (before, play.mean - 1 - before), mode="edge")
    smooth = np.convolve(padded, np.full(play.mean, 1.0 / play.mean), "valid")
    return (smooth - apply_play_hysteresis(smooth, play.half_N)) / play.half_N

"""Built-in limits of the motion in the plane, which no machine file can set."""

from dataclasses import dataclass
from typing import Final


@dataclass(frozen=True)
class PlanarLimits:
    """Built-in limits of the motion in the plane, which no machine file can set.

    One section per file; a comment says what a value limits, in which unit, and how it was chosen.
    """

    # centre_of_mass
    #: Fits of a motion: the terms' columns are made of the mass and moments of the round before.
    motion_fit_rounds: int = 2
    #: Farthest point that a machine may spin about, from the origin over half the track width. On
    #: the independent machines of `benchmarks/turning.py` the farthest was 0.3.
    spin_centre_max_1: float = 0.4

    # planar_budget
    #: Change of a quantity by a gain, as a fraction of it, below which the gain cancels in it,
    cancelled_gain_1: float = 1e-9
    #: and by a gain that changes with the load: an empty machine that is fitted 2 % too heavy.
    cancelled_load_gain_1: float = 0.02

    # planar_motion
    #: Quantile of a signal that a log reaches.
    reached_quantile: float = 0.95
    #: Smallest yaw rate that has a direction, in rad/s: ten times the noise of a gyroscope.
    turning_min_rad_s: float = 0.02
    #: Smallest speed that has one, in m/s: `phases.standstill_speed_m_s` by default.
    moving_min_m_s: float = 0.02
    #: Time in s over which the model's force and torque are averaged: what is in proportion to them
    #: is a few per cent of them, and shares the less of the accelerometer's noise.
    model_mean_s: float = 1.0

    # planar_terms
    #: Standard deviation of the distance from the origin to the point that a machine turns about,
    #: times that to its centre of mass, over half the track width squared: each 0.13 of half the
    #: track width on the independent machines of `benchmarks/turning.py`.
    spin_centre_moment_std_1: float = 0.017
    #: Standard deviation by which tyres and friction that differ from side to side change the
    #: difference of the sides' gains. On 33 machines of seeds 610000 to 612024 of
    #: `benchmarks/turning.py`, whose friction is not the model's, the fitted gain was off by 0.001
    #: in root mean square beside its own deviation.
    sides_gain_std_1: float = 0.0015


#: The values in use.
LIMITS: Final = PlanarLimits()

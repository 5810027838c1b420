"""Built-in limits of how a body moves on its springs, which no machine file can set."""

from dataclasses import dataclass
from typing import Final


@dataclass(frozen=True)
class BodyLimits:
    """Built-in limits of how a body moves on its springs, which no machine file can set.

    One section per file; a comment says what a value limits, in which unit, and how it was chosen.
    """

    # body_squat
    #: Length of a mean, in samples.
    squat_mean_samples: int = 10
    #: Fewest means of a stretch that is compared.
    squat_min_means: int = 10
    #: Fewest stretches with a load that differs, and without: fewer do not determine a gain.
    squat_min_stretches: int = 6
    #: Prior probability that a body squats with its load: one log in ten.
    squat_prior_probability: float = 0.1
    #: The same where the wheels show that it squats at all.
    squat_by_load_prior_probability: float = 0.5
    #: Standard deviation of a squat's growth with the mass, over proportional: springs stiffen.
    squat_growth_std: float = 0.5
    #: Standard deviations from which a change of gain by load shows something, a squat or grades.
    squat_by_load_min_std: float = 2.0
    #: What a squat leaves of the disagreement it explains, r.m.s.: squats left 0.3, grades 0.93.
    squat_residual_ratio: float = 0.7
    #: Log odds above which the choice is certain.
    squat_certain_log_odds: float = 50.0
    #: Prior standard deviation of the grade of a route, in m/s² of gravity along it: five per cent,
    grade_m_s2: float = 0.5
    #: and of its change over ten metres: two per cent.
    grade_change_m_s2: float = 0.2
    #: Parts of the route between which the grade changes linearly: 3 to 8 m, a machine's length.
    squat_grade_parts: int = 8

    # body_swing
    #: Differences over so much time tell the swing of a body from its grade: half a cycle at 2 Hz.
    lever_lag_s: float = 0.25
    #: Fewest means of a stretch.
    lever_min_rows: int = 30
    #: Slowest grid, in Hz, on which such springs are seen: ten samples a cycle.
    lever_min_rate_hz: float = 20.0
    #: Largest share of a quick start that an accelerometer below the axis does not read.
    lever_max_below_1: float = 0.8
    #: Smallest swing that matters: a hundredth of a start's acceleration that comes in 0.2 s.
    lever_min_s2: float = 0.0002
    #: Standard uncertainty of a swing over itself: axles, tyres and a mast are no single spring.
    lever_shape_u: float = 0.15
    #: Frequencies, in Hz, of bodies on springs and tyres that the search begins with,
    lever_frequencies_hz: tuple[float, ...] = (1.0, 1.4, 2.0, 2.8, 4.0)
    #: and their damping over the critical one.
    lever_dampings_1: tuple[float, float, float] = (0.2, 0.4, 0.8)
    #: Logarithms of frequency and damping are searched to this,
    lever_tolerance: float = 0.02
    #: from steps of so much.
    lever_step: float = 0.15

    # pitch_squat
    #: Distance in m from the start of a stretch over which the grade is a polynomial: half a hill.
    grade_reach_m: float = 8.0
    #: Degree of that polynomial.
    grade_degree: int = 3
    #: Half width of a rate of change, in means: 0.1 s at 100 Hz; springs swing faster than longer.
    pitch_rate_means: int = 3
    #: Fewest rows of a stretch beside four coefficients of the grade.
    pitch_min_rows: int = 20
    #: Smallest squat that matters, as a share of the acceleration,
    min_pitch_squat_fraction: float = 0.005
    #: and fewest stretches that separate it from hills.
    pitch_min_stretches: int = 6
    #: Standard deviations from which a squat by the pitch counts.
    pitch_squat_min_std: float = 3.5
    #: and of the pitch where the wheels show the same squat.
    shared_squat_min_std: float = 2.0
    #: Standard uncertainty of what a squat does to the accelerometer, over it: springs swing.
    spring_swing_u: float = 0.5


#: The values in use.
LIMITS: Final = BodyLimits()

"""Built-in limits of digging, phases and the quality of a fit, which no machine file can set."""

from dataclasses import dataclass
from typing import Final


@dataclass(frozen=True)
class StageLimits:
    """Built-in limits of digging, phases and the quality of a fit, which no machine file can set.

    One section per file; a comment says what a value limits, in which unit, and how it was chosen.
    """

    # digging
    #: Smallest growth of a resistance over one start that is a pile, as a fraction of the force
    #: that the log drives with,
    pile_min_growth_fraction: float = 0.2
    #: and in its standard deviations.
    pile_min_growth_std: float = 4.0
    #: Fractions of a start after which the growth may begin.
    pile_contact_fractions: tuple[float, ...] = (0.0, 0.15, 0.3, 0.45, 0.6)
    #: Quantile of a signal that it reaches.
    reached_quantile: float = 0.95
    #: Pause in s up to which driving is one start.
    start_pause_s: float = 0.25
    #: Fraction of what the log drives with above which the force of a machine that slows down still
    #: drives against something; brakes come with the throttle shut.
    slowing_drive_fraction: float = 0.4
    #: Longest start in s: a machine that drives for longer is on its way somewhere.
    start_max_s: float = 15.0
    #: Fewest samples of a start,
    start_min_samples: int = 60
    #: and its shortest duration in s: no bucket fills in less.
    start_min_s: float = 1.2
    #: Largest growth of a start that digs, as a fraction of the force that the log drives with:
    #: only the machine's momentum lets a resistance grow by more than that force. Piles that stop a
    #: fast machine reach 2.1.
    pile_max_growth_fraction: float = 2.5
    #: For each start that may dig, so many whose resistance falls as surely, grows the other way,
    #: or after which the machine drives on: then resistances change by themselves, and none is a
    #: pile. In shifts with a pile there was not one such start; cars, carts, racks and arms have
    #: about one each.
    pile_contradiction_fraction: float = 0.34
    #: Highest speed in m/s at a pile: loaders come with 4 at most.
    pile_max_speed_m_s: float = 8.0
    #: Mass of machine and load over the empty machine's, as a prior mean,
    digging_mass_ratio: float = 1.1
    #: and its standard deviation, over the empty machine's mass.
    digging_mass_std_1: float = 0.15
    #: Standard deviation of friction at full speed, over the driving force: it may take nearly all.
    digging_friction_std_1: float = 1.0
    #: Factor of it by which there is no friction.
    no_friction_ratio: float = 1e-6
    #: Standard deviation of a constant force, likewise.
    digging_constant_std_1: float = 0.3
    #: Noise and what the model misses, as a fraction of that force,
    digging_misfit_fraction: float = 0.015
    #: and the samples that it lasts.
    digging_misfit_samples: float = 10.0

    # phases
    #: Time in s over which a stop takes off more speed than its noise; a cruise before it does not.
    stop_span_s: float = 1.0
    #: Gravity along the motion, less the speed rate, from which a descent is one: 3 % of grade.
    #: Rolling resistance is mostly less, and a tilted accelerometer mostly shows less.
    descent_min_m_s2: float = 0.3
    #: Force along the motion up to which the drive is idle, as a fraction of the driving force,
    idle_force_1: float = 0.1
    #: which is this quantile of all forces.
    driving_force_quantile: float = 0.95
    #: Standard deviations from which a fall of the speed is no noise: of 10 000 rows of a cruise a
    #: few fall so by chance.
    fall_min_std: float = 3.0

    # fit_quality
    #: Fewest samples of a fit that decides something, over its parameters.
    samples_per_parameter: int = 10
    #: Fraction of what varies down to which noise is taken off it: a variance is not known better.
    min_variance_fraction: float = 0.1
    #: Fraction of the 95 % quantile of forces that drive below which offset, losses and hysteresis
    #: decide a force's sign: torque sensors and drivelines have 1 to 5 % of them.
    signed_force_fraction: float = 0.15
    #: Fraction of the variance of what drives from which on a model that leaves it says nothing of
    #: braking.
    explained_variance_fraction: float = 0.5
    #: Fraction of braking with a force of clear sign up to which no sensor sees the brakes: a drive
    #: that lets go as they grip still pushes for a third of it.
    signed_braking_fraction: float = 0.5


#: The values in use.
LIMITS: Final = StageLimits()

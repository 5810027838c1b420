"""Terms of a gearbox: in low gears more rotating mass is accelerated.

An engine that turns i times as fast as the wheels adds to the mass with i². A driver shifts up with
the speed, so that i is about the inverse of the speed, and what a gear has beyond the top one falls
faster than with its square. What turns in the top gear no log tells from the mass
(`machine.rotating_mass_kg`).
"""

from typing import Final

import numpy as np

from analysis.model.prior_settings import PriorSettings
from analysis.weighing.motion_samples import Floats, MotionSamples
from analysis.weighing.nuisances import ColumnInputs, Nuisance
from analysis.weighing.weighing_limits import LIMITS

#: What all of it is in the budget.
BY_GEAR: Final = "gears"


def compute_low_gear_mass_fraction(speed: Floats, quarter_speed_m_s: float) -> Floats:
    """Fraction of the first gear's rotating mass at each speed, (n,)."""
    return (1.0 + (speed / quarter_speed_m_s) ** 2) ** -2


def differentiate_low_gear_mass_fraction_s_m(speed: Floats, quarter_speed_m_s: float) -> Floats:
    """Derivative of the remaining gear inertia by the speed, (n,) in s/m."""
    return -4.0 * speed / quarter_speed_m_s**2 * (1.0 + (speed / quarter_speed_m_s) ** 2) ** -3


def _do_speeds_span_several_gears(motion: MotionSamples) -> bool:
    """Whether speeds reach from that of a first gear to that of a road."""
    if motion.speed_95_percent <= LIMITS.road_speed_m_s:
        return False
    slow = np.abs(motion.speed[motion.is_fittable]) < LIMITS.first_gear_m_s
    return float(slow.mean()) > LIMITS.first_gear_min_fraction


def _low_gear_prior_std(motion: MotionSamples, priors: PriorSettings) -> float:
    return priors.low_gear_share * motion.approximate_mass_kg


def _make_low_gear_term(quarter_speed_m_s: float) -> Nuisance:
    def fraction_in_low_gear(m: ColumnInputs) -> Floats:
        return compute_low_gear_mass_fraction(m.speed, quarter_speed_m_s)

    return Nuisance(
        f"low_gears_{quarter_speed_m_s:.0f}_m_s",
        "kg",
        lambda m: m.acceleration * fraction_in_low_gear(m),
        _low_gear_prior_std,
        "rotating mass of low gears, which falls with the speed",
        "starts at different throttles; driving without a change of gear",
        by_speed=lambda m: (
            m.acceleration * differentiate_low_gear_mass_fraction_s_m(m.speed, quarter_speed_m_s)
        ),
        by_acceleration=fraction_in_low_gear,
        applies=_do_speeds_span_several_gears,
        source=BY_GEAR,
    )


#: Behind the nuisances that every log may have.
LOW_GEARS: Final = tuple(map(_make_low_gear_term, LIMITS.gear_quarter_speeds_m_s))

"""Terms of a gearbox: in low gears more rotating mass is accelerated.

An engine that turns i times as fast as the wheels adds inertia in proportion to i². If the ratio is
measured, this is one term, and the mass excludes it in every gear. Otherwise a driver is assumed to
shift up with the speed, so that i is roughly inverse to the speed, and the inertia of a gear in
excess of the top gear falls faster than with the square of the speed. The inertia in the top gear
cannot then be separated from the mass (`machine.rotating_mass_kg`).
"""

from collections.abc import Sequence
from dataclasses import replace
from typing import Final

import numpy as np

from analysis.model.prior_settings import PriorSettings
from analysis.weighing.column_inputs import ColumnInputs
from analysis.weighing.motion_samples import Floats, MotionSamples
from analysis.weighing.nuisances import (
    Nuisance,
)
from analysis.weighing.weighing_limits import LIMITS

#: Budget entry that combines these terms.
BY_GEAR: Final = "gears"


def compute_fraction_of_first_gear_rotating_mass(
    speed: Floats, speed_of_quarter_fraction_m_s: float
) -> Floats:
    """Fraction of the first gear's rotating mass at each speed, (n,)."""
    return (1.0 + (speed / speed_of_quarter_fraction_m_s) ** 2) ** -2


def differentiate_rotating_mass_fraction_by_speed_s_m(
    speed: Floats, speed_of_quarter_fraction_m_s: float
) -> Floats:
    """Slope of `compute_fraction_of_first_gear_rotating_mass` over speed, (n,) in s/m."""
    return (
        -4.0
        * speed
        / speed_of_quarter_fraction_m_s**2
        * (1.0 + (speed / speed_of_quarter_fraction_m_s) ** 2) ** -3
    )


def do_speeds_span_several_gears(motion: MotionSamples) -> bool:
    """Whether speeds range from first gear to road speed, and no gear ratio is measured."""
    if has_several_gear_ratios(motion) or motion.speed_95_percentile_m_s <= LIMITS.road_speed_m_s:
        return False
    slow = np.abs(motion.speed[motion.is_fittable]) < LIMITS.first_gear_m_s
    return float(slow.mean()) > LIMITS.first_gear_min_fraction


def has_several_gear_ratios(motion: MotionSamples) -> bool:
    """Whether the measured gear ratio varies enough to determine the rotating mass."""
    ratio = motion.relative_gear_ratio
    if ratio is None or not motion.is_fittable.any():
        return False
    return float(ratio[motion.is_fittable].min()) < LIMITS.gear_ratio_min_change


def _compute_low_gear_prior_std_kg(motion: MotionSamples, priors: PriorSettings) -> float:
    return priors.low_gear_share * motion.approximate_mass_kg


def _make_low_gear_term(speed_of_quarter_fraction_m_s: float) -> Nuisance:
    def fraction_in_low_gear(m: ColumnInputs) -> Floats:
        return compute_fraction_of_first_gear_rotating_mass(m.speed, speed_of_quarter_fraction_m_s)

    return Nuisance(
        f"low_gears_{speed_of_quarter_fraction_m_s:.0f}_m_s",
        "kg",
        lambda m: m.acceleration * fraction_in_low_gear(m),
        _compute_low_gear_prior_std_kg,
        "rotating mass of low gears, which falls with the speed",
        "starts at different throttles; driving without a change of gear",
        by_speed=lambda m: (
            m.acceleration
            * differentiate_rotating_mass_fraction_by_speed_s_m(
                m.speed, speed_of_quarter_fraction_m_s
            )
        ),
        by_acceleration=fraction_in_low_gear,
        applies=do_speeds_span_several_gears,
        source=BY_GEAR,
    )


#: Where the gear ratio is measured: rotating mass in the lowest gear.
BY_GEAR_RATIO: Final = Nuisance(
    "gear_ratio",
    "kg",
    lambda m: m.acceleration * m.relative_gear_ratio**2,
    lambda motion, priors: (
        LIMITS.gear_ratio_prior_ratio * _compute_low_gear_prior_std_kg(motion, priors)
    ),
    "rotating mass of engine or turbine in the lowest gear, proportional to the squared ratio",
    "starts in several gears",
    by_acceleration=lambda m: m.relative_gear_ratio**2,
    applies=has_several_gear_ratios,
    source=BY_GEAR,
)
#: Added after the nuisances that every log may have.
LOW_GEARS: Final = (*map(_make_low_gear_term, LIMITS.gear_quarter_speeds_m_s), BY_GEAR_RATIO)


def subtract_gear_inertia(
    motion: MotionSamples, terms: Sequence[Nuisance], estimates: Floats
) -> MotionSamples:
    """Copy of the motion without the force that accelerates the rotating mass of the gears.

    Args:
        motion: samples of a fit.
        terms: nuisances of the fit.
        estimates: (terms,) estimates of the nuisances.
    """
    ratio = motion.relative_gear_ratio
    if ratio is None or BY_GEAR_RATIO not in terms:
        return motion
    rotating_kg = float(estimates[terms.index(BY_GEAR_RATIO)]) * ratio**2
    return replace(motion, force=motion.force - rotating_kg * motion.acceleration)

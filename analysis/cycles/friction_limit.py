"""When friction reaches a limit: the trend of daily values, and the day as an interval.

A line through the days, each weighted by its own variance; where days scatter by more than that,
their scatter counts. The day at which the line reaches the limit is a ratio of two estimates, and
its interval is Fieller's (J. Royal Statistical Society B 16, 1954): all days for which the limit is
inside the line's own interval. Where the slope may be zero it has no end, and nothing is said.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from scipy.stats import t as student

from analysis.cycles.cycle_limits import LIMITS


class FrictionDay(NamedTuple):
    """The friction of a shift.

    Attributes:
        at_d: in the middle of it, in days since any instant.
        friction_N_s_m: viscous friction by its joint fit.
        std_N_s_m: its standard deviation.
    """

    at_d: float
    friction_N_s_m: float
    std_N_s_m: float


class FrictionTrend(NamedTuple):
    """The trend of friction, and when it reaches the limit.

    Attributes:
        limit_N_s_m: that was asked for.
        slope_N_s_m_d: change a day.
        slope_u_N_s_m_d: its standard uncertainty.
        now_N_s_m: of the line at the last shift.
        reached_d: 95 % interval of the day at which it reaches the limit, on the days' clock; None
            where it cannot be said.
        why_not: why it cannot be said; empty where it can.
    """

    limit_N_s_m: float
    slope_N_s_m_d: float | None
    slope_u_N_s_m_d: float | None
    now_N_s_m: float | None
    reached_d: tuple[float, float] | None
    why_not: str


def friction_trend(days: Sequence[FrictionDay], limit_N_s_m: float) -> FrictionTrend:
    """Fit the trend, and date the limit.

    Args:
        days: one of each shift of one machine, in any order.
        limit_N_s_m: upper limit of the friction.
    """
    n = len(days)
    if n < LIMITS.friction_min_days or np.ptp([day.at_d for day in days]) == 0.0:
        why = f"{n} of at least {LIMITS.friction_min_days} shifts on different days"
        return FrictionTrend(limit_N_s_m, None, None, None, None, why)
    at, friction, std = np.array(days).T
    weight = std**-2.0
    middle, mean = np.average(at, weights=weight), np.average(friction, weights=weight)
    squares = float(weight @ (at - middle) ** 2)
    slope = float(weight @ ((at - middle) * (friction - mean))) / squares
    left = friction - mean - slope * (at - middle)
    wider = max(float(weight @ left**2) / (n - 2), 1.0)
    mean_var, slope_var = wider / float(weight.sum()), wider / squares
    k2 = float(student.ppf(0.975, n - 2)) ** 2
    room = limit_N_s_m - mean
    now = float(mean + slope * (at.max() - middle))
    trend = FrictionTrend(limit_N_s_m, slope, float(np.sqrt(slope_var)), now, None, "")
    sure = slope**2 - k2 * slope_var
    if sure <= 0.0:
        return trend._replace(why_not="no trend beyond its uncertainty")
    if slope < 0.0:
        return trend._replace(why_not="friction falls")
    root = float(np.sqrt((room * slope) ** 2 - sure * (room**2 - k2 * mean_var)))
    low, high = ((room * slope - root) / sure, (room * slope + root) / sure)
    return trend._replace(reached_d=(float(middle + low), float(middle + high)))

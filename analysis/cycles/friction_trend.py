"""Friction over a shift and over days with known masses, as a sign of wear or a cold start.

Masses and the other terms of the joint fit are those of the whole shift; only the viscous friction
is fitted to each part of it. So the parts can be compared with each other: errors that they have in
common (a lag, slip) are not in their standard deviations.

A line through the days, each weighted by its variance, predicts when friction reaches a limit; if
the days scatter by more than that, their scatter is used. The day at which the line reaches the
limit is a ratio of two estimates, and its interval is Fieller's (J. Royal Statistical Society B 16,
1954): all days for which the limit is inside the interval of the line. If the slope may be zero,
the interval is unbounded and no day is predicted.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
import polars as pl
from scipy.stats import t as student

from analysis.cycles.cycle_limits import LIMITS
from analysis.model.axes import X, make_regressor_and_force
from analysis.model.physical_units import NS_PER_S
from analysis.model.settings import Settings
from analysis.weighing.load_states import compute_weighted_mean_mass_by_state_kg
from estimators.arrays import Floats


class FrictionDay(NamedTuple):
    """The friction of a shift.

    Attributes:
        at_d: middle of the shift, in days since any epoch.
        friction_N_s_m: viscous friction by the joint fit.
        std_N_s_m: standard deviation of the friction.
    """

    at_d: float
    friction_N_s_m: float
    std_N_s_m: float


class FrictionTrend(NamedTuple):
    """Trend of friction, and the day on which it reaches a limit.

    Attributes:
        limit_N_s_m: upper limit of the friction.
        slope_N_s_m_d: change per day.
        slope_u_N_s_m_d: standard uncertainty of the slope.
        now_N_s_m: friction by the line at the last shift.
        reached_d: 95 % interval of the day on which the limit is reached, since the epoch of
            `FrictionDay.at_d`; None if unknown.
        why_not: reason why `reached_d` is unknown; else "".
    """

    limit_N_s_m: float
    slope_N_s_m_d: float | None
    slope_u_N_s_m_d: float | None
    now_N_s_m: float | None
    reached_d: tuple[float, float] | None
    why_not: str


class FrictionPart(NamedTuple):
    """A part of a shift.

    Attributes:
        start_s: start, in s since the first sample.
        end_s: end, in s since the first sample.
        manoeuvres: number of manoeuvres.
        friction_N_s_m: viscous friction.
        std_N_s_m: its standard deviation, from the differences between manoeuvres.
    """

    start_s: float
    end_s: float
    manoeuvres: int
    friction_N_s_m: float
    std_N_s_m: float


def fit_viscous_friction_by_shift_part(
    excitation: pl.DataFrame, manoeuvres: pl.DataFrame, nuisances: pl.DataFrame, settings: Settings
) -> tuple[FrictionPart, ...]:
    """Fit the viscous friction b in F - m·a - constants = b·v, for each part of a shift.

    Args:
        excitation: frame with force, regressor, speed and phase.
        manoeuvres: frame with load states and masses.
        nuisances: frame of the joint fit with constant, Coulomb friction, quadratic resistance and
            slip.
        settings: settings of the regressor.

    Returns:
        Parts with enough manoeuvres, in order of time; none without a mass.
    """
    if manoeuvres.is_empty() or manoeuvres["mass_kg"].null_count() or nuisances.is_empty():
        return ()
    crossed, squared = sum_speed_force_products_by_start(
        excitation, manoeuvres, nuisances, settings
    )
    t_ns = excitation["t_ns"].to_numpy()
    middle = (manoeuvres["start_t_ns"] + manoeuvres["end_t_ns"]).to_numpy() / 2.0
    since_s = (middle - t_ns[0]) / NS_PER_S
    whole_s = float(t_ns[-1] - t_ns[0]) / NS_PER_S
    length_s = float(
        np.clip(
            whole_s / LIMITS.friction_parts,
            LIMITS.shortest_friction_part_s,
            LIMITS.longest_friction_part_s,
        )
    )
    found: list[FrictionPart] = []
    for number in range(int(np.ceil(whole_s / length_s))):
        begin, end = number * length_s, min((number + 1) * length_s, whole_s)
        inside = (since_s >= begin) & (since_s < end) & (squared > 0.0)
        count = int(inside.sum())
        if count < LIMITS.friction_min_manoeuvres:
            continue
        friction = float(crossed[inside].sum() / squared[inside].sum())
        # errors of samples of one manoeuvre are correlated
        apart = crossed[inside] - friction * squared[inside]
        variance = float(apart @ apart) / float(squared[inside].sum()) ** 2 * count / (count - 1)
        found.append(FrictionPart(begin, end, count, friction, float(np.sqrt(variance))))
    return tuple(found)


def sum_speed_force_products_by_start(
    excitation: pl.DataFrame, manoeuvres: pl.DataFrame, nuisances: pl.DataFrame, settings: Settings
) -> tuple[Floats, Floats]:
    """Sums of v times the force left for viscous friction, and of v², (manoeuvres,) each."""
    A, force = make_regressor_and_force(X, excitation, settings)
    acceleration, speed = A[:, 0], A[:, 1]
    by_term: dict[str, float] = dict(nuisances.select("term", "posterior").iter_rows())
    way = np.sign(speed)
    rest = (
        force
        - by_term.get("const", 0.0)
        - by_term.get("direction", 0.0) * way
        - by_term.get("quadratic", 0.0) * speed * np.abs(speed)
        - by_term.get("slip", 0.0) * np.abs(speed) * force
    )
    driving = excitation["phase"].is_in(["accelerating", "cruising"]).fill_null(False).to_numpy()
    driving &= np.isfinite(rest) & np.isfinite(acceleration) & np.isfinite(speed)
    mass_kg = look_up_state_mass_of_manoeuvres_kg(manoeuvres)
    t_ns = excitation["t_ns"].to_numpy()
    spans = manoeuvres.select("start_t_ns", "end_t_ns").iter_rows()
    crossed, squared = np.zeros(mass_kg.size), np.zeros(mass_kg.size)
    for number, (start, end) in enumerate(spans):
        first, last = np.searchsorted(t_ns, [start, end])
        rows = first + np.flatnonzero(driving[first : last + 1])
        left = rest[rows] - mass_kg[number] * acceleration[rows]
        crossed[number] = speed[rows] @ left
        squared[number] = speed[rows] @ speed[rows]
    return crossed, squared


def look_up_state_mass_of_manoeuvres_kg(manoeuvres: pl.DataFrame) -> Floats:
    """Mass of the load state of each manoeuvre, (manoeuvres,)."""
    state = manoeuvres["load_id"].to_numpy()
    weight = manoeuvres["mass_std_kg"].to_numpy() ** -2.0
    return compute_weighted_mean_mass_by_state_kg(manoeuvres["mass_kg"].to_numpy(), weight, state)[
        state
    ]


def fit_daily_friction_trend(
    daily_friction: Sequence[FrictionDay], limit_N_s_m: float
) -> FrictionTrend:
    """Fit a line to the daily friction, and estimate the day on which it reaches the limit.

    Args:
        daily_friction: friction of each shift of a machine, in any order.
        limit_N_s_m: upper limit of the friction.
    """
    n = len(daily_friction)
    if n < LIMITS.friction_min_days or np.ptp([day.at_d for day in daily_friction]) == 0.0:
        why = f"{n} of at least {LIMITS.friction_min_days} shifts on different days"
        return FrictionTrend(limit_N_s_m, None, None, None, None, why)
    at, friction, std = np.array(daily_friction).T
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

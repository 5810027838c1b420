"""When the friction of each machine of a fleet reaches a limit, from its recordings' joint fits."""

import polars as pl

from analysis.cycles.friction_limit import FrictionDay, FrictionTrend, friction_trend
from analysis.fleet.daily_figures import UNDATED

#: Nanoseconds of a day.
_DAY_NS = 86_400 * 10**9


def fleet_friction_trends(results: pl.DataFrame, limit_N_s_m: float) -> dict[str, FrictionTrend]:
    """The trend of each machine.

    Args:
        results: table `results`.
        limit_N_s_m: upper limit of viscous friction.
    """
    known = results.filter(
        pl.col("day") != UNDATED, pl.col("friction_x_N_s_m").is_not_null()
    ).filter(pl.col("friction_x_std_N_s_m") > 0.0)
    days: dict[str, list[FrictionDay]] = {
        machine: [] for machine in sorted(results["machine"].unique())
    }
    columns = ("machine", "t0_unix_ns", "friction_x_N_s_m", "friction_x_std_N_s_m")
    for machine, begin_ns, friction, std in known.select(columns).iter_rows():
        days[machine].append(FrictionDay(begin_ns / _DAY_NS, friction, std))
    return {machine: friction_trend(each, limit_N_s_m) for machine, each in days.items()}

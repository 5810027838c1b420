"""Drift of machines: charts of zero, scale and friction between successive calibrations.

Daily values are charted from the first one on, by a self-starting CUSUM. A machine's zero and its
scatter are not known in advance, and with an estimate from the first month every limit would have
the error of that estimate. So each value is compared with those before it: without drift,
T = √((n-1)/n) (x_n - mean) / s is Student's t with n-2 degrees of freedom, whatever mean and
standard deviation are, and U = Φ⁻¹(F(T)) is standard normal and independent of the earlier ones
(Hawkins, J. Quality Technology 19, 1987). The CUSUM of U (Page, Biometrika 41, 1954) has the
average run length of a CUSUM with known baseline, which a Markov chain gives (Brook and Evans,
Biometrika 59, 1972): the limit follows from the accepted rate of false alarms.
"""

import datetime as dt
from functools import cache
from typing import Final, NamedTuple

import numpy as np
import polars as pl
from scipy.special import ndtr, ndtri, stdtr

from analysis.fleet.fleet_limits import LIMITS
from estimators.arrays import Floats

#: Days in a year.
_DAYS: Final = 365.0


class ControlChart(NamedTuple):
    """Control chart of n values.

    Attributes:
        innovation: (n,) U of each value, standard normal without drift; 0 for the first values.
        cusum_up: (n,) CUSUM of increases.
        cusum_down: (n,) CUSUM of decreases.
        limit: limit of both sums.
        flagged_index: index of the first value beyond the limit; None if there is none.
        first_shifted_index: index of the first value of the flagged stretch.
        change: mean from `first_shifted_index` on minus mean before; NaN if nothing is flagged.
        change_std: standard deviation of `change`; NaN if nothing is flagged.
    """

    innovation: Floats
    cusum_up: Floats
    cusum_down: Floats
    limit: float
    flagged_index: int | None
    first_shifted_index: int | None
    change: float
    change_std: float


class ChartedQuantity(NamedTuple):
    """Quantity with a control chart.

    Attributes:
        name: name of the quantity.
        column: its column in the frame of days.
        logarithm: whether changes are relative, as for friction.
        unit: unit of changes.
        means: meaning of a change.
    """

    name: str
    column: str
    logarithm: bool
    unit: str
    means: str


SIGNALS: Final = (
    ChartedQuantity("zero", "zero_kg", False, "kg", "mean mass of the empty passes"),
    ChartedQuantity(
        "scale", "load_kg", True, "%", "mean payload: a gain, or another habit, bucket or material"
    ),
    ChartedQuantity(
        "friction", "friction_N_s_m", True, "%", "viscous friction by the joint fits: wear"
    ),
)


class MachineChart(NamedTuple):
    """Control chart of one machine between two calibrations.

    Attributes:
        machine: name of the machine.
        signal: charted quantity.
        calibration: id of the evidence in use ("" for none).
        days: (n,) days of the values.
        values: (n,) values, untransformed.
        chart: control chart of the values.
    """

    machine: str
    signal: ChartedQuantity
    calibration: str
    days: tuple[dt.date, ...]
    values: tuple[float, ...]
    chart: ControlChart

    @property
    def flagged_change_in_unit(self) -> float:
        """Change at the flagged stretch, in the quantity's unit; NaN if nothing is flagged."""
        change = self.chart.change
        return float(np.expm1(change) * 100.0) if self.signal.logarithm else change

    @property
    def flagged_change_std_in_unit(self) -> float:
        """Standard deviation of `flagged_change_in_unit`."""
        std = self.chart.change_std
        return std * (100.0 + self.flagged_change_in_unit) if self.signal.logarithm else std


def compute_cusum_limit_of_fleet() -> float:
    """Limit of each chart that allows half a false alarm per machine and year in total."""
    return find_cusum_limit(len(SIGNALS) * _DAYS / LIMITS.false_alarms_per_year)


def make_machine_charts(days: pl.DataFrame) -> list[MachineChart]:
    """Control charts by machine, quantity and calibration; each starts a new baseline.

    Args:
        days: frame by `summarise_results_by_day`.
    """
    limit = compute_cusum_limit_of_fleet()
    found: list[MachineChart] = []
    for _, rows in days.group_by("machine", maintain_order=True):
        parts = rows.with_columns(part=pl.col("calibration").rle_id())
        for _, part in parts.group_by("part", maintain_order=True):
            found += [
                make_machine_chart_of_quantity(part.drop_nulls(signal.column), signal, limit)
                for signal in SIGNALS
                if part[signal.column].count() > 0
            ]
    return found


def make_machine_chart_of_quantity(
    days: pl.DataFrame, quantity: ChartedQuantity, cusum_limit: float
) -> MachineChart:
    """Chart of one quantity of a machine between two calibrations."""
    values = days[quantity.column].to_numpy()
    if quantity.logarithm:
        # values that are not positive have no relative change
        kept = values > 0.0
        days, values = days.filter(pl.Series(kept)), np.log(values[kept])
    raw = np.exp(values) if quantity.logarithm else values
    return MachineChart(
        str(days["machine"].first()),
        quantity,
        str(days["calibration"].first()),
        tuple(days["day"].to_list()),
        tuple(float(value) for value in raw),
        make_control_chart(values, cusum_limit),
    )


def make_control_chart(values: Floats, cusum_limit: float) -> ControlChart:
    """Control chart of a series of values.

    Args:
        values: (n,) values in order of time, without NaN.
        cusum_limit: limit of the sums, from `find_cusum_limit`.
    """
    innovation = standardise_innovations(remove_lag_1_correlation(values))
    up, down = np.zeros(values.size), np.zeros(values.size)
    flagged: int | None = None
    starts = [0, 0]
    since: int | None = None
    high = low = 0.0
    for n, u in enumerate(innovation):
        starts = [n if high == 0.0 else starts[0], n if low == 0.0 else starts[1]]
        high, low = (
            max(high + u - LIMITS.cusum_allowance_std, 0.0),
            max(low - u - LIMITS.cusum_allowance_std, 0.0),
        )
        up[n], down[n] = high, low
        if flagged is None and max(high, low) > cusum_limit:
            flagged, since = n, starts[0 if high > low else 1]
    change, std = estimate_mean_change_and_std_at_row(values, since)
    return ControlChart(innovation, up, down, cusum_limit, flagged, since, change, std)


def remove_lag_1_correlation(values: Floats) -> Floats:
    """Part (n,) of each value that the previous value does not predict.

    The correlation is estimated from differences over one and two values, as E2 / E1 - 1 of a
    first-order process, which a drift increases less than the correlation of the values.
    """
    if values.size < LIMITS.correlation_min_values:
        return values
    one, two = (float(np.mean((values[k:] - values[:-k]) ** 2)) for k in (1, 2))
    alike = float(np.clip(two / one - 1.0, 0.0, LIMITS.max_correlation)) if one > 0.0 else 0.0
    before = np.concatenate([values[:1], values[:-1]])
    return values - alike * before


def standardise_innovations(values: Floats) -> Floats:
    """Innovation (n,) of each value, standard normal without drift."""
    found = np.zeros(values.size)
    if values.size < LIMITS.deviation_min_values:
        return found
    # relative to the first value, so that squares keep their digits
    offset = values - values[0]
    number = np.arange(values.size, dtype=float)
    sums, squares = np.cumsum(offset), np.cumsum(offset**2)
    n = number[LIMITS.deviation_min_values - 1 :]
    mean = sums[LIMITS.deviation_min_values - 2 : -1] / n
    variance = np.maximum(squares[LIMITS.deviation_min_values - 2 : -1] - n * mean**2, 0.0) / (
        n - 1.0
    )
    apart = offset[LIMITS.deviation_min_values - 1 :] - mean
    with np.errstate(divide="ignore", invalid="ignore"):
        t = np.sqrt(n / (n + 1.0)) * apart / np.sqrt(variance)
    t = np.where(np.isnan(t), 0.0, t)
    # computed from the nearer tail, which keeps its digits
    tail = ndtri(stdtr(n - 1.0, -np.abs(t)))
    found[LIMITS.deviation_min_values - 1 :] = np.clip(
        np.where(t > 0, -tail, tail), -LIMITS.cusum_max_std, LIMITS.cusum_max_std
    )
    return found


def estimate_mean_change_and_std_at_row(
    values: Floats, change_row: int | None
) -> tuple[float, float]:
    """Change of the mean of the values (n,) at a row, and its standard deviation."""
    if change_row is None or change_row < 2 or values.size - change_row < 2:
        return float("nan"), float("nan")
    before, after = values[:change_row], values[change_row:]
    variance = before.var(ddof=1) / before.size + after.var(ddof=1) / after.size
    return float(after.mean() - before.mean()), float(np.sqrt(variance))


@cache
def find_cusum_limit(average_run_length: float) -> float:
    """CUSUM limit in standard deviations, for `average_run_length` values between false alarms.

    Args:
        average_run_length: average run length of both sums together, without drift.
    """
    low, high = 0.5, 40.0
    # either sum alone has twice the run length
    while high - low > 1e-3:
        middle = (low + high) / 2.0
        low, high = (
            (middle, high)
            if compute_cusum_average_run_length(middle) < 2.0 * average_run_length
            else (low, middle)
        )
    return (low + high) / 2.0


def compute_cusum_average_run_length(cusum_limit: float, mean_shift: float = 0.0) -> float:
    """Average run length of one CUSUM from 0, for normal values.

    Args:
        cusum_limit: limit of the sum.
        mean_shift: mean of the values, in standard deviations.
    """
    width = 2.0 * cusum_limit / (2 * LIMITS.cusum_states - 1)
    middle = np.arange(LIMITS.cusum_states) * width
    # transition from one state to another, by a value minus the allowance
    to = middle[np.newaxis, :] - middle[:, np.newaxis] + LIMITS.cusum_allowance_std - mean_shift
    chance = ndtr(to + width / 2.0) - ndtr(to - width / 2.0)
    chance[:, 0] = ndtr(to[:, 0] + width / 2.0)
    return float(
        np.linalg.solve(np.eye(LIMITS.cusum_states) - chance, np.ones(LIMITS.cusum_states))[0]
    )

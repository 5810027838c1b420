"""Which machines drift: charts of zero, scale and friction between one calibration and the next."""

import datetime as dt
from typing import Final, NamedTuple

import numpy as np
import polars as pl

from analysis.fleet.control_chart import ControlChart, control_chart, limit_for

#: False alarms that all charts of a machine together may have in a year of daily values.
_ALARMS_A_YEAR: Final = 0.5
_DAYS: Final = 365.0


class Signal(NamedTuple):
    """A quantity that is charted.

    Attributes:
        name: of it.
        column: of the frame of days.
        logarithm: whether changes are shares, as of friction.
        unit: of a change.
        means: what a change of it says.
    """

    name: str
    column: str
    logarithm: bool
    unit: str
    means: str


SIGNALS: Final = (
    Signal("zero", "zero_kg", False, "kg", "mean mass of the empty passes"),
    Signal(
        "scale", "load_kg", True, "%", "mean payload: a gain, or another habit, bucket or material"
    ),
    Signal("friction", "friction_N_s_m", True, "%", "viscous friction by the joint fits: wear"),
)


class MachineChart(NamedTuple):
    """A chart of one machine between two calibrations.

    Attributes:
        machine: its name.
        signal: what is charted.
        calibration: id of the evidence in use (empty: none).
        days: of the values.
        values: of the signal, as it is.
        chart: of them.
    """

    machine: str
    signal: Signal
    calibration: str
    days: tuple[dt.date, ...]
    values: tuple[float, ...]
    chart: ControlChart

    @property
    def change(self) -> float:
        """From before the flagged stretch to it, in the signal's unit; NaN where nothing is."""
        change = self.chart.change
        return float(np.expm1(change) * 100.0) if self.signal.logarithm else change

    @property
    def change_std(self) -> float:
        """Standard deviation of that."""
        std = self.chart.change_std
        return std * (100.0 + self.change) if self.signal.logarithm else std


def drift_limit() -> float:
    """The limit of each chart, for at most half a false alarm a machine and year in all."""
    return limit_for(len(SIGNALS) * _DAYS / _ALARMS_A_YEAR)


def machine_charts(days: pl.DataFrame) -> list[MachineChart]:
    """A chart a machine, signal and calibration; the baseline is found anew after each.

    Args:
        days: of `daily`.
    """
    limit = drift_limit()
    found: list[MachineChart] = []
    for _, rows in days.group_by("machine", maintain_order=True):
        parts = rows.with_columns(part=pl.col("calibration").rle_id())
        for _, part in parts.group_by("part", maintain_order=True):
            found += [
                _chart(part.drop_nulls(signal.column), signal, limit)
                for signal in SIGNALS
                if part[signal.column].count() > 0
            ]
    return found


def _chart(part: pl.DataFrame, signal: Signal, limit: float) -> MachineChart:
    values = part[signal.column].to_numpy()
    if signal.logarithm:
        # what is not positive has no share to change by
        kept = values > 0.0
        part, values = part.filter(pl.Series(kept)), np.log(values[kept])
    raw = np.exp(values) if signal.logarithm else values
    return MachineChart(
        str(part["machine"].first()),
        signal,
        str(part["calibration"].first()),
        tuple(part["day"].to_list()),
        tuple(float(value) for value in raw),
        control_chart(values, limit),
    )

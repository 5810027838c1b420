"""Figures of a fleet: tonnes by week, and the charts of machines that drift."""

import datetime as dt
from collections.abc import Sequence
from typing import Final

import numpy as np
import polars as pl

from analysis.fleet.machine_drifts import MachineChart
from recordings.report.svg_shapes import WIDTH, Axes, Drawing

_BOX: Final = (52.0, 22.0, WIDTH - 8.0, 170.0)
_HEIGHT: Final = 206
_TONNE: Final = 1e3
_WEEK: Final = 7
#: Limits of a week's mean, in its standard deviations.
_LIMIT: Final = 3.0
#: Days, at least, that limits are drawn about; the chart itself needs none.
_BASELINE: Final = 14


def tonnes(weeks: pl.DataFrame) -> Drawing | None:
    """Tonnes of all machines by week; None where there are none.

    Args:
        weeks: week (Date), payload_kg, payload_u_kg, in time.
    """
    if weeks.is_empty():
        return None
    t, u = weeks["payload_kg"].to_numpy() / _TONNE, weeks["payload_u_kg"].to_numpy() / _TONNE
    picture = Drawing(
        "tonnes",
        "Tonnes by week",
        f"Tonnes of all machines in {weeks.height} weeks, from {t.min():,.0f} to {t.max():,.0f}; "
        "lines reach two standard uncertainties either way.",
        _HEIGHT,
    )
    first = weeks["week"][0]
    at = [(week - first).days / _WEEK for week in weeks["week"]]
    axes = Axes.around([-0.5, at[-1] + 0.5], [0.0, float((t + 2.0 * u).max())], _BOX, 0.02)
    axes = Axes(axes.x, (0.0, axes.y[1]), _BOX)
    axes.draw(picture, f"weeks since {first}", "tonnes")
    for x, value, half in zip(at, t, 2.0 * u, strict=True):
        left, top = axes.place(x - 0.4, float(value))
        right, bottom = axes.place(x + 0.4, 0.0)
        picture.bar(left, top, right - left, bottom - top, "bar")
        middle, low = axes.place(x, float(value - half))
        _, high = axes.place(x, float(value + half))
        picture.line(middle, low, middle, high, "ideal")
    return picture


def drift(number: int, shown: MachineChart) -> Drawing:
    """A machine's signal by week, against the limits of its baseline."""
    flagged, since = shown.chart.flagged, shown.chart.since
    assert flagged is not None
    assert since is not None
    values = np.array(shown.values)
    count = min(max(since, _BASELINE), values.size)
    base = values[:count]
    centre, deviation = float(base.mean()), float(base.std(ddof=1))
    points = _weeks(shown.days, values)
    half = _LIMIT * deviation / np.sqrt(float(np.median([n for _, _, n in points])))
    signal = shown.signal
    unit = {"zero": "kg", "scale": "kg", "friction": "N·s/m"}[signal.name]
    picture = Drawing(
        f"drift-{number}",
        f"{shown.machine}: {signal.name}",
        f"Weekly means of the {signal.means}, in {unit}, with the limits of a week's mean about "
        f"its first {count} days; dashed: {shown.days[flagged]}, when the "
        "chart flagged it.",
        _HEIGHT,
    )
    means = [mean for _, mean, _ in points]
    axes = Axes.around(
        [at for at, _, _ in points], [*means, centre - half, centre + half], _BOX, 0.04
    )
    left, top = axes.place(axes.x[0], centre + half)
    right, bottom = axes.place(axes.x[1], centre - half)
    picture.bar(left, top, right - left, bottom - top, "band")
    axes.draw(picture, f"weeks since {shown.days[0]}", unit)
    x, _ = axes.place((shown.days[flagged] - shown.days[0]).days / _WEEK, centre)
    picture.line(x, _BOX[1], x, _BOX[3], "ideal")
    for at, mean, count in points:
        outside = abs(mean - centre) > half
        week = shown.days[0] + dt.timedelta(days=_WEEK * at)
        tip = f"week of {week}: {mean:,.1f} {unit}, {count} days"
        picture.dot(*axes.place(at, mean), "left" if outside else "point", tip)
    return picture


def _weeks(days: Sequence[dt.date], values: np.ndarray) -> list[tuple[float, float, int]]:
    """Of every week with values: its number since the first day, their mean and count."""
    number = np.array([(day - days[0]).days // _WEEK for day in days])
    return [
        (float(n), float(values[number == n].mean()), int((number == n).sum()))
        for n in np.unique(number)
    ]

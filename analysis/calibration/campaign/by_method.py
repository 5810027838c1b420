"""Frame `calibration`: a line for each method, fitted in the same way as for evidence."""

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
import polars as pl

from analysis.calibration.campaign.campaign_fit import average_readings_of_runs
from analysis.calibration.line.calibration import Calibration, CalibrationOptions, Point
from analysis.calibration.line.line_fit import fit_calibration_line
from analysis.model.schema import conform_frame_to_schema
from estimators.arrays import Floats
from estimators.errors import DataError

#: Columns of the frame that are fields of a point.
_COLUMNS = {
    "reference_kg": "reference_kg",
    "readings": "runs",
    "mean_kg": "estimate_kg",
    "std_kg": "estimate_std_kg",
    "calibrated_kg": "calibrated_kg",
    "error_kg": "error_kg",
    "error_left_out_kg": "error_left_out_kg",
}


def fit_calibration_line_by_method(estimates: pl.DataFrame) -> pl.DataFrame:
    """Fit a line to the starts of each method; each load is a point with a known mass.

    Args:
        estimates: a row per method and start: `method`, `load_kg`, `reference_kg`, `mass_kg` (null
            if not estimated).

    Returns:
        The frame `calibration`: a row per method and load, null from `alpha_1` on if the loads
        determine no line.
    """
    rows: list[dict[str, Any]] = []
    for method, found in iter_readings_by_method(estimates):
        known, exact = found.references, found.covariance_kg2
        try:
            line = fit_calibration_line(found.readings, known, exact, CalibrationOptions(method))
        except DataError:
            line, points = None, average_readings_of_runs(found.readings, known)
        else:
            points = line.points
        rows += make_calibration_rows_of_method(
            method, points, line, lambda point: float(point.load_id)
        )
    return make_calibration_frame(rows)


@dataclass(frozen=True, eq=False)
class MethodReadings:
    """Starts of one method as readings; each load is a run with a known mass.

    Attributes:
        readings: frame with run_id, load_id, day, mass_kg, used.
        references: frame with load_id, reference_kg.
        covariance_kg2: (loads, loads) covariance of the references, here 0.
    """

    readings: pl.DataFrame
    references: pl.DataFrame
    covariance_kg2: Floats


def iter_readings_by_method(estimates: pl.DataFrame) -> Iterator[tuple[str, MethodReadings]]:
    """Yield the name and the readings of each method, in order of appearance.

    Args:
        estimates: as in `fit_calibration_line_by_method`.
    """
    for (method,), found in estimates.group_by("method", maintain_order=True):
        load_id = found["load_kg"].cast(pl.String)
        mass = pl.col("mass_kg").cast(pl.Float64)
        mass = pl.when(mass.is_finite()).then(mass)
        readings = found.select(
            run_id=load_id, load_id=load_id, day=pl.lit(""), mass_kg=mass, used=True
        )
        known = found.select(load_id=load_id, reference_kg="reference_kg").unique(
            "load_id", maintain_order=True
        )
        exact = np.zeros((known.height, known.height))
        yield str(method), MethodReadings(readings, known, exact)


def make_calibration_rows_of_method(
    method: str,
    points: Iterable[Point],
    line: Calibration | None,
    find_load_kg: Callable[[Point], float],
) -> list[dict[str, Any]]:
    """Rows of the frame `calibration` for a method, in order of ascending load.

    Args:
        method: name of the method.
        points: a point per load.
        line: line through the points; None without one.
        find_load_kg: returns the load of a point, without the machine.
    """
    ordered = sorted(points, key=lambda point: point.reference_kg)
    return [
        {
            "method": method,
            "load_kg": find_load_kg(point),
            **{name: getattr(point, own) for own, name in _COLUMNS.items()},
            "alpha_1": None if line is None else line.alpha_1,
            "beta_kg": None if line is None else line.beta_kg,
        }
        for point in ordered
    ]


def make_calibration_frame(rows: list[dict[str, Any]]) -> pl.DataFrame:
    """Make the frame `calibration` from its rows."""
    texts = {"method": pl.String, "load_kg": pl.Float64, "runs": pl.Int64}
    numbers = dict.fromkeys((*_COLUMNS.values(), "alpha_1", "beta_kg"), pl.Float64)
    return conform_frame_to_schema(
        "calibration", pl.DataFrame(rows, schema={**numbers, **texts}, orient="row")
    )

"""Calibrated masses beside the raw ones of a log's loads."""

from collections.abc import Mapping
from typing import Final

import polars as pl

from analysis.calibration.calibration import CalibratedMass, Calibration
from analysis.schema import conform
from estimators.errors import DataError, nearest

#: The estimators of frame `loads`: m̂ and the random part of its standard uncertainty.
ESTIMATORS: Final[Mapping[str, tuple[str, str]]] = {
    "joint_mass": ("mass_kg", "u_random_kg"),
    "joint_payload": ("payload_kg", "payload_u_random_kg"),
}


def calibrated_loads(
    loads: pl.DataFrame, calibration: Calibration, refused: str = ""
) -> pl.DataFrame:
    """Put the calibrated mass of each load beside its raw one.

    Args:
        loads: the frame `loads`, without calibrated columns or with those of another calibration.
        calibration: of the machine, by one of `ESTIMATORS`.
        refused: why no mass of this log is calibrated; "" where nothing speaks against it.

    Returns:
        The frame with `calibrated_kg`, `calibrated_u_kg`, `calibrated_low_kg`,
        `calibrated_high_kg` and `calibrated_reason`, which says why a row has none ("" else).

    Raises:
        DataError: the calibration is of an estimator that the frame does not have.
    """
    if calibration.method not in ESTIMATORS:
        raise DataError(
            f"calibration: it is of '{calibration.method}', no mass of the loads: "
            f"{nearest(calibration.method, ESTIMATORS)}"
        )
    mass, u_random = ESTIMATORS[calibration.method]
    found = [
        CalibratedMass(None, None, None, None, refused)
        if refused
        else _calibrated(calibration, *row)
        for row in loads.select(mass, u_random, "manoeuvres", "withheld_for").iter_rows()
    ]
    columns = {
        "calibrated_kg": pl.Series([one.mass_kg for one in found], dtype=pl.Float64),
        "calibrated_u_kg": pl.Series([one.u_kg for one in found], dtype=pl.Float64),
        "calibrated_low_kg": pl.Series([one.low_kg for one in found], dtype=pl.Float64),
        "calibrated_high_kg": pl.Series([one.high_kg for one in found], dtype=pl.Float64),
        "calibrated_reason": pl.Series([one.reason for one in found], dtype=pl.String),
    }
    return conform("loads", loads.with_columns(**columns))


def _calibrated(
    calibration: Calibration,
    mass_kg: float | None,
    u_random_kg: float | None,
    manoeuvres: int,
    withheld_for: str,
) -> CalibratedMass:
    if mass_kg is None and withheld_for:
        return CalibratedMass(None, None, None, None, f"withheld for {withheld_for}")
    return calibration.calibrated(mass_kg, u_random_kg, manoeuvres)

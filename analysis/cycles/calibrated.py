"""Payloads of cycles under a calibration line."""

from collections.abc import Mapping
from typing import Any, Final

import numpy as np
import polars as pl

from analysis.calibration.calibration import Calibration
from analysis.schema import QUALITY, conform
from estimators.errors import DataError, nearest

#: Lines whose estimate is the mass of a state, and lines of a difference of two.
_OF_MASS: Final = "joint_mass"
_OF_PAYLOAD: Final = "joint_payload"


def calibrated_cycles(cycles: pl.DataFrame, calibration: Calibration) -> pl.DataFrame:
    """Put payloads on the line m̂ = c0 + c1 m: of a difference of masses the constant cancels.

    What the line does not know is common to all cycles; it stands beside what the log has in
    common, which is not taken off: a calibration holds for the machine, nuisances are the log's.

    A cycle whose load is outside of what was calibrated has no payload, and says so.

    Args:
        cycles: the frame.
        calibration: of the machine.

    Raises:
        DataError: the line is of another estimator.
    """
    if calibration.method not in (_OF_MASS, _OF_PAYLOAD):
        raise DataError(
            f"calibration: it is of '{calibration.method}', no mass of cycles: "
            f"{nearest(calibration.method, (_OF_MASS, _OF_PAYLOAD))}"
        )
    slope, payload = calibration.c1_1, cycles["payload_kg"].to_numpy()
    if calibration.method == _OF_MASS:
        mass = payload / slope
        line_kg = np.abs(mass) * np.sqrt(calibration.covariance[2]) / abs(slope)
    else:
        mass = (payload - calibration.c0_kg) / slope
        off = mass - calibration.centre_kg
        level, both, own = calibration.covariance
        line_kg = np.sqrt(np.maximum(level + 2.0 * both * off + own * off**2, 0.0)) / abs(slope)
    random_kg = cycles["payload_u_random_kg"].to_numpy() / abs(slope)
    common_kg, shared_kg = (
        np.hypot(cycles[f"payload_u_{part}_kg"].to_numpy() / abs(slope), line_kg)
        for part in ("common", "shared")
    )
    found = {
        "payload_kg": mass,
        "payload_u_random_kg": random_kg,
        "payload_u_common_kg": common_kg,
        "payload_u_shared_kg": shared_kg,
        "payload_u_kg": np.hypot(random_kg, common_kg),
    }
    reasons = pl.Series("reason", [_outside(row, calibration) for row in cycles.to_dicts()])
    refused = reasons.to_numpy() != ""
    columns = [
        pl.Series(name, np.where(refused, np.nan, value)).fill_nan(None)
        for name, value in found.items()
    ]
    said = cycles.with_columns(*columns, refused=pl.Series(refused), reason=reasons).with_columns(
        quality=pl.when("refused").then(pl.lit("no mass", QUALITY)).otherwise("quality"),
        counted=pl.col("counted") & ~pl.col("refused"),
        withheld_for=pl.when("refused").then("reason").otherwise("withheld_for"),
    )
    return conform("cycles", said.drop("refused", "reason"))


def _outside(row: Mapping[str, Any], calibration: Calibration) -> str:
    """Why a cycle is none of the line's; "" where it is, or has no mass anyway."""
    name = "loaded" if calibration.method == _OF_MASS else "payload"
    mass_kg, u_kg = row[f"{name}_kg"], row["loaded_u_kg"]
    if row["payload_kg"] is None:
        return ""
    return calibration.calibrated(mass_kg, u_kg, row["manoeuvres"]).reason

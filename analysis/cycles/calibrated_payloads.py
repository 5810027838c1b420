"""Payloads of cycles, calibrated by a line."""

from collections.abc import Mapping, Sequence
from typing import Any, Final

import numpy as np
import polars as pl

from analysis.calibration.line.calibration import Calibration
from analysis.calibration.line.shared_errors import SharedErrors
from analysis.calibration.use.mass_differences import calibrate_mass_differences
from analysis.cycles.empty_machine import BY_CALIBRATION, BY_EMPTY_MACHINE
from analysis.cycles.haul_spillage import subtract_spillage_from_payload_columns
from analysis.model.schema import MASS_KINDS, QUALITY, conform_frame_to_schema, get_column_values
from estimators.errors import DataError

#: Method of lines for the mass of a state; the other is for a difference of two masses.
_OF_MASS: Final = "joint_mass"
_OF_PAYLOAD: Final = "joint_payload"
#: Parts of the uncertainty common to payloads, and shared by all payloads.
_COMMON: Final = ("common", "shared")


def calibrate_cycles(
    cycles: pl.DataFrame, calibration: Calibration, shared_errors: SharedErrors | None = None
) -> pl.DataFrame:
    """Calibrate payloads by the line m̂ = c0 + c1 m; the constant cancels in differences.

    The uncertainty of the line is common to all cycles. The line already includes the scale and the
    errors of learnt means in its own logs; only the difference of their effect on this log remains.
    If the empty machine determines the scale better than the line, payloads are unchanged. The
    payload of a cycle with a load outside the calibrated range is withheld, with the reason.

    Args:
        cycles: the frame `cycles`.
        calibration: calibration of the machine.
        shared_errors: estimate from this log of the errors that it shares with the campaign; None
            corrects none.

    Raises:
        DataError: the line is for another method.
    """
    if calibration.method not in (_OF_MASS, _OF_PAYLOAD):
        raise DataError(
            f"calibration: method '{calibration.method}' does not estimate the masses of cycles; "
            f"calibrate with {_OF_MASS} or {_OF_PAYLOAD}"
        )
    numbers = [("cycle", number) for number in cycles["cycle"].to_list()]
    scale_1 = get_column_values(cycles, "scale_1")
    payload_kg = get_column_values(cycles, "payload_kg") / scale_1
    on_line = calibrate_mass_differences(calibration, shared_errors, numbers, payload_kg)
    common, shared = (
        on_line.compute_unabsorbed_common_u_kg(get_column_values(cycles, f"own_u_{n}_kg"))
        for n in _COMMON
    )
    shared_kg = np.linalg.norm([shared, on_line.shared_u_kg, on_line.line_u_kg], axis=0)
    common_kg = np.linalg.norm([common, on_line.driving_u_kg, on_line.line_u_kg], axis=0)
    common_kg = np.maximum(common_kg, shared_kg)
    random_kg = get_column_values(cycles, "payload_u_random_kg") / scale_1 / on_line.abs_slope_1
    found = {
        "payload_kg": on_line.payload_kg,
        "payload_u_random_kg": random_kg,
        "payload_u_common_kg": common_kg,
        "payload_u_shared_kg": shared_kg,
        "payload_u_kg": np.hypot(random_kg, common_kg),
        "scale_1": np.where(np.isnan(payload_kg), np.nan, 1.0 / on_line.abs_slope_1),
    }
    on_scale = subtract_spillage_from_payload_columns(
        cycles.with_columns(pl.Series(name, each).fill_nan(None) for name, each in found.items())
    )
    if is_empty_mass_scale_more_certain(cycles, on_scale, tuple(found)):
        return cycles
    off_kg, u_kg = estimate_mean_offset_from_line_and_u_kg(calibration, shared_errors)
    reasons = pl.Series(
        "reason",
        [_explain_inapplicable_line(row, calibration, off_kg, u_kg) for row in cycles.to_dicts()],
    )
    refused = pl.col("reason") != ""
    said = on_scale.with_columns(reasons).with_columns(
        *(pl.when(~refused).then(name).alias(name) for name in found),
        quality=pl.when(refused).then(pl.lit("no mass", QUALITY)).otherwise("quality"),
        counted=pl.col("counted") & ~refused,
        withheld_for=pl.when(refused).then("reason").otherwise("withheld_for"),
    )
    return conform_frame_to_schema(
        "cycles",
        said.drop("reason").with_columns(
            scale_from=pl.when(pl.col("payload_kg").is_not_null()).then(pl.lit(BY_CALIBRATION))
        ),
    )


def is_empty_mass_scale_more_certain(
    cycles: pl.DataFrame, line_payloads: pl.DataFrame, names: Sequence[str]
) -> bool:
    """Whether the empty machine gives the sum of payloads a smaller uncertainty than the line.

    Args:
        cycles: the frame `cycles`.
        line_payloads: the same frame calibrated by the line.
        names: columns in both.
    """
    counted = cycles["counted"].to_numpy()
    if not counted.any() or (cycles["scale_from"].drop_nulls() != BY_EMPTY_MACHINE).any():
        return False

    def compute_relative_u_of_payload_sum(table: pl.DataFrame) -> float:
        sums = {name: get_column_values(table, name)[counted] for name in names}
        shared = sums["payload_u_shared_kg"].sum()
        random = np.linalg.norm(sums["payload_u_random_kg"])
        return float(np.hypot(shared, random) / abs(sums["payload_kg"].sum()))

    return compute_relative_u_of_payload_sum(cycles) < compute_relative_u_of_payload_sum(
        line_payloads
    )


def estimate_mean_offset_from_line_and_u_kg(
    calibration: Calibration, shared_errors: SharedErrors | None
) -> tuple[float, float]:
    """Mean offset of the log's masses from the line, and its standard uncertainty, in kg."""
    of_masses = (
        []
        if shared_errors is None
        else [x for (of, _), x in shared_errors.mass_responses_kg.items() if of == MASS_KINDS[0]]
    )
    if (
        shared_errors is None
        or not of_masses
        or not calibration.responses
        or calibration.method == _OF_PAYLOAD
    ):
        return 0.0, 0.0
    moved_kg = np.mean(of_masses, axis=0)
    return shared_errors.compute_offset_from_line_kg_and_u_kg(
        moved_kg, shared_errors.compute_line_shifts_kg(calibration.responses, 1.0, 0.0)
    )


def _explain_inapplicable_line(
    cycle_row: Mapping[str, Any],
    calibration: Calibration,
    line_offset_kg: float,
    driving_u_kg: float,
) -> str:
    """Why the line does not apply to a cycle; "" if it does, or if there is no mass."""
    name = "loaded" if calibration.method == _OF_MASS else "payload"
    mass_kg, u_kg = cycle_row[f"{name}_kg"], cycle_row["loaded_u_kg"]
    if cycle_row["payload_kg"] is None:
        return ""
    count = cycle_row["manoeuvres"]
    return calibration.calibrate_estimate(
        mass_kg - line_offset_kg, u_kg, count, driving_u_kg
    ).reason

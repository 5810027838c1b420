"""Add calibrated masses to the loads of a later log, or the reason why it cannot be calibrated."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, Final, NamedTuple

import numpy as np
import polars as pl

from analysis.calibration.line.calibration import CalibratedMass, Calibration
from analysis.calibration.line.shared_errors import SharedErrors
from analysis.calibration.use.calibration_drift import (
    CheckPoint,
    DriftCheck,
    compare_known_mass_with_calibration,
)
from analysis.calibration.use.learnt_priors import (
    describe_contradicted_learnt_priors,
    describe_undetectable_changes_by_load,
)
from analysis.calibration.use.mass_differences import NORMAL, calibrate_mass_differences
from analysis.calibration.use.use_limits import LIMITS
from analysis.model.machine_body import Body
from analysis.model.schema import CALIBRATED, conform_frame_to_schema
from estimators.errors import DataError

#: By estimator, columns of frame `loads` with m̂ and the random part of its standard uncertainty.
ESTIMATORS: Final[Mapping[str, tuple[str, str]]] = {
    "joint_mass": ("mass_kg", "u_random_kg"),
    "joint_payload": ("own_payload_kg", "own_payload_u_random_kg"),
}
#: Frames of a replay for `collect_later_log_facts`; the last two only exist with learnt priors.
LATER_LOG_FRAMES: Final = ("loads", "nuisances", "responses", "learnt_errors")


class CalibratedPayload(NamedTuple):
    """Payload of a load, its standard uncertainty and half interval, in kg."""

    payload_kg: float
    u_kg: float
    half_interval_kg: float


@dataclass(frozen=True)
class LaterLog:
    """Facts about a later log besides its loads.

    Attributes:
        refusal_reason: reason why no mass of the log is calibrated; "" if there is none.
        shared_errors: estimate by the log of errors shared with its campaign; None corrects none.
        empty_kg: known mass of the empty machine; None if unknown.
        empty_u_kg: standard uncertainty of that mass.
        undetectable_change_text_by_load: text on changes since the evidence that the log would not
            show, by load.
    """

    refusal_reason: str = ""
    shared_errors: SharedErrors | None = None
    empty_kg: float | None = None
    empty_u_kg: float = 0.0
    undetectable_change_text_by_load: Mapping[int, str] = field(default_factory=dict[int, str])


_NOTHING_MORE: Final = LaterLog()


def calibrate_loads(
    loads: pl.DataFrame, calibration: Calibration, log: LaterLog = _NOTHING_MORE
) -> pl.DataFrame:
    """Add the calibrated mass and payload of each load.

    If the log contains an empty state, its calibrated mass must equal that of the empty machine,
    within a limit that one log in 370 exceeds by chance.

    Args:
        loads: frame `loads`; existing calibrated columns are replaced.
        calibration: calibration of the machine, by one of `ESTIMATORS`.
        log: further facts about the log.

    Returns:
        The frame with the columns `CALIBRATED`; `calibrated_reason` is the reason why a row has no
        mass, or "", and `calibrated_said` a note on its mass.

    Raises:
        DataError: the calibration's method does not estimate the masses of loads.
    """
    if calibration.method not in ESTIMATORS:
        raise DataError(
            f"calibration: method '{calibration.method}' does not estimate the masses of loads; "
            f"calibrate with one of {', '.join(ESTIMATORS)}"
        )
    mass, u_random = ESTIMATORS[calibration.method]
    rows = loads.with_columns(estimate_kg=mass, estimate_u_random_kg=u_random).to_dicts()
    check = check_drift_of_empty_machine(rows, calibration, log)
    refused = log.refusal_reason or describe_machine_change(check, log)
    drift_was_checked = check is not None and check.drifted is not None
    empties = sum(row["manoeuvres"] for row in rows if row["empty"])
    found = [
        _make_calibrated_columns(
            row,
            calibration,
            log,
            refused,
            drift_was_checked=drift_was_checked,
            empty_weighings=empties,
        )
        for row in rows
    ]
    types = dict.fromkeys(CALIBRATED, pl.Float64)
    types |= {"calibrated_reason": pl.String, "calibrated_said": pl.String}
    columns = {n: pl.Series([one.get(n) for one in found], dtype=t) for n, t in types.items()}
    return conform_frame_to_schema("loads", loads.with_columns(**columns))


def _make_calibrated_columns(
    load_row: Mapping[str, Any],
    calibration: Calibration,
    later_log: LaterLog,
    refusal: str,
    *,
    drift_was_checked: bool,
    empty_weighings: int,
) -> dict[str, Any]:
    """Columns `CALIBRATED` of a load."""
    off_kg, driving_u_kg = estimate_driving_offset_and_u_kg(
        load_row, calibration, later_log.shared_errors
    )
    one = _calibrate_load_mass(load_row, calibration, refusal, off_kg, driving_u_kg)
    said = {
        "calibrated_kg": one.mass_kg,
        "calibrated_u_kg": one.u_kg,
        "calibrated_low_kg": one.low_kg,
        "calibrated_high_kg": one.high_kg,
        "calibrated_reason": one.reason,
        "calibrated_said": "",
    }
    if one.mass_kg is None:
        return said
    said["calibrated_unlike_u_kg"] = driving_u_kg / abs(calibration.c1_1)
    days = calibration.day_count_with_unknown_scatter
    unseen = later_log.undetectable_change_text_by_load.get(load_row["load_id"], "")
    if days and unseen and not drift_was_checked:
        said["calibrated_said"] = (
            f"evidence of {'one day' if days == 1 else f'{days} days'}: {unseen}"
        )
    payload = calibrate_payload_of_load(load_row, calibration, later_log, one, empty_weighings)
    if payload is not None:
        mass_kg, u_kg, half_kg = payload
        said |= {
            "calibrated_payload_kg": mass_kg,
            "calibrated_payload_u_kg": u_kg,
            "calibrated_payload_low_kg": mass_kg - half_kg,
            "calibrated_payload_high_kg": mass_kg + half_kg,
        }
    return said


def estimate_driving_offset_and_u_kg(
    load_row: Mapping[str, Any], calibration: Calibration, shared_errors: SharedErrors | None
) -> tuple[float, float]:
    """Offset of m̂ by driving differently from the campaign, and its uncertainty, in kg."""
    key = ("mass" if calibration.method == "joint_mass" else "payload", load_row["load_id"])
    if (
        shared_errors is None
        or not calibration.responses
        or key not in shared_errors.mass_responses_kg
    ):
        return 0.0, 0.0
    away_kg = ((load_row["estimate_kg"] or 0.0) - calibration.level_kg) / calibration.c1_1
    line_kg = shared_errors.compute_line_shifts_kg(calibration.responses, 1.0, away_kg)
    return shared_errors.compute_offset_from_line_kg_and_u_kg(
        shared_errors.mass_responses_kg[key], line_kg
    )


def _calibrate_load_mass(
    load_row: Mapping[str, Any],
    calibration: Calibration,
    refusal: str,
    driving_offset_kg: float,
    driving_u_kg: float,
) -> CalibratedMass:
    """Calibrated mass of a load, or the reason why it has none."""
    estimate_kg, withheld_for = load_row["estimate_kg"], load_row["withheld_for"]
    if refusal:
        return CalibratedMass(None, None, None, None, refusal)
    if estimate_kg is None:
        if withheld_for:
            return CalibratedMass(None, None, None, None, f"withheld for {withheld_for}")
        return calibration.calibrate_estimate(None, None, load_row["manoeuvres"])
    random_kg, count = load_row["estimate_u_random_kg"], load_row["manoeuvres"]
    return calibration.calibrate_estimate(
        estimate_kg - driving_offset_kg, random_kg, count, driving_u_kg
    )


def calibrate_payload_of_load(
    load_row: Mapping[str, Any],
    calibration: Calibration,
    later_log: LaterLog,
    load_mass: CalibratedMass,
    empty_weighings: int,
) -> CalibratedPayload | None:
    """Payload, standard uncertainty and half interval in kg; None without a payload."""
    if (
        load_mass.mass_kg is None
        or load_mass.u_kg is None
        or load_row["own_payload_kg"] is None
        or load_row["empty"]
    ):
        return None
    assert load_mass.high_kg is not None
    assert load_mass.low_kg is not None
    half_kg = (load_mass.high_kg - load_mass.low_kg) / 2.0
    if calibration.method == "joint_payload":
        return CalibratedPayload(load_mass.mass_kg, load_mass.u_kg, half_kg)
    if load_row["payload_to"] is None:
        empty_kg = load_row["mass_kg"] - load_row["own_payload_kg"]
        u_kg = float(np.hypot(load_mass.u_kg, later_log.empty_u_kg))
        half_kg = float(np.hypot(half_kg, NORMAL * later_log.empty_u_kg))
        return CalibratedPayload(load_mass.mass_kg - empty_kg, u_kg, half_kg)
    # assuming that readings repeat no better than those of the campaign
    repeats_kg = (calibration.repeatability_kg or 0.0) * float(
        np.sqrt(1.0 / load_row["manoeuvres"] + 1.0 / max(empty_weighings, 1))
    )
    u_kg, u_random_kg = load_row["own_payload_u_kg"], load_row["own_payload_u_random_kg"]
    random_kg = max(u_random_kg, repeats_kg)
    common_kg = float(np.sqrt(max(u_kg**2 - u_random_kg**2, 0.0)))
    found = calibrate_mass_differences(
        calibration,
        later_log.shared_errors,
        [("payload", load_row["load_id"])],
        np.array([load_row["own_payload_kg"]]),
    )
    beside_kg = found.compute_unabsorbed_common_u_kg(np.array([common_kg]))[0]
    parts = (
        random_kg / abs(calibration.c1_1),
        beside_kg,
        found.driving_u_kg[0],
        found.line_u_kg[0],
    )
    u_kg = float(np.linalg.norm(parts))
    half_kg = max(calibration.coverage_k_1, NORMAL) * u_kg
    return CalibratedPayload(float(found.payload_kg[0]), u_kg, half_kg)


def check_drift_of_empty_machine(
    load_rows: list[dict[str, Any]], calibration: Calibration, later_log: LaterLog
) -> DriftCheck | None:
    """Check the log's empty states against the known empty mass; None if one is missing."""
    empty = [row for row in load_rows if row["empty"] and row["mass_kg"] is not None]
    if later_log.empty_kg is None or not empty or calibration.method != "joint_mass":
        return None
    count = np.array([row["manoeuvres"] for row in empty], np.float64)
    share = count / count.sum()
    apart = [
        estimate_driving_offset_and_u_kg(row, calibration, later_log.shared_errors) for row in empty
    ]
    mass_kg = float(
        share @ [row["mass_kg"] - off for row, (off, _) in zip(empty, apart, strict=True)]
    )
    random_kg = float(np.linalg.norm(share * [row["u_random_kg"] for row in empty]))
    # shared errors have the same effect on all of them
    driving_u_kg = float(share @ [u for _, u in apart]) / abs(calibration.c1_1)
    point = CheckPoint(mass_kg, random_kg, int(count.sum()))
    u_kg = float(np.hypot(later_log.empty_u_kg, driving_u_kg))
    return compare_known_mass_with_calibration(calibration, later_log.empty_kg, u_kg, point)


def describe_machine_change(check: DriftCheck | None, later_log: LaterLog) -> str:
    """Reason why the calibration no longer applies to this machine; "" if it does."""
    if (
        check is None
        or check.p_1 is None
        or check.p_1 > LIMITS.moved_machine_probability
        or later_log.empty_kg is None
    ):
        return ""
    assert check.mass_kg is not None
    return (
        f"the empty machine weighs {check.mass_kg:,.0f} kg in this log by the calibration, but "
        f"{later_log.empty_kg:,.0f} kg by its stated mass; chance explains at most "
        f"{check.limit_kg:,.0f} kg: the machine, the ground or the empty mass has changed"
    )


def collect_later_log_facts(
    frames: Mapping[str, pl.DataFrame], body: Body, refusal_reasons: str = ""
) -> LaterLog:
    """Collect the facts about a later log.

    Args:
        frames: `LATER_LOG_FRAMES` of a replay with the calibration's learnt priors.
        body: machine body with the calibration's empty mass.
        refusal_reasons: known reason why the log must not be calibrated, if any.
    """
    nuisances, shared_errors = frames["nuisances"], SharedErrors.from_frames(frames)
    return LaterLog(
        refusal_reasons or describe_contradicted_learnt_priors(nuisances),
        shared_errors,
        body.empty_mass_kg,
        body.empty_mass_u_kg or 0.0,
        describe_undetectable_changes_by_load(nuisances, shared_errors),
    )

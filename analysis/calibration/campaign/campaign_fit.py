"""Fit of a campaign: from references and readings to the calibration."""

from collections.abc import Iterable, Sequence
from dataclasses import asdict, dataclass, replace
from typing import Final

import numpy as np
import polars as pl
from numpy.typing import NDArray

from analysis.calibration.campaign.campaign_plan import JOINT_ESTIMATORS, CalibrationCampaign
from analysis.calibration.line.calibration import Calibration, CalibrationOptions, Point, StatedPart
from analysis.calibration.line.line_fit import fit_calibration_line
from analysis.calibration.line.shared_errors import RunResponse
from analysis.calibration.use.calibration_drift import (
    CheckPoint,
    DriftCheck,
    compare_known_mass_with_calibration,
)
from analysis.calibration.use.error_limits import (
    DecisionRule,
    ErrorLimits,
    compute_error_limit_of_load_kg,
    judge_loads_by_error_limits,
)
from analysis.model.machine_body import Body
from estimators.errors import CampaignError, DataError

#: Names in the budget of a calibration of the factors that a machine file states.
_SCALES: Final = {
    "force_gain": "force gain",
    "force_share": "force share",
    "wheel_radius": "wheel radius",
    "rotating_mass": "rotating mass",
}
_FROM_FILE: Final = "from the machine file"
_POINT_TYPES: Final[dict[str, type[pl.DataType]]] = {
    "run_id": pl.String,
    "load_id": pl.String,
    "day": pl.String,
    "reference_kg": pl.Float64,
    "readings": pl.Int64,
    "rejected": pl.Int64,
    "mean_kg": pl.Float64,
    "std_kg": pl.Float64,
    "calibrated_kg": pl.Float64,
    "error_kg": pl.Float64,
    "error_left_out_kg": pl.Float64,
    "studentised_1": pl.Float64,
}
#: Columns of the frame of points.
POINTS: Final = _POINT_TYPES


@dataclass(frozen=True, slots=True)
class CampaignFit:
    """Result of fitting a campaign.

    Attributes:
        calibration: the line; None if the readings determine none.
        no_fit: reason why there is no line; "" if there is one.
        points: a row per run, even without a line.
        limits: verdict on the campaign's error limits; None without limits or without a line.
    """

    calibration: Calibration | None
    no_fit: str
    points: tuple[Point, ...]
    limits: ErrorLimits | None

    @property
    def point_frame(self) -> pl.DataFrame:
        """The points as a frame."""
        return pl.DataFrame([asdict(point) for point in self.points], schema=POINTS, orient="row")


def fit_campaign_line(
    campaign: CalibrationCampaign,
    body: Body,
    readings: pl.DataFrame,
    options: CalibrationOptions,
    responses: Sequence[RunResponse] = (),
) -> CampaignFit:
    """Fit the line of a campaign; if that is impossible, give the reason.

    Args:
        campaign: campaign with its references.
        body: machine body with its empty mass.
        readings: frame `readings`.
        options: options of the fit.
        responses: responses of runs to errors of learnt means.
    """
    known, covariance_kg2 = tabulate_reference_masses_and_covariance(campaign, body)
    rule = make_decision_rule(campaign, known)
    try:
        fitted = fit_calibration_line(readings, known, covariance_kg2, options, responses)
    except DataError as fault:
        no_fit = str(fault).removeprefix("calibration: ")
        return CampaignFit(None, no_fit, average_readings_of_runs(readings, known), None)
    limits = None if rule is None else judge_loads_by_error_limits(fitted, rule)
    return CampaignFit(fitted, "", fitted.points, limits)


def make_decision_rule(
    campaign: CalibrationCampaign, known_masses: pl.DataFrame
) -> DecisionRule | None:
    """Decision rule of a campaign file; None without one.

    Args:
        campaign: campaign with its decision.
        known_masses: frame with `reference_kg` of its loads.

    Raises:
        DataError: the class is unknown, needs a scale interval, or does not cover a load.
    """
    asked = campaign.decision
    if asked is None:
        return None
    rule = DecisionRule(**asked.model_dump())
    for reference_kg in known_masses["reference_kg"]:
        compute_error_limit_of_load_kg(rule, reference_kg - rule.tare_kg)
    return rule


def make_calibration_options(
    campaign: CalibrationCampaign, stated_parts: Iterable[StatedPart]
) -> CalibrationOptions:
    """Options of the fit from a campaign file.

    Args:
        campaign: campaign with its method.
        stated_parts: components known from the replays; those stated in the file override them.
    """
    method = campaign.method
    own = tuple(
        StatedPart(each.component, each.u_kg, each.absorbed, each.known) for each in method.stated
    )
    named = {each.component for each in own}
    return CalibrationOptions(
        method=method.estimator,
        confidence_1=method.confidence_1,
        day_known_kg=method.day_known_kg,
        margin_1=method.margin_1,
        stated=(*own, *(each for each in stated_parts if each.component not in named)),
    )


def list_stated_uncertainties_of_force_scale(
    campaign: CalibrationCampaign, budgets: Iterable[pl.DataFrame]
) -> tuple[StatedPart, ...]:
    """Factors of the force that no log determines, from the budgets of the replays.

    They are constants of the machine, which the line absorbs.

    Args:
        campaign: campaign with its estimator; estimators of the paper have no budget.
        budgets: frame `budget` of each replay.
    """
    if campaign.method.estimator not in JOINT_ESTIMATORS:
        return ()
    found: dict[str, float | None] = {}
    for budget in budgets:
        for row in budget.filter(pl.col("kind") == "scale").iter_rows(named=True):
            before, u_kg = found.get(row["cause"]), row["u_kg"]
            known = [each for each in (before, u_kg) if each is not None]
            found[row["cause"]] = max(known) if known else None
    return tuple(
        StatedPart(_SCALES[cause], u_kg, absorbed=True, known=_FROM_FILE)
        for cause, u_kg in sorted(found.items())
        if u_kg is not None
    )


def average_readings_of_runs(
    readings: pl.DataFrame, known_masses: pl.DataFrame
) -> tuple[Point, ...]:
    """Make a point of each run, with the mean of its readings, before any line is fitted.

    Args:
        readings: frame `readings`.
        known_masses: frame with `load_id` and `reference_kg`.

    Raises:
        DataError: a load has no reference.
    """
    unknown = set(readings["load_id"]) - set(known_masses["load_id"])
    if unknown:
        raise DataError(
            f"calibration: load '{min(unknown)}' has readings but no reference mass; add one"
        )
    used = pl.col("used") & pl.col("mass_kg").is_not_null()
    rows = (
        readings.group_by("run_id", maintain_order=True)
        .agg(
            pl.col("load_id", "day").first(),
            readings=used.sum().cast(pl.Int64),
            rejected=(~used).sum().cast(pl.Int64),
            mean_kg=pl.col("mass_kg").filter(used).mean(),
            std_kg=pl.col("mass_kg").filter(used).std(),
        )
        .join(known_masses, "load_id", "left", maintain_order="left")
    )
    return tuple(
        Point(
            **row,
            calibrated_kg=None,
            error_kg=None,
            error_left_out_kg=None,
            studentised_1=None,
        )
        for row in rows.to_dicts()
    )


def tabulate_reference_masses_and_covariance(
    campaign: CalibrationCampaign, body: Body
) -> tuple[pl.DataFrame, NDArray[np.float64]]:
    """Reference of each load, and covariance of the references.

    Args:
        campaign: campaign with masses and runs.
        body: machine body; its empty mass is part of a reference unless payloads are calibrated.

    Returns:
        Frame with `load_id` and `reference_kg`; and (loads, loads) covariance in kg². Masses from
        one source share a part of their error, loads that contain the same mass its whole error,
        and references that include the machine that of its empty mass.

    Raises:
        CampaignError: the machine file lacks the empty mass, or its uncertainty.
    """
    ids = campaign.load_ids
    count = len(campaign.masses)
    mass_kg2 = np.zeros((count, count))
    for i, one in enumerate(campaign.masses):
        for j, other in enumerate(campaign.masses):
            if i == j:
                mass_kg2[i, j] = one.u_kg**2
            elif one.source and one.source == other.source:
                mass_kg2[i, j] = one.shared_u_kg * other.shared_u_kg
    on_board = np.array(
        [
            [mass in campaign.select_masses_of_load(load) for mass in campaign.masses]
            for load in ids
        ],
        np.float64,
    ).reshape(len(ids), count)
    values = np.array([mass.value_kg for mass in campaign.masses])
    reference_kg = on_board @ values
    covariance_kg2 = on_board @ mass_kg2 @ on_board.T
    if campaign.method.estimator != "joint_payload":
        if body.empty_mass_kg is None or body.empty_mass_u_kg is None:
            lacks = "empty_mass_kg" if body.empty_mass_kg is None else "empty_mass_u_kg"
            raise CampaignError(
                f"neither the campaign nor the machine file has machine.{lacks}, but the reference "
                "mass of each run is the load plus the empty machine; give it, or calibrate "
                'payload with method.estimator = "joint_payload"'
            )
        reference_kg = reference_kg + body.empty_mass_kg
        covariance_kg2 = covariance_kg2 + body.empty_mass_u_kg**2
    frame = pl.DataFrame(
        {"load_id": list(ids), "reference_kg": reference_kg},
        schema={"load_id": pl.String, "reference_kg": pl.Float64},
    )
    return frame, covariance_kg2


def check_single_load_by_calibration(
    campaign: CalibrationCampaign, body: Body, readings: pl.DataFrame, calibration: Calibration
) -> tuple[CampaignFit, DriftCheck]:
    """Check an earlier calibration by the single load of a campaign.

    Args:
        campaign: campaign of one run.
        body: machine body.
        readings: frame `readings`.
        calibration: earlier calibration.

    Returns:
        The calibration with the points of this campaign, and the result of the check.
    """
    known, covariance_kg2 = tabulate_reference_masses_and_covariance(campaign, body)
    (point, *_) = average_readings_of_runs(readings, known)
    drift = compare_known_mass_with_calibration(
        calibration,
        point.reference_kg,
        float(covariance_kg2[0, 0]) ** 0.5,
        CheckPoint(point.mean_kg, None, point.readings),
    )
    if drift.mass_kg is not None:
        point = replace(point, calibrated_kg=drift.mass_kg, error_kg=drift.difference_kg)
    return CampaignFit(calibration, "", (point,), None), drift

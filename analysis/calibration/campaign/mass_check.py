"""A campaign of one known mass against a calibration: its points, and whether it has drifted."""

from dataclasses import replace

import polars as pl

from analysis.calibration.campaign.campaign_fit import CampaignFit, unfitted_points
from analysis.calibration.campaign.campaign_plan import CalibrationCampaign
from analysis.calibration.campaign.reference_masses import references
from analysis.calibration.line.calibration import Calibration
from analysis.calibration.use.calibration_drift import CheckPoint, DriftCheck, check_against
from analysis.model.machine import Body


def check_known_mass(
    campaign: CalibrationCampaign,
    body: Body,
    readings: pl.DataFrame,
    calibration: Calibration,
) -> tuple[CampaignFit, DriftCheck]:
    """Compare the one load of a campaign with what a calibration makes of it.

    Args:
        campaign: of one run.
        body: the machine.
        readings: frame `readings`.
        calibration: made before.

    Returns:
        The calibration with the points of this campaign, and the outcome.
    """
    known, covariance_kg2 = references(campaign, body)
    (point, *_) = unfitted_points(readings, known)
    drift = check_against(
        calibration,
        point.reference_kg,
        float(covariance_kg2[0, 0]) ** 0.5,
        CheckPoint(point.mean_kg, None, point.readings),
    )
    if drift.mass_kg is not None:
        point = replace(point, calibrated_kg=drift.mass_kg, error_kg=drift.difference_kg)
    return CampaignFit(calibration, "", (point,), None), drift

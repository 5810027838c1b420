"""What lay on board: the reference of each load of a campaign, and how their errors go together."""

import numpy as np
import polars as pl
from numpy.typing import NDArray

from analysis.calibration.campaign.campaign_plan import CalibrationCampaign
from analysis.model.machine import Body
from estimators.errors import CampaignError


def references(
    campaign: CalibrationCampaign, body: Body
) -> tuple[pl.DataFrame, NDArray[np.float64]]:
    """The reference of each load, and how their errors go together.

    Args:
        campaign: masses and runs.
        body: the machine; its empty mass is part of a reference unless payload is calibrated.

    Returns:
        `load_id`, `reference_kg`; and (loads, loads) their covariance, kg²: masses of one source
        share a part, loads with a mass in common all of it, whole masses the machine's own.

    Raises:
        CampaignError: the machine file does not know the empty mass, or its uncertainty.
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
        [[mass in campaign.on_board(load) for mass in campaign.masses] for load in ids], np.float64
    ).reshape(len(ids), count)
    values = np.array([mass.value_kg for mass in campaign.masses])
    reference_kg = on_board @ values
    covariance_kg2 = on_board @ mass_kg2 @ on_board.T
    if campaign.method.estimator != "joint_payload":
        if body.empty_mass_kg is None or body.empty_mass_u_kg is None:
            lacks = "empty_mass_kg" if body.empty_mass_kg is None else "empty_mass_u_kg"
            raise CampaignError(
                f"neither campaign nor machine file has machine.{lacks}, part of every reference; "
                'give it, or calibrate payload with method.estimator = "joint_payload"'
            )
        reference_kg = reference_kg + body.empty_mass_kg
        covariance_kg2 = covariance_kg2 + body.empty_mass_u_kg**2
    frame = pl.DataFrame(
        {"load_id": list(ids), "reference_kg": reference_kg},
        schema={"load_id": pl.String, "reference_kg": pl.Float64},
    )
    return frame, covariance_kg2

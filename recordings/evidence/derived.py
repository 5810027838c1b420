"""What evidence holds that follows from the campaign and machine files alone."""

import hashlib
from typing import Any

from analysis.calibration.campaign import CalibrationCampaign
from analysis.calibration.reference_masses import references
from analysis.machine import Machine
from recordings.evidence.canonical import canonical
from recordings.evidence.document import Estimator, ReferenceLoad


def estimator_of(campaign: CalibrationCampaign, machine: Machine) -> Estimator:
    """The estimator by name, and the digest of what defines it: channels, settings, priors.

    Args:
        campaign: its method.
        machine: with the priors that were learnt. When it was empty is no part of how it weighs.
    """
    defined = {"estimator": campaign.method.estimator, "machine": definition(machine)}
    return Estimator(
        name=campaign.method.estimator,
        definition_sha256=hashlib.sha256(canonical(defined)).hexdigest(),
    )


def definition(machine: Machine) -> dict[str, Any]:
    """Of a machine, what defines its mass, as plain values."""
    values = machine.model_dump(mode="json")
    del values["settings"]["loads"]
    return values


def reference_loads(
    campaign: CalibrationCampaign, machine: Machine
) -> tuple[tuple[ReferenceLoad, ...], tuple[tuple[float, ...], ...]]:
    """The references as they are kept, and their covariance."""
    known, covariance_kg2 = references(campaign, machine.machine)
    loads = tuple(
        ReferenceLoad(load_id=row["load_id"], reference_kg=row["reference_kg"], u_kg=float(v**0.5))
        for row, v in zip(known.to_dicts(), covariance_kg2.diagonal(), strict=True)
    )
    return loads, tuple(tuple(map(float, row)) for row in covariance_kg2)

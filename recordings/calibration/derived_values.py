"""What evidence holds that follows from the campaign and machine files alone."""

import hashlib
from collections.abc import Container, Iterator, Mapping
from typing import Any

from pydantic import BaseModel

from analysis.calibration.campaign.campaign_plan import CalibrationCampaign
from analysis.calibration.campaign.reference_masses import references
from analysis.model.machine import Machine
from recordings.calibration.canonical_json import canonical
from recordings.calibration.evidence_document import Estimator, ReferenceLoad


def estimator_of(
    campaign: CalibrationCampaign, machine: Machine, kept: Machine | None = None
) -> Estimator:
    """The estimator by name, and the digest of what defines it: channels, settings, priors.

    Args:
        campaign: its method.
        machine: with the priors that were learnt. When it was empty is no part of how it weighs.
        kept: the machine as earlier evidence has it, without settings that came later.
    """
    own = definition(machine)
    if kept is not None:
        own = _without(own, set(later_settings(kept)))
    defined = {"estimator": campaign.method.estimator, "machine": own}
    return Estimator(
        name=campaign.method.estimator,
        definition_sha256=hashlib.sha256(canonical(defined)).hexdigest(),
    )


def definition(machine: Machine) -> dict[str, Any]:
    """Of a machine, what defines its mass, as plain values."""
    values = machine.model_dump(mode="json")
    del values["settings"]["loads"]
    return values


def later_settings(kept: BaseModel, at: str = "") -> tuple[str, ...]:
    """Names of what came after evidence was made, and is taken at its default: dotted, in order.

    Args:
        kept: a part of the evidence.
        at: what its names begin with.
    """
    there = kept.model_dump(mode="json", exclude_unset=True)
    return tuple(_lacking(kept.model_dump(mode="json"), there, at))


def _lacking(whole: Mapping[str, Any], there: Mapping[str, Any], at: str = "") -> Iterator[str]:
    for name, value in whole.items():
        if name not in there:
            yield f"{at}{name}"
        elif isinstance(value, dict):
            yield from _lacking(value, there[name], f"{at}{name}.")


def _without(values: Mapping[str, Any], names: Container[str], at: str = "") -> dict[str, Any]:
    """The same without some names, dotted."""
    return {
        name: _without(value, names, f"{at}{name}.") if isinstance(value, dict) else value
        for name, value in values.items()
        if f"{at}{name}" not in names
    }


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

"""Compute values of evidence that follow only from campaign, machine file and previous line."""

import hashlib
import math
from collections.abc import Container, Mapping
from typing import Any, Final

import polars as pl

from analysis.calibration.campaign.campaign_fit import tabulate_reference_masses_and_covariance
from analysis.calibration.campaign.campaign_plan import CalibrationCampaign
from analysis.model.machine import Machine
from recordings.calibration.evidence_document import (
    FORMAT,
    AsFound,
    Estimator,
    EvidenceDocument,
    ReferenceLoad,
)
from recordings.signatures.canonical_json import encode_canonical_json

#: Keys of `[machine]` and stages of settings on which no mass depends, so that they are not part of
#: its definition.
_NO_PART_BODY: Final = ("id", "timezone", "empty_mass_day")
_NO_PART_STAGES: Final = ("loads", "planar")
#: Formats whose digest of the definition includes them, except the stage `loads`.
_WHOLE_FORMATS: Final = tuple(f"payscope-calibration-evidence/{number}" for number in (1, 2, 3))


def make_estimator_with_digest(
    campaign: CalibrationCampaign,
    machine: Machine,
    absent_settings: Container[str] = (),
    evidence_format: str = FORMAT,
) -> Estimator:
    """Make the estimator with the digest of its definition: channels, settings, priors.

    Args:
        campaign: campaign with its method.
        machine: machine with the learnt priors; the time span when it was empty does not count.
        absent_settings: dotted names of settings newer than the evidence.
        evidence_format: format of the evidence; earlier formats digest more settings.
    """
    own = (
        _select_mass_settings_up_to_format_3(machine)
        if evidence_format in _WHOLE_FORMATS
        else select_mass_defining_settings(machine)
    )
    if absent_settings:
        own = remove_dotted_names(own, absent_settings, "machine.")
    defined = {"estimator": campaign.method.estimator, "machine": own}
    return Estimator(
        name=campaign.method.estimator,
        definition_sha256=hashlib.sha256(encode_canonical_json(defined)).hexdigest(),
    )


def select_mass_defining_settings(machine: Machine) -> dict[str, Any]:
    """Select the settings of a machine that define its mass, as JSON-compatible values."""
    values = machine.model_dump(mode="json")
    for name in _NO_PART_BODY:
        values["machine"].pop(name, None)
    for stage in _NO_PART_STAGES:
        del values["settings"][stage]
    return values


def _select_mass_settings_up_to_format_3(machine: Machine) -> dict[str, Any]:
    """Select the definition of the mass in formats up to 3, which includes the time zone."""
    values = machine.model_dump(mode="json")
    values["machine"].pop("id", None)
    del values["settings"]["loads"]
    return values


def remove_dotted_names(
    values: Mapping[str, Any], dotted_names: Container[str], prefix: str = ""
) -> dict[str, Any]:
    """Copy a table of values without the entries with some dotted names."""
    return {
        name: remove_dotted_names(value, dotted_names, f"{prefix}{name}.")
        if isinstance(value, dict)
        else value
        for name, value in values.items()
        if f"{prefix}{name}" not in dotted_names
    }


def make_reference_loads_and_covariance(
    campaign: CalibrationCampaign, machine: Machine
) -> tuple[tuple[ReferenceLoad, ...], tuple[tuple[float, ...], ...]]:
    """Make the reference loads of the evidence, and their covariance in kg²."""
    known, covariance_kg2 = tabulate_reference_masses_and_covariance(campaign, machine.machine)
    loads = tuple(
        ReferenceLoad(load_id=row["load_id"], reference_kg=row["reference_kg"], u_kg=float(v**0.5))
        for row, v in zip(known.to_dicts(), covariance_kg2.diagonal(), strict=True)
    )
    return loads, tuple(tuple(map(float, row)) for row in covariance_kg2)


def evaluate_previous_line_as_found(
    previous_evidence: EvidenceDocument | None,
    previous_estimator: Estimator | None,
    estimator: Estimator,
    points: pl.DataFrame,
) -> AsFound | None:
    """Evaluate the previous line by its r.m.s. error on these points; None without such a line.

    Args:
        previous_evidence: previous evidence.
        previous_estimator: estimator of the previous evidence, digested by this version.
        estimator: estimator of this campaign; a line of another one does not apply.
        points: points of this campaign, a row per run.
    """
    if previous_evidence is None or previous_evidence.calibration is None:
        return None
    line = previous_evidence.calibration
    found = AsFound(
        evidence_id=previous_evidence.id,
        alpha_1=line.alpha_1,
        beta_kg=line.beta_kg,
        rms_error_kg=None,
    )
    if previous_estimator != estimator:
        return found
    return found.model_copy(update={"rms_error_kg": compute_rms_error_of_line_kg(found, points)})


def compute_rms_error_of_line_kg(line: AsFound, points: pl.DataFrame) -> float | None:
    """Compute the r.m.s. error in kg of the points' masses calibrated by this line."""
    errors = [
        line.alpha_1 * row["mean_kg"] + line.beta_kg - row["reference_kg"]
        for row in points.drop_nulls("mean_kg").iter_rows(named=True)
    ]
    return math.sqrt(sum(e * e for e in errors) / len(errors)) if errors else None

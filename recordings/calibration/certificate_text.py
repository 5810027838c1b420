"""Write the statements that ISO/IEC 17025:2017, 7.8 requires of a certificate, for the report."""

import datetime as dt
from collections.abc import Iterator, Mapping
from typing import Any, Final

import polars as pl

from recordings.calibration.evidence_document import EvidenceDocument

NOT_STATED: Final = "not stated"
_PLACES: Final = {
    "laboratory": "at the laboratory",
    "customer": "at the customer's",
    "other": "elsewhere",
}
#: Minimum capacity of R 51's classes, in scale intervals e. Source: schedule 1 of the United
#: Kingdom's Automatic Catchweighing Instruments Regulations 2003 (SI 2003/2761), after R 51.
_MIN_E: Final = {"OIML R 51 Y(a)": 20.0, "OIML R 51 Y(b)": 10.0}


def make_certificate_rows(document: EvidenceDocument) -> list[tuple[str, str]]:
    """Make the rows of page 1: customer, place, object, time and author, as (name, text)."""
    campaign = document.campaign
    about, machine = campaign.campaign, campaign.machine
    days = sorted(run.day for run in campaign.runs)
    work = f"{days[0]}" if days[0] == days[-1] else f"{days[0]} to {days[-1]}"
    kind = f" ({_PLACES[about.place_kind]})" if about.place_kind else ""
    replaced = f"{about.replaces}, because {about.replaces_reason}" if about.replaces else "nothing"
    return [
        ("identification", document.id),
        (
            "laboratory",
            NOT_STATED
            if campaign.laboratory is None
            else campaign.laboratory.name_and_address_line,
        ),
        (
            "customer",
            NOT_STATED if campaign.customer is None else campaign.customer.name_and_address_line,
        ),
        ("place of the work", f"{about.place}{kind}" if about.place else NOT_STATED),
        ("item", f"{document.machine.machine.name}, serial number {machine.id}"),
        ("make and model", f"{machine.make or NOT_STATED}, {machine.model or NOT_STATED}"),
        ("condition", machine.condition or NOT_STATED),
        *([("received", about.received.isoformat())] if about.received else []),
        ("work done", work),
        ("issued", document.made[:10]),
        ("authorised by", _format_person_and_function(about.authoriser, about.authoriser_function)),
        ("made by", _format_person_and_function(about.author, about.author_function)),
        ("deviations from the method", about.deviations or NOT_STATED),
        ("replaces", replaced),
        *make_run_condition_rows(document),
    ]


def _format_person_and_function(name: str, function: str) -> str:
    if not name:
        return NOT_STATED
    return f"{name}, {function or 'function ' + NOT_STATED}"


def make_run_condition_rows(document: EvidenceDocument) -> list[tuple[str, str]]:
    """Make the rows of the runs' conditions, each with all values that occur, as (name, text)."""
    shown = {
        "temperature_degC": ("air temperature", "{:g} °C"),
        "slope_deg": ("slope of the ground", "{:g}°"),
        "surface": ("surface", "{}"),
        "tyres": ("tyres", "{}"),
        "fuel": ("fuel", "{}"),
    }
    campaign = document.campaign
    runs = [campaign.fill_run_conditions_from_campaign(run) for run in campaign.runs]
    found: list[tuple[str, str]] = []
    for key, (name, form) in shown.items():
        said = [each[key] for each in runs]
        texts = [NOT_STATED if value in ("", None) else form.format(value) for value in said]
        found.append((name, "; ".join(dict.fromkeys(texts))))
    return found


def make_traceability_warnings(document: EvidenceDocument) -> list[str]:
    """Make a warning about references that are not traceable, if there are any."""
    untraceable = document.campaign.untraceable_references_text
    return [f"NOT TRACEABLE: {'; '.join(untraceable)}."] if untraceable else []


def describe_missing_certificate_statements(document: EvidenceDocument) -> list[str]:
    """Say which required statements of a certificate the campaign file lacks; empty if none."""
    keys = document.campaign.missing_certificate_entries
    if not keys:
        return []
    return [f"Not stated, and ISO/IEC 17025, 7.8 asks for it: {', '.join(keys)}."]


def make_weighing_rows(
    document: EvidenceDocument, readings: pl.DataFrame
) -> list[Mapping[str, Any]]:
    """Make a row for each load: number of weighings, mean error and standard deviation in kg.

    The limit applies to a single error: categories Y of R 51 and classes of R 134 do not limit mean
    or standard deviation (R 51 does so for category X, which checks packages).
    """
    fitted, limits = document.calibration, document.limits
    if fitted is None:
        return []
    allowed = {} if limits is None else {row.load_id: row.limit_kg for row in limits.rows}
    references = {each.load_id: each.reference_kg for each in document.references}
    found: list[Mapping[str, Any]] = []
    for load_id in document.campaign.load_ids:
        used = readings.filter((pl.col("load_id") == load_id) & pl.col("used"))["mass_kg"]
        masses = [m for m in used.to_list() if m is not None]
        if not masses:
            continue
        errors = [fitted.alpha_1 * m + fitted.beta_kg - references[load_id] for m in masses]
        mean = sum(errors) / len(errors)
        many = len(errors) > 1
        std = (sum((e - mean) ** 2 for e in errors) / (len(errors) - 1)) ** 0.5 if many else None
        limit = allowed.get(load_id)
        kept = 0 if limit is None else sum(abs(error) <= limit for error in errors)
        found.append(
            {
                "load": load_id,
                "count": len(errors),
                "mean_kg": mean,
                "std_kg": std,
                "largest_kg": max(errors, key=abs),
                "limit_kg": limit,
                "within": "–" if limit is None else f"{kept} of {len(errors)}",
            }
        )
    return found


def iter_accuracy_class_sentences(document: EvidenceDocument) -> Iterator[str]:
    """Yield sentences on Max and Min of an accuracy class, and on what its limits apply to."""
    limits = document.limits
    if limits is None:
        return
    name, e_kg = limits.rule.accuracy_class, limits.rule.scale_interval_kg
    loads = [row.load_kg for row in limits.rows if row.load_kg > 0.0]
    if name in _MIN_E and e_kg is not None and loads:
        low_kg = _MIN_E[name] * e_kg
        below = [f"{load:g} kg" for load in loads if load < low_kg]
        less = f" Below it: {', '.join(below)}." if below else ""
        yield (
            f"Max, the heaviest load that was judged: {max(loads):,.1f} kg. Min of {name}, "
            f"{_MIN_E[name]:g} e: {low_kg:,.1f} kg.{less}"
        )
    yield (
        f"The limits of {name} are of each single error; it has none of a mean or of a standard "
        "deviation."
    )
    rule = limits.rule
    yield (
        "Decision rule (JCGM 106, guarded acceptance by specific risk): 'within limits' if a later "
        f"mass exceeds the limits with a probability of at most {rule.risk_1:g}; 'outside limits' "
        f"if it keeps them with a probability of at most {rule.risk_1:g}; otherwise 'undecided'."
    )


def read_certificate_issue_day(document: EvidenceDocument) -> dt.date:
    """Read the day of issue of the certificate: that on which the evidence was made."""
    return dt.date.fromisoformat(document.made[:10])

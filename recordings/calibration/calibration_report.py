"""Render the report of a bundle: one page for readers, made only from the evidence.

The same evidence gives the same bytes, so that `verify` can make the page again and compare. The
page has no script, and its policy forbids loading anything.
"""

import datetime as dt
import math
from collections.abc import Callable, Mapping
from functools import cache
from importlib.resources import files
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import polars as pl

from analysis.calibration.campaign.campaign_subjects import ReferenceMass
from analysis.calibration.line.calibration import Calibration
from recordings.calibration.calibration_plots import draw_report_pictures
from recordings.calibration.calibration_text import (
    ESTIMATORS,
    describe_undetectable_faults,
    write_report_paragraphs,
)
from recordings.calibration.campaign_faults import select_runs_without_date
from recordings.calibration.certificate_text import (
    describe_missing_certificate_statements,
    iter_accuracy_class_sentences,
    make_certificate_rows,
    make_traceability_warnings,
    make_weighing_rows,
)
from recordings.calibration.evidence_document import EvidenceDocument
from recordings.calibration.learnt_terms_text import make_learnt_term_rows
from recordings.report.svg_shapes import WIDTH

if TYPE_CHECKING:
    from jinja2 import Template

TEMPLATE: Final = "report.html.j2"
_NONE: Final = "–"


def render_report_html(
    document: EvidenceDocument, readings: pl.DataFrame, points: pl.DataFrame
) -> str:
    """Render the report as HTML.

    Args:
        document: the evidence; all its texts are escaped.
        readings: frame `readings`.
        points: frame of the points, a row per run.
    """
    return load_report_template().render(
        e=document,
        fitted=document.calibration,
        title=make_report_title(document),
        facts=list_report_names_and_values(document),
        certificate=make_certificate_rows(document),
        warnings=make_traceability_warnings(document),
        not_stated=describe_missing_certificate_statements(document),
        weighings=make_weighing_rows(document, readings),
        accuracy_class_sentences=list(iter_accuracy_class_sentences(document)),
        words=write_report_paragraphs(document, readings, points),
        unseen=describe_undetectable_faults(document),
        pictures=draw_report_pictures(document, readings),
        width=WIDTH,
        points=_make_calibration_point_rows(points),
        rejected=_make_rejected_reading_rows(readings),
        budget=_make_budget_rows(document.calibration),
        learnt=make_learnt_term_rows(document.learnt),
        references=_make_reference_mass_rows(document),
        runs=_make_campaign_run_rows(document, readings),
        estimator=ESTIMATORS.get(document.estimator.name, document.estimator.name),
    )


@cache
def load_report_template() -> "Template":
    """Load and compile the template of the page."""
    from jinja2 import Environment, StrictUndefined

    environment = Environment(
        undefined=StrictUndefined, autoescape=True, trim_blocks=True, lstrip_blocks=True
    )
    environment.filters["kg"] = format_kilograms_or_dash
    source = files("recordings.calibration").joinpath(TEMPLATE).read_text(encoding="utf-8")
    return environment.from_string(source)


def write_report_pdf(html: str, path: Path) -> str:
    """Write the report as a PDF.

    Returns:
        Why there is no PDF (WeasyPrint or its system library is missing); "" if it is written.
    """
    try:
        from weasyprint import HTML
    except ImportError:
        return "no PDF: WeasyPrint is not installed (pip install 'payscope[pdf]')"
    except OSError as error:
        missing = str(error).splitlines()[0]
        return (
            f"no PDF: WeasyPrint lacks a system library ({missing}); "
            "on Debian libpangoft2-1.0-0, libharfbuzz-subset0"
        )
    HTML(string=html, url_fetcher=_refuse_external_resource).write_pdf(path)
    return ""


def make_report_title(document: EvidenceDocument) -> str:
    """Make the heading of the report."""
    what = "Calibration" if document.kind == "calibration" else "Check"
    name = document.campaign.campaign.title
    return name or f"{what} of {document.machine.machine.name} {document.campaign.machine.id}"


def list_report_names_and_values(document: EvidenceDocument) -> list[tuple[str, str]]:
    """List the key facts of the report as (name, value)."""
    fitted = document.calibration
    found: list[tuple[str, str]] = []
    if fitted is not None:
        low, high = fitted.range_kg
        at_kg, readings = fitted.budget_at
        found += [
            ("α", _format_value_with_interval(fitted.alpha_1, fitted.alpha_interval_1, "{:.4f}")),
            (
                "β",
                _format_value_with_interval(fitted.beta_kg, fitted.beta_interval_kg, "{:,.1f}")
                + " kg",
            ),
            ("valid for", f"{low:,.1f} to {high:,.1f} kg"),
            (
                "expanded uncertainty",
                f"{fitted.coverage_k_1 * fitted.u_kg:,.1f} kg at {at_kg:,.0f} kg (k = "
                f"{fitted.coverage_k_1:.2f}, {fitted.confidence_1:.0%}, mean of {readings} "
                "readings)",
            ),
            (
                "error, in the fit / load left out",
                f"{format_kilograms_or_dash(fitted.rms_error_kg)} / "
                f"{format_kilograms_or_dash(fitted.rms_error_left_out_kg)} kg r.m.s.",
            ),
            (
                "repeatability of a reading",
                format_scatter_in_calibrated_kg(fitted.repeatability_kg, fitted),
            ),
            ("day to day", format_scatter_in_calibrated_kg(fitted.day_kg, fitted)),
        ]
    found += [
        ("expires", document.expires.isoformat()),
        ("made", document.made.replace("T", " ").replace("Z", " UTC")),
    ]
    return found


def format_kilograms_or_dash(mass_kg: float | None, digits: int = 1) -> str:
    """Format a number of kg; a dash if it is None or not finite."""
    return _NONE if mass_kg is None or not math.isfinite(mass_kg) else f"{mass_kg:,.{digits}f}"


def _format_value_with_interval(
    value: float, interval: tuple[float | None, float | None], number_format: str
) -> str:
    low, high = interval
    if low is None or high is None:
        return f"{number_format.format(value)} (no bounded interval)"
    shown, least, most = (number_format.format(each) for each in (value, low, high))
    return f"{shown} ({least} to {most})"


def format_scatter_in_calibrated_kg(scatter_kg: float | None, calibration: Calibration) -> str:
    """Format the scatter of estimates in kg of calibrated mass: divided by the line's slope."""
    return (
        "unknown"
        if scatter_kg is None
        else f"{format_kilograms_or_dash(scatter_kg / abs(calibration.c1_1))} kg"
    )


def _make_calibration_point_rows(points: pl.DataFrame) -> list[Mapping[str, Any]]:
    return [
        {
            "run": point["run_id"],
            "load": point["load_id"],
            "cells": [
                format_kilograms_or_dash(point["reference_kg"]),
                str(point["readings"]),
                str(point["rejected"]),
                *(
                    format_kilograms_or_dash(point[n])
                    for n in ("mean_kg", "std_kg", "calibrated_kg")
                ),
                *(format_kilograms_or_dash(point[n], 2) for n in ("error_kg", "error_left_out_kg")),
            ],
        }
        for point in points.iter_rows(named=True)
    ]


def _make_rejected_reading_rows(readings: pl.DataFrame) -> list[Mapping[str, Any]]:
    return [
        {**row, "mass": format_kilograms_or_dash(row["mass_kg"])}
        for row in readings.filter(~pl.col("used")).iter_rows(named=True)
    ]


def _make_budget_rows(calibration: Calibration | None) -> list[Mapping[str, Any]]:
    if calibration is None:
        return []
    return [
        {
            "component": row.component,
            "kind": row.kind,
            "u": format_kilograms_or_dash(row.u_kg, 2),
            "freedom": _NONE if row.freedom is None else f"{row.freedom:.1f}",
            "known": row.known,
        }
        for row in calibration.budget
    ]


def _make_reference_mass_rows(document: EvidenceDocument) -> list[Mapping[str, Any]]:
    def format_day(value: dt.date | None) -> str:
        return _NONE if value is None else value.isoformat()

    rows: list[Mapping[str, Any]] = [
        {
            "id": mass.id,
            "value": format_kilograms_or_dash(mass.value_kg, 3),
            "u": format_kilograms_or_dash(mass.u_kg, 3),
            "certificate": _describe_mass_certificate(mass),
            "issuer": mass.certificate_issuer or _NONE,
            "expires": format_day(mass.expires),
            "shared": f"{mass.source}: {format_kilograms_or_dash(mass.shared_u_kg, 3)} kg"
            if mass.source
            else "",
        }
        for mass in document.campaign.masses
    ]
    body, about = document.machine.machine, document.campaign.machine
    if document.campaign.method.estimator != "joint_payload":
        machine = {
            "id": "machine, empty",
            "value": format_kilograms_or_dash(body.empty_mass_kg, 3),
            "u": format_kilograms_or_dash(body.empty_mass_u_kg, 3),
            "certificate": about.empty_certificate or "none named",
            "issuer": _NONE,
            "expires": format_day(about.empty_expires),
            "shared": "every load",
        }
        rows.insert(0, machine)
    return rows


def _describe_mass_certificate(reference_mass: ReferenceMass) -> str:
    """Describe a mass's certificate or source; for a digital certificate also its signer."""
    if reference_mass.stated_by:
        return f"stated by the {reference_mass.stated_by}"
    signed = (
        f" ({reference_mass.certificate_signature})" if reference_mass.certificate_signature else ""
    )
    digest = (
        f", SHA-256 {reference_mass.certificate_sha256[:16]}…"
        if reference_mass.certificate_sha256
        else ""
    )
    return f"{reference_mass.certificate or 'none named'}{signed}{digest}"


def _make_campaign_run_rows(
    document: EvidenceDocument, readings: pl.DataFrame
) -> list[Mapping[str, Any]]:
    counts = {
        row["run_id"]: row
        for row in readings.group_by("run_id")
        .agg(used=pl.col("used").sum(), all=pl.col("mass_kg").is_not_null().sum())
        .iter_rows(named=True)
    }
    found: list[Mapping[str, Any]] = []
    undated = select_runs_without_date(document)
    for run in document.campaign.runs:
        start = "start" if run.from_s is None else f"{run.from_s:g} s"
        end = "end" if run.to_s is None else f"{run.to_s:g} s"
        whole = run.from_s is None and run.to_s is None
        count = counts.get(run.id, {"used": 0, "all": 0})
        conditions = run.conditions
        said: dict[str, Callable[[], str]] = {
            "slope": lambda c=conditions: "" if c.slope_deg is None else f"{c.slope_deg:g}°",
            "surface": lambda c=conditions: c.surface,
            "tyres": lambda c=conditions: c.tyres,
            "fuel": lambda c=conditions: c.fuel,
            "air": lambda c=conditions: (
                "" if c.temperature_degC is None else f"{c.temperature_degC:g} °C"
            ),
            "note": lambda c=conditions: c.note,
        }
        found.append(
            {
                "id": run.id,
                "stretch": run.log if whole else f"{run.log}, {start} to {end}",
                "load": run.load_id,
                "day": f"{run.day}{' (stated, not provable)' if run in undated else ''}",
                "operator": run.operator or _NONE,
                "conditions": ", ".join(f"{k} {text()}" for k, text in said.items() if text()),
                "used": f"{count['used']} of {count['all']}",
                "excluded": run.excluded,
            }
        )
    return found


def _refuse_external_resource(url: str, *_: Any, **__: Any) -> Any:
    """Raise an error for any external resource that the page would load."""
    raise ValueError(f"a report must be self-contained; refused to load {url[:80]}")

"""Recompute everything in a bundle that follows from its other contents, and compare."""

import datetime as dt
import warnings
from collections.abc import Callable, Iterable, Iterator
from typing import Any, Final, NamedTuple

import polars as pl
from pydantic_core import to_jsonable_python

from analysis.calibration.campaign.campaign_fit import (
    CampaignFit,
    check_single_load_by_calibration,
    fit_campaign_line,
    make_calibration_options,
)
from analysis.calibration.campaign.campaign_plan import CampaignRun
from analysis.calibration.use.calibration_drift import DriftCheck
from analysis.calibration.use.error_limits import WITHIN
from analysis.calibration.use.learnt_priors import pool_learnt_terms_over_logs
from estimators.errors import CampaignError
from recordings.calibration.bundle_folder import EVIDENCE, POINTS, READINGS, REPORT
from recordings.calibration.bundle_limits import LIMITS
from recordings.calibration.calibration_report import render_report_html
from recordings.calibration.campaign_faults import (
    iter_machine_id_contradictions,
    iter_repeated_run_sentences,
    iter_sentences_on_run_days_unlike_logs,
    parse_creation_time,
)
from recordings.calibration.check_outcomes import BundleFinding, BundleOutcome
from recordings.calibration.derived_values import (
    compute_rms_error_of_line_kg,
    make_estimator_with_digest,
    make_reference_loads_and_covariance,
)
from recordings.calibration.evidence_document import EvidenceDocument

_LATER: Final = "made before {} existed: the first default of that setting is used"
_NOTHING: Final = (None, "", [], {}, ())

Findings = Iterator[BundleFinding]


class RecomputationResult(NamedTuple):
    """Findings of a recomputation, and notes on what was not compared."""

    findings: list[BundleFinding]
    notes: list[str]


def compare_bundle_with_recomputed(
    document: EvidenceDocument,
    readings: pl.DataFrame,
    points: pl.DataFrame | None,
    report_html: bytes | None,
) -> RecomputationResult:
    """Recompute the values in a bundle that follow from its other contents, and compare them.

    Args:
        document: the evidence.
        readings: frame `readings`.
        points: frame of the points; None if unreadable.
        report_html: content of the page; None without one.

    Returns:
        Differences, and notes for the reader.
    """
    # a setting that is None by default had no influence on the mass
    named = [
        f"{name} = {value}"
        for name, value in document.settings_at_default.items()
        if value not in _NOTHING
    ]
    notes = [_LATER.format(", ".join(named))] if named else []
    found: list[BundleFinding] = []
    steps: tuple[tuple[str, Callable[[], Iterable[BundleFinding]]], ...] = (
        (EVIDENCE, lambda: iter_evidence_values_unlike_campaign(document)),
        (READINGS, lambda: check_runs_and_readings(document, readings)),
        (
            f"{EVIDENCE}: calibration",
            lambda: compare_fit_with_refitted(document, readings, points, notes),
        ),
        (REPORT, lambda: compare_report_with_rerendered(document, readings, points, report_html)),
    )
    for item, step in steps:
        found += _run_step_and_catch_failure(item, step)
    found += find_exceeded_campaign_limits(document)
    return RecomputationResult(found, notes)


def _run_step_and_catch_failure(
    item_name: str, iter_findings: Callable[[], Iterable[BundleFinding]]
) -> list[BundleFinding]:
    """Run a step of the recomputation and collect its findings; a failure is a finding as well."""
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            return list(iter_findings())
    except Exception as fault:  # noqa: BLE001  the numbers are untrusted
        said = str(fault)[: LIMITS.fault_characters]
        what = f"cannot be recomputed ({type(fault).__name__}: {said})"
        return [BundleFinding(BundleOutcome.IRREPRODUCIBLE, item_name, what)]


def compare_report_with_rerendered(
    document: EvidenceDocument,
    readings: pl.DataFrame,
    points: pl.DataFrame | None,
    report_html: bytes | None,
) -> Findings:
    """Compare the report with one made from the evidence, byte by byte."""
    if report_html is None or points is None:
        return
    if render_report_html(document, readings, points).encode() == report_html:
        return
    if document.other_payscope_version:
        what = (
            f"made by {document.other_payscope_version}: the page cannot be recomputed here, so "
            "only its digest was compared"
        )
        yield BundleFinding(BundleOutcome.OTHER_VERSION, REPORT, what)
    else:
        yield BundleFinding(
            BundleOutcome.TAMPERED, REPORT, "differs from the page made from the evidence"
        )


class JsonDifference(NamedTuple):
    """Place where two JSON values differ."""

    dotted_path: str
    is_only_rounding: bool


def find_differing_json_values(
    stored: Any, computed: Any, dotted_path: str = ""
) -> list[JsonDifference]:
    """Find the places where two JSON values differ, and whether only by rounding."""
    if isinstance(stored, dict) and isinstance(computed, dict):
        found: list[JsonDifference] = []
        for name in sorted(set(stored) | set(computed)):
            inside = f"{dotted_path}.{name}" if dotted_path else name
            if name not in stored or name not in computed:
                found.append(JsonDifference(inside, is_only_rounding=False))
            else:
                found += find_differing_json_values(stored[name], computed[name], inside)
        return found
    if isinstance(stored, list | tuple) and isinstance(computed, list | tuple):
        if len(stored) != len(computed):
            return [JsonDifference(dotted_path, is_only_rounding=False)]
        pairs = zip(stored, computed, strict=True)
        return [
            each
            for k, pair in enumerate(pairs)
            for each in find_differing_json_values(*pair, f"{dotted_path}.{k}")
        ]
    if stored == computed and isinstance(stored, bool) == isinstance(computed, bool):
        return []
    return [JsonDifference(dotted_path, do_numbers_differ_only_by_rounding(stored, computed))]


def do_numbers_differ_only_by_rounding(stored: Any, computed: Any) -> bool:
    """Whether two numbers differ only in their last bits."""
    if not all(type(value) in (int, float) for value in (stored, computed)):
        return False
    return abs(stored - computed) <= LIMITS.last_bits_1 * max(abs(stored), abs(computed))


def _make_irreproducible_finding(item_name: str, difference: str) -> BundleFinding:
    return BundleFinding(BundleOutcome.IRREPRODUCIBLE, f"{EVIDENCE}: {item_name}", difference)


def iter_evidence_values_unlike_campaign(document: EvidenceDocument) -> Findings:
    """Yield findings on values that do not follow from campaign and machine file."""
    campaign, machine = document.campaign, document.machine
    if document.kind == "calibration" and document.expires != campaign.last_valid_day:
        yield _make_irreproducible_finding(
            "expires", f"is not {campaign.last_valid_day}, which follows from the days of the runs"
        )
    made, now = parse_creation_time(document), dt.datetime.now(dt.UTC)
    for fault in iter_sentences_on_run_days_unlike_logs(
        campaign, document.logs, machine.machine.time_zone, made
    ):
        yield _make_irreproducible_finding("campaign.runs", fault)
    if made > now + dt.timedelta(seconds=LIMITS.clock_difference_s):
        yield _make_irreproducible_finding(
            "made", f"is in the future: {document.made}, but now it is {now:%F %R}"
        )
    for fault in iter_machine_id_contradictions(campaign.machine.id, machine, document.logs):
        yield _make_irreproducible_finding("campaign.machine.id", fault)
    yield from compare_learnt_priors_with_pooled(document)
    if document.estimator != make_estimator_with_digest(
        campaign, document.weighing_machine, document.settings_at_default, document.format
    ):
        yield _make_irreproducible_finding("estimator", "does not match the settings")
    try:
        loads, covariance = make_reference_loads_and_covariance(campaign, machine)
    except CampaignError as fault:
        yield _make_irreproducible_finding("references", str(fault))
        return
    if document.references != loads:
        yield _make_irreproducible_finding("references", "are not the sums of the masses on board")
    if document.reference_covariance_kg2 != covariance:
        yield _make_irreproducible_finding(
            "reference_covariance_kg2", "does not follow from the masses"
        )
    own = {each.component for each in campaign.method.stated}
    others = tuple(each for each in document.options.stated if each.component not in own)
    if document.options != make_calibration_options(campaign, others):
        yield _make_irreproducible_finding("options", "do not match the campaign's method")
    for overdue in campaign.describe_invalid_certificates():
        yield BundleFinding(BundleOutcome.INCOMPLETE, f"{EVIDENCE}: campaign.masses", overdue)
    if tuple(log.log for log in document.logs) != campaign.log_names:
        yield BundleFinding(
            BundleOutcome.INCOMPLETE, f"{EVIDENCE}: logs", "are not the logs of the campaign's runs"
        )


def compare_learnt_priors_with_pooled(document: EvidenceDocument) -> Findings:
    """Compare the learnt priors with those pooled from the logs."""
    learnt, campaign = document.learnt, document.campaign
    if learnt is None:
        return
    if not campaign.learns_priors:
        yield _make_irreproducible_finding(
            "learnt", "is present, although the campaign learns no priors"
        )
    pooled = pool_learnt_terms_over_logs(learnt.logs, document.procedure_rules)
    stored, computed = (
        {name: term.model_dump() for name, term in terms.items()}
        for terms in (learnt.terms, pooled)
    )
    if not all(near for _, near in find_differing_json_values(stored, computed)):
        yield _make_irreproducible_finding("learnt", "does not follow from its logs")
    if len({(each.log, each.term) for each in learnt.logs}) < len(learnt.logs):
        yield _make_irreproducible_finding("learnt", "lists a term of one log twice")
    said = {each.log for each in learnt.logs}
    if document.kind == "calibration" and not said <= set(campaign.log_names):
        yield _make_irreproducible_finding("learnt", "belongs to other logs than the campaign's")


def check_runs_and_readings(document: EvidenceDocument, readings: pl.DataFrame) -> Findings:
    """Check that each run is present, with a reason for every unused reading."""
    runs = {run.id: run for run in document.campaign.runs}
    weighs = {log.log: log.can_weigh for log in document.logs}
    seen: dict[str, int] = {}
    for row in readings.iter_rows(named=True):
        name = row["run_id"]
        seen[name] = seen.get(name, 0) + 1
        item = f"{READINGS}: run '{name}', reading {row['reading']}"
        run = runs.get(name)
        if run is None:
            yield BundleFinding(BundleOutcome.TAMPERED, item, "belongs to no run of the campaign")
            continue
        for what in _iter_sentences_on_reading_unlike_run(
            row, run, seen[name], weighs.get(run.log, False)
        ):
            yield BundleFinding(BundleOutcome.IRREPRODUCIBLE, item, what)
        if not row["used"] and not row["reason"]:
            yield BundleFinding(BundleOutcome.INCOMPLETE, item, "is left out without a reason")
    for name in runs:
        if name not in seen:
            yield BundleFinding(BundleOutcome.INCOMPLETE, f"{READINGS}: run '{name}'", "is missing")
    for fault in iter_repeated_run_sentences(document.campaign, document.logs, readings):
        yield _make_irreproducible_finding("campaign.runs", fault)


def _iter_sentences_on_reading_unlike_run(
    reading_row: dict[str, Any], run: CampaignRun, reading_number: int, is_run_weighing: bool
) -> Iterator[str]:
    """Yield contradictions between a reading and its run."""
    about = (reading_row["load_id"], reading_row["day"], reading_row["log"])
    if about != (run.load_id, run.day.isoformat(), run.log):
        yield "belongs to another load, day or log than its run"
    if reading_row["reading"] != reading_number:
        yield (
            f"should be reading {reading_number} of its run: a reading is missing, or the readings "
            "are out of order"
        )
    if reading_row["used"] is None or reading_row["reason"] is None:
        yield "does not state whether it is used, or why it is not"
        return
    if reading_row["mass_kg"] is None:
        if reading_row["used"]:
            yield "is used, but has no mass"
    elif (
        reading_row["start_s"] is None
        or reading_row["end_s"] is None
        or not reading_row["start_s"] < reading_row["end_s"]
    ):
        yield "has no valid start and end"
    elif not run.contains_middle_of_span(reading_row["start_s"], reading_row["end_s"]):
        yield "is outside the time span of its run"
    if reading_row["used"] and reading_row["reason"]:
        yield "is used, but has a reason for its exclusion"
    if reading_row["used"] and run.excluded:
        yield "is used, although its run is excluded"
    if reading_row["used"] and not is_run_weighing:
        yield "is used, although its log cannot weigh"


def compare_fit_with_refitted(
    document: EvidenceDocument,
    readings: pl.DataFrame,
    points: pl.DataFrame | None,
    notes: list[str],
) -> Findings:
    """Compare fit, budget, verdict and points with the results of a new fit to the readings."""
    fitted, drift = _refit_campaign_or_mass_check(document, readings)
    stored = document.calibration
    pairs: tuple[tuple[str, Any, Any], ...] = (
        (
            "calibration",
            _convert_dataclass_to_json(stored),
            _convert_dataclass_to_json(fitted.calibration),
        ),
        ("no_fit", document.no_fit, fitted.no_fit),
        (
            "limits",
            _convert_dataclass_to_json(document.limits),
            _convert_dataclass_to_json(fitted.limits),
        ),
        ("drift", _convert_dataclass_to_json(document.drift), _convert_dataclass_to_json(drift)),
    )
    places = [
        each
        for name, kept, computed in pairs
        for each in find_differing_json_values(kept, computed, name)
    ]
    wrong = [place for place, near in places if not near]
    for place in wrong[: LIMITS.max_differences]:
        yield _make_irreproducible_finding(place, "does not follow from the readings")
    if len(wrong) > LIMITS.max_differences:
        yield _make_irreproducible_finding(
            "calibration", f"and {len(wrong) - LIMITS.max_differences} more"
        )
    if places and not wrong:
        notes.append(
            f"{len(places)} numbers of the fit differ in their last bits: another processor or "
            f"library (made with payscope {document.software.payscope}, "
            f"{document.software.platform})"
        )
    if points is not None and (wrong or not places) and not points.equals(fitted.point_frame):
        yield BundleFinding(
            BundleOutcome.IRREPRODUCIBLE, POINTS, "does not follow from the readings"
        )
    yield from compare_errors_of_previous_line(document, fitted.point_frame)


class _RefittedCampaign(NamedTuple):
    """Fit of a campaign, and the drift of a single-mass check."""

    fit: CampaignFit
    drift: DriftCheck | None


def _refit_campaign_or_mass_check(
    document: EvidenceDocument, readings: pl.DataFrame
) -> _RefittedCampaign:
    """Fit the readings again; for a single-mass check, compare them with the calibration's line."""
    campaign, body = document.campaign, document.machine.machine
    if document.kind == "check" and document.calibration is not None:
        return _RefittedCampaign(
            *check_single_load_by_calibration(campaign, body, readings, document.calibration)
        )
    responses = () if document.learnt is None else document.learnt.responses
    fit = fit_campaign_line(campaign, body, readings, document.options, responses)
    return _RefittedCampaign(fit, None)


def _convert_dataclass_to_json(value: Any) -> Any:
    """Convert a dataclass to JSON-compatible values; None stays None."""
    return None if value is None else to_jsonable_python(value)


def find_exceeded_campaign_limits(document: EvidenceDocument) -> Findings:
    """Yield findings on limits or drift that the evidence itself reports as exceeded."""
    limits, drift = document.limits, document.drift
    if limits is not None and limits.verdict != WITHIN:
        yield BundleFinding(BundleOutcome.OUTSIDE, f"{EVIDENCE}: limits", limits.statement)
    if drift is not None and drift.drifted is not False:
        what = (
            f"cannot be decided: {drift.reason}"
            if drift.drifted is None
            else f"the machine has drifted, by {drift.difference_kg:+.4g} kg"
        )
        yield BundleFinding(BundleOutcome.OUTSIDE, f"{EVIDENCE}: drift", what)


def compare_errors_of_previous_line(document: EvidenceDocument, points: pl.DataFrame) -> Findings:
    """Compare the previous line's errors on these points."""
    found = document.as_found
    if found is not None and found.rms_error_kg is not None:
        computed = compute_rms_error_of_line_kg(found, points)
        if find_differing_json_values(found.rms_error_kg, computed) not in ([], [("", True)]):
            yield _make_irreproducible_finding(
                "as_found.rms_error_kg", "does not follow from the points"
            )

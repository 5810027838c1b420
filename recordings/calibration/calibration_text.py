"""Write the sentences of a calibration report."""

import math
from collections.abc import Iterator
from typing import Final

import polars as pl

from analysis.calibration.line.calibration import Calibration
from analysis.calibration.line.calibration_budget import NextLoad, rank_loads_for_next_run
from analysis.calibration.line.outliers import find_runs_with_swapped_loads
from estimators.errors import format_count, join_first_names
from recordings.calibration.bundle_limits import LIMITS
from recordings.calibration.campaign_faults import (
    list_logs_without_machine_id,
    select_runs_without_date,
)
from recordings.calibration.evidence_document import EvidenceDocument
from recordings.calibration.learnt_terms_text import RUNS, TERMS

ESTIMATORS: Final = {
    "joint_mass": "mass by the joint fit, of machine and load",
    "joint_payload": "payload by the joint fit, as a difference to runs without load",
    "pooled": "pooled least squares of a manoeuvre",
}

_NO_CONFORMITY: Final = (
    "This is a comparison with the limits of a class, not a statement of conformity with the "
    "recommendation, whose other tests were not made."
)

_UNLISTED: Final = (
    "A run that was left out before the campaign file was written and signed: nothing in a bundle "
    "shows that it was ever made. Compare with the machine's own list of logs (payscope notarise)."
)
_UNSEEN: Final = (
    "Whether the loads that the campaign file names were on board, and whether the certificates "
    "are genuine.",
    "Whether the machine has changed since: tyres, sensors, bucket, firmware. A check against one "
    "known mass (payscope calibrate --check) shows some of that.",
    "Whoever has the signing key can make all of this again: a signature is only as trustworthy "
    "as the protection of its key.",
)


def write_report_paragraphs(
    document: EvidenceDocument, readings: pl.DataFrame, points: pl.DataFrame
) -> list[str]:
    """Write the paragraphs that explain the numbers."""
    fitted = document.calibration
    found: list[str] = []
    if fitted is None:
        found += _describe_campaign_without_line(document, readings, points)
    else:
        found += [
            *_describe_limits_and_drift(document),
            describe_calibration_offset(fitted),
            *(f"{_capitalise_first_letter(said)}." for said in fitted.says),
            *_describe_learnt_priors(document),
        ]
        if document.kind == "calibration":
            found += [
                *describe_one_day_limits(document),
                *describe_driving_unlike_campaign(fitted),
                describe_next_load(rank_loads_for_next_run(fitted)[0]),
            ]
    if document.kind == "calibration":
        found += [
            *describe_previous_line_as_found(document),
            *_describe_logs_of_notary_list(document),
        ]
    return found


def describe_runs_with_swapped_loads(document: EvidenceDocument) -> list[str]:
    """Name two runs that would fit the line with their loads swapped; empty if none would."""
    if document.kind != "calibration" or document.calibration is None:
        return []
    found = find_runs_with_swapped_loads(document.calibration)
    return [] if found is None else [str(found)]


def describe_undetectable_faults(document: EvidenceDocument) -> list[str]:
    """Describe the faults that no check of a bundle can find, a sentence each."""
    first = (
        ("Whether this machine has earlier evidence: this bundle names none before it.",)
        if document.chain.previous is None
        else ()
    )
    later = (
        f"Whether later evidence of this machine exists: this is number {document.chain.counter}, "
        "and whoever holds a later one may keep it back. Ask for all of it.",
    )
    undated = [run.id for run in select_runs_without_date(document)]
    days = (
        (
            f"On which day these runs were made: {', '.join(undated)}. Their logs have no "
            "absolute time; the day is not provable, only the campaign file states it.",
        )
        if undated
        else ()
    )
    return [
        _describe_runs_possibly_left_out(document),
        *_UNSEEN,
        *_describe_recording_machine(document),
        *first,
        *later,
        *days,
    ]


def _describe_runs_possibly_left_out(document: EvidenceDocument) -> str:
    """Say in a sentence which runs may have been left out undetected."""
    stretch = document.campaign.notary
    if stretch is None:
        return _UNLISTED
    return (
        f"A run that the recorder's list does not have between number {stretch.first} and "
        f"{stretch.last}: by a second recorder, of a file that was deleted before it ended or "
        "before the notary looked, before the first or after the last number; or a list that "
        "whoever has a copy of the notary's key wrote anew."
    )


def _describe_logs_of_notary_list(document: EvidenceDocument) -> list[str]:
    """Describe which logs of the recorder's notary list the campaign uses and omits."""
    stretch = document.campaign.notary
    if stretch is None:
        return []
    reasons = "; ".join(f"{each.number}: {each.reason}" for each in stretch.left_out)
    left_out = f" Left out: {reasons}." if reasons else " None is left out."
    return [
        f"The recorder's list has {format_count(stretch.last - stretch.first + 1, 'log')} from "
        f"number {stretch.first} to {stretch.last}; each is one of this campaign's but for those "
        f"left out.{left_out}"
    ]


def _describe_recording_machine(document: EvidenceDocument) -> Iterator[str]:
    """Yield sentences on whether this machine recorded the logs."""
    without = list_logs_without_machine_id(document.logs)
    naming_logs = len(document.logs) - len(without)
    if without:
        yield (
            f"Whether these logs were recorded by this machine: "
            f"{join_first_names(without, LIMITS.max_logs)}. They do not name "
            "theirs; their digests only show that they are the files that were replayed."
        )
    if naming_logs:
        yield (
            f"Whether {format_count(naming_logs, 'log')} whose metadata name this machine were "
            "recorded by it: a log can be written with any name."
        )


def _describe_limits_and_drift(document: EvidenceDocument) -> list[str]:
    """Describe the verdict on error limits and the drift, with their risks."""
    found: list[str] = []
    if document.limits is not None:
        found.append(f"{_capitalise_first_letter(document.limits.statement)}. {_NO_CONFORMITY}")
    drift = document.drift
    if drift is not None and drift.drifted is None:
        found.append(f"It cannot be decided whether the machine has drifted: {drift.reason}.")
    elif drift is not None and drift.difference_kg is not None and drift.limit_kg is not None:
        risk = (
            f"A machine that has not drifted would be as far off with a probability of "
            f"{drift.p_1:.2g}."
            if drift.drifted
            else f"A drift of {drift.matters_kg:,.1f} kg would have gone undetected with a "
            f"probability of {drift.missed_1:.2g}."
        )
        found.append(
            f"{'Drifted' if drift.drifted else 'Not drifted'}: the known mass comes out "
            f"{drift.difference_kg:+,.1f} kg off, and up to {drift.limit_kg:,.1f} kg is the limit "
            f"of the calibration. {risk} The line is that of the calibration before."
        )
    return found


def _describe_learnt_priors(document: EvidenceDocument) -> list[str]:
    """Describe the priors learnt from the campaign's logs; empty if there are none."""
    learnt = document.learnt
    if learnt is None:
        return []
    logs = len({each.log for each in learnt.logs})
    return [
        f"The mass is estimated with priors of {len(learnt.terms)} nuisances, learnt from "
        f"{logs} logs; errors of these estimates are common to all masses, and the line "
        "absorbs them."
    ]


def describe_one_day_limits(document: EvidenceDocument) -> list[str]:
    """Describe the limitation of evidence from a single day; empty for format 1."""
    fitted = document.calibration
    if fitted is None or not fitted.responses or not fitted.has_runs_of_one_day_only:
        return []
    return [
        "Evidence of one day: its intervals do not include changes from day to day. Runs of "
        "several days (five determine it well), or day_known_kg from earlier campaigns, would "
        "include it; until then an empty start in each later log shows whether the machine is "
        "the same."
    ]


def describe_driving_unlike_campaign(calibration: Calibration) -> list[str]:
    """Describe the uncertainty of logs driven unlike these runs, and how to reduce it."""
    if not calibration.responses:
        return []
    most = max(calibration.responses, key=lambda each: abs(each.level_kg))
    return [
        f"Logs that are driven unlike these runs lose most accuracy by the {TERMS[most.term][0]}: "
        f"its uncertainty moved these runs by {abs(most.level_kg):,.1f} kg, and moves other runs "
        f"by a different amount. {_capitalise_first_letter(RUNS[most.term])} would determine it "
        "better."
    ]


def describe_next_load(best: NextLoad) -> str:
    """Say in a sentence which load of the campaign would be most useful to run next."""
    now, then = (f"{each:,.1f}" for each in (best.half_width_now_kg, best.half_width_kg))
    if best.half_width_kg >= best.half_width_now_kg:
        return (
            f"Next load: one more run with a load of this campaign leaves half the interval of a "
            f"later mass at {now} kg or more. The runs disagree with the line: check the entered "
            "masses, and the logs of the runs farthest from it."
        )
    return (
        f"Next load: of those of this campaign, one more run with '{best.load_id}' on another day "
        f"makes the line surest; half the interval of a later mass would go from {now} to {then} "
        "kg."
    )


def describe_calibration_offset(calibration: Calibration) -> str:
    """Say in a sentence how much of the calibrated mass is the constant β."""
    middle_kg = sum(calibration.range_kg) / 2.0
    share = calibration.beta_kg / middle_kg if middle_kg else 0.0
    start = (
        f"A calibrated mass is α times the estimate plus β. In the middle of the range, at "
        f"{middle_kg:,.0f} kg, β is {calibration.beta_kg:,.1f} kg: {share:.0%} of what is reported"
    ).replace("%", " %")
    if abs(share) > LIMITS.large_correction_fraction:
        return (
            f"{start}. That part is a constant, which no sensor influences. What the machine "
            f"measured moves the result by {calibration.alpha_1:.3f} kg for each kg of the "
            "estimate. "
            "So a small error relative to the machine's whole mass is not a merit of the "
            "estimate: judge errors by the range of loads. An error of β is contained "
            "in full in every result, and outside the range the line says nothing."
        )
    return (
        f"{start}. The rest is measured: the estimate moves the result by "
        f"{calibration.alpha_1:.3f} kg "
        "for each of its kg."
    )


def _describe_campaign_without_line(
    document: EvidenceDocument, readings: pl.DataFrame, points: pl.DataFrame
) -> list[str]:
    loads = sorted({run.load_id for run in document.campaign.runs if not run.excluded})
    found = [f"There is no calibration line: {document.no_fit}."]
    found += [_describe_estimate_error(document, load, readings, points) for load in loads]
    if len(loads) == 1:
        found.append(
            "One load shows how far the estimate is from one reference, and how it repeats. It "
            "cannot show: whether the error grows with the mass (no slope α), so nothing about any "
            "other mass; whether an offset and a wrong gain cancel at this mass; whether the "
            "readings follow the load at all. Three different loads determine a line and leave one "
            "to contradict it."
        )
    return found


def _describe_estimate_error(
    document: EvidenceDocument, load_id: str, readings: pl.DataFrame, points: pl.DataFrame
) -> str:
    """Say in a sentence by how much the estimate of one load is wrong before calibration."""
    reference = next(each for each in document.references if each.load_id == load_id)
    used = readings.filter((pl.col("load_id") == load_id) & pl.col("used"))
    known = points.filter((pl.col("load_id") == load_id) & pl.col("mean_kg").is_not_null())
    start = f"Load '{load_id}', reference {reference.reference_kg:,.2f} kg: "
    if known.is_empty():
        return f"{start}no reading could be used."
    means = known["mean_kg"].to_list()
    off_kg = sum(means) / len(means) - reference.reference_kg
    masses, common = used["mass_kg"].to_list(), used["common_u_kg"].drop_nulls().to_list()
    text = f"{start}the estimate is {off_kg:+,.2f} kg off"
    if len(masses) > 1:
        mean = sum(masses) / len(masses)
        std_kg = math.sqrt(sum((mass - mean) ** 2 for mass in masses) / (len(masses) - 1))
        u_kg = math.hypot(std_kg / math.sqrt(len(masses)), max(common, default=0.0), reference.u_kg)
        text += (
            f"; {len(masses)} readings scatter by {std_kg:,.2f} kg, and the difference has a "
            f"standard uncertainty of {u_kg:,.2f} kg by scatter, priors and reference"
        )
    return f"{text}."


def describe_previous_line_as_found(document: EvidenceDocument) -> list[str]:
    """Describe the previous line as found, and its errors on these runs."""
    found, link, fitted = document.as_found, document.chain.previous, document.calibration
    if found is None or link is None:
        return []
    error = (
        ""
        if found.rms_error_kg is None
        else f", and was off by {found.rms_error_kg:,.1f} kg r.m.s. on these runs"
    )
    return [
        f"As found, the line of evidence number {link.counter} held: α {found.alpha_1:.4f}, β "
        f"{found.beta_kg:,.1f} "
        f"kg{error}.{'' if fitted is None else _describe_new_line_as_left(fitted)}"
    ]


def _describe_new_line_as_left(calibration: Calibration) -> str:
    return f" As left: α {calibration.alpha_1:.4f}, β {calibration.beta_kg:,.1f} kg."


def _capitalise_first_letter(text: str) -> str:
    return text[:1].upper() + text[1:]

"""Format findings as text, in one line each or as Markdown."""

from collections.abc import Iterable, Mapping
from typing import Any, Final

from analysis.explain import Finding
from analysis.model.run_record import Run
from recordings.report.clock_text import ShiftClock
from recordings.report.number_text import format_number, format_plus_minus, round_to_uncertainty

_LEADS_TO: Final = {
    "withhold": "invalidates the mass",
    "widen": "moves the mass by more than its uncertainty",
    "tell": "moves the mass by less than its uncertainty",
}


def describe_consequence_of_finding(finding: Finding) -> str:
    """Describe the effect of a finding on the mass."""
    if finding.severity == "tell" and finding.mass_change_kg is None:
        return "effect on the mass unknown"
    return _LEADS_TO[finding.severity]


def read_findings_of_run(run: Run) -> tuple[Finding, ...]:
    """Read the findings of a run, the most likely first; none if they were not computed."""
    frame = run.frames.get("findings")
    return () if frame is None else make_findings_of_rows(frame.iter_rows(named=True))


def make_findings_of_rows(finding_rows: Iterable[Mapping[str, Any]]) -> tuple[Finding, ...]:
    """Make findings from rows of the frame `findings`, the most likely first."""
    return tuple(Finding.from_row(row) for row in finding_rows)


def find_readable_cause_name(cause: str) -> str:
    """Name of a cause for readers, with spaces instead of underscores."""
    return cause.replace("_", " ")


def can_fixing_change_mass(finding: Finding) -> bool:
    """Whether fixing a finding may change the mass: not if it only informs, without a change."""
    return finding.severity != "tell" or finding.mass_change_kg is not None


def describe_mass_change_if_fixed(finding: Finding) -> str:
    """Say by how much fixing the cause of a finding changes the mass; empty if unknown."""
    change, u = finding.mass_change_kg, finding.mass_change_u_kg
    if change is None:
        return ""
    if change == 0.0 and u is not None:
        # the direction is not known
        return f"fixing it may change the mass by ± {round_to_uncertainty(u, u)} kg"
    text = format_plus_minus(change, u)
    signed = f"+{text}" if change > 0 else text.replace("-", "−", 1)
    return f"fixing it changes the mass by {signed} kg"


def format_finding_span(finding: Finding, clock: ShiftClock | None = None) -> str:
    """Format a finding's time span in s since the start, or by a clock; empty for the whole log."""
    if finding.start_s is None or finding.end_s is None:
        return ""
    if clock is not None:
        start, end = clock.format_time(finding.start_s), clock.format_time(finding.end_s)
        return start if start == end else f"{start} to {end}"
    start, end = f"{finding.start_s:,.1f}", f"{finding.end_s:,.1f}"
    return f"{start} s" if start == end else f"{start} to {end} s"


def format_finding(finding: Finding, clock: ShiftClock | None = None) -> str:
    """Format in one line the cause, its time span, the measured evidence and the mass change."""
    where = ", ".join(filter(None, (finding.channel, format_finding_span(finding, clock))))
    parts = [
        f"{find_readable_cause_name(finding.cause)}{f' ({where})' if where else ''}: "
        f"{finding.evidence}"
    ]
    parts += filter(None, [describe_mass_change_if_fixed(finding)])
    return "; ".join(parts)


def format_proposed_machine_keys(finding: Finding) -> str:
    """Format the keys to set in the machine file; empty if there are none."""
    if finding.setting is None or finding.value is None:
        return ""
    keys, values = finding.setting.split(", "), finding.value.split(", ")
    if len(keys) != len(values):
        return f"set {finding.setting} = {finding.value}"
    return "set " + " and ".join(
        f"{key} = {value}" for key, value in zip(keys, values, strict=True)
    )


def describe_indistinguishable_causes(finding: Finding) -> str:
    """Say which causes the log cannot distinguish from this one; empty if there are none."""
    if not finding.alternatives:
        return ""
    names = ", ".join(map(find_readable_cause_name, finding.alternatives))
    return f"cannot be distinguished from: {names}"


def format_findings_markdown(run: Run) -> str:
    """Format all findings in Markdown; a sentence if there are none, "" if not computed."""
    if "findings" not in run.frames:
        return ""
    found = read_findings_of_run(run)
    if not found:
        return "# Findings\n\nNone of the known causes of a wrong mass was detected in this log."
    parts = ["# Findings"]
    for each in found:
        lines = [
            each.evidence,
            *filter(
                None,
                (
                    describe_mass_change_if_fixed(each),
                    format_proposed_machine_keys(each),
                    describe_indistinguishable_causes(each),
                ),
            ),
            describe_consequence_of_finding(each),
        ]
        where = ", ".join(filter(None, (each.channel, format_finding_span(each))))
        parts.append(
            f"## {each.rank}. "
            f"{find_readable_cause_name(each.cause)}{f' ({where})' if where else ''}"
        )
        strength = f"{format_number(each.strength_1)} × the detection threshold"
        parts.append(f"{each.says}; {strength}\n\n" + "\n".join(f"- {line}" for line in lines))
    return "\n\n".join(parts)

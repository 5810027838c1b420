"""The causes that a log shows, in words: a line each, and as Markdown."""

from typing import Final

from analysis.explaining import Finding
from analysis.run import Run
from recordings.wording import number, plus_minus

#: What a severity leads to.
LEADS_TO: Final = {
    "withhold": "a mass under it is worth nothing",
    "widen": "it moves the mass by more than its uncertainty",
    "tell": "it changes the mass by less than its uncertainty, or by what is not known",
}


def findings_of(run: Run) -> tuple[Finding, ...]:
    """The findings of a run, the likeliest first; none of a run that was not looked at."""
    frame = run.frames.get("findings")
    return () if frame is None else tuple(Finding.of(row) for row in frame.iter_rows(named=True))


def name_of(cause: str) -> str:
    """A cause as a person reads it."""
    return cause.replace("_", " ")


def bends(finding: Finding) -> bool:
    """Whether it matters to the mass, or may: what is told alone, without kilograms, does not."""
    return finding.severity != "tell" or finding.mass_change_kg is not None


def change_of(finding: Finding) -> str:
    """What mending would do to the mass, or nothing where that is not known."""
    change, u = finding.mass_change_kg, finding.mass_change_u_kg
    if change is None:
        return ""
    return f"mended, the mass changes by {'+' if change > 0 else ''}{plus_minus(change, u)} kg"


def span_of(finding: Finding) -> str:
    """Where it is, or nothing for the whole log."""
    if finding.start_s is None or finding.end_s is None:
        return ""
    begin, end = f"{finding.start_s:,.1f}", f"{finding.end_s:,.1f}"
    return f"{begin} s" if begin == end else f"{begin} to {end} s"


def finding_line(finding: Finding) -> str:
    """One line: the cause, where, what was measured, what mending it would do."""
    where = ", ".join(filter(None, (finding.channel, span_of(finding))))
    parts = [f"{name_of(finding.cause)}{f' ({where})' if where else ''}: {finding.evidence}"]
    parts += filter(None, [change_of(finding)])
    return "; ".join(parts)


def proposal_of(finding: Finding) -> str:
    """What to write into the machine file, or nothing."""
    if finding.setting is None or finding.value is None:
        return ""
    return f"set {finding.setting} = {finding.value}"


def untold(finding: Finding) -> str:
    """Which causes it cannot be told from, or nothing."""
    if not finding.alternatives:
        return ""
    names = ", ".join(map(name_of, finding.alternatives))
    return f"this log does not tell it from: {names}"


def findings_text(run: Run) -> str:
    """Every finding in Markdown; a sentence where none shows, nothing where none was looked for."""
    if "findings" not in run.frames:
        return ""
    found = findings_of(run)
    if not found:
        return "# Findings\n\nNo known cause of a wrong mass shows in this log."
    parts = ["# Findings"]
    for each in found:
        lines = [
            each.evidence,
            *filter(None, (change_of(each), proposal_of(each), untold(each))),
            LEADS_TO[each.severity],
        ]
        where = ", ".join(filter(None, (each.channel, span_of(each))))
        parts.append(f"## {each.rank}. {name_of(each.cause)}{f' ({where})' if where else ''}")
        strength = f"{number(each.strength_1)} times what chance gives"
        parts.append(f"{each.says}; {strength}\n\n" + "\n".join(f"- {line}" for line in lines))
    return "\n\n".join(parts)

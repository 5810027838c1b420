"""Write the texts of a recording in Markdown: first the answer, then its provenance."""

from collections.abc import Callable
from typing import Final

import polars as pl

from analysis.model.answer import Answer, AnswerRow, make_answer
from analysis.model.physical_units import NS
from analysis.model.run_record import Provenance, Run
from analysis.model.verdict import Verdict
from analysis.stages.signals.timestamps import FIRST_DATE_NS
from recordings.report.answer_text import (
    describe_answer_as_lines,
    describe_loads_as_lines,
    find_load_with_most_manoeuvres,
    make_load_table_heads,
    make_load_table_rows,
    make_uncertainty_rows,
)
from recordings.report.clock_text import ShiftClock
from recordings.report.finding_text import (
    format_finding,
    format_findings_markdown,
    read_findings_of_run,
)
from recordings.report.number_text import (
    SCALE_NOT_KNOWN,
    format_check_outcome,
    format_markdown_table,
    format_number,
    format_plus_minus,
    format_unit_suffix,
)
from recordings.report.planar_text import describe_planar_fits, format_planar_markdown
from recordings.report.shift_text import describe_shift_payload
from recordings.rrd.display_frames import find_time_span_of_grid_ns
from recordings.rrd.recording_limits import LIMITS
from recordings.rrd.recording_properties import (
    format_local_time,
    format_provenance_markdown,
    format_settings_markdown,
    read_machine_section,
    read_timezone_name,
)

#: Character of bars, since the viewer's font has no block and the viewer crashes without a glyph.
_MARK: Final = "="
_MASS: Final = ("mass_kg", "mass_std_kg")
_INERTIA: Final = ("inertia_z_kg_m2", "inertia_z_std_kg_m2")
#: Columns of the table of masses: heading, value, standard deviation. A payload's is that of its
#: load, not of a method.
_MASS_COLUMNS: Final = (
    ("mass (kg)", "mass_kg", "mass_std_kg"),
    ("payload (kg)", "payload_kg", None),
    ("friction (N·s/m)", "friction_x_N_s_m", "friction_x_std_N_s_m"),
    ("Coulomb friction (N)", "coulomb_x_N", "coulomb_x_std_N"),
    ("yaw inertia (kg·m²)", "inertia_z_kg_m2", "inertia_z_std_kg_m2"),
    ("friction of turning (N·m·s)", "friction_z_N_m_s", "friction_z_std_N_m_s"),
)


def make_texts_of_run(run: Run) -> dict[str, str]:
    """Make all texts for which this run has content, by name."""
    written: dict[str, Callable[[Run], str]] = {
        "answer": format_answer_markdown,
        "findings": format_findings_markdown,
        "planar": format_planar_markdown,
        "calibration": format_calibration_markdown,
        "settings": format_settings_markdown,
        "provenance": format_provenance_markdown,
    }
    return {name: text for name, write in written.items() if (text := write(run))}


def make_recording_name(provenance: Provenance) -> str:
    """Make the name of a recording in the viewer: its machine and logs."""
    logs = ", ".join(each.name for each in provenance.inputs)
    return ": ".join(filter(None, (read_machine_name(provenance), logs))) or "payscope"


def read_machine_name(provenance: Provenance) -> str:
    """Read the machine's name in the machine file; empty without one."""
    return str(read_machine_section(provenance).get("name", ""))


#: Sentence on the times on the axes of the viewer.
_AXES: Final = "Times on the axes are UTC, unless the viewer's settings say local time."
_AXES_WITHOUT_DATE: Final = "Times on the axes are those of the log's own clock, which has no date."
#: Heads of a calibration's errors.
_ERRORS: Final = ("error kg", "load left out kg")


def format_answer_headline(answer: Answer) -> str:
    """Format the answer in one sentence, without Markdown."""
    failed = answer.verdict.list_withholding_checks("mass")
    if failed:
        return f"This log cannot weigh the machine: {len(failed)} of the checks failed."
    if len(answer.loads) > 1:
        return (
            describe_shift_payload(answer.shift)
            if has_payload_total(answer)
            else _describe_loads_in_sentence(answer)
        )
    for load in answer.loads:
        if load["mass_kg"] is not None:
            scale = f", {SCALE_NOT_KNOWN}" if load["scale_unknown"] else ""
            mass = format_plus_minus(load["mass_kg"], load["u_kg"])
            return f"{mass} kg (standard uncertainty{scale})"
    # recordings of earlier versions have no loads
    for row in answer.rows if not answer.loads else ():
        known = [method for method in row.methods if row.estimate("mass_kg", method) is not None]
        if known:
            best = "pooled" if "pooled" in known else known[0]
            mass = _format_value_of_method(row, best, *_MASS)
            return f"{mass} kg ({best}, statistical standard deviation)"
    if not answer.verdict.checks:
        return "This recording contains no answer."
    return "No window of this log was accepted: there is no mass."


def has_payload_total(answer: Answer) -> bool:
    """Whether the log's cycles add up to a payload total."""
    return bool(answer.shift.get("cycles_counted"))


def _describe_loads_in_sentence(answer: Answer) -> str:
    """Describe the loads of a log in a sentence."""
    known = [load for load in answer.loads if load["payload_kg"] is not None]
    count = f"{len(answer.loads)} loads"
    if not known:
        return f"{count}: the log has no single mass"
    most = max(known, key=lambda load: load["payload_kg"])
    return (
        f"{count}, payloads up to {format_plus_minus(most['payload_kg'], most['payload_u_kg'])} kg"
    )


def format_answer_summary(run: Run) -> str:
    """Format the answer in plain lines, the headline first."""
    about, said = run.provenance, make_answer(run)
    lines = [
        format_answer_headline(said),
        f"{make_recording_name(about)} · {format_local_time(about)}",
    ]
    lines += describe_answer_as_lines(said)[1:]
    if len(said.loads) > 1:
        lines += describe_loads_as_lines(said, LIMITS.max_load_lines)
    lines += [""]
    for row in said.rows if len(said.loads) <= 1 else ():
        for method in row.methods:
            mass = (
                "withheld" if row.withheld else f"{_format_value_of_method(row, method, *_MASS)} kg"
            )
            inertia = row.estimate(_INERTIA[0], method)
            turns = (
                f", yaw inertia {_format_value_of_method(row, method, *_INERTIA)} kg·m²"
                if inertia
                else ""
            )
            lines.append(f"{method:<8} {mass}{turns}")
    lines += describe_planar_fits(said.planar, said.planar_budget)
    for each in read_findings_of_run(run)[: LIMITS.max_findings]:
        lines.append(f"finding  {each.rank}. {format_finding(each)}")
    quiet: dict[str, list[str]] = {"passed": [], "n/a": []}
    for check in said.verdict.checks:
        came_out = format_check_outcome(check, passed="passed", failed="FAILED", absent="n/a")
        if came_out in quiet:
            value = "" if check.value is None else f" {format_number(check.value)}"
            quiet[came_out].append(f"{check.check}{value}")
        else:
            lines.append(
                f"{came_out:<8} {check.check} {format_number(check.value)} ({check.limit_text})"
            )
    lines += [f"{name:<8} {', '.join(checks)}" for name, checks in quiet.items() if checks]
    return "\n".join(lines)


def format_answer_markdown(run: Run) -> str:
    """Format masses, verdict with every check, and notes for the reader."""
    if "points" in run.frames:
        return ""  # evidence is about many logs
    about, span, said = run.provenance, find_time_span_of_grid_ns(run), make_answer(run)
    duration = f", {(span[1] - span[0]) / NS:,.1f} s" if span else ""
    parts = [
        f"# {format_answer_headline(said)}",
        f"{read_machine_name(about) or 'machine without a name'} · "
        f"{format_local_time(about)}{duration}",
    ]
    parts.append(_AXES if about.t0_unix_ns >= FIRST_DATE_NS else _AXES_WITHOUT_DATE)
    if has_payload_total(said):
        parts.append("As weighed; the verdicts of reviewers are on the page of the review.")
    if failed := said.verdict.list_withholding_checks("mass"):
        parts.append("**The mass is withheld**, because:")
        parts.append(
            "\n".join(
                f"- **{check.check}** is {format_number(check.value)}, must be {check.limit_text}: "
                f"{check.meaning}"
                for check in failed
            )
        )
    if found := read_findings_of_run(run):
        parts.append("## Findings in this log")
        parts.append(
            "\n".join(
                f"- **{each.rank}** {format_finding(each)}" for each in found[: LIMITS.max_findings]
            )
        )
    parts += _describe_reliability(said, _make_cycle_lines(run) if has_payload_total(said) else [])
    if len(said.loads) > 1:
        parts.append("The paper's methods give one mass per log, and are not shown.")
    else:
        parts += [each for row in said.rows for each in _make_mass_cells_of_load(row)]
    if lines := describe_planar_fits(said.planar, said.planar_budget):
        parts.append("\n".join(f"- {line}" for line in lines))
    parts += _make_lines_of_verdict(said.verdict) + _describe_acceptance_of_masses(run)
    parts += [f"- {note}" for note in said.notes]
    parts += [f"- lost: {each}" for each in said.losses]
    return "\n\n".join(parts)


def format_calibration_markdown(run: Run) -> str:
    """Format calibration points and line of each method, and the evidence; empty without any."""
    parts = ["# Calibration", *_describe_calibration_evidence(run)]
    points = run.frames.get("calibration")
    if points is None or points.is_empty():
        return "\n\n".join(parts) if len(parts) > 1 else ""
    for (method,), group in points.group_by("method", maintain_order=True):
        fit = group.row(0, named=True)
        if fit.get("alpha_1") is not None and fit.get("beta_kg") is not None:
            parts.append(
                f"**{method}**: reference = {format_number(fit['alpha_1'])} · estimate "
                f"{fit['beta_kg']:+.4g} kg"
            )
    rows = [
        (
            row["method"],
            format_number(row["load_kg"]),
            format_number(row["reference_kg"]),
            f"{format_plus_minus(row['estimate_kg'], row['estimate_std_kg'])} ({row['runs']})",
            format_number(row["error_kg"]),
            format_number(row["error_left_out_kg"]),
        )
        for row in points.iter_rows(named=True)
    ]
    heads = ("method", "load kg", "reference kg", "estimate kg (runs)", *_ERRORS)
    return "\n\n".join([*parts, format_markdown_table(heads, rows)])


def _describe_calibration_evidence(run: Run) -> list[str]:
    """Describe the evidence: its line, points, and recordings of runs; empty without evidence."""
    if "points" not in run.frames:
        return []
    line, points, runs = (run.frames[name] for name in ("line", "points", "runs"))
    rows = [
        (
            row["run_id"],
            row["load"],
            format_number(row["reference_kg"]),
            f"{format_plus_minus(row['mean_kg'], row['std_kg'])} ({row['readings']})",
            format_number(row["error_kg"]),
            format_number(row["error_left_out_kg"]),
        )
        for row in points.iter_rows(named=True)
    ]
    heads = ("run", "load", "reference kg", "estimate kg (readings)", *_ERRORS)
    fitted = [
        f"reference = {format_number(row['alpha_1'])} · estimate {row['beta_kg']:+.4g} kg, from "
        f"{format_number(row['valid_from_kg'])} to {format_number(row['valid_to_kg'])} "
        f"kg; a later mass ± {format_number(row['line_u_kg'])} kg (k = 1), interval with "
        f"k = {format_number(row['coverage_k_1'])}"
        for row in line.iter_rows(named=True)
    ]
    # listed, since a digest does not fit into a column
    logs = [
        f"- **{row['run_id']}** {row['log']}{', ' + row['recording'] if row['recording'] else ''}: "
        f"`{row['log_sha256']}`"
        for row in runs.iter_rows(named=True)
    ]
    return [
        "\n".join(f"- {note}" for note in run.provenance.notes),
        *("## Line", *fitted),
        *("## Points", format_markdown_table(heads, rows)),
        *("## Logs of the runs", "\n".join(logs)),
    ]


def _format_value_of_method(row: AnswerRow, method: str, value: str, std: str | None) -> str:
    return format_plus_minus(
        row.estimate(value, method), row.estimate(std, method) if std else None
    )


def _make_mass_cells_of_load(row: AnswerRow) -> list[str]:
    if not row.methods:
        return []
    shown = [each for each in _MASS_COLUMNS if row.has_quantity(each[1])]
    rows = [
        (
            method,
            *(_format_value_of_method(row, method, value, std) for _, value, std in shown),
            row.estimates[method],
        )
        for method in row.methods
    ]
    heads = ("method", *(head for head, _, _ in shown), "estimates")
    return [
        "## By method over the whole log",
        "joint is the answer; the others are the paper's, and their ± is statistical only",
        format_markdown_table(heads, rows),
    ]


def _describe_reliability(answer: Answer, cycles: list[str]) -> list[str]:
    """Describe the answer's reliability: prior sensitivity, budget, priors and posteriors.

    Sentences are lists, since the viewer wraps them but not tables.

    Args:
        answer: the answer.
        cycles: lines on the cycles of a shift.
    """
    if not any(load["mass_kg"] is not None for load in answer.loads):
        return []
    parts = ["\n".join(f"- {line}" for line in describe_answer_as_lines(answer))]
    which = ""
    if len(answer.loads) > 1:
        parts += cycles or [
            "## Loads",
            format_markdown_table(make_load_table_heads(answer), make_load_table_rows(answer)),
        ]
        which = f" (mass of load {find_load_with_most_manoeuvres(answer)})"
    parts += [
        f"## Where the uncertainty comes from{which}",
        "\n".join(
            f"- **{cause}** ({kind}): {f'{u} kg {share}' if share else u}; shrinks with {shrinks}"
            for cause, kind, u, share, shrinks in make_uncertainty_rows(answer, _MARK)
        ),
        "## Terms of the fit besides mass and friction",
        "\n".join(
            f"- **{row['term']}**, {row['meaning']}: "
            f"{format_plus_minus(row['posterior'], row['posterior_std'])}{unit}, "
            f"prior ± {format_number(row['prior_std'])}{unit}; u of the mass "
            f"{format_number(row['u_kg'])} kg"
            for row in answer.nuisances
            for unit in [format_unit_suffix(row["unit"])]
        ),
    ]
    return parts


def _make_cycle_lines(run: Run) -> list[str]:
    """Make the lines on a shift's cycles, with the local time of each dump."""
    about, span = run.provenance, find_time_span_of_grid_ns(run)
    duration_s = 0.0 if span is None else (span[1] - span[0]) / NS
    clock = ShiftClock(read_timezone_name(about), about.t0_unix_ns, duration_s)
    rows = [
        (
            str(row["cycle"]),
            clock.format_time(row["end_t_ns"] / NS),
            format_plus_minus(row["payload_kg"], row["payload_u_kg"]),
            row["quality"],
        )
        for row in run.frames["cycles"].iter_rows(named=True)
    ]
    return [
        "## Cycles",
        format_markdown_table(("cycle", "dumped at", "payload kg", "quality"), rows),
    ]


def _make_lines_of_verdict(verdict: Verdict) -> list[str]:
    if not verdict.checks:
        return []
    words = {"passed": "passed", "failed": "**failed**", "absent": "does not apply"}
    checks = [
        f"- {format_check_outcome(check, **words)}: **{check.check}** "
        f"{format_number(check.value)} "
        f"({check.limit_text}), {check.meaning}"
        for check in verdict.checks
    ]
    parts = ["## Can this log weigh the machine?", "\n".join(checks)]
    if verdict.has_spins and not verdict.can_estimate_inertia:
        parts.append(
            "**The yaw inertia is withheld**: the checks of its spins, or of the sign of the "
            "force, failed."
        )
    return parts


def _describe_acceptance_of_masses(run: Run) -> list[str]:
    gate = run.frames.get("gate")
    if gate is None or gate.is_empty() or "accepted_x" not in gate.columns:
        return []
    parts = [f"## Gate\n\n{gate['accepted_x'].mean():.1%} of the windows accepted."]
    if "reason_x" in gate.columns:
        counts = gate["reason_x"].cast(pl.String).value_counts(sort=True)
        shares = [(reason, f"{n / gate.height:.1%}") for reason, n in counts.rows()]
        parts.append(format_markdown_table(("reason", "share of windows"), shares))
    return parts

"""Make the properties of a recording, by which viewer and catalog sort, and its provenance.

Properties are below `ANSWER`, so that `property:answer:mass_kg` is a column of Rerun's tables. A
quantity is present only if the run has it; other properties always are. The provenance, in
Markdown, has settings, machine file, inputs and versions.
"""

import json
from collections.abc import Mapping
from datetime import UTC, datetime
from typing import Any, Final
from zoneinfo import ZoneInfo

from analysis.model.answer import make_answer
from analysis.model.physical_units import NS
from analysis.model.run_record import Provenance, Run
from analysis.model.verdict import Verdict
from analysis.stages.signals.timestamps import FIRST_DATE_NS
from recordings.report.answer_text import COVERAGE
from recordings.report.clock_text import ShiftClock
from recordings.report.finding_text import format_finding, read_findings_of_run
from recordings.report.number_text import format_markdown_table, format_number

ANSWER: Final = "answer"
Value = str | float | int | bool


def make_recording_properties(run: Run) -> dict[str, Value]:
    """Make the properties of a run's recording.

    Args:
        run: the recorded run.

    Returns:
        Values by name, which includes the unit: `machine`, `serial`, `day` (local; empty without a
        date), `logs`, `verdict`, `can_weigh`, `loads` (load states), `first_finding`,
        `fingerprint`, `payscope` and `versions`; `mass_kg` for one load state, `tonnes_t` and
        `cycles` if cycles count, each quantity with its expanded uncertainty `U` (95 %).
    """
    about, said = run.provenance, make_answer(run)
    body: Mapping[str, Any] = about.machine.get("machine", {})
    findings = read_findings_of_run(run)
    found: dict[str, Value | None] = {
        "machine": str(body.get("name", "")),
        "serial": str(body.get("id") or ""),
        "day": _format_recording_day(about),
        "logs": ", ".join(each.name for each in about.inputs),
        "verdict": _summarise_weighing_verdict(said.verdict),
        "can_weigh": said.verdict.can_weigh if said.verdict.checks else None,
        "loads": len(said.loads),
        "first_finding": format_finding(findings[0]) if findings else "",
        "fingerprint": about.fingerprint.results if about.fingerprint else "",
        "payscope": about.versions.get("payscope", ""),
        "versions": ", ".join(f"{name} {text}" for name, text in about.versions.items()),
    }
    if len(said.loads) == 1:
        load = said.loads[0]
        found |= _make_quantity_property("mass", "kg", load["mass_kg"], load["u_kg"])
    if said.shift:
        cycles, kg = said.shift["cycles_counted"], said.shift["payload_kg"]
        found["cycles"] = cycles
        found |= _make_quantity_property(
            "tonnes", "t", kg, said.shift["payload_u_kg"], units_per_display_unit=1e3
        )
    return {name: value for name, value in found.items() if value is not None}


def _make_quantity_property(
    name: str,
    unit: str,
    value: float | None,
    standard_u: float | None,
    units_per_display_unit: float = 1.0,
) -> dict[str, float | None]:
    """Make the properties of a quantity and its expanded uncertainty; None if unknown."""
    return {
        f"{name}_{unit}": None if value is None else value / units_per_display_unit,
        f"{name}_U_{unit}": None
        if value is None or standard_u is None
        else COVERAGE * standard_u / units_per_display_unit,
    }


def _summarise_weighing_verdict(verdict: Verdict) -> str:
    if not verdict.checks:
        return "not judged"
    failed = [check.check for check in verdict.list_withholding_checks("mass")]
    return f"cannot weigh: {', '.join(failed)}" if failed else "can weigh"


def _format_recording_day(provenance: Provenance) -> str:
    if provenance.t0_unix_ns < FIRST_DATE_NS:
        return ""
    zone = ZoneInfo(str(provenance.machine.get("machine", {}).get("timezone", "UTC")))
    return f"{datetime.fromtimestamp(provenance.t0_unix_ns // NS, UTC).astimezone(zone):%Y-%m-%d}"


def format_local_time(provenance: Provenance, t_ns: int = 0) -> str:
    """Format a time since the start in local time; by the log's own clock if it is undated."""
    stamp_ns = provenance.t0_unix_ns + t_ns
    if stamp_ns < FIRST_DATE_NS:
        return f"{stamp_ns / NS:.3f} s of the log's own clock"
    clock = ShiftClock(read_timezone_name(provenance), stamp_ns, 0.0)
    return f"{clock.to_local_datetime(0.0):%Y-%m-%d} {clock.format_time(0.0)} {clock.zone}"


def format_settings_markdown(run: Run) -> str:
    """Format all settings and the resolved machine file in Markdown."""
    about = run.provenance
    rows = [
        (name, json.dumps(value)) for name, value in sorted(about.settings.to_flat_dict().items())
    ]
    machine = json.dumps(about.machine, indent=2, ensure_ascii=False)
    return "\n\n".join(
        [
            "# Settings",
            format_markdown_table(("setting", "value"), rows),
            "# Machine",
            f"```json\n{machine}\n```",
        ]
    )


def format_provenance_markdown(run: Run) -> str:
    """Format inputs with SHA-256, versions, stamps, losses and notes in Markdown."""
    about = run.provenance
    inputs = [
        (each.name, format_number(each.size_bytes), f"`{each.sha256}`") for each in about.inputs
    ]
    frames = [f"- **{n}**, {f.height} rows: {', '.join(f.columns)}" for n, f in run.frames.items()]
    return "\n\n".join(
        [
            "# Inputs",
            format_markdown_table(("file", "bytes", "SHA-256"), inputs),
            f"First aligned sample: {format_local_time(about)} "
            f"({about.t0_unix_ns} ns since 1970-01-01 UTC)",
            "# Fingerprint",
            _format_fingerprint_digests(about),
            "# Stamps",
            format_markdown_table(("topic", "placed by"), about.stamps.items()),
            "# Losses",
            format_markdown_table(
                ("source", "topic", "what"),
                [(each.source, each.topic, each.what) for each in about.losses],
            ),
            "# Notes",
            "\n".join(f"- {note}" for note in about.notes) or "none",
            "# Versions",
            format_markdown_table(("what", "version"), about.versions.items()),
            "# Stages",
            "\n".join(frames),
        ]
    )


def _format_fingerprint_digests(provenance: Provenance) -> str:
    """Format the digests of the fingerprint in full, including the digests of the frames."""
    taken = provenance.fingerprint
    if taken is None:
        return "none"
    whole = {"inputs": taken.inputs, "settings": taken.settings, "results": taken.results}
    digests = [(name, f"`{digest}`") for name, digest in (whole | taken.frames).items()]
    return format_markdown_table(("SHA-256 of", "digest"), digests)


def read_machine_section(provenance: Provenance) -> dict[str, Any]:
    """Read the table `machine` of the machine file; empty without one."""
    body = provenance.machine.get("machine", {})
    return body if isinstance(body, dict) else {}


def read_timezone_name(provenance: Provenance) -> str:
    """Read the time zone of the machine file; UTC by default."""
    return str(read_machine_section(provenance).get("timezone", "UTC"))

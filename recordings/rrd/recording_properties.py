"""Properties of a recording, by which viewer and catalog sort recordings.

They belong to the property `ANSWER`: `property:answer:mass_kg` is a column of Rerun's tables, for
example. A quantity is present if the run has it; all others always are.
"""

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
from recordings.report.finding_text import format_finding, read_findings_of_run

ANSWER: Final = "answer"
Value = str | float | int | bool


def make_recording_properties(run: Run) -> dict[str, Value]:
    """Properties of a run's recording.

    Args:
        run: the recorded run.

    Returns:
        Values by name with the unit: `machine`, `serial`, `day` (local; empty without a date),
        `logs`, `verdict`, `can_weigh`, `loads` (load states), `first_finding`, `fingerprint`,
        `payscope` and `versions`; `mass_kg` for one load state, `tonnes_t` and `cycles` if cycles
        count, each quantity with its uncertainty `U` (95 %).
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
    """A quantity and its expanded uncertainty."""
    return {
        f"{name}_{unit}": None if value is None else value / units_per_display_unit,
        f"{name}_U_{unit}": None
        if value is None or standard_u is None
        else COVERAGE * standard_u / units_per_display_unit,
    }


def _summarise_weighing_verdict(verdict: Verdict) -> str:
    if not verdict.checks:
        return "not judged"
    failed = [check.check for check in verdict.withholding_checks("mass")]
    return f"cannot weigh: {', '.join(failed)}" if failed else "can weigh"


def _format_recording_day(provenance: Provenance) -> str:
    if provenance.t0_unix_ns < FIRST_DATE_NS:
        return ""
    zone = ZoneInfo(str(provenance.machine.get("machine", {}).get("timezone", "UTC")))
    return f"{datetime.fromtimestamp(provenance.t0_unix_ns // NS, UTC).astimezone(zone):%Y-%m-%d}"

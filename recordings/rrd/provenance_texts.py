"""Provenance of a recording in Markdown: settings, machine file, inputs and versions."""

import json
from typing import Any

from analysis.model.physical_units import NS
from analysis.model.run_record import Provenance, Run
from analysis.stages.signals.timestamps import FIRST_DATE_NS
from recordings.report.clock_text import ShiftClock
from recordings.report.number_text import format_markdown_table, format_number


def format_local_time(provenance: Provenance, t_ns: int = 0) -> str:
    """Local time of a time since the start; without a date if the log has none."""
    stamp_ns = provenance.t0_unix_ns + t_ns
    if stamp_ns < FIRST_DATE_NS:
        return f"{stamp_ns / NS:.3f} s of the log's own clock"
    clock = ShiftClock(read_timezone_name(provenance), stamp_ns, 0.0)
    return f"{clock.to_local_datetime(0.0):%Y-%m-%d} {clock.format_time(0.0)} {clock.zone}"


def format_settings_markdown(run: Run) -> str:
    """All settings, and the resolved machine file."""
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
    """Inputs with SHA-256, versions, stamps, losses and notes."""
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
    """Digests in full, including those of the frames."""
    taken = provenance.fingerprint
    if taken is None:
        return "none"
    whole = {"inputs": taken.inputs, "settings": taken.settings, "results": taken.results}
    digests = [(name, f"`{digest}`") for name, digest in (whole | taken.frames).items()]
    return format_markdown_table(("SHA-256 of", "digest"), digests)


def read_machine_section(provenance: Provenance) -> dict[str, Any]:
    """Table `machine` of the machine file."""
    body = provenance.machine.get("machine", {})
    return body if isinstance(body, dict) else {}


def read_timezone_name(provenance: Provenance) -> str:
    """Time zone of the machine file."""
    return str(read_machine_section(provenance).get("timezone", "UTC"))

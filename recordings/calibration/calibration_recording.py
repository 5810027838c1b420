"""Write `calibration.rrd`: the evidence for the viewer, with links to the recordings of runs."""

from pathlib import Path

import polars as pl

from analysis.model.run_record import InputFile, Provenance, Run
from analysis.model.schema import conform_frame_to_schema
from recordings.calibration.bundle_folder import RECORDING
from recordings.calibration.calibration_text import write_report_paragraphs
from recordings.calibration.evidence_document import EvidenceDocument
from recordings.rrd.writer import write_recording


def write_calibration_recording(
    bundle_folder: Path, document: EvidenceDocument, readings: pl.DataFrame, points: pl.DataFrame
) -> None:
    """Write the recording of a bundle's calibration."""
    write_recording(make_run_of_calibration(document, readings, points), bundle_folder / RECORDING)


def make_run_of_calibration(
    document: EvidenceDocument, readings: pl.DataFrame, points: pl.DataFrame
) -> Run:
    """Make the run with the frames of a bundle's recording, computed from the evidence.

    Args:
        document: the evidence.
        readings: frame `readings`.
        points: frame of the points.
    """
    fitted = document.calibration
    line: dict[str, list[float]] = {
        name: []
        for name in (
            *("alpha_1", "beta_kg", "valid_from_kg", "valid_to_kg"),
            *("line_u_kg", "coverage_k_1"),
        )
    }
    if fitted is not None:
        low, high = fitted.range_kg
        row = (fitted.alpha_1, fitted.beta_kg, low, high, fitted.u_kg, fitted.coverage_k_1)
        line = {name: [value] for name, value in zip(line, row, strict=True)}
    runs = [
        {
            "run_id": run.id,
            "log": run.log,
            "log_sha256": " ".join(file.sha256 for file in log.files),
            "recording": log.recording,
        }
        for run in document.campaign.runs
        if (log := document.find_log_by_name(run.log)) is not None
    ]
    resolved = document.weighing_machine.model_dump(mode="json")
    del resolved["settings"]
    about = Provenance(
        inputs=tuple(InputFile(**file.model_dump()) for log in document.logs for file in log.files),
        machine=resolved,
        settings=document.weighing_machine.settings,
        versions={"payscope": document.software.payscope, "python": document.software.python},
        notes=(
            f"evidence {document.id} of machine {document.campaign.machine.id}, "
            f"{'signed' if document.signer else 'UNSIGNED'}",
            *write_report_paragraphs(document, readings, points),
        ),
    )
    named = {"load_id": "load", "reason": "left_out_for"}
    frames = {
        "line": pl.DataFrame(line, schema=dict.fromkeys(line, pl.Float64)),
        "points": points.rename(named, strict=False),
        "readings": readings.rename(named, strict=False),
        "runs": pl.DataFrame(runs),
    }
    run = Run({name: conform_frame_to_schema(name, frame) for name, frame in frames.items()}, about)
    return run.with_fingerprint()

"""Write a bundle: tables, document, report, recording, digests and signature."""

import hashlib
from collections.abc import Mapping
from pathlib import Path
from typing import NamedTuple

import polars as pl

from recordings.calibration.bundle_folder import (
    EVIDENCE,
    NOTARY,
    PDF,
    POINTS,
    READINGS,
    REPORT,
    STATEMENT,
    SUMS,
    format_sha256sums,
    list_bundle_files_and_faults,
    read_bundle_file,
)
from recordings.calibration.calibration_report import render_report_html, write_report_pdf
from recordings.calibration.calibration_text import describe_runs_with_swapped_loads
from recordings.calibration.evidence_document import EvidenceDocument, EvidenceTables
from recordings.calibration.untrusted_files import encode_uncompressed_parquet_table
from recordings.signatures.signing import (
    SigningKey,
    encode_in_toto_statement,
    encode_signed_envelope,
)


class EncodedTables(NamedTuple):
    """Tables of evidence as files by name, and their digests."""

    parquet_by_file_name: dict[str, bytes]
    digests: EvidenceTables


def encode_evidence_tables(readings: pl.DataFrame, points: pl.DataFrame) -> EncodedTables:
    """Encode the tables of evidence as Parquet, and compute their digests."""
    written = {
        READINGS: encode_uncompressed_parquet_table(readings),
        POINTS: encode_uncompressed_parquet_table(points),
    }
    return EncodedTables(
        written,
        EvidenceTables(
            readings_sha256=hashlib.sha256(written[READINGS]).hexdigest(),
            points_sha256=hashlib.sha256(written[POINTS]).hexdigest(),
        ),
    )


def write_bundle(
    folder: Path,
    document: EvidenceDocument,
    readings: pl.DataFrame,
    points: pl.DataFrame,
    tables: Mapping[str, bytes],
    signing_key: SigningKey | None,
    list_range: bytes | None = None,
) -> list[str]:
    """Complete the folder of a bundle, which already contains the recordings of runs.

    Args:
        folder: folder with the recordings.
        document: the evidence.
        readings: frame `readings`.
        points: frame of the points.
        tables: both frames by file name, from `encode_evidence_tables`.
        signing_key: signing key; None leaves the bundle unsigned.
        list_range: part of the recorder's notary list, if the campaign names one.

    Returns:
        Remarks for the user, a line each.

    Raises:
        EvidenceError: canonical JSON cannot represent a number or text.
    """
    for name, data in tables.items():
        (folder / name).write_bytes(data)
    (folder / EVIDENCE).write_bytes(document.canonical_json_bytes)
    if list_range is not None:
        (folder / NOTARY).write_bytes(list_range)
    html = render_report_html(document, readings, points)
    (folder / REPORT).write_bytes(html.encode())
    remark = write_report_pdf(html, folder / PDF)
    names, _ = list_bundle_files_and_faults(folder)
    digests = {name: read_bundle_file(folder, name).sha256 for name in names}
    sums = format_sha256sums(digests).encode()
    (folder / SUMS).write_bytes(sums)
    if signing_key is not None:
        digests[SUMS] = hashlib.sha256(sums).hexdigest()
        payload = encode_in_toto_statement(digests, make_signed_statement_predicate(document))
        (folder / STATEMENT).write_bytes(encode_signed_envelope(payload, signing_key))
    return [*([remark] if remark else []), *describe_runs_with_swapped_loads(document)]


def make_signed_statement_predicate(document: EvidenceDocument) -> dict[str, object]:
    """Make the predicate of the signed statement, which identifies the evidence.

    It has id, kind, machine, time and counter of the evidence, and the link to the previous one.
    """
    previous = document.chain.previous
    return {
        "id": document.id,
        "kind": document.kind,
        "machine": document.campaign.machine.id,
        "made": document.made,
        "counter": document.chain.counter,
        "previous": None if previous is None else previous.model_dump(mode="json"),
    }

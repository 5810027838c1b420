"""`calibrate --dcc`: write a digital calibration certificate in addition to the evidence."""

import hashlib
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from analysis.calibration.campaign.campaign_plan import CalibrationCampaign
from estimators.errors import EvidenceError
from recordings.calibration.bundle_folder import SUMS
from recordings.calibration.evidence_document import EvidenceDocument
from recordings.report.atomic_output import require_writable_output, stage_output_file

if TYPE_CHECKING:
    from recordings.dcc.dcc_signature import DccKey


@dataclass(frozen=True, slots=True)
class DccOutput:
    """Output file and signing keys of a digital calibration certificate.

    Attributes:
        file: certificate file to write.
        key_file: private ECDSA or RSA key in PEM; None leaves the certificate unsigned.
        certificate_file: X.509 certificate of that key in PEM; None if it has none.
    """

    file: Path
    key_file: Path | None = None
    certificate_file: Path | None = None


def require_dcc_inputs(
    source: Path, campaign: CalibrationCampaign, dcc: DccOutput, *, overwrites: bool
) -> "DccKey | None":
    """Raise an error, before any log is replayed, if no certificate can be made.

    Returns:
        The signing key; None if none is given.

    Raises:
        EvidenceError: the campaign lacks data for a certificate, or the key is invalid.
        OutputError: the file cannot be written.
    """
    from recordings.dcc.dcc_signature import read_dcc_signing_key
    from recordings.dcc.write_dcc import refuse_campaign_incomplete_for_dcc

    refuse_campaign_incomplete_for_dcc(campaign, source)
    require_writable_output(dcc.file, overwrites=overwrites)
    if dcc.key_file is None and dcc.certificate_file is not None:
        raise EvidenceError("--dcc-certificate and --dcc-key belong together; give both")
    return (
        None if dcc.key_file is None else read_dcc_signing_key(dcc.key_file, dcc.certificate_file)
    )


def write_and_verify_dcc(
    bundle_folder: Path,
    document: EvidenceDocument,
    dcc_output: DccOutput,
    dcc_key: "DccKey | None",
    *,
    overwrites: bool,
) -> str:
    """Write the digital calibration certificate of a bundle, and verify it.

    Returns:
        A remark for the user: which key signed the certificate, or that it is unsigned.

    Raises:
        EvidenceError: there is no calibration line, or the certificate fails verification.
    """
    from recordings.dcc.dcc_document import parse_untrusted_dcc, serialise_dcc_to_xml
    from recordings.dcc.dcc_signature import check_dcc_signature, sign_dcc
    from recordings.dcc.write_dcc import make_unsigned_dcc

    if document.calibration is None:
        return f"no {dcc_output.file}: there is no calibration line to certify"
    root = make_unsigned_dcc(
        document, hashlib.sha256((bundle_folder / SUMS).read_bytes()).hexdigest()
    )
    signed = root if dcc_key is None else sign_dcc(root, dcc_key)
    data = serialise_dcc_to_xml(signed)
    name = str(dcc_output.file)
    checked = check_dcc_signature(parse_untrusted_dcc(data, name), name)
    with stage_output_file(dcc_output.file, overwrites=overwrites) as partial:
        partial.write_bytes(data)
    if not checked.key_id:
        return f"{dcc_output.file} is unsigned; sign it with --dcc-key KEY.pem (ECDSA or RSA)"
    return f"{dcc_output.file} is signed by the key {checked.key_id[:12]}…"

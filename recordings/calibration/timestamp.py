"""Time stamps (RFC 3161): proof by an authority that a signature existed at a time.

payscope itself sends nothing: the request is a file that the user sends, the response another file.
"""

import datetime as dt
import hashlib
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Final

from estimators.errors import EvidenceError
from recordings.calibration.bundle_folder import STATEMENT, TIMESTAMP, BundleFile
from recordings.calibration.bundle_limits import LIMITS
from recordings.calibration.campaign_faults import parse_creation_time
from recordings.calibration.check_outcomes import BundleOutcome
from recordings.calibration.checked_bundle import CheckedBundle, require_content_in_memory
from recordings.calibration.evidence_document import EvidenceDocument

if TYPE_CHECKING:
    from cryptography.x509 import Certificate
    from rfc3161_client import TimeStampResponse

_INSTALL: Final = "pip install 'payscope[timestamp]'"
#: Hash algorithms that a time stamp may use, by object identifier (RFC 5754).
_HASHES: Final = {
    "2.16.840.1.101.3.4.2.1": hashlib.sha256,
    "2.16.840.1.101.3.4.2.2": hashlib.sha384,
    "2.16.840.1.101.3.4.2.3": hashlib.sha512,
}


def require_timestamp_library() -> None:
    """Raise an error, before any work begins, if rfc3161-client is not installed.

    Raises:
        EvidenceError: rfc3161-client is not installed.
    """
    try:
        import rfc3161_client  # noqa: F401  # pyright: ignore[reportUnusedImport]
    except ImportError:
        raise EvidenceError(f"time stamps need rfc3161-client: {_INSTALL}") from None


def encode_timestamp_request(statement: bytes) -> bytes:
    """Encode the query for a time-stamp authority, in DER (application/timestamp-query).

    Args:
        statement: content of `statement.dsse.json`.

    Raises:
        EvidenceError: rfc3161-client is not installed.
    """
    require_timestamp_library()
    from rfc3161_client import HashAlgorithm, TimestampRequestBuilder

    return (
        TimestampRequestBuilder()
        .data(statement)
        .hash_algorithm(HashAlgorithm.SHA256)
        .build()
        .as_bytes()
    )


def read_authority_certificates(path: Path) -> "tuple[Certificate, ...]":
    """Read root certificates of trusted time-stamp authorities from a file.

    Raises:
        EvidenceError: the file cannot be read, or has no certificate in PEM.
    """
    from cryptography.x509 import load_pem_x509_certificates

    require_timestamp_library()
    try:
        with path.open("rb") as file:
            data = file.read(LIMITS.response_bytes)
    except OSError as error:
        raise EvidenceError(f"{path}: cannot be read ({error.strerror})") from None
    try:
        return tuple(load_pem_x509_certificates(data))
    except ValueError:
        raise EvidenceError(
            f"{path}: holds no PEM certificate; give that of the time-stamp authority"
        ) from None


def check_bundle_timestamp(
    checked_bundle: CheckedBundle,
    files: Mapping[str, BundleFile],
    document: EvidenceDocument,
    authority_certificates: "Sequence[Certificate]",
) -> None:
    """Check that the time stamp, if any, belongs to this signature, and who issued it.

    Args:
        checked_bundle: receives the findings and the proven day.
        files: files of the bundle.
        document: the evidence.
        authority_certificates: trusted root certificates; without any, the day remains unproven.
    """
    if TIMESTAMP not in files:
        if authority_certificates:
            what = "is missing, although --tsa is given: the time of the signature is not proven"
            checked_bundle.add_finding(BundleOutcome.INCOMPLETE, TIMESTAMP, what)
        return
    if STATEMENT not in files:
        checked_bundle.add_finding(
            BundleOutcome.TAMPERED, TIMESTAMP, "belongs to a signature that is missing"
        )
        return
    try:
        from rfc3161_client import decode_timestamp_response
    except ImportError:
        checked_bundle.notes.append(
            f"{TIMESTAMP}: not checked, which needs rfc3161-client ({_INSTALL})"
        )
        return
    try:
        response = decode_timestamp_response(require_content_in_memory(files, TIMESTAMP))
        stamped = response.tst_info.gen_time.astimezone(dt.UTC)
        imprint = response.tst_info.message_imprint
        hashed = _HASHES.get(imprint.hash_algorithm.dotted_string)
    except Exception as error:  # noqa: BLE001  the parser is another's, the bytes a stranger's
        what = f"is not a granted time-stamp response ({str(error)[: LIMITS.fault_characters]})"
        checked_bundle.add_finding(BundleOutcome.TAMPERED, TIMESTAMP, what)
        return
    statement = require_content_in_memory(files, STATEMENT)
    if hashed is None:
        checked_bundle.add_finding(
            BundleOutcome.TAMPERED, TIMESTAMP, "uses a hash that is not SHA-2"
        )
    elif hashed(statement).digest() != imprint.message:
        checked_bundle.add_finding(
            BundleOutcome.TAMPERED, TIMESTAMP, "belongs to another signature than this one"
        )
    elif stamped < parse_creation_time(document) - dt.timedelta(seconds=LIMITS.clock_difference_s):
        what = f"is of {stamped:%F %R} UTC, before the evidence says that it was made"
        checked_bundle.add_finding(BundleOutcome.IRREPRODUCIBLE, TIMESTAMP, what)
    elif not authority_certificates:
        checked_bundle.notes.append(
            f"a time stamp states that the evidence was signed no later than {stamped:%F %R} UTC; "
            "only the authority's certificate proves whose time stamp this is: --tsa CA.pem"
        )
    else:
        fault = describe_timestamp_fault(response, statement, authority_certificates)
        if fault:
            checked_bundle.add_finding(BundleOutcome.TAMPERED, TIMESTAMP, fault)
        else:
            checked_bundle.proven_day = stamped.date()
            checked_bundle.notes.append(
                f"signed no later than {stamped:%F %R} UTC, proven by its time stamp"
            )


def describe_timestamp_fault(
    response: "TimeStampResponse", statement: bytes, authority_certificates: "Sequence[Certificate]"
) -> str:
    """Say why a time stamp is not a valid one by a trusted authority; "" if it is."""
    from rfc3161_client import VerificationError, VerifierBuilder

    verifier = VerifierBuilder(roots=list(authority_certificates)).build()
    try:
        verifier.verify_message(response, statement)
    except (VerificationError, ValueError) as error:
        said = str(error)[: LIMITS.fault_characters]
        return f"is not by an authority of --tsa, or not valid ({said})"
    return ""

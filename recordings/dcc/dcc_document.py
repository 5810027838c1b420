"""Parse untrusted digital calibration certificates of one version, within bounds, without DTD."""

import re
from collections.abc import Iterator
from importlib.util import find_spec
from typing import TYPE_CHECKING, Final

from estimators.errors import EvidenceError
from recordings.dcc.dcc_limits import LIMITS

if TYPE_CHECKING:
    from lxml.etree import _Element  # pyright: ignore[reportPrivateUsage]

DCC: Final = "https://ptb.de/dcc"
SI: Final = "https://ptb.de/si"
DS: Final = "http://www.w3.org/2000/09/xmldsig#"
#: Version of the schema that is read and written; 3.3 has other elements, earlier ones lack some.
VERSION: Final = "3.2.1"
_IDS: Final = ("id", "Id", "ID", "{http://www.w3.org/XML/1998/namespace}id")
#: Core data that the schema requires, and the form of each.
_CORE: Final = {
    "countryCodeISO3166_1": r"[A-Z]{2}",
    "uniqueIdentifier": r"\S+(\s+\S+)*",
    "beginPerformanceDate": r"\d{4}-\d\d-\d\d",
    "endPerformanceDate": r"\d{4}-\d\d-\d\d",
}


def require_xml_libraries() -> None:
    """Raise an error if the libraries for certificates are not installed.

    Raises:
        EvidenceError: lxml or signxml is missing.
    """
    lacking = [name for name in ("lxml", "signxml") if find_spec(name) is None]
    if lacking:
        raise EvidenceError(
            f"digital calibration certificates need {' and '.join(lacking)}: "
            "pip install 'payscope[dcc]'"
        )


def parse_untrusted_dcc(xml_bytes: bytes, source: str) -> "_Element":
    """Parse a certificate and check its basic structure, without access to other files.

    Args:
        xml_bytes: content of the certificate's file.
        source: name of the certificate, for errors.

    Returns:
        The root element; its signature is not checked.

    Raises:
        EvidenceError: the content is too large, not XML, has a DTD, is of another version, or is
            not a certificate.
    """
    require_xml_libraries()
    from lxml import etree

    if len(xml_bytes) > LIMITS.certificate_bytes:
        raise EvidenceError(
            f"{source}: is larger than {LIMITS.certificate_bytes >> 20} MiB, the largest "
            "certificate that is read; ask the laboratory for a smaller one"
        )
    parser = etree.XMLParser(
        resolve_entities=False,
        no_network=True,
        load_dtd=False,
        dtd_validation=False,
        huge_tree=False,
        remove_comments=True,
    )
    try:
        root = etree.fromstring(xml_bytes, parser)
    except (etree.XMLSyntaxError, ValueError) as fault:
        raise EvidenceError(
            f"{source}: is not XML ({str(fault)[:120]}); give a DCC (.xml)"
        ) from None
    if root.getroottree().docinfo.internalDTD is not None:
        raise EvidenceError(
            f"{source}: contains a DTD, which is refused; ask the laboratory for a copy without it"
        )
    if root.tag != f"{{{DCC}}}digitalCalibrationCertificate":
        raise EvidenceError(
            f"{source}: is not a digital calibration certificate: its root element is "
            f"{str(root.tag)[:80]}; give a DCC (.xml)"
        )
    version = root.get("schemaVersion", "none")
    if version != VERSION:
        raise EvidenceError(
            f"{source}: is of DCC version {version[:20]}, but only {VERSION} is supported; ask the "
            f"laboratory for one of {VERSION}, or state the masses by value_kg and u_kg"
        )
    fault = next(iter_faults_against_dcc_schema(root), None)
    if fault is not None:
        raise EvidenceError(f"{source}: {fault}")
    return root


def iter_faults_against_dcc_schema(certificate: "_Element") -> Iterator[str]:
    """Yield faults of the basic structure against the schema of certificates."""
    seen: set[str] = set()
    for count, element in enumerate(certificate.iter()):
        if count > LIMITS.certificate_elements:
            yield f"has more than {LIMITS.certificate_elements} elements"
            return
        if not isinstance(element.tag, str):  # pyright: ignore[reportUnnecessaryIsInstance]
            yield "has a processing instruction or an entity inside"
            return
        for name in _IDS:
            value = element.get(name)
            if value is not None and value in seen:
                yield f"has two elements with the id '{value[:60]}'"
            if value is not None:
                seen.add(value)
    yield from _iter_faults_of_missing_or_repeated_elements(certificate)


def _iter_faults_of_missing_or_repeated_elements(certificate: "_Element") -> Iterator[str]:
    """Yield faults on elements that must occur once, but are missing or repeated."""
    names = [child.tag for child in certificate]
    for name in ("administrativeData", "measurementResults"):
        if names.count(f"{{{DCC}}}{name}") != 1:
            yield f"has {names.count(f'{{{DCC}}}{name}')} {name} elements instead of one"
            return
        if len(list(certificate.iter(f"{{{DCC}}}{name}"))) != 1:
            yield f"has a {name} element inside another element"
    core = certificate.findall(f"{{{DCC}}}administrativeData/{{{DCC}}}coreData")
    if len(core) != 1:
        yield f"has {len(core)} coreData elements instead of one"
        return
    for name, form in _CORE.items():
        found = core[0].findall(f"{{{DCC}}}{name}")
        if len(found) != 1 or not re.fullmatch(form, read_leaf_text(found[0]) or ""):
            yield f"has no valid {name}"


def serialise_dcc_to_xml(certificate: "_Element") -> bytes:
    """Serialise a certificate to the bytes of an XML file."""
    from lxml import etree

    return etree.tostring(certificate, xml_declaration=True, encoding="UTF-8")


def read_leaf_text(element: "_Element | None") -> str | None:
    """Read the stripped text of an element; None if it is missing or has child elements.

    Programs differ in whether they read text after a child element.
    """
    if element is None or len(element):
        return None
    return (element.text or "").strip()

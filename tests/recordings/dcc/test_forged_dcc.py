"""Forged certificates: each is refused, in words that say what is wrong with it."""

import base64
import re
from collections.abc import Callable

import pytest

pytest.importorskip("signxml", reason="signxml is not installed (pip install 'payscope[dcc]')")

from estimators.errors import EvidenceError
from recordings.dcc.dcc_document import MOST_BYTES, parse_dcc
from recordings.dcc.dcc_masses import CertifiedMass, certified_masses
from recordings.dcc.dcc_signature import check_signature
from tests.recordings.dcc.certificates import signed_weights, weights_xml, wrapped

Forge = Callable[[bytes], bytes]
DTD = b'<!DOCTYPE d [<!ENTITY x SYSTEM "file:///etc/hostname">]>'
LAUGHS = b'<!DOCTYPE d [<!ENTITY a "aaaaaaaaaa"><!ENTITY b "&a;&a;&a;&a;&a;&a;&a;&a;">]>'


def read(data: bytes) -> list[CertifiedMass]:
    signed = check_signature(parse_dcc(data, "w.xml"), "w.xml")
    return certified_masses(signed.root, "weight-1", "w.xml")


def put(old: str, new: str, count: int = 1) -> Forge:
    """Replace a text that is there."""

    def forge(data: bytes) -> bytes:
        assert old.encode() in data, old
        return data.replace(old.encode(), new.encode(), count)

    return forge


def repeat(name: str) -> Forge:
    """An element twice."""

    def forge(data: bytes) -> bytes:
        found = re.search(rf"<dcc:{name}[ >].*?</dcc:{name}>".encode(), data, re.S)
        assert found
        return data.replace(found[0], found[0] * 2, 1)

    return forge


def drop(pattern: str) -> Forge:
    """Without what a pattern finds first."""

    def forge(data: bytes) -> bytes:
        made, count = re.subn(pattern.encode(), b"", data, count=1, flags=re.S)
        assert count
        return made

    return forge


VALUE = "<si:value>20.0005</si:value>"
UNIT = VALUE + "\n<si:unit>\\kilogram"
FORGED: dict[str, tuple[Forge, str]] = {
    # the file
    "no XML": (lambda _: b"PDF-1.7", "is no XML"),
    "empty": (lambda _: b"", "is no XML"),
    "cut off": (lambda data: data[:-40], "is no XML"),
    "two roots": (lambda data: data + data, "is no XML"),
    "too large": (lambda data: data + b" " * MOST_BYTES, "MiB"),
    "external entity": (
        lambda data: DTD + data.replace(b">Example Masses<", b">&x;<"),
        "DTD",
    ),
    "entities that grow": (lambda data: LAUGHS + data, "DTD"),
    "DTD without entities": (lambda data: b"<!DOCTYPE d>" + data, "DTD"),
    "DTD in UTF-16": (
        lambda data: (DTD + data).decode().encode("utf-16"),
        "DTD",
    ),
    "nested too deep": (
        put("<dcc:results>", "<dcc:results>" + "<dcc:x>" * 5000),
        "is no XML",
    ),
    "processing instruction": (put("<dcc:items>", "<?php x?><dcc:items>"), "instruction"),
    # the frame
    "another root": (
        lambda data: data.replace(b"digitalCalibrationCertificate", b"certificate"),
        "is no digital calibration certificate",
    ),
    "another namespace": (put("https://ptb.de/dcc", "https://ptb.de/dccx"), "no digital"),
    "version 3.3.0": (put('"3.2.1"', '"3.3.0"'), "of DCC version 3.3.0"),
    "version 2.4.0": (put('"3.2.1"', '"2.4.0"'), "of DCC version 2.4.0"),
    "no version": (put(' schemaVersion="3.2.1"', ""), "of DCC version none"),
    "two administrative data": (
        put(
            "<dcc:measurementResults>",
            "<dcc:administrativeData></dcc:administrativeData><dcc:measurementResults>",
        ),
        "2 elements administrativeData",
    ),
    "two core data": (repeat("coreData"), "2 elements coreData"),
    "no results": (drop("<dcc:measurementResults>.*</dcc:measurementResults>"), "0 elements"),
    "no identifier": (drop("<dcc:uniqueIdentifier>.*?</dcc:uniqueIdentifier>"), "uniqueId"),
    "two identifiers": (repeat("uniqueIdentifier"), "uniqueIdentifier"),
    "a day that is none": (put("2026-01-07", "yesterday"), "beginPerformanceDate"),
    "two elements of one id": (put('id="weight-2"', 'id="weight-1"'), "two elements of the id"),
    "no laboratory": (drop("<dcc:content>Example Masses</dcc:content>"), "name its laboratory"),
    # the item
    "item that is not there": (
        lambda data: data.replace(b"weight-1", b"weight-9"),
        "has no item 'weight-1'",
    ),
    "two items of one number": (put("SN-weight-2", "weight-1"), "2 items 'weight-1'"),
    "result of another item": (put('refId="weight-1"', 'refId="weight-2"'), "refType"),
    "two masses": (put("basic_nominalValue", "mass_conventionalMass"), "2 quantities"),
    "nominal value alone": (
        lambda data: data.replace(b"mass_conventionalMass", b"basic_nominalValue"),
        "is a mass by its refType",
    ),
    # the mass
    "unit of a length": (put(UNIT, UNIT.replace("kilogram", "metre")), "unit '\\metre'"),
    "unit in words": (put(UNIT, UNIT.replace("\\kilogram", "kg")), "unit 'kg'"),
    "no unit": (
        put(f"{VALUE}\n<si:unit>\\kilogram</si:unit>", VALUE),
        "single si:unit",
    ),
    "grams for kilograms": (
        put("<si:uncertainty>0.0016", "<si:uncertainty>16.0"),
        "is none of",
    ),
    "two values": (put(VALUE, VALUE * 2), "single si:value"),
    "no number": (put(VALUE, "<si:value>NaN</si:value>"), "decimal number"),
    "infinite": (put(VALUE, "<si:value>1e999</si:value>"), "not finite"),
    "negative": (put(VALUE, "<si:value>-20.0</si:value>"), "no mass of a weight"),
    "comma": (put(VALUE, "<si:value>20,0005</si:value>"), "decimal number"),
    "value cut by an element": (
        put(VALUE, "<si:value>20<si:x/>.0005</si:value>"),
        "single si:value",
    ),
    "no uncertainty": (drop("<si:expandedUnc>.*?</si:expandedUnc>"), "0 uncertainties"),
    "U of 0": (put("<si:uncertainty>0.0016", "<si:uncertainty>0"), "uncertainty of 0"),
    "negative U": (put("<si:uncertainty>0.0016", "<si:uncertainty>-0.0016"), "uncertainty of"),
    "U without k": (drop("<si:coverageFactor>2</si:coverageFactor>"), "coverageFactor"),
    "k of 0": (put("Factor>2<", "Factor>0<"), "no coverage factor"),
    "k of a thousand": (put("Factor>2<", "Factor>1000<"), "no coverage factor"),
    "U without probability": (
        drop("<si:coverageProbability>0.95</si:coverageProbability>"),
        "coverageProbability",
    ),
    "probability of 1": (put("Probability>0.95", "Probability>1"), "coverage probability"),
}
SIGNED: dict[str, tuple[Forge, str]] = {
    "mass changed": (put("20.0005", "20.0006"), "does not hold"),
    "uncertainty changed": (put("0.0016", "0.0001"), "does not hold"),
    "laboratory changed": (put("Example Masses", "PTB"), "does not hold"),
    "identifier changed": (put("EXAMPLE-1", "EXAMPLE-2"), "does not hold"),
    "wrapped with its signature": (lambda data: wrapped(data, "root"), "two elements of the id"),
    "wrapped, its signature moved": (lambda data: wrapped(data, "moved"), "of the id"),
    "wrapped, other ids": (lambda data: wrapped(data, "root", b"forged"), "inside of another"),
    "wrapped, its signature moved, other ids": (
        lambda data: wrapped(data, "moved", b"forged"),
        "inside of another",
    ),
    "two signatures": (
        lambda data: re.sub(rb"(<ds:Signature .*</ds:Signature>)", rb"\1\1", data, flags=re.S),
        "2 signatures",
    ),
    "signature at another place": (
        lambda data: re.sub(
            rb"(<ds:Signature .*</ds:Signature>)(</dcc:digital)",
            rb"<dcc:comment>\1</dcc:comment>\2",
            data,
            flags=re.S,
        ),
        "not a child",
    ),
    "signature of a part": (put('URI=""', 'URI="#weight-1"'), "not of the whole"),
    "no reference": (drop("<ds:Reference .*</ds:Reference>"), "not of the whole"),
    "XPath chooses what is signed": (
        put(
            "http://www.w3.org/2000/09/xmldsig#enveloped-signature",
            "http://www.w3.org/TR/1999/REC-xpath-19991116",
        ),
        "transform that is not read",
    ),
    "XSLT": (
        put(
            "http://www.w3.org/2000/09/xmldsig#enveloped-signature",
            "http://www.w3.org/TR/1999/REC-xslt-19991116",
        ),
        "transform that is not read",
    ),
    "HMAC, whose key anybody has": (
        put("xmldsig-more#ecdsa-sha256", "xmldsig-more#hmac-sha256"),
        "does not hold",
    ),
    "SHA-1": (
        put(
            "http://www.w3.org/2001/04/xmldsig-more#ecdsa-sha256",
            "http://www.w3.org/2000/09/xmldsig#rsa-sha1",
        ),
        "does not hold",
    ),
    "no key": (drop("<ds:KeyInfo>.*</ds:KeyInfo>"), "does not hold"),
    "a certificate that is none": (
        lambda data: re.sub(
            rb"<ds:KeyInfo>.*</ds:KeyInfo>",
            b"<ds:KeyInfo><ds:X509Data><ds:X509Certificate>"
            + base64.b64encode(b"none")
            + b"</ds:X509Certificate></ds:X509Data></ds:KeyInfo>",
            data,
            flags=re.S,
        ),
        "does not hold",
    ),
    "empty signature value": (
        lambda data: re.sub(rb"(<ds:SignatureValue>)[^<]*", rb"\1", data),
        "does not hold",
    ),
}


@pytest.mark.parametrize("name", FORGED)
def test_a_forged_certificate_is_refused(name: str) -> None:
    forge, words = FORGED[name]
    with pytest.raises(EvidenceError, match=re.escape(words)):
        read(forge(weights_xml()))


@pytest.mark.parametrize("name", SIGNED)
def test_a_signed_certificate_that_was_changed_is_refused(name: str) -> None:
    forge, words = SIGNED[name]
    data = signed_weights()
    changed = forge(data)
    assert changed != data
    with pytest.raises(EvidenceError, match=re.escape(words)):
        read(changed)


def test_the_tables_have_at_least_forty() -> None:
    assert len(FORGED) + len(SIGNED) >= 40

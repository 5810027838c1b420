"""Forged certificates: each is refused, in words that say what is wrong with it."""

import base64
import re
from collections.abc import Callable

import pytest

from recordings.dcc.dcc_limits import LIMITS

pytest.importorskip("signxml", reason="signxml is not installed (pip install 'payscope[dcc]')")

from estimators.errors import EvidenceError
from recordings.dcc.dcc_document import parse_untrusted_dcc
from recordings.dcc.dcc_masses import CertifiedMass, read_certified_masses
from recordings.dcc.dcc_signature import check_dcc_signature
from tests.recordings.dcc.certificates import (
    signed_weights,
    weight_set_xml,
    weights_xml,
    wrapped,
)

Forge = Callable[[bytes], bytes]
DTD = b'<!DOCTYPE d [<!ENTITY x SYSTEM "file:///etc/hostname">]>'
LAUGHS = b'<!DOCTYPE d [<!ENTITY a "aaaaaaaaaa"><!ENTITY b "&a;&a;&a;&a;&a;&a;&a;&a;">]>'


def read(data: bytes) -> list[CertifiedMass]:
    signed = check_dcc_signature(parse_untrusted_dcc(data, "w.xml"), "w.xml")
    return read_certified_masses(signed.root, "weight-1", "w.xml")


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
    "no XML": (lambda _: b"PDF-1.7", "is not XML"),
    "empty": (lambda _: b"", "is not XML"),
    "cut off": (lambda data: data[:-40], "is not XML"),
    "two roots": (lambda data: data + data, "is not XML"),
    "too large": (lambda data: data + b" " * LIMITS.certificate_bytes, "MiB"),
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
        "is not XML",
    ),
    "processing instruction": (put("<dcc:items>", "<?php x?><dcc:items>"), "instruction"),
    # the frame
    "another root": (
        lambda data: data.replace(b"digitalCalibrationCertificate", b"certificate"),
        "is not a digital calibration certificate",
    ),
    "another namespace": (put("https://ptb.de/dcc", "https://ptb.de/dccx"), "not a digital"),
    "version 3.3.0": (put('"3.2.1"', '"3.3.0"'), "of DCC version 3.3.0"),
    "version 2.4.0": (put('"3.2.1"', '"2.4.0"'), "of DCC version 2.4.0"),
    "no version": (put(' schemaVersion="3.2.1"', ""), "of DCC version none"),
    "two administrative data": (
        put(
            "<dcc:measurementResults>",
            "<dcc:administrativeData></dcc:administrativeData><dcc:measurementResults>",
        ),
        "2 administrativeData elements",
    ),
    "two core data": (repeat("coreData"), "2 coreData elements"),
    "no results": (drop("<dcc:measurementResults>.*</dcc:measurementResults>"), "0 measurement"),
    "no identifier": (drop("<dcc:uniqueIdentifier>.*?</dcc:uniqueIdentifier>"), "uniqueId"),
    "two identifiers": (repeat("uniqueIdentifier"), "uniqueIdentifier"),
    "a day that is none": (put("2026-01-07", "yesterday"), "beginPerformanceDate"),
    "two elements of one id": (put('id="weight-2"', 'id="weight-1"'), "two elements with the id"),
    "no laboratory": (drop("<dcc:content>Example Masses</dcc:content>"), "name its laboratory"),
    # the item
    "item that is not there": (
        lambda data: data.replace(b"weight-1", b"weight-9"),
        "has no item 'weight-1'",
    ),
    "two items of one number": (put("SN-weight-2", "weight-1"), "2 items named 'weight-1'"),
    "result of another item": (put('refId="weight-1"', 'refId="weight-2"'), "refType"),
    "one mass for two items": (
        put('<dcc:result refId="weight-1"', '<dcc:result refId="weight-1 weight-2"'),
        "one mass for 2 items",
    ),
    "two masses": (put("basic_nominalValue", "mass_conventionalMass"), "2 quantities"),
    "nominal value alone": (
        lambda data: data.replace(b"mass_conventionalMass", b"basic_nominalValue"),
        "has the refType of a mass",
    ),
    # the mass
    "unit of a length": (put(UNIT, UNIT.replace("kilogram", "metre")), "unit '\\metre'"),
    "unit in words": (put(UNIT, UNIT.replace("\\kilogram", "kg")), "unit 'kg'"),
    "no unit": (
        put(f"{VALUE}\n<si:unit>\\kilogram</si:unit>", VALUE),
        "exactly one si:unit",
    ),
    "grams for kilograms": (
        put("<si:uncertainty>0.0016", "<si:uncertainty>16.0"),
        "is not possible for",
    ),
    "two values": (put(VALUE, VALUE * 2), "exactly one si:value"),
    "no number": (put(VALUE, "<si:value>NaN</si:value>"), "decimal number"),
    "infinite": (put(VALUE, "<si:value>1e999</si:value>"), "not finite"),
    "negative": (put(VALUE, "<si:value>-20.0</si:value>"), "not a possible mass of a weight"),
    "comma": (put(VALUE, "<si:value>20,0005</si:value>"), "decimal number"),
    "value cut by an element": (
        put(VALUE, "<si:value>20<si:x/>.0005</si:value>"),
        "exactly one si:value",
    ),
    "no uncertainty": (drop("<si:expandedUnc>.*?</si:expandedUnc>"), "0 uncertainties"),
    "U of 0": (put("<si:uncertainty>0.0016", "<si:uncertainty>0"), "uncertainty of 0"),
    "negative U": (put("<si:uncertainty>0.0016", "<si:uncertainty>-0.0016"), "uncertainty of"),
    "U without k": (drop("<si:coverageFactor>2</si:coverageFactor>"), "coverageFactor"),
    "k of 0": (put("Factor>2<", "Factor>0<"), "is not from 1 to 100"),
    "k of a thousand": (put("Factor>2<", "Factor>1000<"), "is not from 1 to 100"),
    "U without probability": (
        drop("<si:coverageProbability>0.95</si:coverageProbability>"),
        "coverageProbability",
    ),
    "probability of 1": (put("Probability>0.95", "Probability>1"), "coverage probability"),
}
LIST = "<si:valueXMLList>19.9991 20.0005"
NAMES = "SN-weight-2 SN-weight-1"
U = "<si:uncertaintyXMLList>0.0016 0.0016"
FORGED_SETS: dict[str, tuple[Forge, str]] = {
    # the numbers
    "a value too few": (
        put(LIST, "<si:valueXMLList>19.9991"),
        "1 values but 2 names",
    ),
    "a value too many": (put(LIST, LIST + " 20.1"), "3 values but 2 names"),
    "no values": (put(LIST, "<si:valueXMLList>"), "exactly one si:valueXMLList"),
    "two lists of values": (put(LIST, LIST + "</si:valueXMLList>" + LIST), "exactly one si:value"),
    "a list and a value": (
        put(
            "</si:expandedUncXMLList></si:realListXMLList>",
            "</si:expandedUncXMLList></si:realListXMLList><si:real/>",
        ),
        "exactly one si:real",
    ),
    "no number": (put(LIST, "<si:valueXMLList>19.9991 NaN"), "'NaN' is not a decimal number"),
    "no number, of another weight": (put(LIST, "<si:valueXMLList>NaN 20.0005"), "decimal number"),
    "infinite": (put(LIST, "<si:valueXMLList>19.9991 1e999"), "not finite"),
    "negative": (put(LIST, "<si:valueXMLList>19.9991 -20.0005"), "not a possible mass of a weight"),
    "decimal commas": (put(LIST, "<si:valueXMLList>19,9991 20,0005"), "decimal number"),
    "separated by semicolons": (
        put(LIST, "<si:valueXMLList>19.9991;20.0005"),
        "1 values but 2 names",
    ),
    "list cut by an element": (
        put(LIST, "<si:valueXMLList>19.9991 <si:x/>20.0005"),
        "exactly one si:",
    ),
    "more values than any set has": (put(LIST, LIST + " 20" * 1000), "at most 1000 are"),
    # their units
    "no units": (
        drop(r"<si:unitXMLList>[^<]*</si:unitXMLList>(?=\n<si:expanded)"),
        "exactly one si:unitXMLList",
    ),
    "a unit of a length among them": (
        put(
            r"\kilogram</si:unitXMLList>" + "\n<si:exp",
            r"\kilogram \metre</si:unitXMLList>" + "\n<si:exp",
        ),
        r"unit '\metre'",
    ),
    "three units of two values": (
        put(
            r"\kilogram</si:unitXMLList>" + "\n<si:exp",
            r"\kilogram \kilogram \kilogram</si:unitXMLList>" + "\n<si:exp",
        ),
        "3 entries for 2 values",
    ),
    # their uncertainties
    "no uncertainties": (
        drop("<si:expandedUncXMLList>.*?</si:expandedUncXMLList>"),
        "0 uncertainties",
    ),
    "uncertainties of single values": (
        lambda data: data.replace(b"expandedUncXMLList", b"expandedUnc"),
        "0 uncertainties",
    ),
    "three U of two values": (put(U, U + " 0.0016"), "3 entries for 2 values"),
    "U of 0": (put(U, "<si:uncertaintyXMLList>0.0016 0"), "uncertainty of 0 kg"),
    "negative U": (put(U, "<si:uncertaintyXMLList>0.0016 -0.0016"), "uncertainty of -0.0008 kg"),
    "U that is not a number": (put(U, "<si:uncertaintyXMLList>0.0016 NaN"), "decimal number"),
    "U of grams": (put(U, "<si:uncertaintyXMLList>1.6 16"), "is not possible for 20.0005 kg"),
    "one U for several units": (
        lambda data: put(U, "<si:uncertaintyXMLList>0.0016")(
            data.replace(rb"\kilogram</si:unitXMLList>", rb"\kilogram \tonne</si:unitXMLList>")
        ),
        "one uncertainty for values in several units",
    ),
    "U without k": (
        drop("<si:coverageFactorXMLList>2</si:coverageFactorXMLList>"),
        "coverageFactorXMLList",
    ),
    "k of single values": (
        lambda data: data.replace(b"coverageFactorXMLList", b"coverageFactor"),
        "coverageFactorXMLList",
    ),
    "k of 0": (put("FactorXMLList>2<", "FactorXMLList>2 0<"), "is not from 1 to 100"),
    "three k of two values": (put("FactorXMLList>2<", "FactorXMLList>2 2 2<"), "3 entries"),
    "U without probability": (
        drop("<si:coverageProbabilityXMLList>.*</si:coverageProbabilityXMLList>"),
        "coverageProbabilityXMLList",
    ),
    "probability in percent": (put("ProbabilityXMLList>0.95", "ProbabilityXMLList>95"), "prob"),
    # whose each is
    "a name too few": (put(NAMES, "SN-weight-1"), "values but 1 names"),
    "a name of no item": (
        put(NAMES, "SN-weight-9 SN-weight-1"),
        "'SN-weight-9', which is the name of 0 items",
    ),
    "a name twice": (put(NAMES, "SN-weight-1 SN-weight-1"), "names a weight twice"),
    "a name of two items": (
        lambda data: put("<dcc:value>SN-weight-2", "<dcc:value>SN-weight-1")(
            put(NAMES, "SN-weight-1 weight-2")(data)
        ),
        "'SN-weight-1', which is the name of 2 items",
    ),
    "names of a result that is of one item": (
        put("<dcc:result>", '<dcc:result refId="weight-1">'),
        "which is the name of 0 items of that result",
    ),
    "two lists of names that disagree": (
        put("M1 M1", "SN-weight-1 SN-weight-2"),
        "two lists of names",
    ),
    "labels that disagree": (
        put(LIST, "<si:labelXMLList>weight-1 weight-2</si:labelXMLList>" + LIST),
        "two lists of names",
    ),
    "no names, a value too many": (
        lambda data: put(LIST, LIST + " 20.1")(put(NAMES, "M1 M1")(data)),
        "a result has 2 weights but a list has 3 values without names",
    ),
    "no names, of one item": (
        lambda data: put("<dcc:result>", '<dcc:result refId="weight-1">')(put(NAMES, "M1")(data)),
        "a result has 1 weight but a list has 2 values without names",
    ),
    "no names, referred to backwards": (
        lambda data: put("<dcc:result>", '<dcc:result refId="weight-2 weight-1">')(
            put(NAMES, "M1")(data)
        ),
        "another order than the items",
    ),
    "two lists of masses": (put("basic_nominalValue", "mass_conventionalMass"), "2 quantities"),
}
SIGNED: dict[str, tuple[Forge, str]] = {
    "mass changed": (put("20.0005", "20.0006"), "is not valid"),
    "uncertainty changed": (put("0.0016", "0.0001"), "is not valid"),
    "laboratory changed": (put("Example Masses", "PTB"), "is not valid"),
    "identifier changed": (put("EXAMPLE-1", "EXAMPLE-2"), "is not valid"),
    "wrapped with its signature": (lambda data: wrapped(data, "root"), "two elements with the id"),
    "wrapped, its signature moved": (lambda data: wrapped(data, "moved"), "with the id"),
    "wrapped, other ids": (lambda data: wrapped(data, "root", b"forged"), "inside another"),
    "wrapped, its signature moved, other ids": (
        lambda data: wrapped(data, "moved", b"forged"),
        "inside another",
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
        "not directly below the root",
    ),
    "signature of a part": (put('URI=""', 'URI="#weight-1"'), "does not cover the whole"),
    "no reference": (drop("<ds:Reference .*</ds:Reference>"), "does not cover the whole"),
    "XPath chooses what is signed": (
        put(
            "http://www.w3.org/2000/09/xmldsig#enveloped-signature",
            "http://www.w3.org/TR/1999/REC-xpath-19991116",
        ),
        "unsupported transform",
    ),
    "XSLT": (
        put(
            "http://www.w3.org/2000/09/xmldsig#enveloped-signature",
            "http://www.w3.org/TR/1999/REC-xslt-19991116",
        ),
        "unsupported transform",
    ),
    "HMAC, whose key anybody has": (
        put("xmldsig-more#ecdsa-sha256", "xmldsig-more#hmac-sha256"),
        "is not valid",
    ),
    "SHA-1": (
        put(
            "http://www.w3.org/2001/04/xmldsig-more#ecdsa-sha256",
            "http://www.w3.org/2000/09/xmldsig#rsa-sha1",
        ),
        "is not valid",
    ),
    "no key": (drop("<ds:KeyInfo>.*</ds:KeyInfo>"), "is not valid"),
    "a certificate that is none": (
        lambda data: re.sub(
            rb"<ds:KeyInfo>.*</ds:KeyInfo>",
            b"<ds:KeyInfo><ds:X509Data><ds:X509Certificate>"
            + base64.b64encode(b"none")
            + b"</ds:X509Certificate></ds:X509Data></ds:KeyInfo>",
            data,
            flags=re.S,
        ),
        "is not valid",
    ),
    "empty signature value": (
        lambda data: re.sub(rb"(<ds:SignatureValue>)[^<]*", rb"\1", data),
        "is not valid",
    ),
}


@pytest.mark.parametrize("name", FORGED)
def test_a_forged_certificate_is_refused(name: str) -> None:
    forge, words = FORGED[name]
    with pytest.raises(EvidenceError, match=re.escape(words)):
        read(forge(weights_xml()))


@pytest.mark.parametrize("name", FORGED_SETS)
def test_a_forged_certificate_of_a_set_is_refused(name: str) -> None:
    forge, words = FORGED_SETS[name]
    with pytest.raises(EvidenceError, match=re.escape(words)) as refusal:
        read(forge(weight_set_xml()))
    assert "\n" not in str(refusal.value)


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

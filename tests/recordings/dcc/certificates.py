"""Certificates of weights for tests: made here, after the schema, of no laboratory that exists."""

from functools import cache

from lxml import etree

from recordings.dcc.dcc_document import parse_untrusted_dcc, serialise_dcc_to_xml
from recordings.dcc.dcc_signature import DccKey, sign_dcc

WEIGHTS = {"weight-1": (20.0005, 0.0008), "weight-2": (19.9991, 0.0008)}
#: U of a certificate is twice the standard uncertainty.
COVERAGE_FACTOR = 2.0

_ITEM = """<dcc:item id="{id}"><dcc:name><dcc:content>Weight</dcc:content></dcc:name>
<dcc:identifications><dcc:identification><dcc:issuer>manufacturer</dcc:issuer>
<dcc:value>SN-{id}</dcc:value></dcc:identification></dcc:identifications></dcc:item>"""
_RESULT = """<dcc:result refId="{id}"><dcc:name><dcc:content>Mass</dcc:content></dcc:name><dcc:data>
<dcc:quantity refType="basic_nominalValue"><si:real><si:value>20</si:value>
<si:unit>\\kilogram</si:unit></si:real></dcc:quantity>
<dcc:quantity refType="mass_conventionalMass"><si:real><si:value>{value}</si:value>
<si:unit>\\kilogram</si:unit><si:expandedUnc><si:uncertainty>{expanded}</si:uncertainty>
<si:coverageFactor>2</si:coverageFactor><si:coverageProbability>0.95</si:coverageProbability>
</si:expandedUnc></si:real></dcc:quantity></dcc:data></dcc:result>"""
#: A set: all weights in one result, as lists, beside which their numbers stand.
_SET = """<dcc:result><dcc:name><dcc:content>Masses</dcc:content></dcc:name><dcc:data><dcc:list>
<dcc:quantity><dcc:charsXMLList>{names}</dcc:charsXMLList></dcc:quantity>
<dcc:quantity><dcc:charsXMLList>M1 M1</dcc:charsXMLList></dcc:quantity>
<dcc:quantity refType="basic_nominalValue"><si:realListXMLList>
<si:valueXMLList>20 20</si:valueXMLList><si:unitXMLList>\\kilogram</si:unitXMLList>
</si:realListXMLList></dcc:quantity>
<dcc:quantity refType="mass_conventionalMass"><si:realListXMLList>
<si:valueXMLList>{values}</si:valueXMLList><si:unitXMLList>\\kilogram</si:unitXMLList>
<si:expandedUncXMLList><si:uncertaintyXMLList>{expanded}</si:uncertaintyXMLList>
<si:coverageFactorXMLList>2</si:coverageFactorXMLList>
<si:coverageProbabilityXMLList>0.95</si:coverageProbabilityXMLList>
</si:expandedUncXMLList></si:realListXMLList></dcc:quantity></dcc:list></dcc:data></dcc:result>"""
_WHOLE = """<dcc:digitalCalibrationCertificate xmlns:dcc="https://ptb.de/dcc"
 xmlns:si="https://ptb.de/si" schemaVersion="3.2.1"><dcc:administrativeData>
<dcc:dccSoftware><dcc:software><dcc:name><dcc:content>hand</dcc:content></dcc:name>
<dcc:release>v1.0</dcc:release></dcc:software></dcc:dccSoftware>
<dcc:coreData><dcc:countryCodeISO3166_1>DE</dcc:countryCodeISO3166_1>
<dcc:usedLangCodeISO639_1>en</dcc:usedLangCodeISO639_1>
<dcc:mandatoryLangCodeISO639_1>en</dcc:mandatoryLangCodeISO639_1>
<dcc:uniqueIdentifier>EXAMPLE-1</dcc:uniqueIdentifier>
<dcc:beginPerformanceDate>2026-01-07</dcc:beginPerformanceDate>
<dcc:endPerformanceDate>2026-01-08</dcc:endPerformanceDate>
<dcc:performanceLocation>laboratory</dcc:performanceLocation></dcc:coreData>
<dcc:items>{items}</dcc:items>
<dcc:calibrationLaboratory><dcc:contact><dcc:name>
<dcc:content>Example Masses</dcc:content></dcc:name>
<dcc:location><dcc:city>Exampletown</dcc:city></dcc:location></dcc:contact>
</dcc:calibrationLaboratory><dcc:respPersons><dcc:respPerson><dcc:person><dcc:name>
<dcc:content>A. Person</dcc:content></dcc:name></dcc:person></dcc:respPerson></dcc:respPersons>
<dcc:customer><dcc:name><dcc:content>Example Quarry</dcc:content></dcc:name><dcc:location>
<dcc:city>Exampletown</dcc:city></dcc:location></dcc:customer></dcc:administrativeData>
<dcc:measurementResults><dcc:measurementResult><dcc:name><dcc:content>Weights</dcc:content></dcc:name>
<dcc:results>{results}</dcc:results></dcc:measurementResult></dcc:measurementResults>
</dcc:digitalCalibrationCertificate>"""


def weights_xml() -> bytes:
    """An unsigned certificate of two weights."""
    items = "".join(_ITEM.format(id=each) for each in WEIGHTS)
    results = "".join(
        _RESULT.format(id=each, value=repr(value), expanded=repr(COVERAGE_FACTOR * u))
        for each, (value, u) in WEIGHTS.items()
    )
    return _WHOLE.format(items=items, results=results).encode()


def weight_set_xml() -> bytes:
    """An unsigned certificate of the same two weights as a set: their masses are one list."""
    backwards = list(WEIGHTS)[::-1]
    result = _SET.format(
        names=" ".join(f"SN-{each}" for each in backwards),
        values=" ".join(repr(WEIGHTS[each][0]) for each in backwards),
        expanded=" ".join(repr(COVERAGE_FACTOR * WEIGHTS[each][1]) for each in backwards),
    )
    items = "".join(_ITEM.format(id=each) for each in WEIGHTS)
    return _WHOLE.format(items=items, results=result).encode()


@cache
def ec_key() -> DccKey:
    """A key of the laboratory, drawn anew for each session of tests."""
    from cryptography.hazmat.primitives import serialization
    from cryptography.hazmat.primitives.asymmetric import ec

    pem = ec.generate_private_key(ec.SECP256R1()).private_bytes(
        serialization.Encoding.PEM,
        serialization.PrivateFormat.PKCS8,
        serialization.NoEncryption(),
    )
    return DccKey(pem, None, "ecdsa-sha256")


def public_pem(key: DccKey) -> bytes:
    """The public half."""
    from cryptography.hazmat.primitives import serialization

    return (
        serialization.load_pem_private_key(key.private, None)
        .public_key()
        .public_bytes(serialization.Encoding.PEM, serialization.PublicFormat.SubjectPublicKeyInfo)
    )


@cache
def signed_weights() -> bytes:
    """The certificate of two weights, signed."""
    return serialise_dcc_to_xml(sign_dcc(parse_untrusted_dcc(weights_xml(), "weights"), ec_key()))


def wrapped(data: bytes, where: str, item: bytes = b"weight") -> bytes:
    """A signed certificate inside of a forged one: signature wrapping.

    Args:
        data: the signed one.
        where: "root" wraps it with its signature, "moved" puts the genuine content into a comment
            element and a forged one in its place.
        item: what the forged one calls its items.
    """
    original = etree.fromstring(data)
    forged = etree.fromstring(
        weights_xml().replace(b"20.0005", b"25.0005").replace(b"weight-", item + b"-")
    )
    comment = etree.SubElement(forged, "{https://ptb.de/dcc}comment")
    signature = original.find("{http://www.w3.org/2000/09/xmldsig#}Signature")
    assert signature is not None
    if where == "root":
        comment.append(original)
    else:
        forged.append(signature)
        comment.append(original)
    return etree.tostring(forged)

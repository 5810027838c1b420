"""Sets of weights whose certificate has their masses as a list."""

from collections.abc import Callable
from pathlib import Path

import pytest

pytest.importorskip("signxml", reason="signxml is not installed (pip install 'payscope[dcc]')")

from lxml import etree

from recordings.dcc.dcc_document import parse_untrusted_dcc
from recordings.dcc.dcc_masses import read_certified_masses
from tests.recordings.dcc.certificates import WEIGHTS, weight_set_xml, weights_xml

SCHEMA = Path(__file__).parents[4] / "shared" / "dcc" / "dcc.xsd"
NAMES = b"SN-weight-2 SN-weight-1"
KILOGRAMS = rb"\kilogram</si:unitXMLList>" + b"\n<si:exp"
VALUES = b"<si:valueXMLList>19.9991 20.0005"
U = b"<si:uncertaintyXMLList>0.0016 0.0016"
IN_ORDER = b"<si:valueXMLList>20.0005 19.9991"


def unnamed(data: bytes) -> bytes:
    """The set without names of its weights beside the list, and the values in the items' order."""
    return data.replace(NAMES, b"M1 M1").replace(VALUES, IN_ORDER)


#: The same set in the forms that the schema allows.
FORMS: dict[str, Callable[[bytes], bytes]] = {
    "numbers beside the list": lambda data: data,
    "ids beside the list": lambda data: data.replace(NAMES, b"weight-2 weight-1"),
    "numbers as text": lambda data: data.replace(
        b"<dcc:charsXMLList>" + NAMES + b"</dcc:charsXMLList>",
        b"<dcc:noQuantity><dcc:content>" + NAMES + b"</dcc:content></dcc:noQuantity>",
    ),
    "labels in the list": lambda data: data.replace(NAMES, b"M1 M1").replace(
        VALUES, b"<si:labelXMLList>" + NAMES + b"</si:labelXMLList>" + VALUES
    ),
    "in the order of the items": unnamed,
    "in the order of the refId": lambda data: unnamed(data).replace(
        b"<dcc:result>", b'<dcc:result refId="weight-1 weight-2">'
    ),
    "one U for all": lambda data: data.replace(U, b"<si:uncertaintyXMLList>0.0016"),
    "a k and a probability for each": lambda data: (
        data.replace(b"FactorXMLList>2<", b"FactorXMLList>2 2.5<")
        .replace(b"ProbabilityXMLList>0.95<", b"ProbabilityXMLList>0.95 0.99<")
        .replace(U, b"<si:uncertaintyXMLList>0.0016 0.0020")
    ),
    "a unit for each": lambda data: (
        data.replace(KILOGRAMS, KILOGRAMS.replace(b"</", rb" \gram</"))
        .replace(VALUES, b"<si:valueXMLList>19.9991 20000.5")
        .replace(U, b"<si:uncertaintyXMLList>0.0016 1.6")
    ),
    "coverage intervals": lambda data: (
        data.replace(b"expandedUncXMLList", b"coverageIntervalXMLList")
        .replace(
            U + b"</si:uncertaintyXMLList>",
            b"<si:standardUncXMLList>0.0008</si:standardUncXMLList>",
        )
        .replace(
            b"<si:coverageFactorXMLList>2</si:coverageFactorXMLList>",
            b"<si:intervalMinXMLList>19.9975 19.9989</si:intervalMinXMLList>"
            b"<si:intervalMaxXMLList>20.0007 20.0021</si:intervalMaxXMLList>",
        )
    ),
}


@pytest.mark.parametrize("form", FORMS)
def test_each_weight_of_a_set_has_its_mass_and_uncertainty(form: str) -> None:
    data = FORMS[form](weight_set_xml())
    root = parse_untrusted_dcc(data, "set.xml")
    masses = {each.item_id: each for each in read_certified_masses(root, "", "set.xml")}
    assert list(masses) == list(WEIGHTS)
    for item, (value_kg, u_kg) in WEIGHTS.items():
        picked = read_certified_masses(root, item, "set.xml")
        assert picked == [masses[item]]
        assert picked[0].value_kg == pytest.approx(value_kg, rel=1e-12)
        assert picked[0].u_kg == pytest.approx(u_kg, rel=1e-12)


@pytest.mark.parametrize("form", FORMS)
def test_these_forms_are_those_of_the_schema(form: str) -> None:
    if not SCHEMA.exists():
        pytest.skip("PTB's schema of certificates is not here")
    schema = etree.XMLSchema(etree.parse(SCHEMA))
    data = FORMS[form](weight_set_xml())
    assert form == "numbers beside the list" or data != weight_set_xml()
    schema.assertValid(etree.fromstring(data))


def test_a_set_as_a_list_is_the_set_as_single_results() -> None:
    single = read_certified_masses(
        parse_untrusted_dcc(weights_xml(), "weights.xml"), "", "weights.xml"
    )
    assert (
        read_certified_masses(parse_untrusted_dcc(weight_set_xml(), "set.xml"), "", "set.xml")
        == single
    )

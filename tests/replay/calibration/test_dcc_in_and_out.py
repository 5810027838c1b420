"""Masses out of a digital certificate, a campaign with them, and the certificate that it writes."""

import json
import re
import shutil
import subprocess
from pathlib import Path

import polars as pl
import pytest

pytest.importorskip("signxml", reason="signxml is not installed (pip install 'payscope[dcc]')")

from lxml import etree

from estimators.errors import CampaignError
from recordings.calibration.certificate_text import (
    describe_missing_certificate_statements,
    make_traceability_warnings,
    make_weighing_rows,
)
from recordings.calibration.evidence_document import Chain, Link
from recordings.dcc.dcc_document import DCC, parse_untrusted_dcc
from recordings.dcc.dcc_masses import read_certified_masses
from recordings.dcc.dcc_signature import check_dcc_signature, read_key_id_from_pem_file
from recordings.dcc.write_dcc import make_unsigned_dcc
from replay.calibration.calibrate_campaign import CalibrationOutcome, calibrate_from_campaign
from replay.calibration.campaign_file import load_campaign_and_machine
from replay.calibration.dcc_output import DccOutput, write_and_verify_dcc
from replay.calibration.verify_bundle import verify_bundle
from tests.recordings.dcc.certificates import (
    WEIGHTS,
    ec_key,
    public_pem,
    signed_weights,
    weight_set_xml,
    weights_xml,
)
from tests.replay.sledge import Payscope, join_to_one_line
from tests.replay.sledge_campaign import MASS, campaign_folder

pytestmark = pytest.mark.usefixtures("kept_replays", "without_pdf")

SCHEMA = Path(__file__).parents[4] / "shared" / "dcc" / "dcc.xsd"
SI = "{https://ptb.de/si}"
ABOUT = """author = "A. Author"
author_function = "tester"
authoriser = "B. Head"
authoriser_function = "head"
place = "hall 3"
place_kind = "laboratory"
deviations = "none"
replaces = "evidence-0"
replaces_reason = "its day was wrong"
"""
REST = """
[laboratory]
name = "Example Laboratory <&>"
address = "Example Street 1"
city = "Exampletown"
country = "DE"

[customer]
name = "Example Quarry"
address = "Example Street 2"
city = "Exampletown"
country = "DE"

[conditions]
surface = "ice"
slope_deg = 0.5
tyres = "runners"
fuel = "none"
temperature_degC = -4.0

[decision]
accuracy_class = "OIML R 51 Y(b)"
scale_interval_kg = 3.0
tare_kg = 100.0
"""


def certified_campaign(folder: Path) -> Path:
    """A campaign of a laboratory, whose masses stand in a signed certificate."""
    path = campaign_folder(folder, loads=(0, 1, 2))
    (folder / "weights.xml").write_bytes(signed_weights())
    (folder / "masses.pub.pem").write_bytes(public_pem(ec_key()))
    text = path.read_text()
    for number in (1, 2, 3):
        text = text.replace(MASS.format(number=number), "")
    for number in (1, 2):
        text = text.replace(f'"block-{number}"', f'"weight-{number}"')
    text = text.replace('author = "A. Author"\n', ABOUT)
    text = text.replace(
        'id = "sledge-7"\n',
        'id = "sledge-7"\nmake = "Example"\nmodel = "S"\ncondition = "new"\n'
        'empty_certificate = "example"\n',
    )
    head = 'masses = "weights.xml"\ndcc_keys = ["masses.pub.pem"]\n'
    path.write_text(head + text + REST)
    return path


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("dcc")


@pytest.fixture(scope="module")
def made(folder: Path) -> CalibrationOutcome:
    campaign = certified_campaign(folder)
    (folder / "key.pem").write_bytes(ec_key().private)
    dcc = DccOutput(folder / "sledge.xml", folder / "key.pem")
    return calibrate_from_campaign(campaign, folder / "evidence", dcc=dcc)


def test_masses_in_are_masses_out(tmp_path: Path) -> None:
    campaign, _ = load_campaign_and_machine(certified_campaign(tmp_path))
    assert {m.id: (m.value_kg, pytest.approx(m.u_kg)) for m in campaign.masses} == WEIGHTS
    first = campaign.masses[0]
    assert (first.certificate, first.certificate_issuer) == ("EXAMPLE-1", "Example Masses")
    assert first.certificate_signature.startswith("signed by a key of dcc_keys, ")
    assert campaign.untraceable_references_text == ()


def test_weights_of_a_set_are_picked_from_a_list(tmp_path: Path) -> None:
    path = certified_campaign(tmp_path)
    (tmp_path / "weights.xml").write_bytes(weight_set_xml())
    picked = '[{ dcc = "weights.xml#SN-weight-2", id = "weight-2" }, "weights.xml#weight-1"]'
    path.write_text(path.read_text().replace('"weights.xml"', picked))
    campaign, _ = load_campaign_and_machine(path)
    assert [m.id for m in campaign.masses] == ["weight-2", "weight-1"]
    assert {m.id: (m.value_kg, pytest.approx(m.u_kg)) for m in campaign.masses} == WEIGHTS


def test_a_signature_by_another_key_is_said(tmp_path: Path) -> None:
    path = certified_campaign(tmp_path)
    path.write_text(path.read_text().replace('dcc_keys = ["masses.pub.pem"]\n', ""))
    campaign, _ = load_campaign_and_machine(path)
    assert "signed by an unknown key" in campaign.untraceable_references_text[0]
    (tmp_path / "weights.xml").write_bytes(weights_xml())
    campaign, _ = load_campaign_and_machine(path)
    assert (
        campaign.untraceable_references_text[0] == "the certificate of mass 'weight-1' is unsigned"
    )


@pytest.mark.parametrize(
    ("block", "words"),
    [
        ('masses = "none.xml#weight-1"', "none.xml: cannot be read"),
        ('masses = "weights.xml#weight-7"', "has no item 'weight-7'; its items: weight-1, w"),
        ('masses = [{ dcc = "weights.xml#weight-1", u_kg = 1e-6 }]', "u_kg of .* is read from"),
        (
            'masses = [{ dcc = "weights.xml", id = "w" }]',
            "has 2 items, but 'w' names a single mass",
        ),
        (
            'masses = [{ id = "w", certificate_signature = "PTB" }]',
            "is written by payscope; leave it out",
        ),
    ],
)
def test_a_wrong_reference_to_a_certificate_is_refused(
    tmp_path: Path, block: str, words: str
) -> None:
    path = certified_campaign(tmp_path)
    path.write_text(path.read_text().replace('masses = "weights.xml"', block))
    with pytest.raises(CampaignError, match=words):
        load_campaign_and_machine(path)


def test_a_forged_certificate_stops_the_campaign_in_one_line(
    tmp_path: Path, payscope: Payscope
) -> None:
    path = certified_campaign(tmp_path)
    forged = signed_weights().replace(b"20.0005", b"20.0006")
    (tmp_path / "weights.xml").write_bytes(forged)
    join_to_one_line(
        payscope("calibrate", path, "-o", tmp_path / "e"), "its signature is not valid"
    )


@pytest.mark.heavy
def test_the_certificate_has_the_numbers_of_the_evidence(
    made: CalibrationOutcome, folder: Path
) -> None:
    root = etree.parse(folder / "sledge.xml").getroot()
    fitted = made.document.calibration
    assert fitted is not None
    quantities = root.findall(f".//{{{DCC}}}results/{{{DCC}}}result[1]//{{{DCC}}}quantity")
    alpha, beta, mass = (each.find(f"{SI}real") for each in quantities)
    assert alpha is not None
    assert beta is not None
    assert mass is not None
    assert float(alpha.findtext(f"{SI}value", "")) == fitted.alpha_1
    assert float(beta.findtext(f"{SI}value", "")) == fitted.beta_kg
    expanded = float(mass.findtext(f"{SI}expandedUnc/{SI}uncertainty", ""))
    assert expanded == fitted.coverage_k_1 * fitted.u_kg
    assert root.findtext(f".//{{{DCC}}}replacedUniqueIdentifier") == "evidence-0"
    hashes = [each.text for each in root.iterfind(f".//{{{DCC}}}certificate/{{{DCC}}}value")]
    assert hashes == [each.certificate_sha256 for each in made.document.campaign.masses]


@pytest.mark.usefixtures("made")
def test_units_are_those_of_the_si_format(folder: Path) -> None:
    root = etree.parse(folder / "sledge.xml").getroot()
    units = {each.text for each in root.iter(f"{SI}unit")}
    assert {r"\one", r"\kilogram"} <= units
    assert all(re.fullmatch(r"\\[a-z]+", str(unit)) for unit in units), units


def test_the_evidence_verifies_and_its_page_says_what_a_certificate_says(
    made: CalibrationOutcome,
) -> None:
    assert verify_bundle(made.folder).signed_by.how == "unsigned"
    assert not verify_bundle(made.folder).checked.evidence_faults
    page = (made.folder / "report.html").read_text()
    for words in (
        "Example Laboratory &lt;&amp;&gt;, Example Street 1",
        "B. Head, head",
        "evidence-0, because its day was wrong",
        "signed by a key of dcc_keys",
        f"End of evidence {made.document.id}.",
    ):
        assert words in page
    assert "NOT TRACEABLE" not in page
    assert "7.8 asks for it" not in page


def test_the_page_has_the_weighings_max_and_min_of_r_51(made: CalibrationOutcome) -> None:
    page = (made.folder / "report.html").read_text()
    assert "Min of OIML R 51 Y(b), 10 e: 30.0 kg. Below it: 20.0005 kg." in page
    assert "the heaviest load that was judged: 40.0 kg" in page
    rows = make_weighing_rows(made.document, made.readings)
    fitted = made.document.calibration
    assert fitted is not None
    used = made.readings.filter(pl.col("used") & (pl.col("load_id") == "weight-1"))
    errors = fitted.alpha_1 * used["mass_kg"] + fitted.beta_kg - 120.0005
    row = next(each for each in rows if each["load"] == "weight-1")
    assert row["count"] == used.height > 1
    assert row["mean_kg"] == pytest.approx(errors.mean())
    assert row["std_kg"] == pytest.approx(errors.std())
    assert row["limit_kg"] == 1.5 * 3.0  # up to 50 e


def test_the_certificate_is_signed_and_read_back(made: CalibrationOutcome, folder: Path) -> None:
    data = (folder / "sledge.xml").read_bytes()
    signed = check_dcc_signature(parse_untrusted_dcc(data, "sledge.xml"), "sledge.xml")
    (folder / "own.pub.pem").write_bytes(public_pem(ec_key()))
    assert signed.key_id == read_key_id_from_pem_file(folder / "own.pub.pem")
    assert "sledge.xml is signed by the key" in made.remarks[-1]
    # it is the certificate of a machine, so nobody takes a weight from it
    with pytest.raises(Exception, match="has no item 'weight-1'"):
        read_certified_masses(signed.root, "weight-1", "sledge.xml")


@pytest.mark.skipif(not SCHEMA.exists(), reason="the schema of the DCC is not beside the checkout")
@pytest.mark.usefixtures("made")
@pytest.mark.parametrize("name", ["sledge.xml", "weights.xml"])
def test_the_certificate_is_valid_after_the_official_schema(folder: Path, name: str) -> None:
    schema = etree.XMLSchema(etree.parse(SCHEMA))
    assert schema.validate(etree.parse(folder / name)), schema.error_log


@pytest.mark.skipif(not SCHEMA.exists(), reason="the schema of the DCC is not beside the checkout")
def test_a_certificate_after_another_names_it_by_its_digest(made: CalibrationOutcome) -> None:
    before = Link(id="evidence-1", counter=1, sums_sha256="ab" * 32)
    chained = made.document.model_copy(update={"chain": Chain(counter=2, previous=before)})
    root = make_unsigned_dcc(chained, "cd" * 32)
    report = root.find(f".//{{{DCC}}}previousReport")
    assert report is not None
    assert report.findtext(f"{{{DCC}}}referralID") == "evidence-1"
    assert report.findtext(f"{{{DCC}}}value") == "ab" * 32
    schema = etree.XMLSchema(etree.parse(SCHEMA))
    assert schema.validate(root), schema.error_log


@pytest.mark.usefixtures("made")
def test_debians_xmlsec1_checks_the_signature(folder: Path) -> None:
    program = shutil.which("xmlsec1")
    if program is None:
        pytest.skip("xmlsec1 is not installed (apt-get install xmlsec1)")
    (folder / "own.pub.pem").write_bytes(public_pem(ec_key()))
    command = [program, "--verify", "--pubkey-pem", str(folder / "own.pub.pem")]
    assert subprocess.run([*command, str(folder / "sledge.xml")], check=False).returncode == 0
    forged = folder / "forged.xml"
    forged.write_bytes((folder / "sledge.xml").read_bytes().replace(b"hall 3", b"hall 4"))
    assert subprocess.run([*command, str(forged)], check=False).returncode != 0


@pytest.mark.usefixtures("made")
def test_dcclib_and_its_schematron_read_it(folder: Path) -> None:
    validation = pytest.importorskip("dcclib.validation", reason="dcclib is not installed")
    report = validation.SchematronValidator.for_dcc().validate_file(str(folder / "sledge.xml"))
    faults = [
        each.text
        for each in (*report.failed_assertions, *report.successful_reports)
        # elements of an XML signature are empty by their own standard
        if each.role == "error" and "Signature" not in each.location
    ]
    assert faults == []


def test_a_certificate_needs_what_the_campaign_does_not_state(
    tmp_path: Path, payscope: Payscope
) -> None:
    path = campaign_folder(tmp_path)
    said = payscope("calibrate", path, "-o", tmp_path / "e", "--dcc", tmp_path / "e.xml")
    join_to_one_line(said, "a DCC needs laboratory, customer, campaign.authoriser", "machine.model")
    assert not (tmp_path / "e.xml").exists()


def test_without_a_line_there_is_no_certificate(tmp_path: Path, made: CalibrationOutcome) -> None:
    without = made.document.model_copy(update={"calibration": None})
    dcc = DccOutput(tmp_path / "e.xml")
    remark = write_and_verify_dcc(made.folder, without, dcc, None, overwrites=False)
    assert "no calibration line to certify" in remark
    assert not dcc.file.exists()


@pytest.mark.usefixtures("made")
def test_a_key_that_signs_no_xml_is_refused(
    tmp_path: Path, payscope: Payscope, folder: Path
) -> None:
    key = tmp_path / "ed25519.pem"
    subprocess.run(["openssl", "genpkey", "-algorithm", "ed25519", "-out", key], check=True)
    said = payscope(
        *("calibrate", folder / "campaign.toml", "-o", tmp_path / "e"),
        *("--dcc", tmp_path / "e.xml", "--dcc-key", key),
    )
    join_to_one_line(said, "needs an ECDSA or RSA key")


def test_the_report_says_loudly_what_is_not_traceable(made: CalibrationOutcome) -> None:
    values = json.loads(made.document.canonical_json_bytes)
    values["campaign"]["masses"][0]["u_kg"] = 0.0
    values["campaign"]["machine"]["make"] = ""
    changed = type(made.document).model_validate_json(json.dumps(values))
    assert make_traceability_warnings(changed) == [
        "NOT TRACEABLE: mass 'weight-1' has a standard uncertainty of 0."
    ]
    assert describe_missing_certificate_statements(changed) == [
        "Not stated, and ISO/IEC 17025, 7.8 asks for it: machine.make."
    ]

"""When: days against the logs' own time, expiry, and time stamps by an authority."""

import datetime as dt
import shutil
import subprocess
from collections.abc import Callable
from pathlib import Path

import pytest

from estimators.errors import CampaignError, EvidenceError
from recordings.calibration.bundle_folder import STATEMENT, TIMESTAMP
from recordings.calibration.check_outcomes import BundleOutcome
from recordings.calibration.timestamp import encode_timestamp_request
from recordings.signatures.keyring import KnownKey, add_key_to_keyring, load_keyring
from recordings.signatures.signing import read_public_key_file
from replay.calibration.calibrate_campaign import calibrate_from_campaign
from replay.calibration.verify_bundle import Verification, verify_bundle
from tests.replay.attacker import Bundle, tampered
from tests.replay.made_evidence import Made, items
from tests.replay.sledge import Payscope, join_to_one_line
from tests.replay.sledge_campaign import campaign_folder

pytestmark = pytest.mark.usefixtures("kept_replays")

#: 23:30 UTC on 2026-04-30, 01:30 on 2026-05-01 in Paris, where the sledge is.
BEGIN_UNIX_S = dt.datetime(2026, 4, 30, 23, 30, tzinfo=dt.UTC).timestamp()
IRREPRODUCIBLE = BundleOutcome.IRREPRODUCIBLE


def test_a_run_of_another_day_than_its_log_is_refused(tmp_path: Path) -> None:
    campaign = campaign_folder(tmp_path / "c", loads=(0,), begin_unix_s=BEGIN_UNIX_S + 86400.0)
    with pytest.raises(CampaignError) as refused:
        calibrate_from_campaign(campaign, tmp_path / "evidence")
    assert "run 'run-0' of 2026-05-01: its log load-0.csv was recorded on 2026-05-02" in str(
        refused.value
    )
    assert "Europe/Paris" in str(refused.value)
    assert not (tmp_path / "evidence").exists()


@pytest.mark.heavy
def test_the_day_is_that_of_the_machines_time_zone(tmp_path: Path) -> None:
    campaign = campaign_folder(tmp_path / "c", loads=(0,), begin_unix_s=BEGIN_UNIX_S)
    made = calibrate_from_campaign(campaign, tmp_path / "evidence")
    assert made.document.logs[0].begins == "2026-04-30 23:30:00 UTC"
    assert not any(
        "not provable" in each for each in verify_bundle(made.folder).unverifiable_statements
    )


def began(*texts: str) -> Callable[[Bundle], None]:
    def tamper(bundle: Bundle) -> None:
        for log, text in zip(bundle.evidence["logs"], texts, strict=False):
            log["begins"] = text

    return tamper


def at(name: str, value: str) -> Callable[[Bundle], None]:
    return lambda bundle: bundle.evidence.update({name: value})


@pytest.mark.parametrize(
    ("tamper", "words"),
    [
        (began("2026-04-30 12:00:00 UTC"), "was recorded on 2026-04-30"),
        (began("2026-05-01 22:00:01 UTC"), "was recorded on 2026-05-02"),
        (at("made", "2026-05-01T00:00:00Z"), "is after the evidence was made"),
        (at("made", "2999-05-01T00:00:00Z"), "is in the future"),
    ],
)
def test_days_that_the_logs_contradict_are_irreproducible(
    made: Made, tmp_path: Path, tamper: Callable[[Bundle], None], words: str
) -> None:
    found = verify_bundle(tampered(made.bundle, tmp_path / "b", tamper, signed=False))
    assert found.outcome is IRREPRODUCIBLE, items(found)
    assert words in items(found)


def test_runs_that_were_recorded_at_the_same_time_are_irreproducible(
    made: Made, tmp_path: Path
) -> None:
    tamper = began("2026-05-01 10:00:00 UTC", "2026-05-01 10:00:05 UTC")
    found = verify_bundle(tampered(made.bundle, tmp_path / "b", tamper, signed=False))
    assert found.outcome is IRREPRODUCIBLE
    assert "runs 'run-0' and 'run-1'" in items(found)
    assert "were recorded at the same time: one drive counts twice" in items(found)


@pytest.mark.heavy
def test_a_drive_that_counts_twice_under_another_name_is_refused(tmp_path: Path) -> None:
    campaign = campaign_folder(tmp_path / "c", loads=(0, 1, 2))
    shutil.copy(campaign.parent / "load-1.csv", campaign.parent / "again.csv")
    text = campaign.read_text()
    start = text.index('[[runs]]\nid = "run-1"')
    run = text[start : text.index("[[runs]]", start + 1)]
    again = run.replace('id = "run-1"', 'id = "again"').replace("load-1.csv", "again.csv")
    campaign.write_text(f"{text}\n{again}")
    with pytest.raises(CampaignError, match="'run-1' and 'again' have the same readings"):
        calibrate_from_campaign(campaign, tmp_path / "evidence")
    campaign.write_text(f'{text}\n{again}excluded = "a copy"\n')
    assert calibrate_from_campaign(campaign, tmp_path / "evidence").document.calibration


def test_evidence_made_before_its_last_log_ended_is_irreproducible(
    made: Made, tmp_path: Path
) -> None:
    def tamper(bundle: Bundle) -> None:
        began(*(f"2026-05-0{k} 12:00:00 UTC" for k in range(1, 5)))(bundle)
        bundle.evidence["made"] = "2026-05-04T11:00:00Z"

    found = verify_bundle(tampered(made.bundle, tmp_path / "b", tamper, signed=False))
    assert found.outcome is IRREPRODUCIBLE
    assert "ends 2026-05-04 12:00 UTC, after the evidence was made" in items(found)


def test_a_run_over_midnight_is_of_either_day(made: Made, tmp_path: Path) -> None:
    folder = tmp_path / "b"
    tamper = began("2026-05-01 21:59:50 UTC")  # ten seconds before midnight in Paris
    assert verify_bundle(tampered(made.bundle, folder, tamper, signed=False)).outcome is None


def test_days_of_logs_without_a_date_are_not_provable_and_said_so(made: Made) -> None:
    assert "not provable" in (made.bundle / "report.html").read_text()
    said = [
        each for each in made.verify(made.bundle).unverifiable_statements if "not provable" in each
    ]
    assert len(said) == 1
    assert "run-0, run-1, run-2, run-3" in said[0]


def test_expired_evidence_has_a_status_of_its_own(made: Made, payscope: Payscope) -> None:
    document_day = "2027-05-04"  # a year after the last run
    assert payscope("verify", made.bundle, "--on", document_day).status == 0
    said = payscope("verify", made.bundle, "--on", "2027-05-05")
    assert said.status == 7
    assert "expired: evidence.json: expires: on 2027-05-04" in said.out
    assert payscope("verify", made.bundle, "--on", "soon").status == 2


@pytest.fixture(scope="module")
def authority(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A time-stamp authority made with openssl: its folder, with `ca.pem`."""
    if shutil.which("openssl") is None:
        pytest.skip("openssl: not installed")
    pytest.importorskip("rfc3161_client")
    return new_authority(tmp_path_factory.mktemp("tsa"))


def new_authority(folder: Path) -> Path:
    extensions = "extendedKeyUsage = critical,timeStamping\nbasicConstraints = CA:FALSE\n"
    (folder / "tsa.ext").write_text(extensions)
    (folder / "serial").write_text("01\n")
    (folder / "tsa.conf").write_text(
        "[tsa]\ndefault_tsa = t\n[t]\n"
        f"serial = {folder}/serial\ncrypto_device = builtin\nsigner_cert = {folder}/tsa.pem\n"
        f"signer_key = {folder}/tsa.key\nsigner_digest = sha256\n"
        "default_policy = 1.2.3.4.1\ndigests = sha256, sha384, sha512\nordering = yes\n"
        "tsa_name = yes\ness_cert_id_chain = no\ness_cert_id_alg = sha256\n"
    )
    rsa = ("-newkey", "rsa:2048", "-nodes")
    openssl(folder, "req", "-x509", *rsa, "-keyout", "ca.key", "-out", "ca.pem", "-subj", "/CN=CA")
    openssl(folder, "req", "-new", *rsa, "-keyout", "tsa.key", "-out", "tsa.csr", "-subj", "/CN=T")
    ca = ("-CA", "ca.pem", "-CAkey", "ca.key", "-CAcreateserial", "-extfile", "tsa.ext")
    openssl(folder, "x509", "-req", "-in", "tsa.csr", *ca, "-out", "tsa.pem", "-days", "30")
    return folder


def openssl(folder: Path, *words: str) -> None:
    left = subprocess.run(["openssl", *words], cwd=folder, capture_output=True, check=False)
    assert left.returncode == 0, left.stderr.decode()


def stamped(authority: Path, query: bytes) -> bytes:
    (authority / "query.tsq").write_bytes(query)
    words = ("-queryfile", "query.tsq", "-config", "tsa.conf", "-out", "answer.tsr")
    openssl(authority, "ts", "-reply", *words)
    return (authority / "answer.tsr").read_bytes()


@pytest.fixture
def bundle(made: Made, authority: Path, tmp_path: Path) -> Path:
    """A copy of the evidence, with the authority's answer put in."""
    folder = Path(shutil.copytree(made.bundle, tmp_path / "stamped"))
    query = encode_timestamp_request((folder / STATEMENT).read_bytes())
    (folder / TIMESTAMP).write_bytes(stamped(authority, query))
    return folder


@pytest.mark.heavy
def test_a_time_stamp_is_checked_offline_against_the_authority(
    made: Made, bundle: Path, authority: Path
) -> None:
    found = made.verify(bundle, authority_certificates=authority / "ca.pem")
    assert not found.findings, items(found)
    assert any(
        f"signed no later than {dt.datetime.now(dt.UTC):%Y-}" in note for note in found.notes
    )
    without = made.verify(bundle)
    assert not without.findings
    assert any("--tsa CA.pem" in note for note in without.notes)


@pytest.mark.heavy
def test_the_query_is_one_that_openssl_answers(
    made: Made, authority: Path, tmp_path: Path, payscope: Payscope
) -> None:
    campaign = campaign_folder(tmp_path / "c", loads=(0,))
    query = tmp_path / "query.tsq"
    ask = ("--timestamp-request", query)
    join_to_one_line(payscope("calibrate", campaign, "-o", tmp_path / "e", *ask), "give --key")
    said = payscope("calibrate", campaign, "-o", tmp_path / "e", "--key", made.private, *ask)
    assert said.status == 1, said.err  # one load gives no line
    (tmp_path / "e" / TIMESTAMP).write_bytes(stamped(authority, query.read_bytes()))
    found = verify_bundle(
        tmp_path / "e", key_file=made.public, authority_certificates=authority / "ca.pem"
    )
    assert found.outcome is None, items(found)


def of_other_evidence(made: Made, bundle: Path, authority: Path, _: Path) -> None:
    shutil.copy(made.first / STATEMENT, bundle / "x")
    query = encode_timestamp_request((bundle / "x").read_bytes())
    (bundle / "x").unlink()
    (bundle / TIMESTAMP).write_bytes(stamped(authority, query))


def of_another_authority(_: Made, bundle: Path, __: Path, scratch: Path) -> None:
    other = new_authority(scratch)
    query = encode_timestamp_request((bundle / STATEMENT).read_bytes())
    (bundle / TIMESTAMP).write_bytes(stamped(other, query))


def with_another_time(_: Made, bundle: Path, __: Path, ___: Path) -> None:
    data = (bundle / TIMESTAMP).read_bytes()
    now = f"{dt.datetime.now(dt.UTC):%Y%m}".encode()
    assert now in data
    (bundle / TIMESTAMP).write_bytes(data.replace(now, b"202705"))


def cut_off(_: Made, bundle: Path, __: Path, ___: Path) -> None:
    (bundle / TIMESTAMP).write_bytes((bundle / TIMESTAMP).read_bytes()[:-40])


def no_answer(_: Made, bundle: Path, __: Path, ___: Path) -> None:
    (bundle / TIMESTAMP).write_bytes(b"not a time stamp")


def no_stamp(_: Made, bundle: Path, __: Path, ___: Path) -> None:
    (bundle / TIMESTAMP).unlink()


@pytest.mark.parametrize(
    ("attack", "outcome", "words"),
    [
        (of_other_evidence, BundleOutcome.TAMPERED, "belongs to another signature"),
        (of_another_authority, BundleOutcome.TAMPERED, "is not by an authority of --tsa"),
        (with_another_time, BundleOutcome.TAMPERED, "is not by an authority of --tsa"),
        (cut_off, BundleOutcome.TAMPERED, "is not a granted time-stamp response"),
        (no_answer, BundleOutcome.TAMPERED, "is not a granted time-stamp response"),
        (no_stamp, BundleOutcome.INCOMPLETE, "is missing, although --tsa is given"),
    ],
)
def test_a_forged_time_stamp_is_found(
    made: Made,
    bundle: Path,
    authority: Path,
    tmp_path_factory: pytest.TempPathFactory,
    attack: Callable[[Made, Path, Path, Path], None],
    outcome: BundleOutcome,
    words: str,
) -> None:
    attack(made, bundle, authority, tmp_path_factory.mktemp("other"))
    found: Verification = made.verify(bundle, authority_certificates=authority / "ca.pem")
    assert found.outcome is outcome, items(found)
    assert words in items(found)


def test_back_dating_a_signature_past_its_time_stamp_is_found(
    made: Made, authority: Path, tmp_path: Path
) -> None:
    """Evidence that says it was made later than the authority saw it."""

    def later(bundle: Bundle) -> None:
        bundle.evidence["made"] = f"{dt.datetime.now(dt.UTC) + dt.timedelta(hours=1):%Y-%m-%dT%XZ}"

    folder = tampered(made.bundle, tmp_path / "b", later, signed=True)
    query = encode_timestamp_request((folder / STATEMENT).read_bytes())
    (folder / TIMESTAMP).write_bytes(stamped(authority, query))
    found = verify_bundle(folder, authority_certificates=authority / "ca.pem")
    assert "before the evidence says that it was made" in items(found)


def test_a_stolen_key_is_worth_nothing_after_its_revocation_but_a_stamp_saves_what_was_signed(
    made: Made, bundle: Path, authority: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("PAYSCOPE_KEYRING", str(tmp_path / "keys.toml"))
    tomorrow = dt.datetime.now(dt.UTC).date() + dt.timedelta(days=1)
    key = read_public_key_file(made.public).base64_text
    add_key_to_keyring(load_keyring(), KnownKey(key=key, owner="Test lab", revoked=tomorrow))
    assert verify_bundle(bundle).outcome is BundleOutcome.TAMPERED
    proven = verify_bundle(bundle, authority_certificates=authority / "ca.pem")
    assert proven.outcome is None, items(proven)
    assert "signed by Test lab" in str(proven.signed_by)


def test_a_certificate_that_is_none_is_refused_in_one_line(
    made: Made, tmp_path: Path, payscope: Payscope
) -> None:
    pytest.importorskip("rfc3161_client")
    (tmp_path / "ca.pem").write_text("nothing")
    join_to_one_line(
        payscope("verify", made.bundle, "--tsa", tmp_path / "ca.pem"), "no PEM certificate"
    )
    with pytest.raises(EvidenceError, match="cannot be read"):
        verify_bundle(made.bundle, authority_certificates=tmp_path / "none.pem")

"""A machine's evidence is one chain: gaps, forks, rollback and who signed which number."""

import shutil
from collections.abc import Callable
from pathlib import Path

import pytest

from estimators.errors import EvidenceError
from recordings.calibration.bundle_folder import EVIDENCE, REPORT, STATEMENT
from recordings.calibration.check_outcomes import BundleOutcome
from recordings.signatures.signing import read_signing_key_or_none
from replay.calibration.calibrate_campaign import read_previous_evidence
from replay.calibration.verify_bundle import verify_bundle
from replay.calibration.verify_chain import VerifiedChain, verify_bundles_and_chains
from tests.replay.attacker import Bundle, sign_with, sign_with_own_key, tampered
from tests.replay.made_evidence import Made, items
from tests.replay.sledge import Payscope

pytestmark = pytest.mark.usefixtures("kept_replays")

TAMPERED, INCOMPLETE = BundleOutcome.TAMPERED, BundleOutcome.INCOMPLETE


def chain(made: Made, *folders: Path) -> VerifiedChain:
    return verify_bundles_and_chains(folders, key_file=made.public)


def said(found: VerifiedChain) -> str:
    return "\n".join(map(str, found.findings))


def resigned(made: Made, tmp_path: Path, of: Path, change: Callable[[Bundle], None]) -> Path:
    """What whoever holds the signer's key can make of evidence."""

    def tamper(bundle: Bundle) -> None:
        change(bundle)
        key = read_signing_key_or_none(made.private)
        assert key is not None
        sign_with(bundle, key)

    return tampered(of, tmp_path / "resigned", tamper, signed=True)


def test_a_whole_chain_verifies_in_any_order_and_names_who_signed_what(
    made: Made, payscope: Payscope
) -> None:
    found = chain(made, made.third, made.first, made.bundle)
    assert found.outcome is None, said(found)
    for number, note in enumerate(found.notes, start=1):
        assert f"machine sledge-7: number {number}, a calibration of" in note
        assert "signed by the key given" in note
    left = payscope("verify", made.third, made.bundle, made.first, "--key", made.public)
    assert left.status == 0, left.out
    assert "3 bundles: each verified, with one chain for each machine" in left.out


def test_a_gap_leaves_the_chain_incomplete(made: Made, payscope: Payscope) -> None:
    found = chain(made, made.first, made.third)
    assert found.outcome is INCOMPLETE
    assert "machine sledge-7: number 2: is missing between" in said(found)
    assert payscope("verify", made.first, made.third, "--key", made.public).status == 5


def test_a_chain_that_begins_later_says_so(made: Made) -> None:
    found = chain(made, made.bundle, made.third)
    assert found.outcome is None
    assert "begins with number 2; earlier evidence was not given" in found.notes[0]


def other_id(bundle: Bundle) -> None:
    bundle.evidence["id"] = "another"


def test_two_signed_of_one_number_are_a_fork(
    made: Made, tmp_path: Path, payscope: Payscope
) -> None:
    forked = resigned(made, tmp_path, made.bundle, other_id)
    # each by itself is good
    assert verify_bundle(forked, key_file=made.public, previous=made.first).outcome is None
    found = chain(made, made.first, made.bundle, forked)
    assert found.outcome is TAMPERED
    assert "machine sledge-7: number 2: a fork: " in said(found)
    assert "have the same number" in said(found)
    left = payscope("verify", made.first, made.bundle, forked, "--key", made.public)
    assert left.status == 3
    # and what follows the one does not follow the other
    found = chain(made, made.first, forked, made.third)
    assert found.outcome is TAMPERED
    assert "number 3: evidence.json: chain.previous: is not the previous evidence" in said(found)


def test_an_older_head_cannot_be_told_and_that_is_said(made: Made) -> None:
    for folder, number in ((made.first, 1), (made.bundle, 2)):
        unseen = "\n".join(verify_bundle(folder).unverifiable_statements)
        assert f"Whether later evidence of this machine exists: this is number {number}" in unseen


def made_in_april(bundle: Bundle) -> None:
    bundle.evidence["made"] = "2026-04-01T00:00:00Z"


def test_evidence_from_before_the_one_that_it_follows_is_found(made: Made, tmp_path: Path) -> None:
    early = resigned(made, tmp_path, made.bundle, made_in_april)
    found = chain(made, made.first, early)
    assert found.outcome is TAMPERED
    assert "made: is before the previous evidence was made" in said(found)
    alone = verify_bundle(early, key_file=made.public, previous=made.first)
    assert "is before the previous evidence was made" in items(alone)


def of_another_machine(bundle: Bundle) -> None:
    bundle.evidence["campaign"]["machine"]["id"] = "sledge-8"
    bundle.evidence["machine"]["machine"]["id"] = "sledge-8"


def test_evidence_of_another_machine_is_a_chain_of_its_own(made: Made, tmp_path: Path) -> None:
    sister = resigned(made, tmp_path, made.bundle, of_another_machine)
    found = chain(made, made.first, sister, made.bundle, made.third)
    assert found.outcome is None
    assert any("machine sledge-8: number 2" in note for note in found.notes)
    spliced = verify_bundle(sister, key_file=made.public, previous=made.first)
    assert "the previous evidence belongs to another machine" in items(spliced)


def test_the_signer_of_the_evidence_before_is_named_and_checked(made: Made, tmp_path: Path) -> None:
    found = made.verify(made.bundle)
    assert any("the previous evidence, number 1: signed by the key given" in n for n in found.notes)
    forged = tampered(made.first, tmp_path / "forged", sign_with_own_key, signed=True)
    found = verify_bundle(made.bundle, key_file=made.public, previous=forged)
    assert found.outcome is TAMPERED
    assert "signed by an unknown key" in "\n".join(found.notes)
    unsigned = Path(shutil.copytree(made.first, tmp_path / "unsigned"))
    (unsigned / STATEMENT).write_bytes((made.third / STATEMENT).read_bytes())
    found = verify_bundle(made.bundle, key_file=made.public, previous=unsigned)
    assert found.outcome is TAMPERED
    assert "the previous evidence: " in items(found)


def other_page(folder: Path) -> None:
    with (folder / REPORT).open("a") as page:
        page.write(" ")


def torn(folder: Path) -> None:
    (folder / EVIDENCE).write_bytes((folder / EVIDENCE).read_bytes()[:-9])


def without_statement(folder: Path) -> None:
    (folder / STATEMENT).unlink()


@pytest.mark.parametrize("change", [other_page, torn, without_statement])
def test_nothing_is_chained_to_evidence_that_does_not_verify(
    made: Made, tmp_path: Path, change: Callable[[Path], None]
) -> None:
    folder = Path(shutil.copytree(made.first, tmp_path / "b"))
    change(folder)
    with pytest.raises(EvidenceError, match="cannot be used as --previous"):
        read_previous_evidence(folder, "sledge-7", read_signing_key_or_none(made.private))


def test_nothing_that_is_signed_is_chained_to_what_is_unsigned(made: Made, tmp_path: Path) -> None:
    unsigned = tampered(made.first, tmp_path / "b", lambda _: None, signed=False)
    with pytest.raises(EvidenceError, match="cannot follow unsigned evidence"):
        read_previous_evidence(unsigned, "sledge-7", read_signing_key_or_none(made.private))
    assert read_previous_evidence(unsigned, "sledge-7", None).document is not None


def test_bundles_that_cannot_be_read_and_wrong_usage(
    made: Made, tmp_path: Path, payscope: Payscope
) -> None:
    folder = Path(shutil.copytree(made.bundle, tmp_path / "b"))
    torn(folder)
    left = payscope("verify", made.first, folder, made.third)
    assert left.status == 3
    assert "number 2: is missing between" in left.out
    left = payscope("verify", made.first, made.bundle, "--previous", made.first)
    assert left.status == 2
    assert "--previous needs a single folder" in left.err
    assert '"chain"' in payscope("verify", made.first, made.bundle, "--json").out

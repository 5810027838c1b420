"""`payscope verify`: keys, chain, logs, and an untouched bundle in another place."""

import hashlib
import os
import shutil
import subprocess
import sys
from pathlib import Path
from typing import Any

import polars as pl
import pytest

from recordings.calibration.bundle_folder import EVIDENCE, PDF, STATEMENT, SUMS
from recordings.calibration.chain_check import check_link_to_previous_evidence
from recordings.calibration.check_outcomes import BundleOutcome
from recordings.calibration.checked_bundle import CheckedBundle
from recordings.calibration.evidence_document import parse_untrusted_evidence
from replay.calibration.calibrate_campaign import calibrate_from_campaign
from replay.calibration.verify_bundle import Verification, verify_bundle
from tests.conftest import REPO
from tests.replay.attacker import Bundle, sign_with_own_key, tampered
from tests.replay.fewer_rights import obeying_modes, of_another_user, readable_folder
from tests.replay.made_evidence import Made, items
from tests.replay.sledge_campaign import campaign_folder
from tests.replay.tamperings import TAMPERINGS
from tests.twins import mark_slow_after

pytestmark = pytest.mark.usefixtures("kept_replays", "readers_in_this_process")

TAMPERED, IRREPRODUCIBLE = BundleOutcome.TAMPERED, BundleOutcome.IRREPRODUCIBLE
INCOMPLETE = BundleOutcome.INCOMPLETE


def test_a_key_in_the_signers_place_is_found_by_the_key_given(made: Made, tmp_path: Path) -> None:
    folder = tampered(made.bundle, tmp_path / "b", sign_with_own_key, signed=True)
    assert "is not signed by the key" in items(made.verify(folder))
    # without a key there is nothing to compare with, and it says so
    alone = verify_bundle(folder)
    assert alone.outcome is None
    assert "signed by an unknown key" in alone.notes[0]
    assert "signed by an unknown key" in alone.verdict


def test_a_removed_signature_leaves_the_evidence_incomplete(made: Made, tmp_path: Path) -> None:
    folder = Path(shutil.copytree(made.bundle, tmp_path / "b"))
    (folder / STATEMENT).unlink()
    found = made.verify(folder)
    assert found.outcome is INCOMPLETE
    assert STATEMENT in items(found)
    unsigned = tampered(made.bundle, tmp_path / "c", lambda _: None, signed=False)
    found = made.verify(unsigned)
    assert found.outcome is INCOMPLETE
    assert "unsigned" in items(found)


def test_an_older_head_of_the_chain_is_found(made: Made) -> None:
    older = verify_bundle(made.first, key_file=made.public, previous=made.bundle)
    assert older.outcome is TAMPERED
    assert "the counter only grows" in items(older)
    skipped = verify_bundle(made.third, key_file=made.public, previous=made.first)
    assert skipped.outcome is TAMPERED
    assert "is not the previous evidence that was given" in items(skipped)


def test_a_check_has_line_machine_and_priors_of_what_it_is_a_check_of(made: Made) -> None:
    before = CheckedBundle()
    before.document = last = parse_untrusted_evidence(
        (made.first / EVIDENCE).read_bytes(), EVIDENCE
    )
    before.sums = (made.first / SUMS).read_bytes()
    own = parse_untrusted_evidence((made.bundle / EVIDENCE).read_bytes(), EVIDENCE)
    other = parse_untrusted_evidence((made.third / EVIDENCE).read_bytes(), EVIDENCE)
    assert other.learnt != last.learnt
    names = ("calibration", "expires", "machine", "learnt", "options")
    kept = {"kind": "check", **{name: getattr(last, name) for name in names}}
    for more, item in (({}, None), ({"learnt": other.learnt}, f"{EVIDENCE}: learnt")):
        checked = CheckedBundle()
        check_link_to_previous_evidence(checked, own.model_copy(update=kept | more), before)
        assert [each.item for each in checked.findings] == ([] if item is None else [item])


def test_the_statement_of_other_evidence_is_found(made: Made, tmp_path: Path) -> None:
    folder = Path(shutil.copytree(made.bundle, tmp_path / "b"))
    shutil.copy(made.third / STATEMENT, folder / STATEMENT)
    found = made.verify(folder)
    assert found.outcome is TAMPERED
    assert "is about other evidence" in items(found)


def test_an_untouched_bundle_verifies(made: Made) -> None:
    found = made.verify(made.bundle)
    assert not found.findings
    assert any("left out before" in sentence for sentence in found.unverifiable_statements)


@pytest.mark.heavy
def test_with_its_logs_every_reading_is_replayed(made: Made, tmp_path: Path) -> None:
    logs = made.campaign.parent
    assert not made.verify(made.bundle, log_folder=logs).findings
    some = Path(shutil.copytree(logs, tmp_path / "logs"))
    (some / "load-2.csv").unlink()

    def verify_third() -> Verification:
        """It learnt no priors: half the replays."""
        return verify_bundle(
            made.third, key_file=made.public, previous=made.bundle, log_folder=some
        )

    found = verify_third()
    assert found.outcome is INCOMPLETE
    assert "'load-2.csv' is not in the folder of logs" in items(found)
    (some / "load-2.csv").symlink_to(logs / "load-2.csv")
    found = verify_third()
    assert found.outcome is INCOMPLETE
    assert "'load-2.csv' is a link in the folder of logs, and no link is followed" in items(found)
    (some / "load-2.csv").unlink()
    shutil.copy(some / "load-1.csv", some / "load-2.csv")
    found = verify_third()
    assert found.outcome is TAMPERED
    assert "logs: load-2.csv" in items(found)


@pytest.mark.heavy
def test_readings_that_the_logs_do_not_give_are_irreproducible(
    made: Made, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Even where whoever holds the key made the fit of them."""
    monkeypatch.setitem(sys.modules, "weasyprint", None)  # no PDF
    private, public = made.private, made.public
    forged = campaign_folder(tmp_path / "campaign")
    table = pl.read_csv(forged.parent / "load-2.csv")
    table.with_columns(pl.col("force_N") * 1.01).write_csv(forged.parent / "load-2.csv")
    calibrate_from_campaign(forged, tmp_path / "b", key_file=private)

    def honest_digest(bundle: Bundle) -> None:
        for log in bundle.evidence["logs"]:
            data = (made.campaign.parent / log["log"]).read_bytes()
            log["files"][0]["sha256"] = hashlib.sha256(data).hexdigest()

    folder = tampered(tmp_path / "b", tmp_path / "c", honest_digest, signed=False)
    assert verify_bundle(folder).outcome is None
    found = verify_bundle(folder, log_folder=made.campaign.parent)
    assert IRREPRODUCIBLE in {each.outcome for each in found.findings}
    assert "run 'run-2', reading 1: the replay gives a different" in items(found)
    assert public.exists()


def verified_elsewhere(
    made: Made, folder: Path, *before: str, variables: dict[str, str], **user: Any
) -> subprocess.CompletedProcess[str]:
    """`payscope verify` of copies in a folder that it may only read, as a program of its own."""
    for source in (made.bundle, made.first, made.public):
        copy = shutil.copy if source.is_file() else shutil.copytree
        copy(source, folder / source.name)
    home = folder / "home"
    home.mkdir(mode=0o555)
    folder.chmod(0o555)
    left = subprocess.run(
        [
            *(*before, sys.executable, "-P", "-c"),
            "from replay.commands.cli import main; main()",
            *("verify", made.bundle.name, "--key", made.public.name),
            *("--previous", made.first.name),
        ],
        env={"PATH": os.environ["PATH"], "PYTHONPATH": str(REPO), "HOME": str(home), **variables},
        cwd=folder,
        capture_output=True,
        text=True,
        check=False,
        **user,
    )
    folder.chmod(0o755)
    return left


@pytest.mark.heavy
@pytest.mark.parametrize(
    "variables",
    mark_slow_after(
        1, [{"TZ": "Pacific/Apia", "LC_ALL": "tr_TR.UTF-8"}, {"LC_ALL": "C", "TZ": "UTC"}]
    ),
)
def test_it_verifies_in_another_folder_time_zone_and_locale(
    made: Made, tmp_path: Path, variables: dict[str, str]
) -> None:
    folder = tmp_path / "another place, ö"
    folder.mkdir()
    left = verified_elsewhere(made, folder, *obeying_modes(), variables=variables)
    assert left.returncode == 0, left.stdout + left.stderr


@pytest.mark.heavy
def test_it_verifies_as_another_user_who_may_only_read_it(made: Made) -> None:
    user = of_another_user()
    with readable_folder() as folder:
        variables = {"TZ": "America/St_Johns", "LC_ALL": "de_DE.UTF-8"}
        left = verified_elsewhere(made, folder, variables=variables, **user)
    assert left.returncode == 0, left.stdout + left.stderr


@pytest.mark.heavy
def test_priors_that_the_logs_do_not_give_are_irreproducible(made: Made, tmp_path: Path) -> None:
    """Where everything else follows from them, only the logs tell."""
    relearnt = TAMPERINGS["priors made narrow throughout"].tamper
    folder = tampered(made.bundle, tmp_path / "b", relearnt, signed=False)
    assert verify_bundle(folder).outcome is None
    found = verify_bundle(folder, log_folder=made.campaign.parent)
    assert IRREPRODUCIBLE in {each.outcome for each in found.findings}
    assert "learnt: load-0.csv, const: its replay gives different estimates" in items(found)


def test_the_digests_are_those_of_sha256sum(made: Made) -> None:
    if shutil.which("sha256sum") is None:
        pytest.skip("sha256sum: not installed")
    left = subprocess.run(
        ["sha256sum", "--strict", "-c", SUMS], cwd=made.bundle, capture_output=True, check=False
    )
    assert left.returncode == 0, left.stderr


def test_the_pdf_is_there_where_it_can_be_made(made: Made) -> None:
    pytest.importorskip("weasyprint", exc_type=OSError)
    assert (made.bundle / PDF).read_bytes().startswith(b"%PDF")

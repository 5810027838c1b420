"""`payscope verify`: what an attacker without the key can do to a bundle, and is caught at."""

import os
import shutil
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import polars as pl
import pytest

from recordings.evidence.findings import BundleOutcome
from recordings.evidence.folder import (
    EVIDENCE,
    PDF,
    POINTS,
    READINGS,
    RECORDING,
    REPORT,
    STATEMENT,
    SUMS,
    listing,
)
from replay.calibrate import calibrate
from replay.verify import Verified, verify
from tests.replay.attacker import Bundle, Tamper, key_files, sign_with_own_key, tampered
from tests.replay.sledge_campaign import campaign_folder

TAMPERED, IRREPRODUCIBLE = BundleOutcome.TAMPERED, BundleOutcome.IRREPRODUCIBLE
INCOMPLETE, OUTSIDE = BundleOutcome.INCOMPLETE, BundleOutcome.OUTSIDE
LIMITS = '\n[decision]\naccuracy_class = "OIML R 134 10"\n'


class Made:
    """Three bundles of one machine, each chained to the one before, and the logs."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.private, self.public = key_files(folder)
        self.campaign = campaign_folder(folder / "campaign", extra=LIMITS)
        before: Path | None = None
        for name in ("first", "second", "third"):
            calibrate(self.campaign, folder / name, key_file=self.private, previous=before)
            before = folder / name
        self.first, self.bundle, self.third = (folder / n for n in ("first", "second", "third"))

    def verify(self, bundle: Path, **more: Any) -> Verified:
        return verify(bundle, key_file=self.public, previous=self.first, **more)


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Made:
    return Made(tmp_path_factory.mktemp("evidence"))


def in_evidence(*place: str | int, to: Any) -> Tamper:
    """Set a value of evidence.json, or change it by a function."""

    def tamper(bundle: Bundle) -> None:
        inside: Any = bundle.evidence
        for name in place[:-1]:
            inside = inside[name]
        value = to(inside[place[-1]]) if callable(to) else to
        assert value != inside[place[-1]]
        inside[place[-1]] = value

    return tamper


def fit(*place: str | int) -> Tamper:
    """A digit of the fit."""
    return in_evidence("calibration", *place, to=lambda x: (x or 0.0) * 1.01 + 1e-3)


def reading(number: int, **values: Any) -> Tamper:
    return lambda bundle: bundle.reading(number, **values)


def of_bytes(name: str, change: Callable[[bytes], bytes]) -> Tamper:
    return lambda bundle: bundle.bytes_of.update({name: change})


def at_last(step: Callable[[Path], object]) -> Tamper:
    return lambda bundle: bundle.last.append(step)  # pyright: ignore


def without_run(bundle: Bundle) -> None:
    (gone,) = [run["id"] for run in bundle.evidence["campaign"]["runs"][1:2]]
    bundle.readings = bundle.readings.filter(pl.col("run_id") != gone)
    bundle.points = bundle.points.filter(pl.col("run_id") != gone)


def without_run_anywhere(bundle: Bundle) -> None:
    without_run(bundle)
    log = bundle.evidence["campaign"]["runs"].pop(1)["log"]
    bundle.evidence["logs"] = [each for each in bundle.evidence["logs"] if each["log"] != log]


def swapped_logs(bundle: Bundle) -> None:
    first, second = bundle.evidence["logs"][:2]
    first["files"], second["files"] = second["files"], first["files"]


def without_reading(bundle: Bundle) -> None:
    bundle.readings = bundle.readings[1:]


def one_reading_more(bundle: Bundle) -> None:
    last = bundle.readings[-1:].with_columns(pl.col("reading") + 1)
    bundle.readings = pl.concat([bundle.readings, last])


def another_mass(bundle: Bundle) -> None:
    number = bundle.readings["mass_kg"][2] + 0.1
    bundle.reading(2, mass_kg=number)


def moved_point(bundle: Bundle) -> None:
    bundle.points = bundle.points.with_columns(pl.col("error_kg") / 10.0)


def edited_report(data: bytes) -> bytes:
    changed = data.replace(b"Not for trade.", b"For trade.", 1)
    assert changed != data
    return changed


def link(folder: Path) -> None:
    (folder / REPORT).rename(folder.parent / f"{folder.name}.html")
    (folder / REPORT).symlink_to(folder.parent / f"{folder.name}.html")


def dropped_sum(folder: Path) -> None:
    lines = (folder / SUMS).read_text().splitlines(keepends=True)
    (folder / SUMS).write_text("".join(lines[1:]))


#: name: the change; what is found where key and earlier evidence are given; what is found with
#: neither, once the attacker has taken the signature off (None: nothing can be).
TAMPERINGS: dict[str, tuple[Tamper, BundleOutcome, BundleOutcome | None]] = {
    "alpha": (fit("alpha_1"), TAMPERED, IRREPRODUCIBLE),
    "beta": (fit("beta_kg"), TAMPERED, IRREPRODUCIBLE),
    "slope": (fit("c1_1"), TAMPERED, IRREPRODUCIBLE),
    "a digit of the covariance": (fit("covariance", 1), TAMPERED, IRREPRODUCIBLE),
    "chi squared": (fit("chi2_1"), TAMPERED, IRREPRODUCIBLE),
    "the uncertainty": (fit("u_kg"), TAMPERED, IRREPRODUCIBLE),
    "the coverage factor": (fit("coverage_k_1"), TAMPERED, IRREPRODUCIBLE),
    "the valid range": (fit("range_kg", 1), TAMPERED, IRREPRODUCIBLE),
    "a row of the budget": (fit("budget", 0, "u_kg"), TAMPERED, IRREPRODUCIBLE),
    "an error of a point": (fit("points", 2, "error_kg"), TAMPERED, IRREPRODUCIBLE),
    "a sentence": (in_evidence("calibration", "says", to=[]), TAMPERED, IRREPRODUCIBLE),
    "the confidence": (in_evidence("options", "confidence_1", to=0.5), TAMPERED, IRREPRODUCIBLE),
    "the verdict's risk": (in_evidence("limits", "risk_1", to=0.5), TAMPERED, IRREPRODUCIBLE),
    "the asked class": (
        in_evidence("campaign", "decision", "accuracy_class", to="OIML R 134 0.2"),
        TAMPERED,
        IRREPRODUCIBLE,
    ),
    "the verdict": (in_evidence("limits", "verdict", to="outside"), TAMPERED, IRREPRODUCIBLE),
    "the last day": (
        in_evidence("expires", to="2035-01-01"),
        TAMPERED,
        IRREPRODUCIBLE,
    ),
    "the intended use": (
        in_evidence("campaign", "campaign", "intended_use", to="trade"),
        TAMPERED,
        None,
    ),
    "the author": (in_evidence("campaign", "campaign", "author", to="N. N."), TAMPERED, None),
    "the notice": (in_evidence("notice", to="Legal for trade."), TAMPERED, TAMPERED),
    "an unknown key": (lambda b: b.evidence.update(more=1), TAMPERED, TAMPERED),
    "a number as text": (in_evidence("chain", "counter", to="2"), TAMPERED, TAMPERED),
    "the machine's id": (
        in_evidence("campaign", "machine", "id", to="sledge-8"),
        TAMPERED,
        None,
    ),
    "a part": (
        in_evidence("campaign", "machine", "parts", "runners", to="R-2"),
        TAMPERED,
        None,
    ),
    "the machine's mass": (
        in_evidence("machine", "machine", "empty_mass_kg", to=101.0),
        TAMPERED,
        IRREPRODUCIBLE,
    ),
    "a setting": (
        in_evidence("machine", "settings", "gate", "window_samples", to=300),
        TAMPERED,
        IRREPRODUCIBLE,
    ),
    "a channel's scale": (
        in_evidence("machine", "channels", "force_x_N", "scale", to=1.1),
        TAMPERED,
        IRREPRODUCIBLE,
    ),
    "a reference mass": (
        in_evidence("campaign", "masses", 0, "value_kg", to=21.0),
        TAMPERED,
        IRREPRODUCIBLE,
    ),
    "a mass' uncertainty": (
        in_evidence("campaign", "masses", 0, "u_kg", to=0.011),
        TAMPERED,
        IRREPRODUCIBLE,
    ),
    "what masses share": (
        in_evidence("campaign", "masses", 1, "shared_u_kg", to=0.0),
        TAMPERED,
        IRREPRODUCIBLE,
    ),
    "a certificate": (
        in_evidence("campaign", "masses", 0, "certificate", to="K-9"),
        TAMPERED,
        None,
    ),
    "an expired certificate": (
        in_evidence("campaign", "masses", 0, "expires", to="2026-01-01"),
        TAMPERED,
        INCOMPLETE,
    ),
    "the references": (
        in_evidence("references", 1, "reference_kg", to=121.0),
        TAMPERED,
        IRREPRODUCIBLE,
    ),
    "the day of a run": (
        in_evidence("campaign", "runs", 0, "day", to="2026-05-03"),
        TAMPERED,
        IRREPRODUCIBLE,
    ),
    "a load on board": (
        in_evidence("campaign", "runs", 1, "loads", to=["block-2"]),
        TAMPERED,
        IRREPRODUCIBLE,
    ),
    "a run excluded afterwards": (
        in_evidence("campaign", "runs", 2, "excluded", to="wheel slip"),
        TAMPERED,
        IRREPRODUCIBLE,
    ),
    "the operator": (
        in_evidence("campaign", "runs", 0, "operator", to="N. N."),
        TAMPERED,
        None,
    ),
    "a dropped run": (without_run, TAMPERED, INCOMPLETE),
    "a run dropped everywhere": (without_run_anywhere, TAMPERED, IRREPRODUCIBLE),
    "swapped logs": (swapped_logs, TAMPERED, None),
    "a log's digest": (
        in_evidence("logs", 0, "files", 0, "sha256", to="0" * 64),
        TAMPERED,
        None,
    ),
    "a log that could not weigh": (
        in_evidence("logs", 0, "can_weigh", to=False),
        TAMPERED,
        IRREPRODUCIBLE,
    ),
    "the mass of a reading": (another_mass, TAMPERED, IRREPRODUCIBLE),
    "a dropped reading": (without_reading, TAMPERED, IRREPRODUCIBLE),
    "a reading more": (one_reading_more, TAMPERED, IRREPRODUCIBLE),
    "a reading rejected without a reason": (reading(0, used=False), TAMPERED, INCOMPLETE),
    "a reading rejected with one": (
        reading(0, used=False, reason="outlier"),
        TAMPERED,
        IRREPRODUCIBLE,
    ),
    "a reading of another log": (reading(0, log="load-9.csv"), TAMPERED, IRREPRODUCIBLE),
    "the points": (moved_point, TAMPERED, IRREPRODUCIBLE),
    "the line before": (
        in_evidence("as_found", "alpha_1", to=lambda x: x * 1.01),
        TAMPERED,
        IRREPRODUCIBLE,
    ),
    "the counter": (in_evidence("chain", "counter", to=7), TAMPERED, TAMPERED),
    "the link": (
        in_evidence("chain", "previous", "sums_sha256", to="0" * 64),
        TAMPERED,
        None,
    ),
    "no link": (
        lambda b: b.evidence.update(chain={"counter": 1, "previous": None}),
        TAMPERED,
        None,
    ),
    "a tolerance that forgives": (
        in_evidence("replay_tolerance_kg", to=1e9),
        TAMPERED,
        TAMPERED,
    ),
    "the software": (in_evidence("software", "python", to="4.0.0"), TAMPERED, None),
    "an edited report": (of_bytes(REPORT, edited_report), TAMPERED, TAMPERED),
    "a removed report": (at_last(lambda f: (f / REPORT).unlink()), INCOMPLETE, INCOMPLETE),
    "removed points": (at_last(lambda f: (f / POINTS).unlink()), INCOMPLETE, INCOMPLETE),
    "removed digests": (at_last(lambda f: (f / SUMS).unlink()), INCOMPLETE, INCOMPLETE),
    "one digest removed": (at_last(dropped_sum), TAMPERED, TAMPERED),
    "a renamed file": (
        at_last(lambda f: (f / REPORT).rename(f / "report.htm")),
        TAMPERED,
        TAMPERED,
    ),
    "an added file": (at_last(lambda f: (f / "note.txt").write_text("n")), TAMPERED, TAMPERED),
    "an added folder": (at_last(lambda f: (f / "more").mkdir()), TAMPERED, TAMPERED),
    "an added recording": (
        lambda b: ((b.folder / "runs").mkdir(), (b.folder / "runs/x.rrd").write_bytes(b"RRF2")),
        TAMPERED,
        TAMPERED,
    ),
    "a link": (at_last(link), TAMPERED, TAMPERED),
    "a line end": (of_bytes(EVIDENCE, lambda data: data + b"\n"), TAMPERED, TAMPERED),
    "spaces": (
        of_bytes(EVIDENCE, lambda data: data.replace(b'{"', b'{ "', 1)),
        TAMPERED,
        TAMPERED,
    ),
    "a compressed table": (
        of_bytes(READINGS, lambda data: compressed(data)),
        TAMPERED,
        TAMPERED,
    ),
    "another recording": (
        of_bytes(RECORDING, lambda data: data + b"\0"),
        TAMPERED,
        None,
    ),
}


def compressed(data: bytes) -> bytes:
    import io

    out = io.BytesIO()
    pl.read_parquet(io.BytesIO(data)).write_parquet(out, compression="zstd")
    return out.getvalue()


def items(found: Verified) -> str:
    return "\n".join(map(str, found.findings))


@pytest.mark.parametrize("name", TAMPERINGS)
def test_a_tampering_is_found_where_the_key_and_the_evidence_before_are_given(
    made: Made, tmp_path: Path, name: str
) -> None:
    tamper, outcome, _ = TAMPERINGS[name]
    found = made.verify(tampered(made.bundle, tmp_path / "b", tamper, signed=True))
    # what is missing altogether is said first to be missing, where nothing else is wrong
    assert found.outcome in (outcome, TAMPERED), items(found)
    assert found.outcome is TAMPERED or all(f.outcome is outcome for f in found.findings)


@pytest.mark.slow
@pytest.mark.parametrize("name", TAMPERINGS)
def test_a_tampering_of_unsigned_evidence_is_found_where_it_contradicts_itself(
    made: Made, tmp_path: Path, name: str
) -> None:
    tamper, _, outcome = TAMPERINGS[name]
    found = verify(tampered(made.bundle, tmp_path / "b", tamper, signed=False))
    assert found.outcome is outcome, items(found)
    assert any("UNSIGNED" in note for note in found.notes) or outcome is not None


def test_there_are_enough_tamperings() -> None:
    assert len(TAMPERINGS) >= 40


def test_a_key_in_the_signers_place_is_found_by_the_key_given(made: Made, tmp_path: Path) -> None:
    folder = tampered(made.bundle, tmp_path / "b", sign_with_own_key, signed=True)
    assert "is not signed by the key" in items(made.verify(folder))
    # without a key there is nothing to compare with, and it says so
    alone = verify(folder)
    assert alone.outcome is None
    assert "no key was given" in alone.notes[0]


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
    older = verify(made.first, key_file=made.public, previous=made.bundle)
    assert older.outcome is TAMPERED
    assert "the counter only grows" in items(older)
    skipped = verify(made.third, key_file=made.public, previous=made.first)
    assert skipped.outcome is TAMPERED
    assert "is other evidence than that given" in items(skipped)


def test_the_statement_of_other_evidence_is_found(made: Made, tmp_path: Path) -> None:
    folder = Path(shutil.copytree(made.bundle, tmp_path / "b"))
    shutil.copy(made.third / STATEMENT, folder / STATEMENT)
    found = made.verify(folder)
    assert found.outcome is TAMPERED
    assert "is about other evidence" in items(found)


def test_every_file_counts_and_a_flipped_byte_of_each_is_found(made: Made, tmp_path: Path) -> None:
    names, _ = listing(made.bundle)
    assert {EVIDENCE, READINGS, POINTS, RECORDING, REPORT, SUMS, STATEMENT} <= set(names)
    for name in names:
        folder = Path(shutil.copytree(made.bundle, tmp_path / name))
        data = bytearray((folder / name).read_bytes())
        data[len(data) // 3] ^= 1
        (folder / name).write_bytes(data)
        assert made.verify(folder).outcome is TAMPERED, name


@pytest.mark.slow
def test_each_flipped_byte_of_the_small_files_is_found(made: Made, tmp_path: Path) -> None:
    from recordings.evidence import checks
    from recordings.evidence.checked import CheckedBundle

    folder = Path(shutil.copytree(made.bundle, tmp_path / "b"))
    for name in (EVIDENCE, READINGS, POINTS, REPORT, SUMS):
        whole = (folder / name).read_bytes()
        for place in range(len(whole)):
            data = bytearray(whole)
            data[place] ^= 1 << place % 8
            (folder / name).write_bytes(data)
            found = CheckedBundle()
            checks._files(folder, found)
            assert found.findings, (name, place)
        (folder / name).write_bytes(whole)
    whole = (folder / STATEMENT).read_bytes()
    for place in range(0, len(whole), 3):
        data = bytearray(whole)
        data[place] ^= 1 << place % 8
        (folder / STATEMENT).write_bytes(data)
        assert made.verify(folder).outcome is TAMPERED, place


def test_an_untouched_bundle_verifies(made: Made) -> None:
    found = made.verify(made.bundle)
    assert not found.findings
    assert any("left out before" in sentence for sentence in found.unseen)


def test_with_its_logs_every_reading_is_replayed(made: Made, tmp_path: Path) -> None:
    logs = made.campaign.parent
    assert not made.verify(made.bundle, logs=logs).findings
    some = Path(shutil.copytree(logs, tmp_path / "logs"))
    (some / "load-2.csv").unlink()
    found = made.verify(made.bundle, logs=some)
    assert found.outcome is INCOMPLETE
    assert "'load-2.csv' is not in the folder of logs" in items(found)
    shutil.copy(some / "load-1.csv", some / "load-2.csv")
    found = made.verify(made.bundle, logs=some)
    assert found.outcome is TAMPERED
    assert "logs: load-2.csv" in items(found)


def test_readings_that_the_logs_do_not_give_are_irreproducible(made: Made, tmp_path: Path) -> None:
    """Even where whoever holds the key made the fit of them."""
    private, public = made.private, made.public
    forged = campaign_folder(tmp_path / "campaign")
    table = pl.read_csv(forged.parent / "load-2.csv")
    table.with_columns(pl.col("force_N") * 1.01).write_csv(forged.parent / "load-2.csv")
    calibrate(forged, tmp_path / "b", key_file=private)

    def honest_digest(bundle: Bundle) -> None:
        import hashlib

        for log in bundle.evidence["logs"]:
            data = (made.campaign.parent / log["log"]).read_bytes()
            log["files"][0]["sha256"] = hashlib.sha256(data).hexdigest()

    folder = tampered(tmp_path / "b", tmp_path / "c", honest_digest, signed=False)
    assert verify(folder).outcome is None
    found = verify(folder, logs=made.campaign.parent)
    assert found.outcome is IRREPRODUCIBLE
    assert "run 'run-2', reading 1: the replay gives another" in items(found)
    assert public.exists()


@pytest.mark.parametrize(
    "variables", [{"TZ": "Pacific/Apia", "LC_ALL": "tr_TR.UTF-8"}, {"LC_ALL": "C", "TZ": "UTC"}]
)
def test_it_verifies_in_another_folder_time_zone_and_locale(
    made: Made, tmp_path: Path, variables: dict[str, str]
) -> None:
    folder = Path(shutil.copytree(made.bundle, tmp_path / "another place, ö"))
    left = subprocess.run(
        [
            *(sys.executable, "-c", "from replay.commands.cli import main; main()"),
            *("verify", folder, "--key", made.public, "--previous", made.first),
        ],
        env={**os.environ, **variables, "HOME": str(tmp_path), "USER": "another"},
        cwd=tmp_path,
        capture_output=True,
        check=False,
    )
    assert left.returncode == 0, left.stdout + left.stderr


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

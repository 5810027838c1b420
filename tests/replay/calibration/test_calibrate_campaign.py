"""`payscope calibrate`: evidence from logs, of one load as well, and checks against one mass."""

import datetime as dt
import json
import re
import shutil
import time
from pathlib import Path

import polars as pl
import pytest

from estimators.errors import EvidenceError
from recordings import read_frame
from recordings.calibration.bundle_folder import EVIDENCE, RECORDING, REPORT, STATEMENT
from recordings.calibration.evidence_document import SCHEMA, format_evidence_schema
from recordings.signatures.signing import KEY_VARIABLE
from replay.calibration.calibrate_campaign import CalibrationOutcome, calibrate_from_campaign
from replay.calibration.check_mass import KnownMassOnBoard, write_evidence_of_mass_check
from replay.calibration.verify_bundle import verify_bundle
from tests.replay.attacker import key_files
from tests.replay.kept_replays import replays_anew
from tests.replay.sledge import Payscope, join_to_one_line, sledge
from tests.replay.sledge_campaign import MASS, campaign_folder

pytestmark = pytest.mark.usefixtures("kept_replays", "without_pdf")

REPO = Path(__file__).resolve().parents[3]


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("calibrate")
    campaign_folder(folder, extra='excluded = "wheel slip"\n', loads=(0, 1, 2, 3, 1))
    text = (folder / "campaign.toml").read_text()
    # the last run is the second with its load: in a log and under a name of its own
    head, _, last = text.rpartition('[[runs]]\nid = "run-1"\nlog = "load-1.csv"')
    shutil.copy(folder / "load-1.csv", folder / "again.csv")
    last = f'[[runs]]\nid = "again"\nlog = "again.csv"{last}'
    (folder / "campaign.toml").write_text(head + last)
    return folder


@pytest.fixture(scope="module")
def keys(folder: Path) -> tuple[Path, Path]:
    return key_files(folder)


@pytest.fixture(scope="module")
def made(folder: Path, keys: tuple[Path, Path]) -> CalibrationOutcome:
    return calibrate_from_campaign(
        folder / "campaign.toml", folder / "evidence", key_file=keys[0], keeps_recordings=True
    )


def test_the_line_is_that_of_the_loads(made: CalibrationOutcome) -> None:
    line = made.document.calibration
    assert line is not None
    assert line.alpha_1 == pytest.approx(1.0, abs=0.02)
    assert max(abs(point.error_kg or 0.0) for point in line.points) < 1.0
    assert made.is_within_limits


def test_an_excluded_run_is_kept_with_its_reason(made: CalibrationOutcome) -> None:
    left_out = made.rejected_readings
    assert left_out["run_id"].unique().to_list() == ["again"]
    assert left_out["reason"].unique().to_list() == ["excluded: wheel slip"]
    assert left_out["mass_kg"].null_count() == 0
    page = (made.folder / REPORT).read_text(encoding="utf-8")
    assert "excluded: wheel slip" in page


def test_the_recording_has_the_line_and_a_link_to_each_replay(made: CalibrationOutcome) -> None:
    runs = read_frame(made.folder / RECORDING, "runs")
    assert runs.height == 5
    for name in runs["recording"]:
        assert (made.folder / name).is_file()
    line = made.document.calibration
    assert line is not None
    assert read_frame(made.folder / RECORDING, "line")["alpha_1"].item() == line.alpha_1


def test_evidence_is_canonical_json_of_the_published_schema(made: CalibrationOutcome) -> None:
    import rfc8785
    from jsonschema import Draft202012Validator

    published = (REPO / "recordings/calibration" / SCHEMA).read_text(encoding="utf-8")
    assert published == format_evidence_schema(), (
        "python -m recordings.calibration.evidence_document prints it"
    )
    data = (made.folder / EVIDENCE).read_bytes()
    held = json.loads(data)
    assert rfc8785.dumps(held) == data
    validator = Draft202012Validator(json.loads(published))
    assert not list(validator.iter_errors(held))
    assert list(validator.iter_errors({**held, "more": 1}))


@pytest.mark.heavy
def test_unsigned_evidence_says_so_on_every_surface(
    folder: Path, tmp_path: Path, payscope: Payscope, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.delenv(KEY_VARIABLE, raising=False)
    said = payscope("calibrate", folder / "campaign.toml", "-o", tmp_path / "evidence")
    assert said.status == 0, said.err
    assert "UNSIGNED" in said.out
    assert not (tmp_path / "evidence" / STATEMENT).exists()
    assert "UNSIGNED" in (tmp_path / "evidence" / REPORT).read_text(encoding="utf-8")
    said = payscope("verify", tmp_path / "evidence")
    assert said.status == 0
    assert "UNSIGNED" in said.out
    join_to_one_line(
        payscope("calibrate", folder / "campaign.toml", "-o", tmp_path / "evidence"),
        "exists already",
    )


@pytest.mark.slow
def test_two_exchanged_files_are_named_by_calibrate_and_by_verify(
    tmp_path: Path, payscope: Payscope
) -> None:
    blocks = "".join(MASS.format(number=number) for number in (4, 5))
    campaign = campaign_folder(tmp_path, extra=blocks, loads=(0, 1, 2, 3, 4, 5))
    first, second, third = (tmp_path / name for name in ("load-1.csv", "load-3.csv", "x.csv"))
    first.rename(third)
    second.rename(first)
    third.rename(second)
    named = "note: runs 'run-1' and 'run-3' may be exchanged"
    assert named in payscope("calibrate", campaign, "-o", tmp_path / "evidence").out
    assert named in payscope("verify", tmp_path / "evidence").out


def test_a_signature_without_a_name_says_where_the_name_is_stated(
    folder: Path, keys: tuple[Path, Path], tmp_path: Path, payscope: Payscope
) -> None:
    unnamed = shutil.copytree(folder, tmp_path / "unnamed") / "campaign.toml"
    unnamed.write_text(unnamed.read_text().replace('signer = "T. Signer"\n', ""))
    said = payscope("calibrate", unnamed, "-o", tmp_path / "evidence", "--key", keys[0])
    assert re.search(
        r"signed with key [0-9a-f]{12}…, without a name; state it as campaign.signer", said.out
    )


@pytest.mark.heavy
def test_the_environment_may_hold_the_key(
    folder: Path, keys: tuple[Path, Path], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv(KEY_VARIABLE, keys[0].read_text())
    made = calibrate_from_campaign(folder / "campaign.toml", tmp_path / "evidence")
    assert made.document.signer is not None
    assert not verify_bundle(made.folder, key_file=keys[1]).findings


@pytest.mark.parametrize(
    ("content", "parts"),
    [
        ("no key", ["no private key in PEM", "openssl genpkey"]),
        (
            "-----BEGIN RSA PRIVATE KEY-----\nAA==\n-----END RSA PRIVATE KEY-----",
            ["no private key"],
        ),
    ],
)
def test_a_key_that_is_none_is_refused_in_one_line(
    folder: Path, tmp_path: Path, payscope: Payscope, content: str, parts: list[str]
) -> None:
    key = tmp_path / "key.pem"
    key.write_text(content)
    said = payscope(
        "calibrate", folder / "campaign.toml", "-o", tmp_path / "evidence", "--key", key
    )
    join_to_one_line(said, str(key), *parts)


def test_the_private_key_is_not_taken_for_the_public_one(
    made: CalibrationOutcome, keys: tuple[Path, Path], payscope: Payscope
) -> None:
    join_to_one_line(
        payscope("verify", made.folder, "--key", keys[0]), "is a private key", "-pubout"
    )


@pytest.mark.heavy
@pytest.mark.usefixtures("readers_in_this_process")
def test_a_known_mass_shows_drift_or_none(
    made: CalibrationOutcome, keys: tuple[Path, Path], tmp_path: Path
) -> None:
    table = sledge(mass_kg=130.0)
    table.write_csv(tmp_path / "as-before.csv")
    table.with_columns(pl.col("force_N") * 1.2).write_csv(tmp_path / "drifted.csv")
    known = KnownMassOnBoard(30.0, 0.01, "K-7", "2026-06-01")
    for name, drifted in (("as-before", False), ("drifted", True)):
        checked = write_evidence_of_mass_check(
            tmp_path / f"{name}.csv", known, tmp_path / name, previous=made.folder, key_file=keys[0]
        )
        drift = checked.document.drift
        assert drift is not None
        assert drift.drifted is drifted
        assert checked.is_within_limits is not drifted
        assert checked.document.expires == made.document.expires
        found = verify_bundle(
            checked.folder, key_file=keys[1], previous=made.folder, log_folder=tmp_path
        )
        assert [int(each.outcome) for each in found.findings] == ([6] if drifted else [])
    with pytest.raises(EvidenceError, match="no evidence"):
        write_evidence_of_mass_check(
            tmp_path / "drifted.csv", known, tmp_path / "x", previous=tmp_path
        )


def test_nothing_is_chained_to_tampered_evidence_or_another_machine(
    made: CalibrationOutcome, folder: Path, tmp_path: Path, payscope: Payscope
) -> None:
    before = Path(shutil.copytree(made.folder, tmp_path / "before"))
    (before / "note.txt").touch()
    words = ("calibrate", folder / "campaign.toml", "-o", tmp_path / "next", "--previous")
    join_to_one_line(payscope(*words, before), "cannot be used as --previous", "note.txt")
    other = campaign_folder(tmp_path / "other")
    other.write_text(other.read_text().replace("sledge-7", "sledge-8"))
    said = payscope("calibrate", other, "-o", tmp_path / "next", "--previous", made.folder)
    join_to_one_line(said, "is evidence of machine 'sledge-7'")


@pytest.mark.heavy
def test_evidence_is_checked_within_seconds_without_its_logs(made: CalibrationOutcome) -> None:
    verify_bundle(made.folder)
    with replays_anew():
        began = time.process_time()
        verify_bundle(made.folder)
    assert time.process_time() - began < 1.5


ONE_LOAD = """
[campaign]
intended_use = "showing what one load cannot"
author = "A. Author"

[machine]
file = "axis.toml"
id = "EMPS-1"
empty_mass_u_kg = 0.1

[[runs]]
log = "linear_axis.csv"
loads = []
day = 2019-05-01
"""


@pytest.mark.usefixtures("readers_in_this_process")
def test_a_real_axis_with_one_load_says_what_that_cannot_show(
    shared_data: Path, tmp_path: Path
) -> None:
    shutil.copy(REPO / "examples/linear_axis.toml", tmp_path / "axis.toml")
    shutil.copy(shared_data / "logs/linear_axis.csv", tmp_path)
    (tmp_path / "campaign.toml").write_text(ONE_LOAD)
    made = calibrate_from_campaign(tmp_path / "campaign.toml", tmp_path / "evidence")
    document = made.document
    assert document.calibration is None
    assert not made.is_within_limits
    (reference,) = document.references
    assert reference.reference_kg == 95.11
    assert made.points["mean_kg"].item() == pytest.approx(95.11, abs=3.0)
    page = (made.folder / REPORT).read_text(encoding="utf-8")
    assert "NO CALIBRATION" in page
    assert "It cannot show: whether the error grows with the mass" in page
    day = dt.date(2020, 4, 1)
    assert not verify_bundle(
        made.folder, log_folder=shared_data / "logs", verification_day=day
    ).findings

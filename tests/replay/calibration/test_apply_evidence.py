"""`--calibration`: the calibrated mass beside the raw one, and the evidence that is refused."""

import json
import shutil
from functools import partial
from pathlib import Path

import polars as pl
import pytest

from analysis.calibration.line.procedure import PROCEDURES
from analysis.calibration.use.learnt_priors import copy_machine_estimating_learnt_mean_errors
from estimators.errors import EvidenceError
from recordings import read_frame, read_provenance
from recordings.calibration.derived_values import make_estimator_with_digest
from recordings.calibration.evidence_document import parse_untrusted_evidence
from recordings.signatures.canonical_json import encode_canonical_json
from replay.calibration.apply_evidence import CalibrationRequest, load_and_verify_calibration
from replay.calibration.calibrate_campaign import CalibrationOutcome, calibrate_from_campaign
from replay.calibration.campaign_runs import replay_campaign_logs
from replay.calibration.check_mass import KnownMassOnBoard, write_evidence_of_mass_check
from replay.calibration.verify_bundle import verify_bundle
from replay.machines.machine_file import load_machine
from tests.replay.attacker import Bundle, key_files, tampered
from tests.replay.kept_replays import replays_anew
from tests.replay.sledge import Payscope, join_to_one_line
from tests.replay.sledge_campaign import campaign_folder

pytestmark = pytest.mark.usefixtures("kept_replays", "without_pdf", "readers_in_this_process")


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("calibrated")
    campaign_folder(folder)
    return folder


@pytest.fixture(scope="module")
def keys(folder: Path) -> tuple[Path, Path]:
    return key_files(folder)


@pytest.fixture(scope="module")
def made(folder: Path) -> CalibrationOutcome:
    return calibrate_from_campaign(folder / "campaign.toml", folder / "evidence")


@pytest.mark.heavy
def test_evidence_has_what_its_logs_said_and_what_came_of_it(made: CalibrationOutcome) -> None:
    learnt = made.document.learnt
    assert learnt is not None
    assert {each.log for each in learnt.logs} == {f"load-{number}.csv" for number in range(4)}
    assert "const" in learnt.terms
    assert made.document.weighing_machine.settings.priors.learnt == learnt.terms
    assert made.document.machine.settings.priors.learnt == {}


@pytest.mark.heavy
def test_its_logs_are_replayed_twice_to_verify_it(folder: Path, made: CalibrationOutcome) -> None:
    with replays_anew():
        assert not verify_bundle(made.folder, log_folder=folder).findings


@pytest.mark.heavy
def test_evidence_that_counts_gain_as_a_common_error_is_replayed_as_it_was_made(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Test: evidence without the key, as earlier versions made it. Expected Result: verified."""
    campaign = campaign_folder(tmp_path / "logs", loads=(0, 2, 3))
    file = tmp_path / "logs" / "sledge.toml"
    file.write_text(file.read_text().replace("[machine]", "[machine]\nforce_gain_u = 0.02", 1))
    now = calibrate_from_campaign(campaign, tmp_path / "now")
    with monkeypatch.context() as earlier:
        counted = partial(replay_campaign_logs, procedure=PROCEDURES[1])
        earlier.setattr("replay.calibration.calibrate_campaign.replay_campaign_logs", counted)
        made = calibrate_from_campaign(campaign, tmp_path / "made")
    assert now.document.calibration is not None
    assert made.document.calibration is not None
    assert now.document.calibration.common_kg < made.document.calibration.common_kg

    def lose_key(bundle: Bundle) -> None:
        del bundle.evidence["procedure"]

    before = tampered(made.folder, tmp_path / "before", lose_key, signed=True)
    assert not verify_bundle(before, log_folder=tmp_path / "logs").findings
    assert verify_bundle(made.folder, log_folder=tmp_path / "logs").findings


def test_a_campaign_may_leave_the_priors_as_they_are(folder: Path, tmp_path: Path) -> None:
    for file in folder.glob("*.csv"):
        shutil.copy(file, tmp_path)
    text = (folder / "campaign.toml").read_text()
    (tmp_path / "campaign.toml").write_text(f"{text}\n[method]\nlearn = false\n")
    shutil.copy(folder / "sledge.toml", tmp_path)
    made = calibrate_from_campaign(tmp_path / "campaign.toml", tmp_path / "evidence")
    assert made.document.learnt is None
    assert made.document.weighing_machine == made.document.machine


@pytest.mark.heavy
def test_the_calibrated_mass_stands_beside_the_raw_one_everywhere(
    folder: Path, made: CalibrationOutcome, tmp_path: Path, payscope: Payscope
) -> None:
    recording = tmp_path / "two.rrd"
    ask = ("-m", folder / "sledge.toml", "--calibration", made.folder)
    log = folder / "load-2.csv"
    said = payscope("run", log, *ask, "-o", recording)
    assert said.status == 0, said.err
    loads = read_frame(recording, "loads")
    row = loads.row(0, named=True)
    assert row["calibrated_low_kg"] < 140.0 < row["calibrated_high_kg"]
    assert row["mass_kg"] is not None
    assert f"calibrated {row['calibrated_kg']:,.1f} kg" in said.out
    assert any(made.document.id in note for note in read_provenance(recording).notes)
    (load,) = json.loads(payscope("run", log, *ask, "--json").out)["loads"]
    assert load["calibrated_kg"] == row["calibrated_kg"]
    shown = payscope("show", recording, "loads", "--calibration", made.folder, "--format", "json")
    assert json.loads(shown.out)[0]["calibrated_kg"] == row["calibrated_kg"]
    other = tmp_path / "one.rrd"
    assert payscope("run", folder / "load-1.csv", *ask, "-o", other).status == 0
    compared = payscope(
        "compare", recording, other, "--other-logs", "--calibration", made.folder, "--json"
    )
    moved = {each["quantity"]: each["change"] for each in json.loads(compared.out)["estimates"]}
    assert moved["calibrated_kg"] == pytest.approx(-20.0, abs=2.0)
    empty = [f"settings.loads.empty_{end}" for end in ("from_s=0", "to_s=1")]
    over = ("--over", "settings.loads.empty_to_s=1,2", *("--set", empty[0], "--set", empty[1]))
    rows = json.loads(payscope("sweep", log, *ask, *over, "--json").out)
    assert [each["loads"][0]["calibrated_kg"] is not None for each in rows] == [True, True]
    rows = json.loads(
        payscope("sweep", log, *ask, "--over", "settings.align.rate_hz=80,100", "--json").out
    )
    reasons = [each["loads"][0]["calibrated_reason"] for each in rows]
    assert "settings.align.rate_hz = 100.0 there and 80.0 here" in reasons[0]
    assert reasons[1] == ""


def test_evidence_that_is_not_of_this_log_is_refused_in_a_line(
    folder: Path,
    made: CalibrationOutcome,
    keys: tuple[Path, Path],
    tmp_path: Path,
    payscope: Payscope,
) -> None:
    def refused(*more: object, evidence: Path = made.folder, says: str) -> None:
        ask = ("-m", folder / "sledge.toml", "--calibration", evidence)
        join_to_one_line(payscope("run", folder / "load-2.csv", *ask, *more), says)

    refused("--require-signed", says="unsigned")
    refused("--key", keys[1], says="cannot be used to calibrate")
    refused("--set", "machine.name=other", says="not to 'other'")
    refused("--set", "settings.priors.lag_s=0.03", says="settings.priors.lag_s = 0.02 there")
    refused(evidence=tmp_path / "nowhere", says="nowhere")
    broken = tmp_path / "broken"
    shutil.copytree(made.folder, broken)
    with (broken / "report.html").open("a") as page:
        page.write(" ")
    refused(evidence=broken, says="report.html")


@pytest.mark.heavy
def test_what_is_no_calibration_calibrates_nothing(
    folder: Path, made: CalibrationOutcome, tmp_path: Path
) -> None:
    check = tmp_path / "check"
    write_evidence_of_mass_check(
        folder / "load-2.csv",
        KnownMassOnBoard(40.0, 0.1, "", "2026-05-09"),
        check,
        previous=made.folder,
    )
    with pytest.raises(EvidenceError, match="is a check against one known mass"):
        load_and_verify_calibration(CalibrationRequest(check))
    single = campaign_folder(tmp_path / "single", loads=(1,))
    calibrate_from_campaign(single, tmp_path / "one-load")
    with pytest.raises(EvidenceError, match="is not a calibration"):
        load_and_verify_calibration(CalibrationRequest(tmp_path / "one-load"))
    paper = campaign_folder(tmp_path / "paper", extra='\n[method]\nestimator = "pooled"\n')
    calibrate_from_campaign(paper, tmp_path / "pooled")
    with pytest.raises(
        EvidenceError, match="calibrates the estimator 'pooled', which does not give the mass"
    ):
        load_and_verify_calibration(CalibrationRequest(tmp_path / "pooled"))


def test_evidence_expires_by_the_day_of_the_log(made: CalibrationOutcome) -> None:
    held = load_and_verify_calibration(CalibrationRequest(made.folder))
    last = int(pl.Series([held.document.expires]).cast(pl.Datetime("ns", "UTC"))[0].timestamp())
    held.refuse_after_expiry(last * 10**9, "a.bag")
    with pytest.raises(EvidenceError, match=r"expired on .* a\.bag is of"):
        held.refuse_after_expiry((last + 3 * 86_400) * 10**9, "a.bag")


@pytest.mark.heavy
def test_a_recording_made_without_it_is_of_other_priors(
    folder: Path, made: CalibrationOutcome, tmp_path: Path, payscope: Payscope
) -> None:
    recording = tmp_path / "plain.rrd"
    ask = ("-m", folder / "sledge.toml")
    assert payscope("run", folder / "load-2.csv", *ask, "-o", recording).status == 0
    said = payscope("show", recording, "loads", "--calibration", made.folder)
    join_to_one_line(said, "record it with `payscope run --calibration")


def test_the_machine_that_is_weighed_is_that_of_the_evidence(
    folder: Path, made: CalibrationOutcome
) -> None:
    held = load_and_verify_calibration(CalibrationRequest(made.folder))
    weighing = held.copy_machine_with_calibrated_settings(load_machine(folder / "sledge.toml"))
    machine = held.require_calibrated_machine(weighing, "sledge.toml")
    # but that a later log of several loads tells what the means have wrong
    assert machine == copy_machine_estimating_learnt_mean_errors(made.document.weighing_machine)
    assert held.list_differing_settings_as_text(machine) == ""


def test_evidence_of_the_first_format_verifies_and_is_used_without_responses(
    made: CalibrationOutcome, tmp_path: Path
) -> None:
    def as_first(bundle: Bundle) -> None:
        bundle.evidence["format"] = form = bundle.evidence["format"].replace("/4", "/1")
        for log in bundle.evidence["logs"]:
            del log["machine_id"]
        document = made.document
        estimator = make_estimator_with_digest(
            document.campaign, document.weighing_machine, (), form
        )
        bundle.evidence["estimator"] = estimator.model_dump(mode="json")
        del bundle.evidence["learnt"]["responses"], bundle.evidence["calibration"]["responses"]

    first = tampered(made.folder, tmp_path / "first", as_first, signed=True)
    assert not verify_bundle(first).findings
    held = load_and_verify_calibration(CalibrationRequest(first))
    assert held.calibration.responses == ()
    machine = held.copy_machine_with_calibrated_settings(
        load_machine(made.folder.parent / "sledge.toml")
    )
    assert machine.settings.priors.learnt_means == "fixed"


def test_evidence_made_before_a_setting_takes_its_default_and_says_so(
    made: CalibrationOutcome, tmp_path: Path
) -> None:
    def before(bundle: Bundle) -> None:
        del bundle.evidence["machine"]["settings"]["priors"]["sag_weight_share"]
        document = parse_untrusted_evidence(encode_canonical_json(bundle.evidence), "evidence.json")
        estimator = make_estimator_with_digest(
            document.campaign, document.weighing_machine, document.settings_at_default
        )
        bundle.evidence["estimator"] = estimator.model_dump(mode="json")

    earlier = tampered(made.folder, tmp_path / "earlier", before, signed=True)
    found = verify_bundle(earlier)
    assert not found.findings
    assert any("settings.priors.sag_weight_share" in note for note in found.notes)
    held = load_and_verify_calibration(CalibrationRequest(earlier))
    assert (
        held.list_differing_settings_as_text(
            held.copy_machine_with_calibrated_settings(
                load_machine(made.folder.parent / "sledge.toml")
            )
        )
        == ""
    )

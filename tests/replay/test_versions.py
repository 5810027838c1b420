"""Evidence of other versions: what this one can recompute holds; the rest is listed, exit 8."""

import json
from collections.abc import Callable
from importlib.metadata import version
from pathlib import Path
from typing import Any

import pytest

from estimators.errors import EvidenceError
from recordings.calibration import evidence_document
from recordings.calibration.bundle_folder import EVIDENCE, REPORT
from recordings.calibration.check_outcomes import BundleOutcome
from recordings.calibration.derived_values import make_estimator_with_digest
from recordings.calibration.evidence_document import parse_untrusted_evidence
from recordings.calibration.released_defaults import (
    collect_defaults_of_this_version,
    list_absent_settings_changed_since,
    load_released_defaults,
)
from recordings.signatures.canonical_json import encode_canonical_json
from replay.calibration.apply_evidence import CalibrationRequest, load_and_verify_calibration
from replay.calibration.verify_bundle import Verification, verify_bundle
from replay.machines.machine_file import load_machine
from tests.replay.attacker import Bundle, tampered
from tests.replay.made_evidence import Made, items
from tests.replay.released_evidence import (
    FORMAT_2,
    FORMAT_3,
    FORMAT_3_BEGIN_S,
    FORMAT_3_LOADS,
    unpacked,
)
from tests.replay.sledge import Payscope
from tests.replay.sledge_campaign import campaign_folder
from tests.replay.tamperings import edited_report, of_bytes

pytestmark = pytest.mark.usefixtures("kept_replays")

OTHER_VERSION, TAMPERED = BundleOutcome.OTHER_VERSION, BundleOutcome.TAMPERED


@pytest.fixture(scope="module", params=[FORMAT_2, FORMAT_3], ids=["format 2", "format 3"])
def released(tmp_path_factory: pytest.TempPathFactory, request: pytest.FixtureRequest) -> Path:
    return unpacked(request.param, tmp_path_factory.mktemp("released"))


def checked(released: Path, folder: Path) -> Verification:
    key = released / "key.pub.pem"
    return verify_bundle(folder, key_file=key, previous=released / "first")


def test_evidence_of_0_1_0_still_verifies_but_for_its_page(
    released: Path, payscope: Payscope
) -> None:
    found = checked(released, released / "second")
    assert found.outcome is OTHER_VERSION, items(found)
    (page,) = found.findings
    assert page.item == REPORT
    assert "made by payscope 0.1.0 (format " in page.what
    assert "): the page cannot be recomputed here" in page.what
    said = payscope("verify", released / "second", "--key", released / "key.pub.pem")
    assert said.status == 8


@pytest.mark.heavy
def test_logs_of_released_evidence_replay_to_all_that_it_has_of_them(tmp_path: Path) -> None:
    """Test: the logs of format 3 written again. Expected Result: only words are others."""
    folder = unpacked(FORMAT_3, tmp_path / "released")
    logs = campaign_folder(
        tmp_path / "logs", loads=FORMAT_3_LOADS, begin_unix_s=FORMAT_3_BEGIN_S
    ).parent
    found = verify_bundle(folder / "first", key_file=folder / "key.pub.pem", log_folder=logs)
    assert {each.outcome for each in found.findings} == {OTHER_VERSION}, items(found)
    assert any("3 logs replayed: every reading" in done for done in found.checks_made)


def test_evidence_of_0_1_0_calibrates_as_before(released: Path) -> None:
    held = load_and_verify_calibration(
        CalibrationRequest(released / "first", released / "key.pub.pem", True)
    )
    kept = json.loads((released / "first" / "evidence.json").read_bytes())
    assert held.calibration.alpha_1 == kept["calibration"]["alpha_1"]
    assert held.signed_by.how == "given"


def in_json(*place: str, value: Any) -> Callable[[Bundle], None]:
    def tamper(bundle: Bundle) -> None:
        inside = bundle.evidence
        for name in place[:-1]:
            inside = inside[name]
        inside[place[-1]] = value

    return tamper


@pytest.mark.parametrize(
    "tamper",
    [
        in_json("calibration", "alpha_1", value=1.5),
        in_json("campaign", "campaign", "author", value="N. N."),
        of_bytes(REPORT, edited_report),
    ],
)
def test_a_change_of_released_evidence_is_tampered_with_its_key(
    released: Path, tmp_path: Path, tamper: Callable[[Bundle], None]
) -> None:
    folder = tampered(released / "second", tmp_path / "b", tamper, signed=True)
    assert checked(released, folder).outcome is TAMPERED


def from_later(*place: str) -> Callable[[Bundle], None]:
    """A setting that this version does not know, of a version to come."""

    def tamper(bundle: Bundle) -> None:
        in_json(*place, value=3)(bundle)
        bundle.evidence["software"]["payscope"] = "0.9.0"

    return tamper


@pytest.mark.parametrize(
    "place", [("campaign", "method", "later"), ("machine", "settings", "gate", "later"), ("later",)]
)
def test_a_setting_that_this_version_lacks_is_no_tampering(
    made: Made, tmp_path: Path, payscope: Payscope, place: tuple[str, ...]
) -> None:
    folder = tampered(made.bundle, tmp_path / "b", from_later(*place), signed=False)
    found = verify_bundle(folder)
    assert found.outcome is OTHER_VERSION, items(found)
    assert "made by payscope 0.9.0" in items(found)
    assert "nothing was recomputed" in items(found)
    assert payscope("verify", folder).status == 8
    with pytest.raises(EvidenceError, match="cannot be used to calibrate: made by another"):
        load_and_verify_calibration(CalibrationRequest(folder))


def test_a_setting_that_came_later_takes_its_default(made: Made, tmp_path: Path) -> None:
    def tamper(bundle: Bundle) -> None:
        del bundle.evidence["campaign"]["method"]["margin_1"]
        bundle.evidence["software"]["payscope"] = "0.0.9"

    found = verify_bundle(tampered(made.bundle, tmp_path / "b", tamper, signed=False))
    assert found.outcome in (None, OTHER_VERSION), items(found)
    assert any("campaign.method.margin_1" in note for note in found.notes)


def lacking(*place: str) -> Callable[[Bundle], None]:
    """Evidence from before there was a setting, with the digest that its maker had."""

    def tamper(bundle: Bundle) -> None:
        inside = bundle.evidence
        for name in place[:-1]:
            inside = inside[name]
        del inside[place[-1]]
        document = parse_untrusted_evidence(encode_canonical_json(bundle.evidence), EVIDENCE)
        estimator = make_estimator_with_digest(
            document.campaign, document.weighing_machine, document.settings_at_default
        )
        bundle.evidence["estimator"] = estimator.model_dump(mode="json")

    return tamper


def test_an_absent_setting_takes_the_default_that_it_came_with(
    made: Made, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Test: it came with 0.05, and today's default is another. Expected Result: 0.05."""
    place = ("machine", "settings", "priors", "sag_weight_share")
    folder = tampered(made.bundle, tmp_path / "b", lacking(*place), signed=False)
    today = load_and_verify_calibration(CalibrationRequest(folder)).document.machine.settings.priors
    released = {"0.0.8": {}, "0.0.9": {".".join(place): 0.05}, "0.1.0": {".".join(place): 0.07}}
    monkeypatch.setattr(evidence_document, "load_released_defaults", lambda: released)
    held = load_and_verify_calibration(CalibrationRequest(folder))
    assert held.document.machine.settings.priors.sag_weight_share == 0.05 != today.sag_weight_share
    assert held.document.canonical_json_bytes == (folder / EVIDENCE).read_bytes()
    assert any("priors.sag_weight_share = 0.05" in note for note in verify_bundle(folder).notes)
    # and who weighs with today's is told
    machine = load_machine(made.campaign.with_name("sledge.toml"))
    assert "settings.priors.sag_weight_share = 0.05 there" in held.list_differing_settings_as_text(
        held.copy_machine_with_calibrated_settings(machine)
    )


def test_a_whole_part_that_came_later_takes_the_defaults_that_it_came_with() -> None:
    kept = {"0.2.0": {"machine.settings.new.a": 1, "machine.settings.new.b": 2}}
    absent = {"machine.settings.new": {"a": 1, "b": 3}, "machine.settings.other": 4}
    assert list_absent_settings_changed_since(absent, kept) == {
        "machine.settings.new": {"a": 1, "b": 2}
    }


def test_defaults_of_this_version_are_kept_as_they_are() -> None:
    """A default that changes belongs to a new version: evidence of this one has the old one."""
    kept = load_released_defaults()[version("payscope")]
    assert kept == collect_defaults_of_this_version(), (
        "python -P -m recordings.calibration.released_defaults prints what has to be in "
        "recordings/calibration/released_defaults.json; where a released default changes, write a "
        "new version into pyproject.toml first"
    )


def test_an_unknown_key_under_this_version_is_tampering(made: Made, tmp_path: Path) -> None:
    tamper = in_json("campaign", "method", "later", value=3)
    found = verify_bundle(tampered(made.bundle, tmp_path / "b", tamper, signed=False))
    assert found.outcome is TAMPERED

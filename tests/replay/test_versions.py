"""Evidence of other versions: what this one can recompute holds; the rest is listed, exit 8."""

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from estimators.errors import EvidenceError
from recordings.calibration.bundle_folder import REPORT
from recordings.calibration.check_outcomes import BundleOutcome
from replay.calibration.apply_evidence import AskedCalibration, load_calibration
from replay.calibration.verify_bundle import Verified, verify
from tests.replay.attacker import Bundle, tampered
from tests.replay.made_evidence import Made, items
from tests.replay.released_evidence import FORMAT_2, unpacked
from tests.replay.sledge import Payscope
from tests.replay.tamperings import edited_report, of_bytes

OTHER_VERSION, TAMPERED = BundleOutcome.OTHER_VERSION, BundleOutcome.TAMPERED


@pytest.fixture(scope="module")
def released(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return unpacked(FORMAT_2, tmp_path_factory.mktemp("released"))


def checked(released: Path, folder: Path) -> Verified:
    key = released / "key.pub.pem"
    return verify(folder, key_file=key, previous=released / "first")


def test_evidence_of_0_1_0_still_verifies_but_for_its_page(
    released: Path, payscope: Payscope
) -> None:
    found = checked(released, released / "second")
    assert found.outcome is OTHER_VERSION, items(found)
    (page,) = found.findings
    assert page.item == REPORT
    assert "made by payscope 0.1.0 (format 2): the page cannot be recomputed here" in page.what
    said = payscope("verify", released / "second", "--key", released / "key.pub.pem")
    assert said.status == 8


def test_evidence_of_0_1_0_calibrates_as_before(released: Path) -> None:
    held = load_calibration(AskedCalibration(released / "first", released / "key.pub.pem", True))
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
    "place",
    [("campaign", "method", "later"), ("machine", "settings", "gate", "later"), ("later",)],
)
def test_a_setting_that_this_version_lacks_is_no_tampering(
    made: Made, tmp_path: Path, payscope: Payscope, place: tuple[str, ...]
) -> None:
    folder = tampered(made.bundle, tmp_path / "b", from_later(*place), signed=False)
    found = verify(folder)
    assert found.outcome is OTHER_VERSION, items(found)
    assert "made by payscope 0.9.0" in items(found)
    assert "nothing in it can be recomputed here" in items(found)
    assert payscope("verify", folder).status == 8
    with pytest.raises(EvidenceError, match=r"calibrates nothing: made by another version"):
        load_calibration(AskedCalibration(folder))


def test_a_setting_that_came_later_takes_its_default(made: Made, tmp_path: Path) -> None:
    def tamper(bundle: Bundle) -> None:
        del bundle.evidence["campaign"]["method"]["margin_1"]
        bundle.evidence["software"]["payscope"] = "0.0.9"

    found = verify(tampered(made.bundle, tmp_path / "b", tamper, signed=False))
    assert found.outcome in (None, OTHER_VERSION), items(found)
    assert any("campaign.method.margin_1" in note for note in found.notes)


def test_an_unknown_key_under_this_version_is_tampering(made: Made, tmp_path: Path) -> None:
    tamper = in_json("campaign", "method", "later", value=3)
    found = verify(tampered(made.bundle, tmp_path / "b", tamper, signed=False))
    assert found.outcome is TAMPERED

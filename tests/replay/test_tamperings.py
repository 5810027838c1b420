"""`payscope verify`: every change of a bundle by an attacker without the key is found."""

from pathlib import Path

import pytest

from replay.calibration.verify_bundle import verify
from tests.replay.attacker import tampered
from tests.replay.made_evidence import Made, items
from tests.replay.tamperings import TAMPERED, TAMPERINGS


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

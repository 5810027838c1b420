"""What is found of a change once the attacker has taken the signature off."""

from pathlib import Path

import pytest

from replay.calibration.verify_bundle import verify_bundle
from tests.replay.attacker import tampered
from tests.replay.made_evidence import Made, items
from tests.replay.tamperings import TAMPERINGS


@pytest.mark.slow
@pytest.mark.parametrize("name", TAMPERINGS)
def test_a_tampering_of_unsigned_evidence_is_found_where_it_contradicts_itself(
    made: Made, tmp_path: Path, name: str
) -> None:
    tamper, _, outcome, *_ = TAMPERINGS[name]
    found = verify_bundle(tampered(made.bundle, tmp_path / "b", tamper, signed=False))
    assert found.outcome is outcome, items(found)
    assert any("UNSIGNED" in note for note in found.notes) or outcome is not None

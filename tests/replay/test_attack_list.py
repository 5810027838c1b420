"""Every attack of the list is found, with its exit status and its words; none without the key."""

from collections import Counter
from collections.abc import Iterator
from pathlib import Path

import pytest

from replay.calibration.verify_bundle import verify_bundle
from tests.replay.attack_list import ATTACKS, Attack
from tests.replay.made_evidence import Made
from tests.replay.sledge import Payscope

pytestmark = [pytest.mark.usefixtures("kept_replays"), pytest.mark.heavy]

#: Where a signature may be there that holds, by whomever.
SIGNED_ANEW = ("signature", "own key", "chain")


@pytest.fixture(autouse=True)
def keyring(monkeypatch: pytest.MonkeyPatch, tmp_path_factory: pytest.TempPathFactory) -> None:
    """A user who keeps no keys."""
    place = tmp_path_factory.mktemp("keys") / "keys.toml"
    monkeypatch.setenv("PAYSCOPE_KEYRING", str(place))


@pytest.mark.parametrize("attack", ATTACKS, ids=lambda each: f"{each.kind}: {each.name}")
def test_an_attack_is_found_and_nothing_of_it_trusted(
    attack: Attack, made: Made, tmp_path: Path, payscope: Payscope
) -> None:
    asked = attack.asked(made, tmp_path)
    said = payscope(*asked)
    assert said.status == attack.exit, said
    assert attack.words in " ".join((said.out + said.err).split()), said
    if attack.kind in SIGNED_ANEW:
        for folder in forged(tmp_path):
            by = verify_bundle(folder).signed_by
            assert not by.is_trusted
            assert "signed by T. Signer" not in str(by)


def forged(scratch: Path) -> Iterator[Path]:
    """The bundle that the attack has made, if any."""
    for name in ("b", "resigned"):
        if (scratch / name).is_dir():
            yield scratch / name


def test_there_are_112_at_least_and_none_passes_with_the_key() -> None:
    assert len({(each.kind, each.name) for each in ATTACKS}) == len(ATTACKS) >= 112
    assert all(each.exit for each in ATTACKS)
    kinds = Counter(each.kind for each in ATTACKS)
    assert {"files", "JSON", "signature", "tables", "own key", "chain", "days"} <= set(kinds)
    assert {"machines", "versions", "use"} <= set(kinds)

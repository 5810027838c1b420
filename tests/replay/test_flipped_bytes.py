"""`payscope verify`: a flipped byte of any file of a bundle is found."""

import shutil
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pytest

from recordings.calibration.bundle_checks import check_bundle_signature, read_and_check_bundle_files
from recordings.calibration.bundle_folder import (
    EVIDENCE,
    POINTS,
    READINGS,
    RECORDING,
    REPORT,
    STATEMENT,
    SUMS,
    UNLISTED,
    list_bundle_files_and_faults,
)
from recordings.calibration.check_outcomes import BundleOutcome, find_most_severe_outcome
from recordings.calibration.checked_bundle import CheckedBundle
from recordings.calibration.evidence_document import parse_untrusted_evidence
from recordings.signatures.keyring import Keyring
from recordings.signatures.signing import read_public_key_file
from tests.replay.made_evidence import Made

pytestmark = pytest.mark.usefixtures("kept_replays")

TAMPERED = BundleOutcome.TAMPERED
#: Of each file, so many flips go through the whole of `verify`.
WHOLE = 20


@contextmanager
def flipped(path: Path, place: int) -> Iterator[None]:
    """Flip one bit of one byte, another bit from byte to byte, and put it back."""
    with path.open("r+b", buffering=0) as file:
        file.seek(place)
        (byte,) = file.read(1)
        for value in (byte ^ 1 << place % 8, byte):
            file.seek(place)
            file.write(bytes([value]))
            if value != byte:
                yield


def assert_found(made: Made, folder: Path, name: str, places: Iterable[int]) -> None:
    for place in places:
        with flipped(folder / name, place):
            assert made.verify(folder).outcome is TAMPERED, (name, place)


@pytest.mark.heavy
def test_every_file_counts_and_a_flipped_byte_of_each_is_found(made: Made, tmp_path: Path) -> None:
    names, _ = list_bundle_files_and_faults(made.bundle)
    assert {EVIDENCE, READINGS, POINTS, RECORDING, REPORT, SUMS, STATEMENT} <= set(names)
    folder = Path(shutil.copytree(made.bundle, tmp_path / "b"))
    for name in names:
        assert_found(made, folder, name, [(folder / name).stat().st_size // 3])
    assert not made.verify(folder).findings


@pytest.mark.slow
def test_a_flip_of_any_byte_of_any_file_is_found(made: Made, tmp_path: Path) -> None:
    """By the first steps of `verify`, digests and signature; nothing takes a finding back."""
    folder = Path(shutil.copytree(made.bundle, tmp_path / "b"))
    names, _ = list_bundle_files_and_faults(folder)
    key = read_public_key_file(made.public)
    document = parse_untrusted_evidence((folder / EVIDENCE).read_bytes(), EVIDENCE)
    flips = 0
    for name in names:
        for place in range((folder / name).stat().st_size):
            with flipped(folder / name, place):
                checked = CheckedBundle()
                held = read_and_check_bundle_files(folder, checked)
                if name in UNLISTED:
                    digests = {n: each.sha256 for n, each in held.items() if n not in UNLISTED}
                    check_bundle_signature(checked, held, digests, document, key, Keyring(Path()))
            assert find_most_severe_outcome(checked.findings) is TAMPERED, (name, place)
            flips += 1
    assert flips == sum((folder / name).stat().st_size for name in names)
    assert not made.verify(folder).findings


@pytest.mark.slow
@pytest.mark.parametrize("name", [EVIDENCE, READINGS, POINTS, RECORDING, REPORT, SUMS, STATEMENT])
def test_whatever_a_flip_makes_of_a_file_verify_comes_to_its_end(
    made: Made, tmp_path: Path, name: str
) -> None:
    folder = Path(shutil.copytree(made.bundle, tmp_path / "b"))
    dice = np.random.default_rng(13)
    places = dice.choice((folder / name).stat().st_size, WHOLE, replace=False)
    assert_found(made, folder, name, map(int, places))

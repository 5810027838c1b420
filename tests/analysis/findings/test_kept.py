"""Findings are those that are kept, until somebody keeps others."""

import pytest

from tests.analysis.findings.kept import (
    ALIKE_1,
    SIZES,
    TOLD_U_KG,
    UPDATE,
    differences,
    findings,
    log_name,
    read_kept,
)
from tests.trials.fault_injection import FAULTS, Fault
from tests.twins import mark_slow_after

LOG = "machine 9, force late, size 3"


#: The other machine has the same faults, just seen.
SOON, *LATER = sorted(SIZES)
#: Every second fault, of half a second each; the others have a twin among them, of another signal.
HALF = FAULTS[::2]


@pytest.mark.parametrize(
    ("seed", "faults"),
    mark_slow_after(1, [(SOON, HALF), *((seed, FAULTS) for seed in (SOON, *LATER))]),
    ids=lambda each: str(each) if isinstance(each, int) else f"{len(each)} faults",
)
def test_faults_are_found_as_they_are_kept(seed: int, faults: tuple[Fault, ...]) -> None:
    kept = read_kept(seed)
    assert set(kept) == {log_name(seed, fault) for fault in FAULTS}
    asked = {name: kept[name] for name in (log_name(seed, fault) for fault in faults)}
    found = list(differences(asked, findings(seed, faults)))
    assert not found, "\n".join(
        ["kept (-) and found now (+):", *found, f"if that is meant, keep it: {UPDATE}"]
    )


def test_kilograms_that_hardly_move_are_no_difference() -> None:
    kept = {LOG: [("delay", 100.0, 10.0)]}
    assert not list(differences(kept, {LOG: [("delay", 100.0 + 9.0 * ALIKE_1, 10.0)]}))
    moved = list(differences(kept, {LOG: [("delay", 100.0 + 11.0 * ALIKE_1, 10.0)]}))
    assert moved == [LOG, "  - delay +100 ± 10 kg", "  + delay +101 ± 10 kg"]


def test_kilograms_that_are_hardly_known_are_no_difference() -> None:
    kept = {LOG: [("saturated", -1000.0, 1.1 * TOLD_U_KG)]}
    assert not list(differences(kept, {LOG: [("saturated", 200.0, 2.0 * TOLD_U_KG)]}))
    assert list(differences(kept, {LOG: [("saturated", 200.0, 0.5 * TOLD_U_KG)]}))


def test_other_causes_or_another_order_are_a_difference() -> None:
    kept = {LOG: [("delay", None, None), ("gaps", None, None)]}
    assert list(differences(kept, {LOG: kept[LOG][::-1]}))
    assert list(differences(kept, {LOG: kept[LOG][:1]}))
    assert list(differences(kept, {LOG: [("slip or delay", None, None), kept[LOG][1]]}))
    assert list(differences(kept, {LOG: [("delay", 1.0, 1.0), kept[LOG][1]]}))


def test_who_else_is_of_a_class_is_no_difference() -> None:
    kept = {LOG: [("delay or slip", None, None)]}
    for causes in ("delay", "slip or delay", "delay or coulomb or slip"):
        assert not list(differences(kept, {LOG: [(causes, None, None)]}))


def test_a_log_that_is_new_or_gone_is_a_difference() -> None:
    kept = {LOG: [("delay", None, None)]}
    assert list(differences({}, kept)) == [LOG, "  + delay"]
    assert list(differences(kept, {})) == [LOG, "  - delay"]

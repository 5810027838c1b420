"""Totals by product: they add up to the shift, and leave out what a reviewer rejects."""

import pytest

from analysis.cycles.shift_totals import sum_cycles_by_label
from tests.analysis.cycles.drawn import drawn_shift
from tests.analysis.cycles.test_cycles import found, summed

FRAMES = drawn_shift([700.0, 650.0, 720.0, 680.0], noise_kg=20.0)
PRODUCTS = ["gravel", "sand", "gravel", ""]


def test_the_parts_add_up_to_the_shift_and_unlabelled_loads_come_last() -> None:
    totals = sum_cycles_by_label(found(FRAMES), PRODUCTS)
    assert [(each.label, each.loads) for each in totals] == [("gravel", 2), ("sand", 1), ("", 1)]
    assert sum(each.payload_kg for each in totals) == pytest.approx(summed(FRAMES)["payload_kg"])


def test_a_rejected_load_is_in_no_total() -> None:
    totals = sum_cycles_by_label(found(FRAMES), PRODUCTS, [2])
    assert [each.label for each in totals] == ["gravel", ""]


def test_without_labels_there_are_no_totals() -> None:
    assert sum_cycles_by_label(found(FRAMES), [""] * 4) == []

"""Sentences of energy and fuel: of how many cycles they are, and what the ± is worth."""

from typing import Any

import pytest

from analysis.cycles.cycle_energy import EnergyAmount, EnergyRow, ShiftEnergy
from recordings.review.energy_columns import (
    FUEL_U,
    list_energy_names_and_values,
    make_energy_table_by_phase,
)
from recordings.review.review_state import ReviewState
from tests.analysis.cycles.test_cycles import summed
from tests.recordings.review.test_shift_facts import FRAMES, rows, state

KWH = EnergyAmount(0.1, 0.001)
NONE = EnergyAmount(0.0, 0.0)


def burnt(cycle: int | None, fuel_L: float) -> EnergyRow:
    return EnergyRow(cycle, "whole", KWH, NONE, NONE, KWH, NONE, NONE, fuel_L)


def reviewed(cycles: int, fuel_u_1: float | None) -> ReviewState:
    """A shift of which so many cycles have an energy and burnt half a litre each."""
    own = [burnt(number, 0.5) for number in range(1, cycles + 1)]
    return state(energy=ShiftEnergy((burnt(None, 0.5 * cycles), *own), "", fuel_u_1))


def facts(of: ReviewState) -> dict[str, Any]:
    return dict(list_energy_names_and_values(rows(of), summed(FRAMES), of))


def test_an_energy_of_some_cycles_says_of_how_many() -> None:
    assert "kWh in 3 of 4 cycles, " in facts(reviewed(3, None))["energy at the wheels"]
    assert "cycles" not in facts(reviewed(4, None))["energy at the wheels"]


def test_litres_of_a_channel_without_an_uncertainty_say_so() -> None:
    said = facts(reviewed(4, None))["fuel"]
    assert said.endswith("; ± not known (set machine.fuel_gain_u)")
    assert said.count("±") == 1
    assert dict(make_energy_table_by_phase(reviewed(4, None)))["fuel in L, ± not known"] == ["2.00"]


def test_litres_of_a_channel_with_one_have_it_in_sentence_table_and_ledger() -> None:
    of = reviewed(4, 0.03)
    assert facts(of)["fuel"].startswith("2.00 ± 0.12 L in the cycles, ")
    assert facts(of)["fuel"].count("±") == 2
    assert dict(make_energy_table_by_phase(of))["fuel in L"] == ["2.00 ± 0.12"]
    assert rows(of)[FUEL_U].to_list() == pytest.approx([0.015] * 4)


@pytest.mark.parametrize(
    ("kinetic", "slope", "friction", "told"),
    [
        # a haul downhill
        ((0.02, 0.004), (-0.05, 0.004), (0.13, 0.004), "kinetic 20%, slope -50%, friction 130%"),
        # flat ground without a pitch
        ((0.244, 0.24), (-0.091, 0.12), (-0.053, 0.12), "its shares not determined"),
        ((0.12, 0.004), (-0.01, 0.004), (-0.01, 0.004), "its shares not determined"),
    ],
)
def test_shares_of_the_work_are_told_where_they_are_determined(
    kinetic: tuple[float, float],
    slope: tuple[float, float],
    friction: tuple[float, float],
    told: str,
) -> None:
    speeding, lifting, rubbing = (EnergyAmount(*each) for each in (kinetic, slope, friction))
    whole = EnergyRow(None, "whole", KWH, speeding, lifting, rubbing, NONE, NONE)
    assert told in facts(state(energy=ShiftEnergy((whole,))))["energy at the wheels"]

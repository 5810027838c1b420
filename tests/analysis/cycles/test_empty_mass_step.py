"""A trailer or another bucket from some cycle on: each load against its own empty machine."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from analysis.cycles.cycles import weigh_cycles
from analysis.model.verdict import Verdict
from analysis.weighing.empty_mass_step import EmptyMassStep, find_empty_mass_step
from replay import load_machine
from tests.analysis.cycles.drawn import drawn_shift

NAMES = ("mass_kg", "mass_std_kg", "load_id", "start_t_ns", "end_t_ns")


def found_step(frames) -> EmptyMassStep | None:
    return find_empty_mass_step(*(frames["manoeuvres"][name].to_numpy() for name in NAMES))


# twenty examples: each drives a shift
@pytest.mark.heavy
@settings(max_examples=20, deadline=None)
@given(
    st.lists(st.floats(400.0, 1100.0), min_size=9, max_size=14),
    st.integers(3, 6),
    st.floats(250.0, 1500.0) | st.floats(-1500.0, -250.0),
    st.integers(0, 99),
)
def test_each_load_is_weighed_against_the_empty_machine_of_its_time(
    payloads_kg: list[float], cycle: int, gained_kg: float, seed: int
) -> None:
    frames = drawn_shift(payloads_kg, gained=(cycle, gained_kg), noise_kg=5.0, seed=seed, boom=True)
    step = found_step(frames)
    assert step is not None
    assert step.change_kg == pytest.approx(gained_kg, abs=6.0 * step.u_kg)
    assert step.at_s == pytest.approx(100.0 * cycle + 5.0)
    machine = load_machine("cat262c.toml")
    weighed = weigh_cycles(None, frames, machine, Verdict(())).cycles
    assert weighed["payload_kg"].to_list() == pytest.approx(payloads_kg, abs=30.0)
    assert np.abs(weighed["carry_back_kg"].drop_nulls().to_numpy()).max() < 40.0


@settings(max_examples=20, deadline=None)
@given(
    st.lists(st.floats(400.0, 1100.0), min_size=6, max_size=14),
    st.floats(-20.0, 20.0),
    st.integers(0, 99),
)
def test_mud_that_grows_and_one_bucket_that_is_not_emptied_are_no_step(
    payloads_kg: list[float], grows_kg: float, seed: int
) -> None:
    count = len(payloads_kg)
    carried_kg = [grows_kg * (k + 1) for k in range(count)]
    assert (
        found_step(drawn_shift(payloads_kg, carried_kg=carried_kg, noise_kg=5.0, seed=seed)) is None
    )
    carried_kg = [200.0 * (k == count // 2) for k in range(count)]
    assert (
        found_step(drawn_shift(payloads_kg, carried_kg=carried_kg, noise_kg=5.0, seed=seed)) is None
    )


def test_a_step_is_told_in_words() -> None:
    assert EmptyMassStep(-2900.0, 80.0, 4, 43200.0).text.startswith(
        "the empty machine loses 2,900 ± 80 kg from 43,200.0 s on: an attachment, a trailer"
    )

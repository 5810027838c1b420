"""Small twin of `make honesty`: an answer that is shown is within three standard uncertainties."""

import numpy as np
import pytest

from analysis.simulation import Scenario, simulate_campaign
from replay import load_machine
from replay.inputs.derived_logs import MemoryLog, copy_machine_with_simulated_channels
from replay.pipeline import run
from tests.trials.drawn_designs import brought_to_size, draw_design, join_designs
from tests.trials.situations import SITUATIONS, sections
from tests.twins import mark_heavy_after, mark_slow_after

SEEDS = (11, 12)
#: The fit has a term, or a part of the budget, for each of these; many of them must be weighed.
FAULTY = (
    "Coulomb friction 300 N",
    "slip 80 kN",
    "slope 1°, acceleration without gravity",
    "force late 50 ms",
    "stops at 0.1 m/s² that no sensor sees",
    "wheels 5 % larger",
    # these have a twin above, of another sensor or another force
    "squat 0.5°",
    "speed late 30 ms",
    "topics 9 ms out of phase",
    "force offset -300 N",
    "accelerometer tilted 1°",
)
HARMLESS = ("stamp jitter 5 ms", "coasting", "sides swapped")
DESIGNS = (21, 22, 23)


@pytest.fixture(scope="module")
def machine():
    return load_machine("cat262c.toml", ['settings.trace.methods=["pooled"]'])


def weighed(scenario, machine):
    """The row of `loads`, and the true mass."""
    log = next(simulate_campaign(scenario))
    body = {
        "empty_mass_kg": scenario.machine.mass_kg,
        "force_share": scenario.machine.force_share,
    }
    own = machine.model_copy(update={"machine": machine.machine.model_copy(update=body)})
    replayed = run(MemoryLog(log), copy_machine_with_simulated_channels(own, log))
    return replayed.frames["loads"].row(0, named=True), float(log.trials["mass_kg"][0])


def holds(load, true_kg):
    return load["withheld"] or abs(load["mass_kg"] - true_kg) <= 3.0 * load["u_kg"]


@pytest.mark.heavy
@pytest.mark.parametrize("seed", mark_slow_after(1, SEEDS))
@pytest.mark.parametrize("name", mark_slow_after(2, FAULTY))
def test_a_fault_is_in_the_interval(name, seed, machine):
    scenario = Scenario.model_validate(sections(name, sensors={"seed": seed}))
    load, true_kg = weighed(scenario, machine)
    assert holds(load, true_kg), (load["mass_kg"], load["u_kg"])


@pytest.mark.heavy
@pytest.mark.parametrize("name", mark_heavy_after(1, HARMLESS))
def test_what_is_harmless_is_weighed(name, machine):
    load, true_kg = weighed(Scenario.model_validate(sections(name)), machine)
    assert not load["withheld"], load["withheld_for"]
    assert holds(load, true_kg)


@pytest.mark.heavy
@pytest.mark.parametrize("seed", mark_heavy_after(1, DESIGNS))
def test_a_machine_that_was_drawn_is_weighed(seed, machine):
    load, true_kg = weighed(Scenario.model_validate(draw_design(seed)), machine)
    assert not load["withheld"], load["withheld_for"]
    assert holds(load, true_kg)
    assert np.isfinite(load["u_kg"])


def test_a_situation_comes_to_the_size_of_its_machine():
    design = draw_design(1)
    small = {
        "machine": {"mass_kg": 1807.0},
        "campaign": {"throttle_force_N": 3000.0},
    }
    sized = brought_to_size(SITUATIONS["digging"], join_designs(design, small))
    start = sized["campaign"]["manoeuvres"][1]
    assert start["digging_N"] == 1500.0
    assert start["digging_s"] == 3.0
    share = brought_to_size(SITUATIONS["share grows with the load"], join_designs(design, small))
    assert share["campaign"]["loads_kg"] == [125.0]
    assert share["defects"]["force_share_1_kg"] == pytest.approx(3.4e-4)


def test_a_draw_is_repeated_bit_for_bit():
    assert draw_design(7) == draw_design(7)
    assert draw_design(7) != draw_design(8)

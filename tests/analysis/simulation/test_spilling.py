"""Loads that lose a share on the way: it takes its momentum with it, and the truth says where."""

import numpy as np
import pytest

from analysis.simulation import Scenario
from analysis.simulation.logs.shift_logs import ShiftSimulation
from tests.analysis.simulation.quiet import MASS_KG, log

SMOOTH = {"friction_N_s_m": 0.0}


def test_what_falls_off_slows_nothing_down_and_the_rest_obeys_its_own_mass():
    made = log(
        loading={"spill_1_s": 0.05},
        machine=SMOOTH,
        campaign={"loads_kg": [1000]},
        sensors={"rate_hz": 500.0},
        log={"latency_jitter_s": 0.0},
    )
    truth = made.noise_free_motion.filter(phase="accelerating")
    start = made.manoeuvres.filter(kind="start").row(0, named=True)
    since_s = (truth["time_ns"] - start["drive_ns"]).to_numpy() * 1e-9
    mass_kg = MASS_KG + 1000.0 * np.exp(-0.05 * since_s)
    np.testing.assert_allclose(truth["mass_kg"], mass_kg, atol=1e-4)
    np.testing.assert_allclose(truth["force_x_N"], mass_kg * truth["acc_x_m_s2"], atol=1.0)


def test_the_truth_follows_the_load_from_start_to_start_until_it_changes():
    made = log(
        loading={"spill_1_s": 0.02, "change_kg": 200.0, "change_before_start": 3},
        campaign={"loads_kg": [500], "runs": 4},
    )
    starts = made.manoeuvres.filter(kind="start")
    begin, end = starts["load_kg"].to_numpy(), starts["load_end_kg"].to_numpy()
    seconds = (starts["end_ns"] - starts["drive_ns"]).to_numpy() * 1e-9
    np.testing.assert_allclose(end, begin * np.exp(-0.02 * seconds), rtol=1e-8)
    np.testing.assert_allclose(begin, [500.0, end[0], end[1], 700.0])
    # it stands with what is left
    rests = made.noise_free_motion.filter(phase="standstill")
    between = (rests["time_ns"] > starts["end_ns"][0]) & (rests["time_ns"] < starts["drive_ns"][1])
    np.testing.assert_allclose(rests.filter(between)["mass_kg"], MASS_KG + end[0])
    assert made.noise_free_motion["mass_kg"][-1] == pytest.approx(MASS_KG + end[-1])


LOSING = {"spill_1_s": 0.01, "pour_cycles": 0.6, "pour_share": 0.25}


@pytest.mark.heavy
def test_in_a_shift_all_that_left_the_bucket_is_named_with_its_place():
    made = Scenario.model_validate({"shift": {"duration_h": 0.2, **LOSING}})
    assert made.shift is not None
    simulation = ShiftSimulation(made, made.shift)
    (whole,) = simulation.simulate_logs()
    truth = simulation.collect_truth()
    sample_position_boom_and_bucket = whole.timeline.sample_position_boom_and_bucket
    assert sample_position_boom_and_bucket is not None
    poured = truth.cycles["poured_kg"] > 0.0
    assert 0 < poured.sum() < truth.cycles.height
    for cycle in truth.cycles.iter_rows(named=True):
        lost = truth.dumps.filter(cycle=cycle["cycle"])
        of = {kind: lost.filter(kind=kind)["mass_kg"].sum() for kind in ("spill", "pour", "dump")}
        assert of["spill"] == pytest.approx(cycle["spilled_kg"])
        assert of["pour"] == pytest.approx(cycle["poured_kg"])
        assert of["dump"] == pytest.approx(cycle["payload_kg"])
        whole_kg = cycle["payload_kg"] + cycle["spilled_kg"] + cycle["poured_kg"]
        assert whole_kg + cycle["carry_back_kg"] == pytest.approx(cycle["load_kg"])
        assert 0.02 < of["spill"] / cycle["load_kg"] < 0.4
        for row in lost.filter(kind="pour").iter_rows(named=True):
            assert 3.0 < row["from_m"] == row["to_m"] < 45.0
        for row in lost.iter_rows(named=True):
            at = sample_position_boom_and_bucket(
                np.array([row["start_ns"], row["end_ns"]])
            ).position_m
            np.testing.assert_allclose(at, [row["from_m"], row["to_m"]], atol=1e-5)
        dumped = lost.filter(kind="dump").row(0, named=True)
        assert dumped["start_ns"] == dumped["end_ns"] == cycle["dump_ns"]


def test_the_mass_of_a_shift_falls_by_what_left_the_bucket():
    made = Scenario.model_validate({"shift": {"duration_h": 0.1, "fuel_kg_h": 0.0, **LOSING}})
    assert made.shift is not None
    simulation = ShiftSimulation(made, made.shift)
    (whole,) = simulation.simulate_logs()
    for row in simulation.collect_truth().dumps.iter_rows(named=True):
        around = np.array([row["start_ns"] - 2_000_000, row["end_ns"] + 2_000_000])
        before, after = whole.timeline.sample(around).mass_kg
        assert before - after == pytest.approx(row["mass_kg"], abs=0.1)


def test_pouring_in_no_cycle_leaves_the_loads_as_they_were():
    def loads(**keys):
        made = Scenario.model_validate({"shift": {"duration_h": 0.06, **keys}})
        assert made.shift is not None
        simulation = ShiftSimulation(made, made.shift)
        list(simulation.simulate_logs())
        return simulation.collect_truth().cycles["load_kg"].to_list()

    plain, losing = loads(), loads(**LOSING)
    together = min(len(plain), len(losing))
    assert plain[:together] == losing[:together]

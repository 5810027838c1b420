"""Payload by difference where a force grows with the load, drifts, or changes with the ground."""

from functools import cache

import numpy as np
import pytest

from analysis.simulation import Scenario, simulate_campaign
from analysis.weighing.fit_columns import RelativeLoads
from analysis.weighing.nuisances import LoadProportionalShare
from benchmarks.honesty_rows import LOADER, POOLED
from benchmarks.weighed import DERIVED, machine
from replay.inputs.derived_logs import MemoryLog, copy_machine_with_simulated_channels
from replay.pipeline import run
from tests.trials.drawn_designs import join_designs

LOAD_KG = 250.0
#: What the priors hold, as a scenario has it; the payload's u without any of it is 6 to 7 kg.
PHYSICS = {
    "accelerometer +0.1 m/s²": {"sensors": {"acc_bias_m_s2": 0.1}},
    "accelerometer -0.05 m/s²": {"sensors": {"acc_bias_m_s2": -0.05}},
    "accelerometer tilted by 1°": {"defects": {"acc_tilt_deg": 1.0}},
    "rolling resistance 2 %, one way": {"rolling": {"coefficient": 0.02}},
    "rolling resistance 2 %, both ways": {
        "rolling": {"coefficient": 0.02},
        "starts": {"directions": "alternating"},
    },
    "rolling resistance 4 % that grows with the speed": {
        "rolling": {"coefficient": 0.04, "growth_s_m": 0.05},
        "starts": {"directions": "alternating"},
    },
    "offset of 300 N": {"sensors": {"force_bias_N": 300.0}},
    "Coulomb friction of 300 N": {"machine": {"coulomb_N": 300.0}},
    "a body that sags by 0.25°": {"chassis": {"pitch_deg_kg": -0.001}},
    "a body that squats more with its load": {"chassis": {"squat_deg_s2_m_kg": 0.001}},
}


@cache
def weighed(sections: str, settings: tuple[str, ...] = (), load_kg: float = LOAD_KG):
    """Row of the load, and the frame of the nuisances, of five empty and five loaded starts."""
    plan = {"campaign": {"loads_kg": [0.0, load_kg], "runs": 5}, "sensors": {"seed": 5}}
    whole = join_designs(
        LOADER, plan, {"log": {"load_change_s": 5.0}}, dict(PHYSICS.get(sections, {}))
    )
    scenario = Scenario.model_validate(whole)
    logs = list(simulate_campaign(scenario))
    times = logs[0].trials.select("start_ns", "end_ns").to_numpy()
    empty_s = float(times.max() - times.min()) / 1e9
    named = ("settings.loads.empty_from_s=0.0", f"settings.loads.empty_to_s={empty_s}")
    own = machine((POOLED, *named, *settings))
    body = {"empty_mass_kg": 3614.0, "force_share": scenario.machine.force_share}
    own = own.model_copy(update={"machine": own.machine.model_copy(update=body)})
    frames = run(
        [MemoryLog(log) for log in logs], copy_machine_with_simulated_channels(own, logs[0])
    ).frames
    (load,) = frames["loads"].filter(~frames["loads"]["empty"]).to_dicts()
    return load, dict(frames["nuisances"].select("term", "posterior").iter_rows())


#: The other sign, the other sensor, or one way of what goes both ways.
ALIKE = (
    "accelerometer -0.05 m/s²",
    "accelerometer tilted by 1°",
    "rolling resistance 2 %, one way",
    "a body that sags by 0.25°",
    # a constant force, as that of an accelerometer's bias and of the way of rolling resistance
    "offset of 300 N",
    "Coulomb friction of 300 N",
)


@pytest.mark.heavy
@pytest.mark.parametrize(
    "name",
    [pytest.param(name, marks=pytest.mark.slow) if name in ALIKE else name for name in PHYSICS],
)
def test_the_payload_holds_its_uncertainty_with(name: str):
    load, _ = weighed(name)
    assert abs(load["payload_kg"] - LOAD_KG) < 2.5 * load["payload_u_kg"]
    assert load["payload_u_kg"] < 20.0


@pytest.mark.heavy
def test_a_heavy_payload_holds_its_uncertainty_where_rolling_resistance_grows_with_the_speed():
    load, terms = weighed("rolling resistance 4 % that grows with the speed", load_kg=1000.0)
    # -2.8 u with one viscous friction for both loads
    assert abs(load["payload_kg"] - 1000.0) < 2.0 * load["payload_u_kg"]
    assert terms["weight_viscous"] > 0.0


@pytest.mark.heavy
def test_without_any_of_it_the_payload_is_little_wider_for_it():
    load, _ = weighed("none")
    assert abs(load["payload_kg"] - LOAD_KG) < 2.5 * load["payload_u_kg"]
    # 4.7 kg where nothing may grow with the load, drift or lie on uneven ground
    assert load["payload_u_kg"] < 9.0


@pytest.mark.heavy
def test_one_load_has_no_terms_that_differ_by_load():
    scenario = Scenario.model_validate(join_designs(LOADER, {"campaign": {"runs": 3}}))
    logs = list(simulate_campaign(scenario))
    own = machine((POOLED,))
    found = run(
        [MemoryLog(log) for log in logs], copy_machine_with_simulated_channels(own, logs[0])
    )
    by_load = {"slip_by_load", "weight_const", "weight_direction", "weight_viscous"}
    assert not by_load & set(found.frames["nuisances"]["term"])


def test_a_log_without_a_drift_has_none_in_its_fit():
    _, terms = weighed("none")
    assert abs(terms["gain_drift"]) < 0.002


@pytest.mark.heavy
def test_a_derived_acceleration_has_its_slip_as_a_term_of_the_mass():
    _, terms = weighed("none", settings=(*DERIVED, "settings.loads.empty_to_s=60.0"))
    assert "slip_acceleration" in terms


class TestWeightShare:
    def test_equal_parts_share_the_force_evenly(self):
        found = LoadProportionalShare.from_parts(300.0, 300.0)
        assert found.expected == pytest.approx(0.5)
        # of a known sum, each part deviates by 300 / √2
        assert found.std_N == pytest.approx(300.0 / np.sqrt(2.0))

    def test_a_force_that_is_all_weight_leaves_nothing_to_tell(self):
        found = LoadProportionalShare.from_parts(1e-9, 300.0)
        assert found.expected == pytest.approx(1.0)
        assert found.std_N == pytest.approx(0.0, abs=1e-6)


class TestRelativeLoads:
    def test_they_are_relative_to_the_mean_of_the_manoeuvres(self):
        found = RelativeLoads.from_masses(np.array([3, 5]), np.array([900.0, 1100.0]), (0.5, 0.5))
        assert found is not None
        np.testing.assert_allclose(found.look_up_relative_loads(np.array([3, 5])), [-0.1, 0.1])

    def test_a_manoeuvre_that_is_not_known_goes_with_the_one_before(self):
        found = RelativeLoads.from_masses(np.array([3, 5]), np.array([900.0, 1100.0]), (0.5, 0.5))
        assert found is not None
        np.testing.assert_allclose(
            found.look_up_relative_loads(np.array([1, 4, 9])), [-0.1, -0.1, 0.1]
        )

    def test_masses_that_are_none_have_no_relation(self):
        assert RelativeLoads.from_masses(np.array([0]), np.array([-5.0]), (0.5, 0.5)) is None

    def test_a_mass_that_no_machine_has_is_taken_for_a_usual_one(self) -> None:
        masses_kg = np.array([2_200.0, 2_700.0, 2_200.0, 76_000.0, 2_700.0, 2_200.0])
        usual_kg = np.where(masses_kg < 5_000.0, masses_kg, np.median(masses_kg))
        unit = np.arange(masses_kg.size)
        found, usual = (
            RelativeLoads.from_masses(unit, each, (0.5, 0.5)) for each in (masses_kg, usual_kg)
        )
        assert found is not None
        assert usual is not None
        np.testing.assert_array_equal(
            found.look_up_relative_loads(unit) / found.rms_relative_load,
            usual.look_up_relative_loads(unit) / usual.rms_relative_load,
        )

"""A simulated shift: one machine from pile to dump and back, and what is true of it."""

from functools import cache
from typing import Any

import numpy as np
import polars as pl
import pytest

from analysis.simulation import Scenario, SimulatedLog, simulate_campaign
from analysis.simulation.logs.shift_logs import ShiftSimulation, ShiftTruth
from estimators.errors import ScenarioError

MASS_KG, FRICTION_N_S_M, COULOMB_N = 3614.0, 2891.0, 120.0


def shift_of(**sections: dict[str, Any]) -> Scenario:
    """Some minutes on a slope with hills."""
    given: dict[str, dict[str, Any]] = {
        "shift": {"duration_h": 0.12, "restart_s": 1.0},
        "machine": {"coulomb_N": COULOMB_N},
        "terrain": {"slope_deg": 1.0, "hills_deg": 1.0},
    }
    for name, section in sections.items():
        given[name] = {**given.get(name, {}), **section}
    return Scenario.model_validate(given)


def simulated(scenario: Scenario) -> tuple[list[SimulatedLog], ShiftTruth]:
    assert scenario.shift is not None
    simulation = ShiftSimulation(scenario, scenario.shift)
    logs = list(simulation.simulate_logs())
    return logs, simulation.collect_truth()


@cache
def plain() -> tuple[SimulatedLog, ShiftTruth]:
    """A shift in one log."""
    (log,), truth = simulated(shift_of(shift={"reverse_share": 0.4, "idle_share": 0.3}))
    return log, truth


def during(log: SimulatedLog, start_ns: int, end_ns: int) -> pl.DataFrame:
    return log.noise_free_motion.filter(pl.col("time_ns").is_between(start_ns, end_ns))


def test_force_mass_and_slope_obey_the_machines_equation_whichever_way_it_looks() -> None:
    log, _ = plain()
    fills = log.manoeuvres.filter(pl.col("load_end_kg") > pl.col("load_kg") + 1e-6)
    motion = log.noise_free_motion.filter(pl.col("speed_x_m_s").abs() > 1e-6)
    for start_ns, end_ns in fills.select("start_ns", "end_ns").iter_rows():
        motion = motion.filter(~pl.col("time_ns").is_between(start_ns, end_ns))
    assert set(np.round(motion["heading_rad"].abs().to_numpy(), 6)) == {0.0, 3.141593}
    speed = motion["speed_x_m_s"].to_numpy()
    left = (
        motion["force_x_N"].to_numpy()
        - motion["mass_kg"].to_numpy() * motion["specific_force_x_m_s2"].to_numpy()
        - FRICTION_N_S_M * speed
        - COULOMB_N * np.sign(speed)
    )
    # straight lines between steps of a millisecond, where the valves open
    assert np.abs(left).max() < 0.3


def test_a_machine_that_turns_on_a_slope_is_held_and_feels_gravity_from_every_side() -> None:
    log, _ = plain()
    turning = log.noise_free_motion.filter(phase="spinning")
    assert turning.height > 1000
    np.testing.assert_allclose(
        turning["force_x_N"],
        turning["mass_kg"] * turning["specific_force_x_m_s2"],
        atol=0.05,
    )
    uphill = 9.80665 * turning["slope_rad"].sin()
    felt = turning["specific_force_x_m_s2"] ** 2 + turning["specific_force_y_m_s2"] ** 2
    np.testing.assert_allclose(felt, uphill**2, atol=1e-9)
    torque = 4000.0 * turning["yaw_acc_rad_s2"] + 5000.0 * turning["yaw_rate_rad_s"]
    empty = turning["mass_kg"] < MASS_KG + 100
    np.testing.assert_allclose(
        turning.filter(empty)["torque_z_N_m"], torque.filter(empty), atol=250.0
    )


def test_the_mass_at_any_time_is_that_of_the_cycles() -> None:
    log, truth = plain()
    for cycle in truth.cycles.iter_rows(named=True):
        hauled = during(log, cycle["haul_ns"], cycle["dump_ns"] - 1)["mass_kg"]
        np.testing.assert_allclose(hauled, cycle["machine_kg"] + cycle["load_kg"], atol=1e-6)
        empty = during(log, cycle["dump_ns"] + 1_000_000, cycle["end_ns"])["mass_kg"]
        np.testing.assert_allclose(empty, cycle["machine_kg"] + cycle["carry_back_kg"], atol=1e-6)
        assert cycle["payload_kg"] == cycle["load_kg"] - cycle["carry_back_kg"]
    carried = truth.cycles["carry_back_kg"].to_list()
    assert truth.cycles["carry_back_before_kg"].to_list() == [0.0, *carried[:-1]]


def test_the_machine_digs_at_the_pile_and_dumps_at_the_dump() -> None:
    log, truth = plain()
    assert truth.cycles["reverse"].n_unique() == 2
    for cycle in truth.cycles.iter_rows(named=True):
        assert log.timeline.sample_position_boom_and_bucket is not None
        times = np.array([cycle[name] for name in ("dig_ns", "haul_ns", "dump_ns")])
        place, boom, bucket = log.timeline.sample_position_boom_and_bucket(times)
        # hills change the speed at which the operator cruises
        assert place[0] == pytest.approx(39.0, abs=5.0)
        assert place[1] > place[0] + 1.0
        assert place[2] == pytest.approx(1.0, abs=5.0)
        assert boom[0] == pytest.approx(0.0, abs=1e-9)
        assert boom[2] > boom[1] > 0.01
        # it drops the load when the bucket is tipped
        assert bucket[2] == pytest.approx(0.8)
        spins = log.manoeuvres.filter(run=cycle["cycle"], kind="spin").height
        assert spins == (0 if cycle["reverse"] else 2)
        heading = during(log, cycle["dig_ns"], cycle["haul_ns"])["heading_rad"]
        assert heading.abs().max() == pytest.approx(0.0, abs=1e-6)


def test_starts_and_stops_are_those_of_the_scenario() -> None:
    log, truth = plain()
    starts = log.manoeuvres.filter(kind="start").group_by("run").len().sort("run")
    assert starts["len"].to_list() == truth.cycles["starts"].to_list()
    assert log.manoeuvres.select("run", "manoeuvre").is_unique().all()
    between_ns = log.manoeuvres["start_ns"][1:] - log.manoeuvres["end_ns"][:-1]
    assert between_ns.is_between(-1, 1).all()
    spread = shift_of(shift={"duration_h": 0.05}, starts={"throttle_least": 0.6})
    drawn = simulated(spread)[0][0].manoeuvres["throttle"].drop_nulls()
    assert drawn.min() < 0.9  # pyright: ignore
    assert drawn.is_between(0.6, 1.0).all()


@pytest.mark.heavy
def test_loads_are_as_the_distribution_has_them() -> None:
    quick = {"duration_h": 0.6, "haul_m": 12.0, "reverse_share": 1.0, "pause_s": 0.2, "topics": []}
    keys = {"load_kg": 500.0, "load_std_kg": 200.0, "load_least_kg": 300.0, "load_most_kg": 800.0}
    scenario = shift_of(shift={**quick, **keys, "idle_share": 0.0}, sensors={"rate_hz": 5.0})
    _, truth = simulated(scenario)
    loads, left = truth.cycles["load_kg"], truth.cycles["carry_back_kg"]
    assert loads.len() > 40
    assert loads.is_between(300.0 - 1e-6, 800.0 + 1e-6).all()
    assert (loads == 300.0).sum() + (loads == 800.0).sum() < 0.5 * loads.len()
    assert loads.mean() == pytest.approx(520.0, abs=80.0)
    assert 4.0 < float(left.mean()) < 20.0  # pyright: ignore
    assert left.max() <= 60.0  # pyright: ignore


def test_the_same_seed_gives_the_same_shift_and_another_gives_another() -> None:
    scenario = shift_of(shift={"duration_h": 0.03})
    (first,), truth = simulated(scenario)
    (again,), same = simulated(scenario)
    assert truth.cycles.equals(same.cycles)
    assert all(frame.equals(again.topics[name]) for name, frame in first.topics.items())
    _, other = simulated(scenario.copy_with_seed(2))
    assert other.cycles["load_kg"].to_list() != truth.cycles["load_kg"].to_list()


def test_idling_does_not_change_what_is_loaded() -> None:
    busy, lazy = (
        simulated(shift_of(shift={"idle_share": share, "idle_s": 20.0}))[1] for share in (0.0, 1.0)
    )
    assert busy.stands.height == 0
    assert lazy.stands.height == lazy.cycles.height
    together = min(busy.cycles.height, lazy.cycles.height)
    np.testing.assert_array_equal(
        busy.cycles["load_kg"][:together], lazy.cycles["load_kg"][:together]
    )


def test_cut_into_logs_the_machine_moves_as_in_one() -> None:
    log, truth = plain()
    logs, cut = simulated(shift_of(shift={"reverse_share": 0.4, "idle_share": 0.3, "logs": 3}))
    assert cut.cycles.drop("first_log", "last_log").equals(
        truth.cycles.drop("first_log", "last_log")
    )
    begins, ends = cut.logs["start_ns"].to_list(), cut.logs["end_ns"].to_list()
    for number, part in enumerate(logs):
        times = part.noise_free_motion["time_ns"].to_numpy()
        assert (times[0], part.timeline.end_ns) == (begins[number], ends[number])
        whole, here = log.timeline.sample(times), part.timeline.sample(times)
        for name in ("speed_x_m_s", "force_x_N", "mass_kg", "heading_rad"):
            np.testing.assert_allclose(getattr(here, name), getattr(whole, name), atol=1e-9)
    gaps_s = (np.array(begins[1:]) - np.array(ends[:-1])) / 1e9
    assert ((gaps_s >= 0.0) & (gaps_s <= 1.0)).all()
    assert cut.cycles["first_log"].drop_nulls().is_sorted()


def test_fuel_is_burnt_and_filled_up_and_nobody_drives_in_a_break() -> None:
    keys = {"fuel_tank_kg": 1.0, "fuel_kg_h": 10.0, "refuel_s": 60.0}
    pause = {"break_after_h": 0.05, "break_s": 50.0, "duration_h": 0.2}
    (log,), truth = simulated(shift_of(shift={**keys, **pause}))
    machine = truth.cycles["machine_kg"]
    assert machine.max() == MASS_KG
    assert MASS_KG - 1.0 < float(machine.min()) < MASS_KG - 0.3  # pyright: ignore
    stands = {kind: truth.stands.filter(kind=kind) for kind in ("break", "refuelling")}
    assert stands["break"].height == 1
    assert stands["refuelling"].height >= 1
    filled = stands["refuelling"]["end_ns"][0]
    after = truth.cycles.filter(pl.col("start_ns") >= filled)["machine_kg"][0]
    assert after == MASS_KG
    for each in stands.values():
        start_ns, end_ns = each.select("start_ns", "end_ns").row(0)
        assert during(log, start_ns, end_ns)["speed_x_m_s"].abs().max() == 0.0
    seconds = (stands["break"]["end_ns"] - stands["break"]["start_ns"])[0] / 1e9
    assert seconds == pytest.approx(50.0)


def test_what_is_recorded_besides_says_where_the_machine_and_its_boom_are() -> None:
    scenario = shift_of(
        shift={
            "duration_h": 0.03,
            "topics": ["boom", "odometry", "gnss"],
            "gnss_noise_m": 0.0,
            "boom_noise_rad": 0.0,
            "bearing_deg": 0.0,
        }
    )
    (log,), _ = simulated(scenario)
    assert log.timeline.sample_position_boom_and_bucket is not None
    boom, odometry, gnss = (log.topics[name] for name in ("boom", "odometry", "gnss"))
    assert gnss.height * 10 == pytest.approx(odometry.height, abs=10)
    true = log.timeline.sample_position_boom_and_bucket(boom["header_stamp_ns"].to_numpy())
    np.testing.assert_array_equal(boom["boom_rad"], true.boom_rad)
    along = log.timeline.sample_position_boom_and_bucket(
        gnss["header_stamp_ns"].to_numpy()
    ).position_m
    north_m = np.radians(gnss["latitude_deg"] - 49.0) * 6_371_008.8
    np.testing.assert_allclose(north_m, along, atol=1e-6)
    assert gnss["longitude_deg"].n_unique() == 1
    place = log.timeline.sample_position_boom_and_bucket(
        odometry["header_stamp_ns"].to_numpy()
    ).position_m
    np.testing.assert_array_equal(odometry["position_x_m"], place)


@pytest.mark.parametrize(
    ("sections", "says"),
    [
        ({"shift": {"turn_rad_s": 2.0}}, "shift.turn_rad_s: takes up to"),
        ({"loading": {"fill_kg_s": 5.0}}, "loading.fill_kg_s: applies to campaigns only"),
        ({"starts": {"turn_rad_s": 0.1}}, "starts.turn_rad_s: applies to campaigns only"),
        (
            {"campaign": {"manoeuvres": [{"kind": "rest"}]}},
            "campaign.manoeuvres: applies to campaigns only",
        ),
        (
            {"terrain": {"slope_deg": 9.0}},
            "starts.throttle_least: the driving force reaches 6000 N",
        ),
        ({"machine": {"mass_kg": 50.0}}, "shift.fuel_tank_kg: is part of machine.mass_kg"),
    ],
)
def test_a_shift_that_cannot_be_driven_is_refused(
    sections: dict[str, dict[str, Any]], says: str
) -> None:
    scenario = shift_of(**sections)
    assert scenario.shift is not None
    with pytest.raises(ScenarioError, match=says):
        ShiftSimulation(scenario, scenario.shift)


@pytest.mark.parametrize(
    ("keys", "says"),
    [
        ({"load_kg": 5000.0}, "'load_kg' is not between"),
        ({"carry_back_most_kg": 300.0}, "'carry_back_most_kg' is not less than"),
        ({"damaged_logs": 2}, "'damaged_logs' is larger than 'logs'"),
        ({"topics": ["boom", "boom"]}, "appears twice"),
        ({"logs": 50, "restart_s": 60.0}, "'restart_s' is nearly as long as a log"),
        ({"duration_h": 12.0, "refuel_share": 0.0}, "'fuel_tank_kg' runs empty"),
    ],
)
def test_values_that_contradict_each_other_are_refused(keys: dict[str, Any], says: str) -> None:
    with pytest.raises(ValueError, match=says):
        shift_of(shift=keys)


def test_a_shift_is_no_campaign() -> None:
    with pytest.raises(ScenarioError, match="shift: this scenario is a shift"):
        simulate_campaign(shift_of())

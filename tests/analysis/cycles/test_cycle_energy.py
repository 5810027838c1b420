"""The energy of cycles whose forces are written down: what goes in, and where it goes."""

from typing import Any

import numpy as np
import polars as pl
import pytest

from analysis.cycles.cycle_energy import J_PER_KWH, NO_ENERGY, EnergyRow, compute_shift_energy
from analysis.model.machine import Machine
from analysis.model.schema import PHASE

RATE_HZ = 100.0
EMPTY_KG, LOADED_KG = 3000.0, 4000.0
FRICTION_N_S_M = 400.0
NS = 10**9


def machine(**body: Any) -> Machine:
    """A machine whose force and speed are channels, which are what they are."""
    channels = {
        name: {"topic": "/t", "field": name}
        for name in ("force_x_N", "speed_x_m_s", "specific_force_x_m_s2")
    }
    settings = {"forces": {"acceleration": "specific_force"}, "smooth": {"samples": 1}}
    told = {"name": "A", "force_gain_u": 0.01} | body
    return Machine.model_validate({"machine": told, "channels": channels, "settings": settings})


def driven(
    *, slope_m_s2: float = 0.0, offset_N: float = 0.0, digs_N: float = 0.0, slip_1_N: float = 0.0
) -> dict[str, pl.DataFrame]:
    """One cycle: a start empty, one that digs, one with the load; then what the fit says of it.

    Each start accelerates for 4 s with 0.5 m/s², cruises for 2 s, and is braked for 2 s without a
    force; between them the machine stands for 2 s.
    """
    parts = [(0.5, 4.0), (0.0, 2.0), (-1.0, 2.0), (None, 2.0)] * 3
    steps = [round(length * RATE_HZ) for _, length in parts]
    rate = np.concatenate([np.full(n, a or 0.0) for (a, _), n in zip(parts, steps, strict=True)])
    stands = np.concatenate([np.full(n, a is None) for (a, _), n in zip(parts, steps, strict=True)])
    brakes = rate < 0.0
    speed = np.maximum(np.cumsum(rate) / RATE_HZ, 0.0)
    speed[stands] = 0.0
    t_ns = np.arange(rate.size) * round(NS / RATE_HZ)
    third = rate.size // 3
    digs = (np.arange(rate.size) // third == 1) & ~stands
    # the bucket fills while it is pushed into the pile
    filled = np.cumsum(digs & ~brakes) / np.sum(digs & ~brakes)
    mass = EMPTY_KG + (LOADED_KG - EMPTY_KG) * filled
    acceleration = rate + slope_m_s2
    ground = mass * acceleration + FRICTION_N_S_M * speed + np.where(digs, digs_N, 0.0)
    force = np.where(brakes | stands, 0.0, ground) + offset_N
    # wheels turn faster than the ground by what the drive takes, slower by what brakes take
    speed = speed * (1.0 + slip_1_N * ground)
    phase = np.where(stands, "standstill", np.where(brakes, "braking", "accelerating"))
    channels = {
        "t_ns": t_ns,
        "speed_x_m_s": speed,
        "force_x_N": force,
        "specific_force_x_m_s2": acceleration,
    }
    aligned = pl.DataFrame({**channels, "gap": np.zeros(rate.size, np.bool_)})
    excitation = pl.DataFrame({**channels, "regressor_acc_x_m_s2": acceleration}).with_columns(
        pl.Series("phase", phase).cast(PHASE)
    )
    edges = [int(t_ns[k]) for k in (0, third, 2 * third, 3 * third - 1)]
    starts = pl.DataFrame(
        {
            "load_id": [0, 1],
            "start_t_ns": [edges[0], edges[2]],
            "end_t_ns": [edges[1], edges[3]],
            "mass_kg": [EMPTY_KG, LOADED_KG],
            "mass_std_kg": [10.0, 10.0],
        }
    )
    term = {"term": ["const", "offset", "wheel_slip"], "posterior": [offset_N, offset_N, slip_1_N]}
    return {
        "aligned": aligned,
        "excitation": excitation,
        "digging": pl.DataFrame(
            {"start_t_ns": [edges[1]], "end_t_ns": [edges[1] + 6 * NS]}
            if digs_N
            else {"start_t_ns": [], "end_t_ns": []},
            schema={"start_t_ns": pl.Int64, "end_t_ns": pl.Int64},
        ),
        "cycles": pl.DataFrame(
            {
                "cycle": [1],
                "start_t_ns": [edges[0]],
                "end_t_ns": [edges[3]],
                "dig_t_ns": [edges[1]],
                "load_s": [(edges[2] - edges[1]) / NS],
                "haul_s": [(edges[3] - edges[2]) / NS],
                "empty_before_kg": [EMPTY_KG],
                "empty_after_kg": [None],
                "loaded_kg": [LOADED_KG],
            }
        ),
        "manoeuvres": starts,
        "loads": pl.DataFrame(
            {
                "load_id": [0, 1],
                "mass_kg": [EMPTY_KG, LOADED_KG],
                "u_random_kg": [3.0, 4.0],
                "friction_x_N_s_m": [FRICTION_N_S_M] * 2,
                "friction_x_std_N_s_m": [4.0] * 2,
            }
        ),
        "nuisances": pl.DataFrame(
            {**term, "posterior_std": [1.0, 1.0, 0.0], "prior_std": [1e6, 1.0, 1.0]}
        ),
        "budget": pl.DataFrame({"load_id": [0], "kind": ["common"], "u_kg": [6.0]}),
    }


def row(frames: dict[str, pl.DataFrame], phase: str = "whole", **body: Any) -> EnergyRow:
    """A row of the cycle."""
    found = compute_shift_energy(frames, machine(**body), ())
    return next(each for each in found.rows if each.cycle == 1 and each.phase == phase)


def test_a_start_on_level_ground_is_half_m_v_squared_and_friction() -> None:
    found = row(driven(), "return")
    friction_J = FRICTION_N_S_M * (0.5**2 * 4.0**3 / 3.0 + 2.0**2 * 2.0)
    assert found.kinetic.kWh * J_PER_KWH == pytest.approx(EMPTY_KG * 2.0**2 / 2.0, rel=0.01)
    assert found.friction.kWh * J_PER_KWH == pytest.approx(friction_J, rel=0.01)
    assert found.slope.kWh * J_PER_KWH == pytest.approx(0.0, abs=60.0)
    assert found.digging.kWh == 0.0


def test_brakes_take_the_kinetic_energy_that_friction_leaves() -> None:
    found = row(driven(), "return")
    friction_J = FRICTION_N_S_M * 2.0**3 / 3.0
    assert found.braking.kWh * J_PER_KWH == pytest.approx(
        EMPTY_KG * 2.0**2 / 2.0 - friction_J, rel=0.03
    )


def test_a_slope_is_weight_times_height() -> None:
    found = row(driven(slope_m_s2=0.3), "return")
    way_m = 0.5 * 4.0**2 / 2.0 + 2.0 * 2.0
    assert found.slope.kWh * J_PER_KWH == pytest.approx(EMPTY_KG * 0.3 * way_m, rel=0.02)
    assert found.kinetic.kWh * J_PER_KWH == pytest.approx(EMPTY_KG * 2.0**2 / 2.0, rel=0.02)


def test_what_a_pile_takes_is_its_force_times_the_way() -> None:
    found = row(driven(digs_N=1500.0), "load")
    way_m = 0.5 * 4.0**2 / 2.0 + 2.0 * 2.0
    assert found.digging.kWh * J_PER_KWH == pytest.approx(1500.0 * way_m, rel=0.02)


def test_work_is_the_sum_of_its_parts_and_the_phases_are_the_whole() -> None:
    frames = driven(slope_m_s2=0.2, digs_N=1000.0)
    whole = row(frames)
    parts = (whole.kinetic, whole.slope, whole.friction, whole.digging)
    assert sum(part.kWh for part in parts) == pytest.approx(whole.work.kWh, rel=1e-4)
    phases = [row(frames, name).work.kWh for name in ("return", "load", "haul", "dump")]
    assert sum(phases) == pytest.approx(whole.work.kWh, rel=1e-4)


def test_an_offset_of_the_force_is_no_work() -> None:
    without, biased = (row(driven(offset_N=offset_N)).work for offset_N in (0.0, 200.0))
    assert biased.kWh == pytest.approx(without.kWh, rel=0.01)


def test_the_gain_of_the_force_is_in_every_interval_and_said_where_it_is_not_known() -> None:
    known, twice = (row(driven(), force_gain_u=u).work for u in (0.01, 0.02))
    assert known.u_kWh == pytest.approx(0.01 * known.kWh, rel=0.3)
    assert twice.u_kWh == pytest.approx(2.0 * known.u_kWh, rel=0.1)
    lacking = compute_shift_energy(driven(), machine(force_gain_u=None), ())
    assert lacking.scale_unknown == "machine.force_gain_u"


def test_a_cycle_with_a_hole_has_no_energy() -> None:
    for hole_s in (1, 7):
        hole = (2 * NS, (2 + hole_s) * NS)
        assert compute_shift_energy(driven(), machine(), [hole]) == NO_ENERGY


def test_a_cycle_without_a_mass_has_those_of_its_starts_on_either_side_of_the_pile() -> None:
    weighed, not_weighed = driven(), driven()
    nothing = pl.lit(None, pl.Float64)
    not_weighed["cycles"] = weighed["cycles"].with_columns(
        empty_before_kg=nothing, loaded_kg=nothing
    )
    # the next start is nearer to the end of the return than the last one
    not_weighed["manoeuvres"] = not_weighed["manoeuvres"].with_columns(
        end_t_ns=pl.col("start_t_ns") + 10**9
    )
    for phase in ("return", "haul"):
        assert row(not_weighed, phase).braking == row(weighed, phase).braking


def test_wheels_that_slip_as_the_machine_brakes_hide_none_of_its_speed() -> None:
    rolls, slips = row(driven(), "return"), row(driven(slip_1_N=3e-5), "return")
    assert slips.kinetic.kWh == pytest.approx(rolls.kinetic.kWh, rel=0.02)
    assert slips.braking.kWh == pytest.approx(rolls.braking.kWh, rel=0.02)
    assert slips.work.kWh > 1.02 * rolls.work.kWh


def test_vibration_of_the_accelerometer_is_no_slope_where_wheels_slip() -> None:
    """1 m/s² of it, which the moving mean of the excitation leaves out."""
    still = driven(slip_1_N=1e-5)
    at_rest = row(still, "haul")
    slopes_kWh = []
    for seed in range(8):
        shaken = np.random.default_rng(seed).normal(0.0, 1.0, still["aligned"].height)
        aligned = still["aligned"].with_columns(pl.col("specific_force_x_m_s2") + shaken)
        slopes_kWh.append(row({**still, "aligned": aligned}, "haul").slope.kWh)
    # a slip by the shaken force itself took 14 % of the work
    apart_kWh = abs(np.mean(slopes_kWh) - at_rest.slope.kWh)
    assert apart_kWh < 0.07 * at_rest.work.kWh


def test_a_first_cycle_that_starts_at_the_pile_is_empty_until_it_digs() -> None:
    frames = driven()
    frames["cycles"] = frames["cycles"].with_columns(
        empty_before_kg=pl.lit(None, pl.Float64), empty_after_kg=pl.lit(EMPTY_KG)
    )
    frames["manoeuvres"] = frames["manoeuvres"].tail(1).with_columns(load_id=pl.lit(0, pl.Int64))
    assert row(frames, "return").kinetic == row(driven(), "return").kinetic


def test_a_load_that_is_lost_on_the_way_was_hauled_until_then() -> None:
    frames = driven()
    # what was left in the bucket at the end of the haul
    frames["cycles"] = frames["cycles"].with_columns(loaded_kg=pl.lit(EMPTY_KG))
    assert row(frames, "haul").kinetic == row(driven(), "haul").kinetic


def test_a_late_force_drives_when_it_acted_not_when_it_was_measured() -> None:
    late = driven()
    rows = 8
    for name in ("aligned", "excitation"):
        late[name] = late[name].with_columns(pl.col("force_x_N").shift(rows, fill_value=0.0))
    late["nuisances"] = pl.DataFrame(
        {
            "term": ["const", "offset", "lag"],
            "posterior": [0.0, 0.0, rows / RATE_HZ],
            "posterior_std": [1.0, 1.0, 1e-4],
            "prior_std": [1e6, 1.0, 0.02],
        }
    )
    assert row(late, "return").kinetic.kWh == pytest.approx(row(driven(), "return").kinetic.kWh)


def test_an_offset_of_the_force_pushes_nothing() -> None:
    without, biased = (row(driven(offset_N=offset_N)).kinetic for offset_N in (0.0, 400.0))
    assert biased.kWh == pytest.approx(without.kWh, rel=0.01)


def test_coulomb_friction_that_the_fit_cannot_tell_is_in_the_interval_of_braking() -> None:
    told = driven()
    direction = {"term": ["direction"], "posterior": [0.0], "posterior_std": [0.0]}
    told["nuisances"] = pl.concat(
        [told["nuisances"], pl.DataFrame({**direction, "prior_std": [1e3]})]
    )
    assert row(driven()).braking.u_kWh > 1.5 * row(told).braking.u_kWh
    assert row(driven()).work == row(told).work


def test_a_radius_moves_energy_between_kinetic_and_slope_and_changes_no_work() -> None:
    radius = {"wheel_radius_m": 0.4, "wheel_radius_u_m": 0.04}
    stated, plain = row(driven(), **radius), row(driven())
    assert stated.kinetic.u_kWh > 0.09 * stated.kinetic.kWh > plain.kinetic.u_kWh
    assert stated.slope.u_kWh > 0.09 * stated.kinetic.kWh
    assert (stated.work, stated.digging) == (plain.work, plain.digging)


def test_masses_that_are_withheld_split_nothing() -> None:
    frames = driven()
    frames["loads"] = frames["loads"].with_columns(mass_kg=pl.lit(None, pl.Float64))
    assert compute_shift_energy(frames, machine(), ()) == NO_ENERGY


def test_fuel_is_counted_while_standing_too() -> None:
    frames = driven()
    frames["aligned"] = frames["aligned"].with_columns(fuel_rate_L_h=pl.lit(12.0))
    assert row(frames).fuel_L == pytest.approx(12.0 * 30.0 / 3600.0, rel=0.01)
    assert row(driven()).fuel_L is None
    assert compute_shift_energy(frames, machine(fuel_gain_u=0.03), ()).fuel_u_1 == 0.03
    assert compute_shift_energy(frames, machine(), ()).fuel_u_1 is None

"""What turns in low gears is no load; a measured gear ratio says how much it is."""

from pathlib import Path

import numpy as np
import polars as pl
import pytest

from analysis.model.machine import Machine
from analysis.weighing.fitted_stretches import mark_gear_changes, read_gear_ratio
from analysis.weighing.low_gears import LOW_GEARS
from estimators.arrays import Floats
from replay import open_log
from replay import run as replay
from tests.analysis.other_machine_logs import replayed
from tests.trials.other_machines import car, cart
from tests.twins import mark_heavy_after, mark_slow_after


#: Without the terms of gears the mass is 5 u off, or none.
@pytest.mark.heavy
@pytest.mark.parametrize("seed", mark_heavy_after(1, [405, 406]))
def test_a_car_with_gears_has_one_load_and_the_mass_that_its_top_gear_moves(
    seed: int, tmp_path: Path
) -> None:
    scenario = car(seed)
    (load,) = replayed(scenario, tmp_path).frames["loads"].to_dicts()
    moves_kg = scenario.machine.mass_kg + scenario.drivetrain.gear_rotating_kg[-1]
    assert abs(load["mass_kg"] - moves_kg) < 2.0 * load["u_kg"]


@pytest.mark.heavy
def test_a_cart_has_no_gears(tmp_path: Path) -> None:
    terms = set(replayed(cart(0), tmp_path).frames["nuisances"]["term"])
    assert not terms & {term.name for term in LOW_GEARS}


@pytest.mark.parametrize("ratio_speeds_m_s", [(6.0, 11.0, 17.0, 24.0), (4.8, 8.8, 13.6, 19.2)])
def test_the_terms_follow_what_gears_have_beyond_the_top_one(
    ratio_speeds_m_s: tuple[float, ...],
) -> None:
    speed = np.linspace(0.5, 30.0, 300)
    beyond = np.array([0.22, 0.09, 0.03, 0.01, 0.0])[np.digitize(speed, ratio_speeds_m_s)]
    columns = np.column_stack([(1.0 + (speed / half) ** 2) ** -2 for half in (4.0, 10.0)])
    missed = beyond - columns @ np.linalg.lstsq(columns, beyond, rcond=None)[0]
    assert np.sqrt(np.mean(missed**2)) < 0.03


RATIOS = np.array([42.0, 28.0, 18.0, 12.0])
UP_M_S = np.array([2.0, 3.2, 5.0])
RADIUS_M, ENGINE_KG_M2 = 0.5, 2.5
EMPTY_KG, PAYLOAD_KG = 16_000.0, 6_000.0
STARTS = 15


def lorry_log(seed: int, path: Path, rows_per_ratio: int = 1) -> Path:
    """Five starts empty, five loaded, five empty; the force is the engine's torque at the wheels.

    Resistance is 1.2 % of the weight and 5 N·s²/m². A change of gear takes half a second. The ratio
    is in every row, or in one of so many.
    """
    draw, step_s = np.random.default_rng(seed), 0.004
    rows: list[tuple[float, float, float]] = []
    for start in range(STARTS):
        mass_kg = EMPTY_KG + PAYLOAD_KG * (5 <= start < 10)
        v, gear, torque, changes_until = 0.0, 0, 0.0, 0.0
        asked, drives_s = draw.uniform(500.0, 1200.0), draw.uniform(8.0, 16.0)
        for at_s in np.arange(-2.0, drives_s + 12.0, step_s):
            brakes = at_s > drives_s
            if not brakes and gear < UP_M_S.size and v > UP_M_S[gear]:
                gear, changes_until = gear + 1, at_s + 0.5
            gear = int(np.searchsorted(UP_M_S, v)) if brakes else gear
            drives = 0.0 < at_s < drives_s and at_s > changes_until
            torque += (asked * drives - torque) * step_s / 0.25
            drive = RATIOS[gear] / RADIUS_M
            resists = 0.012 * 9.81 * mass_kg + 5.0 * v**2 + 1.2 * mass_kg * brakes
            moved_kg = mass_kg + ENGINE_KG_M2 * drive**2
            v = max(v + (torque * drive - resists) / moved_kg * step_s, 0.0)
            rows.append((v, torque * drive, RATIOS[gear]))
    speed, force, ratio = np.array(rows)[::10].T
    pl.DataFrame(
        {
            "t": 0.04 * np.arange(speed.size),
            "speed": speed + draw.normal(0.0, 0.01, speed.size),
            "force": force + draw.normal(0.0, 100.0, speed.size),
            "torque": (force + draw.normal(0.0, 100.0, speed.size)) * RADIUS_M / ratio,
            "ratio": np.where(np.arange(ratio.size) % rows_per_ratio, np.nan, ratio),
        },
        nan_to_null=True,
    ).write_csv(path)
    return path


def lorry(*, with_ratio: bool) -> Machine:
    channels = {
        "force_x_N": {"field": "force"},
        "speed_x_m_s": {"field": "speed"},
        "acc_x_m_s2": {"derive": "d/dt speed_x_m_s"},
    }
    if with_ratio:
        channels["gear_ratio_1"] = {"field": "ratio"}
    return Machine.model_validate(
        {
            "machine": {"name": "lorry", "digs": False},
            "log": {"time": "t"},
            "channels": channels,
            "settings": {"forces": {"acceleration": "kinematic"}},
        }
    )


@pytest.mark.heavy
@pytest.mark.parametrize("seed", mark_slow_after(1, [1, 2]))
def test_with_its_gear_ratio_a_lorry_weighs_as_much_in_every_gear(
    seed: int, tmp_path: Path
) -> None:
    log = lorry_log(seed, tmp_path / "log.csv")
    loads = {
        with_ratio: replay(open_log(log), lorry(with_ratio=with_ratio)).frames["loads"].to_dicts()
        for with_ratio in (False, True)
    }
    assert len(loads[True]) == 3
    for load, true_kg in zip(loads[True], (EMPTY_KG, EMPTY_KG + PAYLOAD_KG, EMPTY_KG), strict=True):
        assert abs(load["mass_kg"] - true_kg) < 2.0 * load["u_kg"] < 0.05 * true_kg
    usual_u_kg = [load["u_kg"] or np.inf for load in loads[False]]
    assert min(usual_u_kg) > 2.5 * max(load["u_kg"] for load in loads[True])


@pytest.mark.heavy
def test_a_ratio_read_five_times_a_second_leaves_the_grid_at_the_rate_of_the_torque(
    tmp_path: Path,
) -> None:
    log = lorry_log(1, tmp_path / "lorry.csv", rows_per_ratio=5)
    machine = lorry(with_ratio=True)
    sources = {
        "engine_torque_N_m": {"field": "torque"},
        "force_x_N": {"derive": "engine_torque_N_m * gear_ratio_1 / wheel_radius_m"},
    }
    machine = Machine.model_validate(
        machine.model_dump(exclude_unset=True)
        | {"machine": {"name": "lorry", "digs": False, "wheel_radius_m": RADIUS_M}}
        | {"channels": machine.model_dump(exclude_unset=True)["channels"] | sources}
    )
    frames = replay(open_log(log), machine).frames
    assert np.median(np.diff(frames["aligned"]["t_ns"])) == 40_000_000
    loads = frames["loads"].to_dicts()
    assert len(loads) == 3
    for load, true_kg in zip(loads, (EMPTY_KG, EMPTY_KG + PAYLOAD_KG, EMPTY_KG), strict=True):
        assert abs(load["mass_kg"] - true_kg) < 2.0 * load["u_kg"] < 0.1 * true_kg


def test_a_ratio_of_neutral_is_that_of_the_gear_before() -> None:
    aligned = pl.DataFrame({"gear_ratio_1": [np.nan, -40.0, 0.0, np.nan, 20.0, 20.0]})
    ratio = read_gear_ratio(aligned)
    assert ratio is not None
    assert ratio.tolist() == [40.0, 40.0, 40.0, 40.0, 20.0, 20.0]
    assert read_gear_ratio(aligned.clear()) is None
    assert read_gear_ratio(pl.DataFrame({"t_ns": [1]})) is None


def test_a_gear_changes_in_a_step_and_a_continuous_one_never_does() -> None:
    def changes(ratios: Floats) -> list[int]:
        aligned = pl.DataFrame({"gear_ratio_1": ratios}, nan_to_null=True)
        return np.flatnonzero(mark_gear_changes(aligned, read_gear_ratio(aligned), 10.0)).tolist()

    assert changes(np.repeat([40.0, 25.0], 20)) == [20]
    assert changes(np.geomspace(40.0, 25.0, 40)) == []
    # read once a second, it may have changed at any time between two readings
    assert changes(np.array([40.0, np.nan, np.nan, 40.0, np.nan, np.nan, 25.0])) == [4, 5, 6]
    assert not mark_gear_changes(pl.DataFrame({"t_ns": [1, 2]}), None, 10.0).any()

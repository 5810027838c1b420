"""What a motion determines: by itself, together only, or not at all."""

import numpy as np
import polars as pl
import pytest

from analysis import Settings
from analysis.explain.determined_parameters import DeterminedParameters, find_determined_parameters
from analysis.explain.worst_manoeuvres import (
    list_stretches_of_gate_decisions,
    report_worst_manoeuvres,
)
from analysis.model.schema import REASON

SETTINGS = Settings(noise={"force_N": 1.0, "acc_m_s2": 0.01, "speed_m_s": 0.01})
S = 10**9


def of(acceleration: np.ndarray, speed: np.ndarray) -> DeterminedParameters:
    excitation = pl.DataFrame(
        {
            "regressor_acc_x_m_s2": acceleration,
            "speed_x_m_s": speed,
            "direction_x_1": np.sign(speed),
        }
    )
    found = find_determined_parameters(excitation, np.ones(speed.size, bool), None, SETTINGS)
    assert found is not None
    return found


t = np.arange(0.0, 60.0, 0.01)


def test_driving_to_and_fro_determines_everything() -> None:
    found = of(np.cos(t), np.sin(t) + 0.3 * np.sin(3.1 * t))
    assert found.alone == ("mass_kg", "friction_x_N_s_m", "coulomb_x_N", "constant_force_N")
    assert found.combinations == ()
    assert found.lost == ()


def test_driving_one_way_joins_coulomb_friction_and_a_constant_force() -> None:
    found = of(np.cos(t), 1.5 + np.sin(t))
    assert found.alone == ("mass_kg", "friction_x_N_s_m")
    assert found.combinations == ("coulomb_x_N + constant_force_N",)


def test_a_steady_speed_determines_no_mass() -> None:
    rng = np.random.default_rng(1)
    found = of(rng.normal(0.0, 0.001, t.size), np.full(t.size, 2.0))
    assert "mass_kg" in found.lost


def test_an_acceleration_in_proportion_to_the_speed_trades_mass_for_friction() -> None:
    rng = np.random.default_rng(1)
    speed = np.sin(t) + 0.01 * rng.normal(size=t.size)
    found = of(0.5 * speed + 0.05 * np.cos(3.0 * t), speed)
    pairs = {(a, b): correlation for a, b, correlation in found.trade_offs}
    assert pairs[("mass_kg", "friction_x_N_s_m")] < -0.95


def test_without_noise_or_with_few_samples_nothing_is_said() -> None:
    excitation = pl.DataFrame({"regressor_acc_x_m_s2": t, "speed_x_m_s": t})
    rows = np.ones(t.size, bool)
    assert find_determined_parameters(excitation, rows, None, Settings.model_validate({})) is None
    assert find_determined_parameters(excitation, rows & (t < 0.1), None, SETTINGS) is None


def test_the_gate_is_told_in_order_with_the_median_of_what_decided() -> None:
    reasons = ["low_information"] * 20 + ["accepted"] * 30 + ["negative_dependence"] * 10
    gate = pl.DataFrame(
        {
            "t_ns": [i * S // 10 for i in range(60)],
            "mi_x_nat": [0.2] * 20 + [1.5] * 30 + [0.0] * 10,
            "corr_x_1": [0.1] * 50 + [-0.4] * 10,
            "reason_x": pl.Series(reasons, dtype=REASON),
        }
    )
    told = list_stretches_of_gate_decisions(gate, SETTINGS, 0, 6 * S)
    assert [(e.reason, e.value, e.limit) for e in told] == [
        ("low_information", 0.2, "≥ 0.7"),
        ("accepted", 1.5, "≥ 0.7"),
        ("negative_dependence", -0.4, "> 0"),
    ]
    assert (told[1].start_s, told[1].end_s) == (2.0, 4.9)


def test_the_manoeuvre_furthest_from_its_load_stands_out_first() -> None:
    loads = pl.DataFrame({"load_id": [0, 1], "mass_kg": [100.0, 150.0]})
    manoeuvres = pl.DataFrame(
        {
            "load_id": [0, 0, 1],
            "start_t_ns": [0, 10 * S, 20 * S],
            "end_t_ns": [5 * S, 15 * S, 25 * S],
            "mass_kg": [101.0, 110.0, 149.0],
            "mass_std_kg": [1.0, 2.0, 1.0],
        }
    )
    first, *_ = report_worst_manoeuvres({"loads": loads, "manoeuvres": manoeuvres})
    assert (first.start_s, first.deviations) == (10.0, pytest.approx(5.0))


def test_a_rejected_stretch_that_is_nearly_the_whole_log_is_not_told_of_a_part() -> None:
    segments = pl.DataFrame(
        {
            "start_t_ns": [0, 10 * S],
            "end_t_ns": [96 * S, 50 * S],
            "mass_kg": [4899.0, None],
            "mass_std_kg": [1331.0, None],
            "reason": ["low_information", "low_information"],
        }
    )
    excitation = pl.DataFrame({"t_ns": [0, 100 * S]})
    shown = report_worst_manoeuvres({"segments": segments, "excitation": excitation})
    assert [each.end_s for each in shown] == [50.0]

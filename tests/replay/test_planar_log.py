"""A simulated log of all manoeuvres, replayed: the replay sees what the truth says was driven."""

import json
from pathlib import Path

import numpy as np
import polars as pl
import pytest

from analysis.simulation import simulate_campaign
from replay import load_machine, open_log, run
from replay.simulation.scenario_file import load_scenario_file
from replay.simulation.simulate_logs import simulate_scenario_to_logs

PLANAR = Path(__file__).parents[2] / "examples" / "planar.toml"


@pytest.mark.heavy
def test_the_replay_of_all_manoeuvres_finds_their_phases_and_the_forces_that_drove_them(tmp_path):
    scenario = load_scenario_file(PLANAR, ["log.dropout_share=0", "machine.slip_stiffness_N=0"])
    (path,) = simulate_scenario_to_logs(scenario, tmp_path / "planar.mcap")
    with open_log(path) as log:
        found = run(log, load_machine("cat262c.toml")).frames["excitation"]
    truth = next(simulate_campaign(scenario)).noise_free_motion
    # the mean of ten samples and the rate over ten look back
    later = truth.with_columns(t_ns=pl.col("time_ns") - truth["time_ns"][0] + 100_000_000)
    both = found.join(later, on="t_ns", suffix="_true")
    assert both.height > 7000
    moving = both.filter(pl.col("speed_x_m_s").abs() > 0.1)
    for phase, least in (("arc", 0.95), ("turning", 0.8), ("accelerating", 0.8)):
        mine = moving.filter(pl.col("phase_true") == phase)
        assert (mine["phase"] == phase).mean() > least, phase
    spun = both.filter(pl.col("phase_true") == "spinning", pl.col("yaw_rate_rad_s").abs() > 0.1)
    assert (spun["phase"] == "spinning").mean() > 0.9
    steady = both.filter(pl.col("phase_true") == "arc")
    for name, column in (("force_x_N", "measured_force_x_N"), ("torque_z_N_m",) * 2):
        name_true = f"{column}_true" if column == name else column
        error = (steady[name] - steady[name_true]).to_numpy()
        assert np.abs(error.mean()) < 60.0, name


@pytest.mark.heavy
def test_the_truth_beside_the_log_names_each_manoeuvre_and_the_loaded_machine(tmp_path):
    scenario = load_scenario_file(PLANAR)
    (path,) = simulate_scenario_to_logs(scenario, tmp_path / "planar.csv")
    truth = json.loads(path.with_name("planar.csv.truth.json").read_text(encoding="utf-8"))
    kinds = [each["kind"] for each in truth["manoeuvres"]]
    assert kinds == ["rest", "start", "start", "spin", "spin", "arc", "excite"]
    ends = [each["end_ns"] for each in truth["manoeuvres"]]
    starts = [each["start_ns"] for each in truth["manoeuvres"]]
    assert starts[1:] == ends[:-1]
    (only,) = truth["runs"]
    assert only["mass_kg"] == 3864.0
    assert only["inertia_z_kg_m2"] == 4000.0 + 250 * 1.5**2
    assert abs(only["com_x_m"] - (-0.15 * 3614 + 1.5 * 250) / 3864) < 1e-12
    assert only["coulomb_z_N_m"] == 200.0

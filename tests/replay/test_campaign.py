"""The demo's campaign: simulated as real logs, replayed, calibrated (one seed of the benchmark)."""

import json
from collections.abc import Sequence
from pathlib import Path

import polars as pl
import pytest

from analysis.calibration.campaign.method_errors import compute_rms_mass_errors_by_method
from analysis.model.answer import make_answer
from analysis.model.run_record import Run
from analysis.simulation import Scenario
from replay import load_machine
from replay.demo.run_demo import replay_simulated_campaign
from replay.simulation.simulate_logs import simulate_scenario_to_logs
from tests.twins import mark_heavy_after


@pytest.fixture(scope="module")
def logs(tmp_path_factory: pytest.TempPathFactory) -> list[Path]:
    return simulate_scenario_to_logs(
        Scenario(), tmp_path_factory.mktemp("campaign") / "campaign.bag"
    )


@pytest.fixture(scope="module")
def campaign(logs: list[Path]) -> Run:
    return replay_simulated_campaign(logs, load_machine("cat262c.toml"))


def test_the_simulated_loader_can_weigh(campaign: Run) -> None:
    checks = make_answer(campaign).verdict.to_dict()
    assert checks["can_weigh"], checks


def test_every_run_is_a_manoeuvre_with_a_mass(campaign: Run) -> None:
    used = campaign.frames["segments"].filter(pl.col("reason") == "accepted")
    assert used.height == 54
    assert used["phase"].unique().to_list() == ["accelerating"]


def test_no_accepted_window_contains_braking(campaign: Run, logs: list[Path]) -> None:
    window_ns = 3_200_000_000
    t0 = campaign.provenance.t0_unix_ns
    ends = campaign.frames["gate"].filter("accepted_x")["t_ns"] + t0
    detection_ns = 200_000_000  # a trailing mean and rate see braking a little late
    for log in logs:
        for truth in json.loads(log.with_name(f"{log.name}.truth.json").read_text())["runs"]:
            begins, stops = truth["braking_ns"] + detection_ns, truth["end_ns"]
            inside = ends.filter((ends >= begins) & (ends - window_ns < stops - 1_500_000_000))
            assert inside.len() == 0


def test_load_means_after_calibration_are_within_8_kg_with_each_load_left_out(
    campaign: Run,
) -> None:
    errors = compute_rms_mass_errors_by_method(campaign.frames["calibration"])
    by_method = {row["method"]: row for row in errors.to_dicts()}
    assert by_method["pooled"]["rmse_left_out_kg"] <= 8.0
    assert by_method["pooled"]["rmse_kg"] < by_method["pooled"]["rmse_left_out_kg"]
    assert by_method["pooled"]["rmse_constant_kg"] == pytest.approx(85.39, abs=0.01)
    assert set(by_method) == {"ls", "rls", "fgls", "tls", "pooled"}


def test_the_reported_deviation_of_a_run_is_that_of_the_runs(campaign: Run) -> None:
    used = campaign.frames["segments"].filter(pl.col("reason") == "accepted")
    per_load = used.with_columns(load=pl.int_range(pl.len()) // 9)
    spread = per_load.group_by("load").agg(pl.col("mass_kg").std())["mass_kg"].mean()
    assert used["mass_std_kg"].mean() == pytest.approx(spread, rel=0.35)


@pytest.fixture(scope="module")
def masses_of_bag(tmp_path_factory: pytest.TempPathFactory) -> pl.Series:
    return masses_of_one_load(tmp_path_factory.mktemp("bag") / "one.bag")


@pytest.mark.heavy
@pytest.mark.parametrize("suffix", mark_heavy_after(1, [".mcap", ".csv", ""]))
def test_every_format_gives_the_same_masses(
    masses_of_bag: pl.Series, tmp_path: Path, suffix: str
) -> None:
    overrides = []
    if suffix == ".csv":
        overrides = [
            "log.time=time_s",
            *(f'channels.{c}={{field = "{c}"}}' for c in _CSV_CHANNELS),
        ]
    masses = masses_of_one_load(tmp_path / f"one{suffix}", overrides)
    assert masses.len() == 2
    assert masses.to_list() == pytest.approx(masses_of_bag.to_list(), rel=1e-9)


def masses_of_one_load(log: Path, overrides: Sequence[str] = ()) -> pl.Series:
    """Masses of the runs of a short campaign that is written to a log."""
    short = Scenario()
    short = short.model_copy(
        update={"campaign": short.campaign.model_copy(update={"loads_kg": (0.0,), "runs": 2})}
    )
    (path,) = simulate_scenario_to_logs(short, log)
    replayed = replay_simulated_campaign([path], load_machine("cat262c.toml", overrides))
    return replayed.frames["segments"]["mass_kg"].drop_nulls()


_CSV_CHANNELS = (
    "torque_left_N_m",
    "torque_right_N_m",
    "speed_left_m_s",
    "speed_right_m_s",
    "specific_force_x_m_s2",
    "yaw_rate_rad_s",
)


@pytest.mark.heavy
def test_slope_is_in_the_specific_force_but_not_in_the_wheels(tmp_path: Path) -> None:
    steep = Scenario()
    steep = steep.model_copy(
        update={
            "terrain": steep.terrain.model_copy(update={"slope_deg": 1.0}),
            "campaign": steep.campaign.model_copy(update={"loads_kg": (0.0,), "runs": 3}),
        }
    )
    (log,) = simulate_scenario_to_logs(steep, tmp_path / "slope.bag")
    from_wheels = [
        'settings.forces.acceleration="kinematic"',
        'channels.acc_x_m_s2={derive = "d/dt speed_x_m_s"}',
    ]
    biases = [
        _pooled_kg(replay_simulated_campaign([log], load_machine("cat262c.toml", sets))) - 3614.0
        for sets in ([], from_wheels)
    ]
    assert abs(biases[0]) < 30.0
    assert biases[1] > 300.0


def _pooled_kg(replayed: Run) -> float:
    used = replayed.frames["segments"].filter(pl.col("reason") == "accepted")
    return float(used["mass_kg"].mean())  # pyright: ignore[reportArgumentType]


def test_other_seeds_give_other_noise_and_the_same_seed_the_same_logs(tmp_path: Path) -> None:
    short = Scenario()
    short = short.model_copy(
        update={"campaign": short.campaign.model_copy(update={"loads_kg": (0.0,), "runs": 1})}
    )
    written = [
        simulate_scenario_to_logs(short.copy_with_seed(seed), tmp_path / f"{name}.csv")[
            0
        ].read_bytes()
        for name, seed in (("a", 1), ("b", 1), ("c", 2))
    ]
    assert written[0] == written[1] != written[2]

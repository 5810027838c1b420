"""A speed that a logger holds over the rows of a faster table, and an acceleration made of it."""

import tomllib
from pathlib import Path

import numpy as np
import polars as pl
import pytest

from analysis.model.machine import Machine
from analysis.model.run_record import Run
from replay import open_log, run
from tests.replay import truck
from tests.replay.sledge import MACHINE
from tests.twins import mark_heavy_after

HELD_NOTE = (
    "speed_x_m_s holds each reading for 5 rows of 50 Hz: it is taken at 10 Hz, without the rows "
    "that repeat a reading"
)


def weighed(folder: Path, table: pl.DataFrame) -> Run:
    """Replay a table of force and speed, braking included."""
    path = folder / "truck.parquet"
    table.drop("acc_m_s2").write_parquet(path)
    text = tomllib.loads(MACHINE)
    text["channels"]["acc_x_m_s2"] = {"derive": "d/dt speed_x_m_s"}
    text["machine"]["empty_mass_kg"] = truck.MASS_KG
    text["settings"]["gate"] = {"exclude_braking": False}
    return run(open_log(path), Machine.model_validate(text))


def hold(table: pl.DataFrame, rows: int) -> pl.DataFrame:
    """The table, with each `rows`-th speed held."""
    at = np.arange(table.height) // rows * rows
    return table.with_columns(table["speed_m_s"].gather(at))


@pytest.fixture(scope="module")
def table() -> pl.DataFrame:
    return truck.starts(seen_1=1.0)


@pytest.mark.heavy
def test_it_weighs_as_the_speed_of_its_sensor_does(table: pl.DataFrame, tmp_path: Path) -> None:
    """Its stairs gave a mass of about half, as the acceleration was 0 in four rows of five."""
    found = weighed(tmp_path, hold(table, 5))
    (load,) = found.frames["loads"].to_dicts()
    assert abs(load["mass_kg"] - truck.MASS_KG) <= 2.0 * load["u_kg"]
    assert load["u_kg"] < 0.02 * truck.MASS_KG
    assert HELD_NOTE in found.provenance.notes
    assert any("the grid is at 10 Hz" in note for note in found.provenance.notes)


@pytest.mark.heavy
@pytest.mark.parametrize("held_rows", mark_heavy_after(1, [1, 2, 5]))
def test_noise_that_falls_as_fast_as_braking_takes_no_driving_apart(
    held_rows: int, tmp_path: Path
) -> None:
    """A lorry at 25 Hz had 313 pieces of 0.4 s, whose mass was 2 % off and threw out braking."""
    table = truck.starts(seen_1=1.0)
    noise = np.random.default_rng(3).normal(0.0, 0.012, table.height)
    noisy = table.with_columns(pl.col("speed_m_s") + noise)
    (load,) = weighed(tmp_path, hold(noisy, held_rows)).frames["loads"].to_dicts()
    assert not load["braking_left_out"]
    assert abs(load["mass_kg"] - truck.MASS_KG) <= 2.0 * load["u_kg"]


@pytest.mark.heavy
def test_empty_cells_between_its_readings_say_the_same(table: pl.DataFrame, tmp_path: Path) -> None:
    held = hold(table, 5)
    own = pl.int_range(pl.len()) % 5 == 0
    empty = held.with_columns(pl.when(own).then(pl.col("speed_m_s")))
    one, other = (weighed(tmp_path, each).frames["loads"] for each in (held, empty))
    assert one.equals(other)


@pytest.mark.heavy
def test_a_speed_that_is_not_held_has_no_note(table: pl.DataFrame, tmp_path: Path) -> None:
    notes = weighed(tmp_path, table).provenance.notes
    assert not any("holds each reading" in note for note in notes)


@pytest.mark.heavy
def test_no_finding_blames_an_accelerometer_that_the_log_has_not(
    table: pl.DataFrame, tmp_path: Path
) -> None:
    late = table.with_columns(pl.col("force_N").shift(3, fill_value=0.0))
    findings = weighed(tmp_path, late).frames["findings"]
    assert "delay" in findings["cause"].to_list()
    assert not findings["evidence"].str.contains("accelerometer").any()

"""A slide that is always about to brake: does its force see the brakes, and what is proposed."""

import json
import tomllib
from pathlib import Path

import numpy as np
import polars as pl
import pytest

from analysis.model.machine import Machine
from replay import open_log, run
from tests.replay import truck
from tests.replay.sledge import MACHINE, Payscope
from tests.twins import mark_heavy_after

MASS_KG = 120.0
FRICTION_N_S_M = 40.0
RATE_HZ = 50.0
DRAFT = MACHINE.replace("empty_mass_kg = 100.0", "empty_mass_kg = 120.0")


def strokes(seen: float = 1.0, count: int = 14) -> pl.DataFrame:
    """Strokes to and fro of two seconds with half a second between them.

    Args:
        seen: share of what brakes that the force sees.
        count: of the strokes.
    """
    size = round(2.0 * RATE_HZ)
    one = 0.5 - 0.5 * np.cos(2.0 * np.pi * np.arange(size) / size)
    rest = np.zeros(round(0.5 * RATE_HZ))
    dice = np.random.default_rng(4)
    tops = dice.uniform(0.5, 1.0, count) * np.resize([1.0, -1.0], count)
    speed = np.concatenate([rest, *(part for top in tops for part in (top * one, rest))])
    acc = np.gradient(speed) * RATE_HZ
    force = MASS_KG * acc + FRICTION_N_S_M * speed
    force = np.where(force * speed < 0.0, seen * force, force)
    read = {"force_N": (force, 2.0), "speed_m_s": (speed, 0.002), "acc_m_s2": (acc, 0.02)}
    noisy = {name: x + dice.normal(0.0, std, x.size) for name, (x, std) in read.items()}
    return pl.DataFrame({"time_s": np.arange(speed.size) / RATE_HZ, **noisy})


@pytest.mark.heavy
@pytest.mark.parametrize("seen", mark_heavy_after(1, [1.0, 0.8, 0.5]))
def test_brakes_that_the_force_sees_in_part_do_not_lower_the_mass(
    seen: float, tmp_path: Path
) -> None:
    """What they do looks like a late force: driving finds another delay, and is right."""
    found = truck.replayed(tmp_path, truck.starts(seen_1=seen), exclude_braking=False)
    (load,) = found.frames["loads"].to_dicts()
    assert abs(load["mass_kg"] - truck.MASS_KG) <= 2.0 * load["u_kg"]
    assert load["braking_left_out"] is (seen < 1.0)


@pytest.fixture
def slide(tmp_path: Path) -> Path:
    path = tmp_path / "slide.csv"
    strokes().write_csv(path)
    return path


def causes(path: Path, **gate: object) -> list[str]:
    text = tomllib.loads(DRAFT)
    settings = {**text["settings"], "gate": gate}
    machine = Machine.model_validate({**text, "settings": settings})
    return run(open_log(path), machine).frames["findings"]["cause"].to_list()


@pytest.mark.heavy
def test_braking_that_tells_the_mass_of_driving_is_named_first(slide: Path) -> None:
    assert causes(slide)[0] == "braking_left_out"
    assert "braking_left_out" not in causes(slide, exclude_braking=False)


@pytest.mark.parametrize("seen", [0.9, 0.4, 0.0])
def test_brakes_that_the_force_sees_in_part_are_left_out_for_good(
    seen: float, tmp_path: Path
) -> None:
    path = tmp_path / "brakes.csv"
    strokes(seen).write_csv(path)
    assert "braking_left_out" not in causes(path)


def test_the_note_of_a_run_names_the_setting(payscope: Payscope, slide: Path) -> None:
    made = slide.with_suffix(".toml")
    made.write_text(DRAFT)
    said = payscope("run", slide, "-m", made)
    assert said.status == 1
    assert "settings.gate.exclude_braking = false" in said.out


@pytest.mark.heavy
def test_explain_apply_mends_it(payscope: Payscope, slide: Path, tmp_path: Path) -> None:
    draft, target = tmp_path / "draft.toml", tmp_path / "mended.toml"
    draft.write_text(DRAFT)
    said = payscope("explain", slide, "-m", draft, "--apply", "-o", target, "--json")
    mended = json.loads(said.out)["mended"]
    assert mended["changes"][0]["key"] == "settings.gate.exclude_braking"
    assert mended["can_weigh"] is True
    (load,) = mended["loads"]
    assert abs(load["mass_kg"] - MASS_KG) <= 2.0 * load["u_kg"]


class TestInit:
    @pytest.mark.heavy
    def test_a_draft_of_a_log_whose_force_sees_the_brakes_lets_braking_weigh(
        self, payscope: Payscope, slide: Path, tmp_path: Path
    ) -> None:
        table, made = tmp_path / "named.csv", tmp_path / "made.toml"
        pl.read_csv(slide).rename({"acc_m_s2": "acc_x_m_s2"}).write_csv(table)
        assert payscope("init", table, "-o", made).status == 0
        assert tomllib.loads(made.read_text())["settings"]["gate"] == {"exclude_braking": False}
        assert "measure the brakes?" not in made.read_text()
        assert payscope("run", table, "-m", made).status == 0

    @pytest.mark.heavy
    def test_another_draft_names_the_setting_in_a_comment(
        self, payscope: Payscope, log: Path, tmp_path: Path
    ) -> None:
        made = tmp_path / "made.toml"
        assert payscope("init", log, "-o", made).status == 0
        assert "gate" not in tomllib.loads(made.read_text())["settings"]
        assert "# exclude_braking = false" in made.read_text()
        assert "measure the brakes?" in made.read_text()

"""`payscope sweep`: every row is what `run --set` says, and the truth beside a log gives errors."""

import csv
import json
from io import StringIO
from pathlib import Path

import numpy as np
import polars as pl
import pytest

from analysis.simulation import Scenario
from replay.simulation.simulate_logs import simulate_scenario_to_logs
from tests.replay.sledge import Payscope, join_to_one_line, sledge
from tests.twins import mark_heavy_after, mark_slow_after

KEYS = ("mass_kg", "mass_std_kg", "friction_x_N_s_m", "payload_kg", "accepted_share", "verdict")


@pytest.mark.heavy
@pytest.mark.parametrize(
    "over",
    mark_slow_after(
        2,
        [
            ["settings.gate.threshold_nat=0.3:1.1:0.4"],
            ["settings.gate.window_samples=200,400", "settings.gate.exclude_braking=true,false"],
            # what comes before the gate: filter, grid, channels, machine
            ["settings.smooth.samples=1,10", "settings.align.rate_hz=50,100"],
            ["channels.force_x_N.delay_s=0.0,0.1", "machine.empty_mass_kg=90,110"],
            ["settings.trace.methods=['ls'],['huber','pooled']"],
        ],
    ),
    ids=str,
)
def test_every_row_equals_run_with_the_same_settings(
    payscope: Payscope, log: Path, machine_file: Path, over: list[str]
) -> None:
    swept = payscope(
        "sweep", log, "-m", machine_file, *(w for o in over for w in ("--over", o)), "--json"
    )
    assert swept.status == 0
    rows = json.loads(swept.out)
    assert len(rows) > 1
    for row in rows:
        sets = [f"{key}={json.dumps(value)}" for key, value in row["over"].items()]
        ran = payscope(
            "run", log, "-m", machine_file, *(w for s in sets for w in ("--set", s)), "--json"
        )
        told = json.loads(ran.out)
        assert {key: row[key] for key in KEYS} == {key: told[key] for key in KEYS}


def test_without_a_setting_to_vary_it_shows_one(
    payscope: Payscope, log: Path, machine_file: Path
) -> None:
    join_to_one_line(
        payscope("sweep", log, "-m", machine_file), "'--over'", "threshold_nat=0.5,0.7"
    )


@pytest.mark.heavy
def test_a_combination_that_cannot_weigh_is_marked_and_has_no_mass(
    payscope: Payscope, log: Path, machine_file: Path
) -> None:
    said = payscope(
        "sweep", log, "-m", machine_file, "--over", "settings.gate.threshold_nat=0.7,50",
        "--format", "csv", "--reference", "120",
    )  # fmt: skip
    assert said.status == 0
    good, bad = csv.DictReader(StringIO(said.out))
    assert (good["can_weigh"], good["failed"]) == ("true", "")
    assert float(good["ls_error_kg"]) == pytest.approx(float(good["ls_mass_kg"]) - 120.0)
    assert (bad["can_weigh"], bad["failed"]) == ("false", "accepted_stretches relative_u")
    assert bad["ls_mass_kg"] == bad["ls_error_kg"] == ""
    table = payscope(
        "sweep", log, "-m", machine_file, "--over", "settings.gate.threshold_nat=0.7,50"
    )
    assert "no: accepted_stretches" in table.out


@pytest.mark.parametrize("words", [[], ["--format", "csv"], ["--json"]], ids=str)
def test_when_no_combination_can_weigh_the_answer_is_no_as_of_run(
    payscope: Payscope, log: Path, machine_file: Path, words: list[str]
) -> None:
    over = "settings.gate.threshold_nat=50,60"
    said = payscope("sweep", log, "-m", machine_file, "--over", over, *words)
    assert said.status == 1
    assert said.out.count("accepted_stretches") >= 2
    assert said.err == "No combination can weigh: every mass is withheld.\n"


@pytest.mark.heavy
def test_the_truth_beside_a_campaign_gives_the_errors_of_tables_3_and_4(
    payscope: Payscope, tmp_path: Path
) -> None:
    small = Scenario()
    campaign = small.campaign.model_copy(update={"loads_kg": (0.0, 100.0, 250.0), "runs": 3})
    logs = simulate_scenario_to_logs(
        small.model_copy(update={"campaign": campaign}), tmp_path / "c.bag"
    )
    said = payscope(
        "sweep",
        *logs,
        "-m",
        "cat262c.toml",
        "--over",
        "settings.gate.threshold_nat=0.7,1.3",
        "--json",
    )
    for row in json.loads(said.out):
        # the joint fit has one mass a log, none a run
        assert set(row["rmse_kg"]) == set(row["mass_kg"]) - {"joint"}
        for method in ("ls", "fgls", "tls", "pooled"):
            assert 0.0 < row["calibrated_rmse_kg"][method] < 25.0
            assert row["calibrated_rmse_kg"][method] < row["left_out_rmse_kg"][method]
    one = payscope(
        "sweep",
        logs[0],
        "-m",
        "cat262c.toml",
        "--over",
        "settings.gate.threshold_nat=0.7",
        "--json",
    )
    (row,) = json.loads(one.out)
    assert row["rmse_kg"]["pooled"] < 25.0
    assert "calibrated_rmse_kg" not in row  # one load determines no line


@pytest.mark.heavy
@pytest.mark.parametrize("suffix", mark_heavy_after(1, [".csv", ".json", ".parquet"]))
def test_the_suffix_says_the_format_and_nothing_is_overwritten(
    payscope: Payscope, log: Path, machine_file: Path, tmp_path: Path, suffix: str
) -> None:
    out = tmp_path / f"rows{suffix}"
    words = (
        "sweep",
        log,
        "-m",
        machine_file,
        "--over",
        "settings.gate.threshold_nat=0.5,0.7",
        "-o",
    )
    assert payscope(*words, out).status == 0
    read = {".csv": pl.read_csv, ".json": pl.read_json, ".parquet": pl.read_parquet}[suffix]
    assert read(out).height == 2
    join_to_one_line(payscope(*words, out), out.name, "--force")
    join_to_one_line(payscope(*words, log, "--force"), "is also an input")


@pytest.mark.heavy
def test_keys_that_end_alike_and_lists_have_their_columns_in_a_file(
    payscope: Payscope, log: Path, machine_file: Path
) -> None:
    over = (
        "channels.force_x_N.scale=1.0,2.0",
        "channels.speed_x_m_s.scale=1.0",
        "settings.trace.methods=['ls'],['ls', 'rls']",
    )
    words = (word for each in over for word in ("--over", each))
    said = payscope("sweep", log, "-m", machine_file, *words, "--format", "csv")
    rows = list(csv.DictReader(StringIO(said.out)))
    varied = ("channels.force_x_N.scale", "channels.speed_x_m_s.scale", "methods")
    assert [tuple(row[name] for name in varied) for row in rows] == [
        ("1.0", "1.0", "['ls']"),
        ("1.0", "1.0", "['ls', 'rls']"),
        ("2.0", "1.0", "['ls']"),
        ("2.0", "1.0", "['ls', 'rls']"),
    ]


class TestWrongInput:
    def test_unknown_key_names_the_nearest(
        self, payscope: Payscope, log: Path, machine_file: Path
    ) -> None:
        said = payscope("sweep", log, "-m", machine_file, "--over", "settings.threshold=0.5,0.7")
        join_to_one_line(
            said, "unknown key 'threshold'", "did you mean 'settings.gate.threshold_nat'?"
        )

    def test_a_value_that_does_not_fit(
        self, payscope: Payscope, log: Path, machine_file: Path
    ) -> None:
        said = payscope(
            "sweep", log, "-m", machine_file, "--over", "settings.gate.window_samples=0.5:1.5:0.5"
        )
        join_to_one_line(said, "settings.gate.window_samples", "0.5")

    def test_no_grid(self, payscope: Payscope, log: Path, machine_file: Path) -> None:
        join_to_one_line(payscope("sweep", log, "-m", machine_file), "--over")
        said = payscope("sweep", log, "-m", machine_file, "--over", "settings.align.rate_hz")
        join_to_one_line(said, "KEY=FROM:TO:STEP")

    def test_no_log(self, payscope: Payscope, machine_file: Path, tmp_path: Path) -> None:
        said = payscope(
            "sweep",
            tmp_path / "no.bag",
            "-m",
            machine_file,
            "--over",
            "settings.align.rate_hz=50,100",
        )
        join_to_one_line(said, "no.bag", "no such")

    @pytest.mark.parametrize("mass", ["nan", "inf", "-1", "0"])
    def test_a_reference_that_is_no_mass(
        self, payscope: Payscope, log: Path, machine_file: Path, mass: str
    ) -> None:
        over = ["--over", "settings.gate.threshold_nat=0.7"]
        said = payscope("sweep", log, "-m", machine_file, *over, f"--reference={mass}")
        join_to_one_line(said, "--reference", "above 0" if np.isfinite(float(mass)) else "finite")

    def test_two_formats(self, payscope: Payscope, log: Path, machine_file: Path) -> None:
        said = payscope(
            "sweep", log, "-m", machine_file, "--over", "settings.align.rate_hz=50", "--json",
            "--format", "csv",
        )  # fmt: skip
        join_to_one_line(said, "--json", "--format")

    def test_a_truth_file_that_is_none(
        self, payscope: Payscope, machine_file: Path, tmp_path: Path
    ) -> None:
        sledge().write_csv(tmp_path / "s.csv")
        (tmp_path / "s.csv.truth.json").write_text("{}")
        said = payscope(
            "sweep",
            tmp_path / "s.csv",
            "-m",
            machine_file,
            "--over",
            "settings.align.rate_hz=50,100",
        )
        join_to_one_line(said, "s.csv.truth.json", "payscope simulate")


@pytest.mark.heavy
def test_the_figure_shows_every_method_the_reference_and_what_cannot_weigh(
    payscope: Payscope, log: Path, machine_file: Path, tmp_path: Path
) -> None:
    figure = tmp_path / "sweep.svg"
    said = payscope(
        "sweep", log, "-m", machine_file, "--over", "settings.gate.threshold_nat=0.7,1.0,50",
        "--reference", "120", "--figure", figure, "--json",
    )  # fmt: skip
    assert said.status == 0
    assert len(json.loads(said.out)) == 3
    drawn = figure.read_text()
    for name in ("joint", "pooled", "reference", "cannot weigh", "threshold_nat", "samples used"):
        assert f"<!-- {name}" in drawn
    join_to_one_line(
        payscope(
            "sweep", log, "-m", machine_file, "--over", "settings.gate.threshold_nat=0.7",
            "--figure", tmp_path / "sweep.bmp",
        ),
        ".bmp",
    )  # fmt: skip


@pytest.mark.heavy
def test_the_figure_of_words_and_several_keys_has_a_place_for_each(
    payscope: Payscope, log: Path, machine_file: Path, tmp_path: Path
) -> None:
    figure = tmp_path / "sweep.svg"
    said = payscope(
        "sweep", log, "-m", machine_file, "--over", "settings.forces.coulomb=true,false",
        "--over", "settings.gate.window_samples=200,320", "--figure", figure,
    )  # fmt: skip
    assert said.status == 0
    assert "<!-- true · 200" in figure.read_text()

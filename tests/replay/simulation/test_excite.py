"""The command `excite`, and scenarios as files that read back as they were."""

import json
from dataclasses import replace
from pathlib import Path

import pytest

from analysis.excitation import design_excitation
from analysis.simulation import Scenario
from estimators.errors import DataError, OutputError
from replay.simulation.scenario_file import (
    format_scenario_file,
    load_scenario_file,
    write_scenario_file,
)
from replay.simulation.simulate_logs import simulate_scenario_to_logs

PLANAR = Path(__file__).parents[3] / "examples" / "planar.toml"
BASE = load_scenario_file(None)


@pytest.fixture(scope="module")
def designed():
    """What a bare `excite` designs; a design takes seconds."""
    return design_excitation(BASE)


@pytest.fixture
def excite(payscope, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    return lambda *arguments: payscope("excite", *arguments)


@pytest.mark.parametrize("made", [Scenario(), BASE, load_scenario_file(PLANAR)])
def test_a_scenario_that_is_written_reads_back_as_it_was(tmp_path, made):
    path = tmp_path / "scenario.toml"
    path.write_text(format_scenario_file(made), encoding="utf-8")
    assert load_scenario_file(path) == made


@pytest.mark.heavy
def test_the_best_waveform_is_written_as_a_scenario_that_simulate_accepts(excite, tmp_path):
    answer = excite("-o", "best.toml", "--json")
    assert answer.status == 0, answer.err
    made = json.loads(answer.out)
    (best,) = [each for each in made["waveforms"] if each["best"]]
    scenario = load_scenario_file(tmp_path / "best.toml")
    rest, driven = scenario.campaign.manoeuvres_of_trial
    assert rest.kind == "rest"
    assert driven.model_dump(exclude_none=True)["force"] == best["force"]
    (log,) = simulate_scenario_to_logs(scenario, tmp_path / "best.csv")
    truth = json.loads(log.with_name("best.csv.truth.json").read_text(encoding="utf-8"))
    assert [each["kind"] for each in truth["manoeuvres"]] == ["rest", "excite"]
    assert truth["runs"][0]["mass_kg"] == 3614.0


def give_design(monkeypatch, made, accuracy=0.01, yard_m=None):
    """Give a design, whose search is tested by itself, if that is asked for."""

    def design(_base, _motion, asked_1, _window_s, asked_m):
        assert (asked_1, asked_m) == (accuracy, yard_m)
        return made

    monkeypatch.setattr("analysis.excitation.design_excitation", design)


@pytest.mark.heavy
def test_an_accuracy_that_no_waveform_reaches_leaves_with_one(excite, designed, monkeypatch):
    give_design(monkeypatch, replace(designed, accuracy=1e-4), accuracy=1e-4)
    answer = excite("--accuracy", "0.01%")
    assert answer.status == 1
    assert "No waveform reaches the accuracy of 0.0001" in answer.out


def test_a_yard_that_nothing_fits_leaves_with_one_and_writes_nothing(
    excite, designed, tmp_path, monkeypatch
):
    nothing = replace(designed, best=None)
    give_design(monkeypatch, nothing, yard_m=0.5)
    answer = excite("--yard", "0.5", "-o", "best.toml")
    assert answer.status == 1
    assert "No waveform stays within the yard" in answer.out
    assert not list(tmp_path.iterdir())
    with pytest.raises(DataError, match="stays within the yard"):
        write_scenario_file(nothing.to_scenario(BASE), tmp_path / "best.toml")


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        (["--accuracy", "much"], "--accuracy much: write it as 1% or 0.01"),
        (["--accuracy", "150%"], "below 100%"),
        (["--window", "1"], "give one between the response time T = 4.97 s"),
        (["--set", "machine.mas_kg=3"], "unknown key 'machine.mas_kg'; did you mean 'mass_kg'?"),
        (["--set", "mass"], "--set mass: write it as key=value"),
        (["none.toml"], "none.toml: cannot be read"),
        (["--motion", "sideways"], "sideways"),
    ],
)
def test_what_is_wrong_is_said_in_one_line_and_leaves_with_two(excite, arguments, says):
    answer = excite(*arguments)
    assert answer.status == 2
    assert says in answer.err
    assert answer.err.count("\n") == 1


def test_the_scenario_that_is_read_is_never_overwritten(excite, designed, tmp_path):
    mine = tmp_path / "mine.toml"
    mine.write_text(format_scenario_file(BASE), encoding="utf-8")
    before = mine.read_bytes()
    assert excite("mine.toml", "-o", "mine.toml", "--force").status == 2
    with pytest.raises(OutputError, match="exists already"):
        write_scenario_file(designed.to_scenario(BASE), mine)
    assert mine.read_bytes() == before

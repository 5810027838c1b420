"""Scenario files."""

import tomllib
from pathlib import Path

import pytest

from analysis.simulation import Scenario
from estimators.errors import ScenarioError
from replay.simulation.scenario_file import load_scenario_file
from tests.one_line import assert_one_line

MANOEUVRE = "[[campaign.manoeuvres]]\n"
EXAMPLE = Path(__file__).parents[3] / "examples" / "campaign.toml"


def refusal(tmp_path, text):
    path = tmp_path / "campaign.toml"
    path.write_text(text, encoding="utf-8")
    with pytest.raises(ScenarioError) as caught:
        load_scenario_file(path)
    message = str(caught.value)
    assert message.startswith(str(path))
    assert_one_line(caught.value)
    return message


def test_the_example_states_every_default():
    assert load_scenario_file(EXAMPLE) == Scenario()
    stated = tomllib.loads(EXAMPLE.read_text(encoding="utf-8"))
    # a campaign is what has no shift
    defaults = Scenario().model_dump(exclude={"shift"})
    assert {name: set(section) for name, section in stated.items()} == {
        name: set(section) for name, section in defaults.items()
    }


def test_an_empty_file_is_the_papers_campaign(tmp_path):
    path = tmp_path / "empty.toml"
    path.touch()
    assert load_scenario_file(path) == Scenario()


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("[machin]\nmass_kg = 1", "unknown key 'machin'; did you mean 'machine'?"),
        ("[machine]\nmas_kg = 1", "unknown key 'machine.mas_kg'; did you mean 'mass_kg'?"),
        ("[terrain]\nzzz = 1", "unknown key 'terrain.zzz'; known: gravity_m_s2, hills_deg"),
        (
            "[campaign]\nruns = 0",
            "campaign.runs: input should be greater than or equal to 1, not 0",
        ),
        ("[campaign]\nruns = 'nine'", "campaign.runs: input should be a valid integer"),
        ("[campaign]\nloads_kg = [0, 'x']", "campaign.loads_kg.1: input should be a valid number"),
        ("[campaign]\nloads_kg = [5, 5]", "campaign.loads_kg: 5 kg appears twice"),
        ("machine = 3", "machine: input should be a table, not 3"),
        (
            "[terrain]\nslope_deg = 15",
            "campaign.throttle_force_N: the driving force reaches 6000 N",
        ),
        ("[machine]\na = 1\nb = 2", "(and 1 more fault)"),
        ("[channels.force_x_N]", "is a machine file, not a scenario file"),
        (
            "[campaign]\n[[masses]]",
            "is a campaign file of `payscope calibrate`, not a scenario file",
        ),
        (MANOEUVRE + "kind = 'spinn'", "0: unknown 'kind' 'spinn'; did you mean 'spin'?"),
        (MANOEUVRE + "start_s = 3", "campaign.manoeuvres.0: 'kind' is missing"),
        (
            MANOEUVRE + "kind = 'rest'\nduration = 3",
            "unknown key 'campaign.manoeuvres.0.duration'; did you mean 'duration_s'?",
        ),
        (
            MANOEUVRE + "kind = 'excite'\nforce = {period = 3}",
            "unknown key 'campaign.manoeuvres.0.force.period'; did you mean 'period_s'?",
        ),
        (
            MANOEUVRE + "kind = 'excite'\nforce = {waveform = 'square'}",
            "campaign.manoeuvres.0.force.waveform: input should be 'triangular', 'sinusoidal' or",
        ),
        ("[campaign]\nmanoeuvres = [3]", "campaign.manoeuvres.0: input should be a table, not 3"),
        ('["a\\nb"]', "unknown key 'a b'"),
        (f"[sensors]\nseed = {'9' * 5000}", "is not TOML"),
        ("[machine\n", "is not TOML"),
    ],
)
def test_a_wrong_scenario_is_refused_in_one_line_that_names_the_key(tmp_path, text, says):
    assert says in refusal(tmp_path, text)


def test_a_number_of_thousands_of_digits_on_the_command_line_is_refused_in_one_line():
    with pytest.raises(ScenarioError, match=r"sensors.seed: unable to parse") as raised:
        load_scenario_file(None, [f"sensors.seed={'9' * 5000}"])
    assert_one_line(raised.value)


def test_what_is_no_text_file_is_refused(tmp_path):
    binary = tmp_path / "campaign.toml"
    binary.write_bytes(b"\xff\xfe\x00")
    with pytest.raises(ScenarioError, match="not UTF-8"):
        load_scenario_file(binary)
    with pytest.raises(ScenarioError, match=r"cannot be read \(Is a directory\)"):
        load_scenario_file(tmp_path)
    with pytest.raises(ScenarioError, match=r"cannot be read \(No such file or directory\)"):
        load_scenario_file(tmp_path / "none.toml")

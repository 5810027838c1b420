"""Campaign files: every fault in one line; and a first one drafted from a folder of logs."""

from pathlib import Path

import pytest

from estimators.errors import CampaignError
from replay.calibration.campaign_file import load_campaign_and_machine
from replay.machines.toml_file import read_toml_file
from tests.replay.sledge import Payscope, join_to_one_line
from tests.replay.sledge_campaign import campaign_folder


@pytest.fixture
def campaign(tmp_path: Path) -> Path:
    return campaign_folder(tmp_path)


def test_a_campaign_file_is_read(campaign: Path) -> None:
    read, machine = load_campaign_and_machine(campaign)
    assert [run.load_id for run in read.runs][:2] == ["empty", "block-1"]
    assert read.last_valid_day.isoformat() == "2027-05-04"
    assert machine.machine.name == "sledge"


@pytest.mark.parametrize(
    ("old", "new", "parts"),
    [
        ('author = "A. Author"', "", ["campaign.author: is missing"]),
        ('operator = "O', 'operater = "O', ["unknown key 'runs.0.operater'", "'operator'"]),
        ("value_kg = 20.0", "value_kg = -1.0", ["masses.0.value_kg", "greater than 0"]),
        ("shared_u_kg = 0.01", "shared_u_kg = 1.0", ["block-1", "exceeds u_kg"]),
        ('source = "scale-3"', "", ["shared_u_kg needs source"]),
        ('"block-1"]', '"block-9"]', ["no mass 'block-9'", "did you mean"]),
        ("day = 2026-05-02", "day = 2031-05-02", ["certificate", "expired on 2030-01-31"]),
        ("day = 2026-05-01", 'day = "soon"', ["runs.0.day"]),
        ('id = "run-1"', 'id = "run-0"', ["two of the runs have the same id 'run-0'"]),
        ('log = "load-1.csv"', 'log = "load-0.csv"', ["overlap in load-0.csv"]),
        ('log = "load-1.csv"', 'log = "load-9.csv"', ["no log 'load-9.csv'"]),
        ('file = "sledge.toml"', 'file = "other.toml"', ["no such machine file"]),
        ('id = "sledge-7"', 'id = "../x"', ["machine.id"]),
        ('operator = "O', 'from_s = 9.0\nto_s = 3.0\noperator = "O', ["to_s is not after from_s"]),
    ],
)
def test_a_fault_is_one_line_with_its_remedy(
    campaign: Path, payscope: Payscope, old: str, new: str, parts: list[str]
) -> None:
    text = campaign.read_text()
    assert old in text
    campaign.write_text(text.replace(old, new, 1))
    said = payscope("calibrate", campaign, "-o", campaign.parent / "evidence")
    join_to_one_line(said, *parts)
    assert not (campaign.parent / "evidence").exists()


CERTIFICATE = """
[laboratory]
name = "Example Laboratory"
address = "Example Street 1"
city = "Exampletown"
country = "DE"
"""


def test_a_campaign_of_a_laboratory_names_each_key_that_a_certificate_lacks(campaign: Path) -> None:
    campaign.write_text(campaign.read_text() + CERTIFICATE)
    with pytest.raises(CampaignError) as fault:
        load_campaign_and_machine(campaign)
    for key in ("customer", "campaign.place", "machine.make", "conditions.tyres"):
        assert key in str(fault.value)


def test_a_campaign_of_before_is_read_and_says_what_it_does_not_state(campaign: Path) -> None:
    read, _ = load_campaign_and_machine(campaign)
    assert "laboratory" in read.missing_certificate_entries
    assert "conditions.temperature_degC" in read.missing_certificate_entries
    assert read.untraceable_references_text == ("the machine's empty mass has no certificate",)


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ("u_kg = 0.02", "u_kg = 0.0", "mass 'block-1' has a standard uncertainty of 0"),
        ('certificate = "K-1"', "", "mass 'block-1' has no certificate"),
        ('certificate = "K-1"', 'stated_by = "customer"', "'block-1' is stated by the customer"),
    ],
)
def test_a_mass_that_is_not_traceable_is_said(
    campaign: Path, old: str, new: str, said: str
) -> None:
    text = campaign.read_text().replace("shared_u_kg = 0.01", "")
    assert old in text
    campaign.write_text(text.replace(old, new, 1))
    assert any(
        said in each for each in load_campaign_and_machine(campaign)[0].untraceable_references_text
    )


def test_a_machine_file_is_no_campaign(campaign: Path) -> None:
    with pytest.raises(
        CampaignError, match=r"sledge\.toml: is a machine file, not a campaign file"
    ):
        load_campaign_and_machine(campaign.parent / "sledge.toml")


def test_what_is_replaced_needs_a_reason(campaign: Path) -> None:
    campaign.write_text(
        campaign.read_text().replace('author = "A', 'replaces = "abc"\nauthor = "A', 1)
    )
    with pytest.raises(CampaignError, match="must be given together"):
        load_campaign_and_machine(campaign)


def test_a_class_that_is_none_is_refused_before_the_work(campaign: Path) -> None:
    campaign.write_text(campaign.read_text() + '\n[decision]\naccuracy_class = "R 51 Y(c)"\n')
    with pytest.raises(CampaignError, match="no class"):
        load_campaign_and_machine(campaign)


def test_a_machine_without_the_uncertainty_of_its_mass_is_refused(campaign: Path) -> None:
    machine = campaign.parent / "sledge.toml"
    machine.write_text(machine.read_text().replace("empty_mass_u_kg", "# empty_mass_u_kg"))
    with pytest.raises(CampaignError, match=r"has machine\.empty_mass_u_kg"):
        load_campaign_and_machine(campaign)


@pytest.mark.heavy
def test_a_draft_names_every_log_of_a_folder_and_can_be_completed(
    tmp_path: Path, payscope: Payscope
) -> None:
    logs = campaign_folder(tmp_path / "logs").parent
    (logs / "note.md").write_text("no log")
    draft = tmp_path / "draft.toml"
    machine = logs / "sledge.toml"
    said = payscope("init", "--campaign", logs, "-m", machine, "-o", draft)
    assert said.status == 0, said.err
    content = read_toml_file(draft, CampaignError)
    assert [run["log"] for run in content["runs"]] == [f"logs/load-{k}.csv" for k in range(4)]
    assert content["machine"]["file"] == "logs/sledge.toml"
    left = payscope("calibrate", draft, "-o", tmp_path / "evidence")
    join_to_one_line(left, "draft.toml", "campaign.intended_use: is not filled in yet")
    text = draft.read_text()
    undated, loads = ('day = "TODO"', "day = 2026-05-01"), ('["TODO"]', '["mass-1"]')
    countries = [
        ('"TODO: two letters, such as DE"', '"DE"'),
        ('"TODO: two letters"', '"DE"'),
        ('"TODO: of the ground, nose up"', "0.0"),
        ('"TODO: of the air"', "15.0"),
    ]
    for open_one, said in (undated, loads, *countries, ('"TODO', '"Sledges')):
        assert open_one in text
        text = text.replace(open_one, said)
    draft.write_text(text)
    campaign, _ = load_campaign_and_machine(draft)
    assert campaign.campaign.author == "Sledges: who made it"
    assert not campaign.missing_certificate_entries
    assert str(tmp_path) not in text
    join_to_one_line(
        payscope("init", "--campaign", tmp_path / "none", "-o", tmp_path / "x.toml"), "none"
    )
    join_to_one_line(payscope("init", "-o", tmp_path / "x.toml"), "--campaign DIR")

"""Fleet files: rules from logs to machines and calibrations, faults in one line."""

from pathlib import Path

import pytest

from estimators.errors import FleetError, PayscopeError
from replay.fleet.machine_setups import MachineRule, load_fleet
from tests.one_line import assert_one_line

RULE = '[[machines]]\nlogs = "{machine}/*.mcap"\nfile = "cat262c.toml"\n'


@pytest.mark.parametrize(
    ("pattern", "log", "machine"),
    [
        ("{machine}/*.mcap", "/data/yard/unit-07/a.mcap", "unit-07"),
        ("{machine}/*.mcap", "s3://bucket/unit-07/a.mcap", "unit-07"),
        ("yard/{machine}/**/*.mcap", "/data/yard/unit-07/2026/10/a.mcap", "unit-07"),
        ("yard/{machine}/**/*.mcap", "/data/yard/unit-07/a.mcap", "unit-07"),
        ("{machine}_*.bag", "/data/unit-07_monday.bag", "unit-07"),
        ("{machine}/*.mcap", "/data/unit-07/a.bag", None),
        ("yard/{machine}/*.mcap", "/data/backyard/unit-07/a.mcap", None),
        ("{machine}/?.mcap", "/data/unit-07/ab.mcap", None),
        ("{machine}/a[1].mcap", "/data/unit-07/a[1].mcap", "unit-07"),
    ],
)
def test_a_rule_is_of_the_end_of_a_path(pattern: str, log: str, machine: str | None) -> None:
    assert MachineRule(logs=pattern, file="x.toml").find_machine_of_log(log) == machine


def write(folder: Path, text: str) -> Path:
    path = folder / "fleet.toml"
    path.write_text(text, encoding="utf-8")
    return path


def test_the_first_rule_that_fits_counts_and_names_the_machine_file(tmp_path: Path) -> None:
    special = RULE.replace("{machine}/", "unit-01/") + (
        'name = "old one"\noverrides = ["settings.gate.threshold_nat=0.9"]\n'
    )
    fleet = load_fleet(write(tmp_path, special + RULE))
    (old,) = fleet.list_setups_of_log("/data/unit-01/a.mcap")
    (other,) = fleet.list_setups_of_log("/data/unit-02/a.mcap")
    assert (old.name, other.name) == ("old one", "unit-02")
    assert old.machine.settings.gate.threshold_nat == 0.9
    assert old.basis != other.basis


@pytest.mark.parametrize(
    ("text", "part"),
    [
        (RULE.replace("logs =", "log ="), "unknown key 'machines.0.log'; did you mean 'logs'?"),
        ("[fleet]\nname = 'x'\n", "machines: is missing"),
        (RULE.replace("{machine}/", ""), "needs either name or {machine}"),
        (RULE + 'name = "x"\n', "needs either name or {machine}"),
        (RULE.replace("*.mcap", "{machine}.mcap"), "more than once"),
        (RULE.replace("*.mcap", "**/*.mcap"), "put the folder above it first"),
        ("[limits]\nsecond = 3\n" + RULE, "did you mean 'seconds'?"),
        ("[channels.x]\n", "is a machine file"),
        ("[[machines]\n", "is not TOML"),
    ],
)
def test_a_fault_is_said_in_one_line(tmp_path: Path, text: str, part: str) -> None:
    with pytest.raises(FleetError) as fault:
        load_fleet(write(tmp_path, text))
    assert part in str(fault.value)
    assert "fleet.toml" in str(fault.value)
    assert_one_line(fault.value)


def test_a_machine_file_that_is_missing_is_a_fault_of_its_logs_alone(tmp_path: Path) -> None:
    rule = RULE.replace("cat262c.toml", "{machine}.toml")
    fleet = load_fleet(write(tmp_path, rule))
    with pytest.raises(PayscopeError, match=r"unit-09.toml: no such machine file"):
        fleet.list_setups_of_log("/data/unit-09/a.mcap")
    with pytest.raises(FleetError, match="no rule in"):
        fleet.list_setups_of_log("/data/a.bag")

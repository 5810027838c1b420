"""Keys that had another name: read as before with one line, and rewritten by `payscope migrate`."""

import json
import tomllib
import warnings
from pathlib import Path
from typing import Any

import pytest

from analysis.model.settings import Settings
from estimators.errors import MachineError
from replay.explain.proposal_edits import Proposal, insert_proposals_into_machine_file
from replay.machines.machine_file import load_machine
from replay.machines.old_names import (
    OLD_NAMES,
    OldNameWarning,
    migrate_toml_file,
    migrate_toml_text,
)
from tests.replay.sledge import MACHINE, Payscope, join_to_one_line

pytestmark = pytest.mark.usefixtures("kept_replays")

OLD = MACHINE.replace("[settings.forces]\n", "[settings]  # of 2025\n# by the wheels\n")
assert "[settings]" in OLD


@pytest.fixture
def old_file(tmp_path: Path) -> Path:
    path = tmp_path / "old.toml"
    path.write_text(OLD)
    return path


def test_every_old_name_leads_to_a_key_there_is() -> None:
    for old, new in OLD_NAMES.items():
        section, _, key = new.removeprefix("settings.").partition(".")
        assert key in Settings.list_stage_models()[section].model_fields, new
        assert new not in OLD_NAMES, f"{old} leads to {new}, which is old itself"


def test_an_old_file_makes_the_machine_of_the_new_one(old_file: Path, machine_file: Path) -> None:
    with pytest.warns(OldNameWarning, match="is now 'settings.forces.acceleration'"):
        machine = load_machine(old_file)
    assert machine == load_machine(machine_file)


def test_run_reads_it_and_says_the_new_name_in_one_line(
    payscope: Payscope, log: Path, machine_file: Path, old_file: Path
) -> None:
    new, old = (payscope("run", log, "-m", file, "--json") for file in (machine_file, old_file))
    assert old.status == new.status == 0
    (line,) = set(old.err.splitlines()) - set(new.err.splitlines())
    assert "'settings.acceleration' is now 'settings.forces.acceleration'" in line
    assert f"payscope migrate {old_file}" in line
    assert json.loads(old.out)["loads"] == json.loads(new.out)["loads"]


def test_an_override_may_have_an_old_name(
    payscope: Payscope, log: Path, machine_file: Path
) -> None:
    said = payscope("run", log, "-m", machine_file, "--set", "settings.window_samples=200")
    assert said.status == 0
    assert "'settings.window_samples' is now 'settings.gate.window_samples'" in said.err


def test_migrate_rewrites_it_once_and_keeps_comments(payscope: Payscope, old_file: Path) -> None:
    old_file.chmod(0o640)
    said = payscope("migrate", old_file)
    assert said.status == 0
    assert said.out == f"{old_file}: settings.acceleration -> settings.forces.acceleration\n"
    assert old_file.read_text() == OLD.replace("acceleration", "forces.acceleration")
    assert old_file.stat().st_mode & 0o777 == 0o640
    again = payscope("migrate", old_file)
    assert again.out == f"{old_file}: no old names\n"
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        load_machine(old_file)


def test_a_link_stays_a_link(tmp_path: Path, old_file: Path) -> None:
    link = tmp_path / "link.toml"
    link.symlink_to(old_file)
    assert migrate_toml_file(link)
    assert link.is_symlink()
    assert "forces.acceleration" in old_file.read_text()


@pytest.mark.parametrize(
    ("old", "new"),
    [
        pytest.param(
            "[settings]\n# why\nrate_hz = 50  # Hz\n",
            "[settings]\n# why\nalign.rate_hz = 50  # Hz\n",
            id="stays where it is",
        ),
        pytest.param(
            "[settings]\n# why\nrate_hz = 50  # Hz\n[settings.align]\n# gaps\ngap_periods = 3\n",
            "[settings]\n[settings.align]\n# why\nrate_hz = 50  # Hz\n# gaps\ngap_periods = 3\n",
            id="moves to the table there is, with its comments",
        ),
        pytest.param(
            "[settings.gate]\nindex = 'ksg'\n\n[settings]\nmethods = [  # two\n 'ls',\n]",
            "[settings.gate]\nindex = 'ksg'\n\n[settings]\ntrace.methods = [  # two\n 'ls',\n]",
            id="a list over several lines",
        ),
        pytest.param(
            "[settings]\ngate = 'ksg'\nthreshold_nat = 0.1\n",
            "[settings]\ngate.index = 'ksg'\ngate.threshold_nat = 0.1\n",
            id="a key that is a table now",
        ),
        pytest.param(
            "settings . \"rate_hz\" = 5\n", "settings.align.rate_hz = 5\n", id="dotted and quoted"
        ),
        pytest.param(
            "[settings]\r\nrate_hz=5\r\n", "[settings]\r\nalign.rate_hz=5\r\n", id="CRLF"
        ),
        pytest.param(
            "note = '''\n[settings]\nrate_hz = 1\n'''\n[settings]\nalign.gap_periods = 3\n",
            "note = '''\n[settings]\nrate_hz = 1\n'''\n[settings]\nalign.gap_periods = 3\n",
            id="what only looks like one stays",
        ),
    ],
)  # fmt: skip
def test_what_a_file_looks_like_afterwards(old: str, new: str) -> None:
    assert migrate_toml_text(old)[0] == new


@pytest.mark.parametrize(
    ("text", "why"),
    [
        ("[settings]\nrate_hz = 5\nalign.rate_hz = 4\n", "both are given"),
        ("settings = { rate_hz = 5 }\n", "rename it by hand"),
        ("[settings]\nsmooth_samples = 3\nsmooth = 1\n", "'smooth' already has a value"),
        ("[settings\n", "is not TOML"),
    ],
)
def test_what_a_person_has_to_settle_is_one_line_and_the_file_stays(
    payscope: Payscope, tmp_path: Path, text: str, why: str
) -> None:
    path = tmp_path / "m.toml"
    path.write_text(text)
    join_to_one_line(payscope("migrate", path), "m.toml", why)
    assert path.read_text() == text
    assert list(tmp_path.iterdir()) == [path]


def test_both_names_are_refused_when_a_log_is_replayed(
    payscope: Payscope, log: Path, old_file: Path
) -> None:
    old_file.write_text(f'{OLD}forces.acceleration = "kinematic"\n')
    join_to_one_line(payscope("run", log, "-m", old_file), "old.toml", "both are given")


def test_no_such_file_is_one_line(payscope: Payscope, tmp_path: Path) -> None:
    join_to_one_line(payscope("migrate", tmp_path / "no.toml"), "no.toml", "cannot be read")
    with pytest.raises(MachineError):
        migrate_toml_file(tmp_path)


def test_explain_applies_a_proposal_to_a_file_with_old_names() -> None:
    """Test: the proposal's key has its old name in the file. Expected: one key, both comments."""
    text = "[settings]\nrate_hz = 50  # grid\nexclude_braking = true  # mine\n"
    change = Proposal("settings.gate.exclude_braking", False, "braking", "the force sees it")
    mended = insert_proposals_into_machine_file(text, [change], Path("m.toml"))
    assert tomllib.loads(mended)["settings"] == {
        "align": {"rate_hz": 50},
        "gate": {"exclude_braking": False},
    }
    assert "# mine; payscope: the force sees it; it was true" in mended
    assert "# grid" in mended


def test_every_old_name_at_once_is_rewritten_to_the_same_values() -> None:
    text = "[settings]\n" + "".join(
        f"{old.removeprefix('settings.')} = {number}  # {old}\n"
        for number, old in enumerate(OLD_NAMES)
    )
    migrated, renamed = migrate_toml_text(text)
    assert renamed == OLD_NAMES
    content: dict[str, Any] = tomllib.loads(migrated)
    for number, new in enumerate(OLD_NAMES.values()):
        _, section, key = new.split(".")
        assert content["settings"][section][key] == number
    assert all(f"# {old}\n" in migrated for old in OLD_NAMES)

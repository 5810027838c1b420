"""The documentation tells the truth: commands run, outputs are real, links lead somewhere."""

import os
import re
import runpy
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest
import typer

from analysis.model.settings import Settings
from analysis.simulation import Scenario
from analysis.simulation.scenario.manoeuvres import Arc, Excite, Rest, Spin, Start
from analysis.simulation.scenario.shift_plan import SimulatedShift
from analysis.simulation.scenario.waveforms import ForceWave, TorqueWave
from replay.commands.cli import app

REPO = Path(__file__).resolve().parent.parent
#: At the top of the repository.
TOP = [REPO / name for name in ("README.md", "CONTRIBUTING.md", "CHANGELOG.md")]
PAGES = sorted([*TOP, *(REPO / "docs").rglob("*.md")])


def test_every_command_has_help_and_a_section_with_its_help() -> None:
    page = (REPO / "docs/commands.md").read_text(encoding="utf-8")
    # typer puts them together anew at every call
    commands = typer.main.get_command(app).commands  # pyright: ignore
    for name, command in commands.items():
        assert f"## `payscope {name}`" in page, (
            f"docs/commands.md: no section '## `payscope {name}`'; write it with a block of "
            f"`$ payscope {name} --help`, whose output python -P docs/update.py --quick writes"
        )
        assert command.help
        # the terminal wraps it, at its own width
        assert all("\n" not in each for each in command.help.split("\n\n"))
        for parameter in command.params:
            assert parameter.help or parameter.name == "help", f"{name} {parameter.name}"


def test_help_names_values_and_not_types_of_python() -> None:
    page = (REPO / "docs/commands.md").read_text(encoding="utf-8")
    helps = "".join(re.findall(r"```console\n\$ payscope [a-z -]+ --help\n.*?```", page, re.DOTALL))
    assert "Usage: payscope run [OPTIONS] LOG..." in helps
    assert not re.findall(r"<(?:bool|path|str|int|float|list)\b.*|\.{4,}|\{\w+\}", helps)


def test_the_index_of_decisions_has_every_record() -> None:
    index = runpy.run_path(str(REPO / "docs/decision_index.py"))
    written = index["INDEX"].read_text(encoding="utf-8")
    assert written == index["index"](), "python -P docs/decision_index.py writes it"


def test_the_tables_of_settings_and_keys_are_those_of_their_models() -> None:
    update = runpy.run_path(str(REPO / "docs/update.py"))
    for page in update["PAGES"]:
        written = page.read_text(encoding="utf-8")
        assert update["with_tables"](written) == written, (
            f"{page}: python -P docs/update.py --quick writes its tables"
        )


def test_the_api_reference_is_what_the_docstrings_say() -> None:
    reference = runpy.run_path(str(REPO / "docs/api_reference.py"))
    folder, pages = reference["FOLDER"], reference["pages"]()
    assert {path.name for path in folder.iterdir()} == set(pages)
    for name, text in pages.items():
        written = (folder / name).read_text(encoding="utf-8")
        assert written == text, f"{name}: python -P docs/api_reference.py writes it"


def test_every_public_name_is_in_the_api_reference() -> None:
    import payscope

    for name, module in (("payscope", payscope), ("online", payscope.online)):
        page = (REPO / f"docs/api/{name}.md").read_text(encoding="utf-8")
        for public in module.__all__:
            assert f"## `{module.__name__.replace('analysis', 'payscope')}.{public}`" in page


def assert_has_row(page: str, key: str, meaning: str | None) -> None:
    """Assert that a page has a row of a key, and that the key's field has a meaning."""
    rows = (REPO / page).read_text(encoding="utf-8").splitlines()
    assert any(row.startswith(f"| `{key}` |") for row in rows), (
        f"{page}: no row `{key}`; python -P docs/update.py --quick writes it"
    )
    assert meaning, f"{key}: its Field has no description"


def test_every_setting_is_documented_under_its_stage() -> None:
    page = "docs/machine-file.md"
    for stage, part in Settings.list_stage_models().items():
        for name, field in part.model_fields.items():
            assert_has_row(page, f"{stage}.{name}", field.description)


def test_every_key_of_a_scenario_is_documented_with_its_meaning() -> None:
    page = "docs/simulating.md"
    sections = [field.annotation for field in Scenario.model_fields.values()]
    models = [each for each in sections if isinstance(each, type)]
    models += [SimulatedShift, Rest, Start, Spin, Arc, Excite, ForceWave, TorqueWave]
    for model in models:
        for name, field in model.model_fields.items():  # pyright: ignore
            if name != "kind":
                assert_has_row(page, name, field.description)


def test_every_key_of_a_campaign_file_is_documented_with_its_meaning() -> None:
    from analysis.calibration.campaign import campaign_plan

    page = "docs/evidence.md"
    for model in (
        *(
            campaign_plan.EvidenceSubject,
            campaign_plan.CalibratedMachine,
            campaign_plan.ReferenceMass,
        ),
        *(campaign_plan.Conditions, campaign_plan.CampaignRun, campaign_plan.CampaignMethod),
        *(campaign_plan.StatedComponent, campaign_plan.CampaignLimits),
    ):
        for name, field in model.model_fields.items():
            assert_has_row(page, name, field.description)


def test_every_key_of_a_fleet_file_is_documented_with_its_meaning() -> None:
    from replay.fleet.last_run import TaskLimits
    from replay.fleet.machine_setups import FleetSection, MachineRule

    page = "docs/fleet.md"
    for model in (FleetSection, TaskLimits, MachineRule):
        for name, field in model.model_fields.items():
            assert_has_row(page, name, field.description)


@pytest.mark.heavy
@pytest.mark.parametrize(
    "pages",
    [
        pytest.param(["README.md"], id="of the readme"),
        pytest.param([], id="of every page", marks=pytest.mark.slow),
    ],
)
def test_every_command_in_the_documentation_gives_the_output_written_there(
    pages: list[str],
) -> None:
    left = subprocess.run(
        [sys.executable, REPO / "docs/update.py", "--check", *pages],
        capture_output=True,
        text=True,
        check=False,
        cwd=REPO,
    )
    assert left.returncode == 0, left.stdout + left.stderr


@pytest.mark.heavy
def test_the_library_example_of_the_readme_runs(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    from replay.simulation.simulate_logs import simulate_scenario_to_logs

    short = Scenario()
    short = short.model_copy(
        update={"campaign": short.campaign.model_copy(update={"loads_kg": (0.0,), "runs": 2})}
    )
    (tmp_path / "demo").mkdir()
    simulate_scenario_to_logs(short, tmp_path / "demo/campaign_000kg.bag")
    monkeypatch.chdir(tmp_path)
    text = (REPO / "README.md").read_text(encoding="utf-8")
    (example,) = re.findall(r"```python\n(.*?)```", text, re.DOTALL)
    names: dict[str, object] = {}
    exec(example, names)
    assert (tmp_path / "shift.rrd").exists()
    assert names["masses"].height > 0  # pyright: ignore


@pytest.mark.parametrize("page", PAGES, ids=lambda p: str(p.relative_to(REPO)))
def test_links_within_the_repository_lead_somewhere(page: Path) -> None:
    text = page.read_text(encoding="utf-8")
    for target, heading in re.findall(r"\]\((?!https?:)([^)#]*)#?([^)]*)\)", text):
        found = page.parent / target if target else page
        assert found.exists(), f"{page}: {target}"
        assert not heading or heading in _anchors(found), f"{page}: {target}#{heading}"


def _anchors(page: Path) -> set[str]:
    """Anchors of a page's headings, as they are made where it is shown."""
    headings = re.findall(r"^#+ (.+)$", page.read_text(encoding="utf-8"), re.M)
    return {re.sub(r"[^\w\- ]", "", each.lower()).replace(" ", "-") for each in headings}


def _prose(text: str) -> Iterator[str]:
    """Lines of a page but for headings, tables, code, and what programs write between markers."""
    code, end = False, ""
    for line in text.splitlines():
        marker = re.match("<!-- (.+) -->", line)
        if line.lstrip().startswith("```"):
            code = not code
        elif end:
            end = "" if line == end else end
        elif marker and f"<!-- end of {marker[1]} -->" in text:
            end = f"<!-- end of {marker[1]} -->"
        elif not code and not line.startswith(("#", "|")):
            yield line


@pytest.mark.parametrize(
    "page",
    # programs write the others
    [page for page in PAGES if page.parent.name not in {"api", "reproduction"}],
    ids=lambda p: str(p.relative_to(REPO)),
)
def test_paragraphs_are_wrapped_at_100_characters(page: Path) -> None:
    long = [line for line in _prose(page.read_text(encoding="utf-8")) if len(line) > 100]
    # an address or a link is not cut
    assert not [line for line in long if " " in line.strip()[:100]], "wrap these at 100 characters"


def test_every_example_machine_file_is_valid() -> None:
    from analysis.calibration.campaign.campaign_plan import CalibrationCampaign
    from estimators.errors import CampaignError
    from replay import load_machine
    from replay.fleet.machine_setups import load_fleet
    from replay.machines.toml_file import read_toml_file, validate_toml_content
    from replay.simulation.scenario_file import load_scenario_file

    for path in sorted((REPO / "examples").glob("*.toml")):
        if path.name in ("campaign.toml", "inertia.toml", "planar.toml", "shift.toml"):
            load_scenario_file(path)
        elif path.name == "fleet.toml":
            load_fleet(path)
        elif path.name == "calibration.toml":
            validate_toml_content(
                path, read_toml_file(path, CampaignError), CalibrationCampaign, CampaignError
            )
        else:
            load_machine(path)


#: What tools leave beside the sources; never part of a release.
MADE = {REPO / name for name in ("dist", "demo", "build")}


def tracked() -> set[Path]:
    """The files of this git checkout, empty where it is none."""
    if not (REPO / ".git").exists():
        return set()
    listed = subprocess.run(
        ["git", "ls-files", "-z"], capture_output=True, text=True, cwd=REPO, check=True
    )
    paths = {REPO / name for name in filter(None, listed.stdout.split("\0"))}
    return {path for path in paths if path.is_file()}


def beside() -> set[Path]:
    """The files of this folder, also where it is an unpacked release."""
    found: set[Path] = set()
    for folder, inside, files in os.walk(REPO):
        here = Path(folder)
        inside[:] = [name for name in inside if not is_made(here / name)]
        found |= {here / name for name in files if not is_made(here / name)}
    return found


def is_made(path: Path) -> bool:
    hidden = path.name.startswith(".") and path.name not in (".ci", ".gitignore")
    return hidden or path.name == "__pycache__" or path in MADE


def test_no_file_names_a_package_index_or_a_path_of_the_makers_machine() -> None:
    index = re.compile(r"(pypi\.org|pythonhosted|/simple/|/packages/[0-9a-f]{2}/)")
    files = tracked() or beside()
    assert {REPO / "README.md", REPO / "pyproject.toml", Path(__file__)} <= files
    for path in sorted(files):
        if path.suffix in (".png", ".rrd", ".mcap", ".xz") or path == Path(__file__):
            continue
        assert not index.search(path.read_text(encoding="utf-8")), path
    assert REPO / "uv.lock" not in files


def test_without_git_no_file_of_the_checkout_is_left_out() -> None:
    assert tracked() <= beside()

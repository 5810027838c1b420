"""The page of a fleet in a real browser: one file, sortable, accessible, also on a phone."""

import json
import shutil
from pathlib import Path
from typing import Any

import pytest

from benchmarks.fleet_size import make
from replay.fleet.gathered_tables import open_results_of_fleet
from replay.fleet.write_fleet_page import FleetReport, write_fleet_report
from tests.replay.shift_review import HOSTILE

pytestmark = pytest.mark.heavy

PHONE, DESK = 380, 1280
SCREENS = [(PHONE, "light"), (PHONE, "dark"), (DESK, "light"), (DESK, "dark")]


@pytest.fixture(scope="module")
def report(tmp_path_factory: pytest.TempPathFactory) -> FleetReport:
    """Of four machines, of which the fourth's zero creeps, and a stranger's texts."""
    folder = tmp_path_factory.mktemp("page")
    make(folder / "results", 4, 45)
    (folder / "results/failed.json").write_text(json.dumps({HOSTILE: "hangs"}))
    results = open_results_of_fleet(str(folder / "results"))
    page = folder / "fleet.html"
    return write_fleet_report(results, "dest", HOSTILE, page, friction_limit_N_s_m=5000.0)


@pytest.fixture(scope="module")
def page_file(report: FleetReport) -> Path:
    return report.path


@pytest.mark.parametrize("opened", SCREENS, indirect=True, ids=lambda s: f"{s[0]} {s[1]}")
def test_the_page_needs_nothing_complains_of_nothing_and_is_accessible(
    opened: Any, page_file: Path
) -> None:
    from axe_playwright_python.sync_playwright import Axe

    assert opened.asked == [page_file.as_uri()]
    found = Axe().run(opened).response["violations"]
    assert not [each["id"] for each in found if each["impact"] in ("serious", "critical")]
    assert not opened.complaints
    assert opened.evaluate("document.documentElement.scrollWidth") <= opened.viewport_size["width"]
    assert HOSTILE in opened.evaluate("document.querySelector('h1').textContent")


@pytest.mark.parametrize("opened", [(DESK, "light")], indirect=True)
def test_every_table_sorts_and_every_command_is_copied(opened: Any) -> None:
    from playwright.sync_api import expect

    for name, head, column in (
        ("machines", "tonnes", 3),
        ("looks", "day", 2),
        ("weeks", "machine", 0),
    ):
        opened.locator(f"#{name} th button", has_text=head).first.click()
        cells = opened.evaluate(
            f"[...document.querySelectorAll('#{name} tbody tr')].map(r => r.cells[{column}]."
            "dataset.v ?? r.cells[" + str(column) + "].textContent)"
        )
        assert cells == sorted(cells, key=float if name == "machines" else str)
    copy = opened.locator("#looks .copy").first
    copy.click()
    expect(opened.locator("#said")).to_have_text(f"copied: {copy.text_content()}")
    assert opened.evaluate("navigator.clipboard.readText()").startswith("payscope fleet open dest ")


@pytest.mark.heavy
@pytest.mark.parametrize("opened", [(DESK, "light")], indirect=True)
def test_drifts_are_drawn_and_figures_and_tables_have_names(opened: Any) -> None:
    titles = opened.evaluate(
        '[...document.querySelectorAll("svg")].map(s => s.querySelector("title").textContent)'
    )
    assert titles[0] == "unit-04: zero"
    assert titles[-1] == "Tonnes by week"
    assert opened.evaluate(
        'document.querySelectorAll("table").length == document.querySelectorAll("caption").length'
    )


@pytest.mark.heavy
def test_what_is_said_as_json_is_what_the_page_shows(report: FleetReport) -> None:
    said = report.to_dict()
    text = report.path.read_text(encoding="utf-8")
    assert f"{said['sum']['loads']:,} loads by 4 machines" in text
    assert [each["machine"] for each in said["drifts"] if each["of"] == "zero"] == ["unit-04"]
    assert said["without_a_result"] == {HOSTILE: "hangs"}
    assert set(said["friction"]) == {each["machine"] for each in said["machines"]}
    assert "<h2>Friction</h2>" in text
    assert HOSTILE not in text
    assert report.path.stat().st_size < 200_000


@pytest.mark.slow
def test_a_report_of_recordings_without_a_date_or_a_load_is_a_page_as_well(
    kept: Path, tmp_path: Path
) -> None:
    copy = shutil.copytree(kept, tmp_path / "results")
    made = write_fleet_report(
        open_results_of_fleet(str(copy)), "dest", "small", tmp_path / "fleet.html"
    )
    assert "No tonnes: no cycle of 3 machines has a mass" in made.path.read_text(encoding="utf-8")

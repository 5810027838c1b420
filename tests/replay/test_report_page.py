"""The report in a real browser: one file, nothing asked of anybody, readable by everybody."""

from pathlib import Path
from typing import Any

import pytest

from recordings.calibration.bundle_folder import REPORT
from replay.calibration.calibrate_campaign import calibrate_from_campaign
from tests.replay.sledge_campaign import campaign_folder

pytestmark = pytest.mark.usefixtures("kept_replays", "without_pdf")

PHONE, DESK = 380, 1280


@pytest.fixture(scope="module")
def page_file(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("report")
    campaign = campaign_folder(folder / "campaign", extra='excluded = "wheel slip"\n')
    calibrate_from_campaign(campaign, folder / "evidence")
    return folder / "evidence" / REPORT


SCREENS = [(PHONE, "light"), (PHONE, "dark"), (DESK, "light"), (DESK, "dark")]


@pytest.mark.parametrize("opened", SCREENS, indirect=True, ids=lambda s: f"{s[0]} {s[1]}")
def test_the_page_needs_nothing_complains_of_nothing_and_is_accessible(
    opened: Any, page_file: Path
) -> None:
    from axe_playwright_python.sync_playwright import Axe

    assert opened.asked == [page_file.as_uri()]
    found = Axe().run(opened).response["violations"]
    serious = [each["id"] for each in found if each["impact"] in ("serious", "critical")]
    assert not serious
    assert not opened.complaints


@pytest.mark.heavy
@pytest.mark.parametrize("opened", [(PHONE, "light")], indirect=True)
def test_on_a_phone_the_page_scrolls_down_only_and_its_texts_can_be_read(opened: Any) -> None:
    assert opened.evaluate("document.documentElement.scrollWidth") <= PHONE
    # of a figure as it is on the screen
    smallest = opened.evaluate(
        """Math.min(...[...document.querySelectorAll("svg text")]
           .map(text => text.getBoundingClientRect().height))"""
    )
    assert smallest >= 10.0
    # nothing of a figure is cut off
    cut = opened.evaluate(
        """[...document.querySelectorAll("svg")].flatMap(svg => {
           const edge = svg.getBoundingClientRect();
           return [...svg.querySelectorAll("text")].filter(text => {
             const box = text.getBoundingClientRect();
             return box.left < edge.left - 1 || box.right > edge.right + 1
               || box.bottom > edge.bottom + 1 }).map(text => text.textContent) })"""
    )
    assert cut == []


@pytest.mark.heavy
@pytest.mark.parametrize("opened", [(DESK, "light")], indirect=True)
def test_every_table_and_figure_has_a_name(opened: Any) -> None:
    assert opened.evaluate(
        'document.querySelectorAll("table").length == document.querySelectorAll("caption").length'
    )
    figures = opened.evaluate(
        '[...document.querySelectorAll("svg")].map(s => s.querySelector("title").textContent)'
    )
    assert figures[0] == "Calibrated against reference mass"
    assert len(figures) == 4
    text = opened.evaluate("document.body.innerText")
    assert "UNSIGNED" in text
    assert "excluded: wheel slip" in text

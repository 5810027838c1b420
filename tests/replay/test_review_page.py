"""The page of a review in a real browser: one file, sortable and copied from by mouse and keys."""

from pathlib import Path
from typing import Any

import pytest

from replay.review.review_shift import ReviewOptions, review_shift
from tests.replay.shift_review import HOSTILE, shift_folder

pytestmark = pytest.mark.usefixtures("kept_replays")

PHONE, DESK = 380, 1280
SCREENS = [(PHONE, "light"), (PHONE, "dark"), (DESK, "light"), (DESK, "dark")]


@pytest.fixture(scope="module")
def page_file(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("page")
    logs, machine, _ = shift_folder(folder)
    made = review_shift(logs, machine, folder / "review", ReviewOptions(target_kg=700.0))
    return made.folder / "review.html"


@pytest.mark.parametrize("opened", SCREENS, indirect=True, ids=lambda s: f"{s[0]} {s[1]}")
def test_the_page_needs_nothing_complains_of_nothing_and_is_accessible(
    opened: Any, page_file: Path
) -> None:
    from axe_playwright_python.sync_playwright import Axe

    assert opened.asked == [page_file.as_uri()]
    for act in ("#fold summary", "#cycles [data-act=product]"):
        opened.locator(act).first.click()
        found = Axe().run(opened).response["violations"]
        assert not [each["id"] for each in found if each["impact"] in ("serious", "critical")]
    assert not opened.complaints
    assert HOSTILE in opened.evaluate("document.querySelector('h1').textContent")


@pytest.mark.parametrize("opened", [(PHONE, "light")], indirect=True)
def test_on_a_phone_the_page_scrolls_down_only_and_its_texts_can_be_read(opened: Any) -> None:
    assert opened.evaluate("document.documentElement.scrollWidth") <= PHONE
    cut = opened.evaluate(
        """[...document.querySelectorAll("svg")].flatMap(svg => {
           const edge = svg.getBoundingClientRect();
           return [...svg.querySelectorAll("text")].filter(text => {
             const box = text.getBoundingClientRect();
             return box.left < edge.left - 1 || box.right > edge.right + 1
               || box.bottom > edge.bottom + 1 || box.height < 10
           }).map(text => text.textContent) })"""
    )
    assert cut == []


def cycles_shown(page: Any) -> list[str]:
    return page.evaluate(
        "[...document.querySelectorAll('#cycles tbody tr')]"
        ".filter(r => !r.hidden).map(r => r.cells[0].textContent)"
    )


@pytest.mark.parametrize("opened", [(DESK, "light")], indirect=True)
def test_a_cycle_is_found_by_the_clock_its_number_and_its_quality(opened: Any) -> None:
    opened.click("#fold summary")
    everything = cycles_shown(opened)
    dumped = opened.locator("#cycles tbody tr .day").nth(1).evaluate("c => c.firstChild.data")
    begins = opened.locator("#cycles tbody tr .day").nth(0).evaluate("c => c.firstChild.data")
    hour, minute, second = map(int, begins.split()[0].split(":"))
    under_way = f"{hour:02d}:{minute:02d}:{second + 2:02d}" if second < 58 else begins.split()[0]
    for words, shown in (
        (dumped.split()[0], [everything[1]]),
        (under_way, [everything[1 if second < 58 else 0]]),
        ("2", ["2"]),
        ("no such word", []),
        ("", everything),
    ):
        opened.fill("#find", words)
        assert cycles_shown(opened) == shown, words


def payloads(page: Any) -> list[float]:
    cells = "[...document.querySelectorAll('#cycles tbody tr')].map(r => r.cells[2].textContent)"
    return [float(cell.replace(",", "")) for cell in page.evaluate(cells)]


@pytest.mark.parametrize("opened", [(DESK, "light")], indirect=True)
def test_the_table_is_sorted_by_mouse_and_by_keys(opened: Any) -> None:
    opened.click("#fold summary")
    head = opened.locator("#cycles th button", has_text="payload kg")
    head.click()
    assert payloads(opened) == sorted(payloads(opened))
    assert head.locator("..").get_attribute("aria-sort") == "ascending"
    head.focus()
    opened.keyboard.press("Enter")
    assert payloads(opened) == sorted(payloads(opened), reverse=True)
    assert "most first" in opened.locator("#said").text_content()


@pytest.mark.heavy
@pytest.mark.parametrize("opened", [(DESK, "light")], indirect=True)
def test_every_cycle_has_the_command_that_opens_it_copied_by_a_click_and_by_a_key(
    opened: Any,
) -> None:
    from playwright.sync_api import expect

    opened.click("#fold summary")
    commands = opened.locator("#cycles .copy")
    assert commands.count() == len(payloads(opened))
    for number, act in ((0, "click"), (1, "key")):
        one = commands.nth(number)
        if act == "click":
            one.click()
        else:
            one.focus()
            opened.keyboard.press("Space")
        expect(opened.locator("#said")).to_have_text(f"copied: {one.text_content()}")
        copied = opened.evaluate("navigator.clipboard.readText()")
        assert copied == one.text_content()
        assert copied.startswith("payscope view shift.rrd --at ")


@pytest.mark.heavy
@pytest.mark.parametrize("opened", [(DESK, "light")], indirect=True)
def test_figures_and_tables_have_names(opened: Any) -> None:
    figures = opened.evaluate(
        '[...document.querySelectorAll("svg")].map(s => s.querySelector("title").textContent)'
    )
    assert figures == [
        "Payloads over time",
        "Distribution of payloads",
        "Friction over the shift",
        "Share of time by the gate's reason",
        "Track",
    ]
    assert opened.evaluate(
        'document.querySelectorAll("table").length == document.querySelectorAll("caption").length'
    )

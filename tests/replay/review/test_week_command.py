"""`payscope review --week`: what reviews add up to, with their verdicts, and their page."""

import json
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import polars as pl
import pytest

from recordings.review.review_state import STATE, read_review_state
from recordings.review.shift_ledger import PARQUET
from replay.review.review_shift import ReviewOptions, review_shift
from tests.replay.shift_review import shift_folder, verdict
from tests.replay.sledge import Payscope, join_to_one_line
from tests.twins import mark_heavy_after

pytestmark = pytest.mark.usefixtures("kept_replays")

DAY_NS = 86_400 * 10**9


@pytest.fixture(scope="module")
def reviewed(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("shift")
    logs, machine, _ = shift_folder(folder)
    return review_shift(logs, machine, folder / "review", ReviewOptions()).folder


@pytest.fixture
def on_day(reviewed: Path, tmp_path: Path) -> Callable[..., Path]:
    """The same review as if its logs were of so many days later, with so much more friction."""

    def later(days: int, friction: float = 1.0) -> Path:
        folder = Path(shutil.copytree(reviewed, tmp_path / f"day{days}"))
        state = read_review_state(folder)
        assert state is not None
        value, std = state.friction
        assert value is not None
        moved = state.model_copy(
            update={
                "t0_unix_ns": state.t0_unix_ns + days * DAY_NS,
                "friction": (value * friction, std),
                "begins": f"day {days}",
            }
        )
        (folder / STATE).write_text(moved.model_dump_json(), encoding="utf-8")
        rows = pl.read_parquet(folder / PARQUET)
        times = pl.col("^.*_unix_ns$") + days * DAY_NS
        ends = pl.from_epoch(rows["end_unix_ns"] + days * DAY_NS, time_unit="ns")
        ids = ends.dt.truncate("1s").dt.strftime("%Y-%m-%dT%H:%M:%SZ").alias("id")
        rows.with_columns(times, ids).write_parquet(folder / PARQUET)
        return folder

    return later


def counted(folder: Path) -> pl.DataFrame:
    return pl.read_parquet(folder / PARQUET).filter("counted")


@pytest.mark.heavy
def test_a_week_is_the_sum_of_its_days(on_day: Callable[..., Path], payscope: Payscope) -> None:
    folders = [on_day(day) for day in range(3)]
    done = payscope("review", "--week", *map(str, folders), "--json")
    assert done.status == 0, done.err
    found = json.loads(done.out)
    loads = counted(folders[0])
    assert [day["loads"] for day in found["day"]] == [loads.height] * 3
    assert found["all"]["payload_kg"] == pytest.approx(3.0 * loads["payload_kg"].sum())
    # of one machine: what is common adds up as it is
    assert found["all"]["payload_u_kg"] > 1.9 * found["day"][0]["payload_u_kg"]
    assert found["all"]["kWh_per_t"] == pytest.approx(found["day"][0]["kWh_per_t"])


def test_a_verdict_on_a_review_is_in_the_week_and_on_its_page(
    on_day: Callable[..., Path], payscope: Payscope, tmp_path: Path
) -> None:
    folders = [on_day(day) for day in range(2)]
    said = verdict(counted(folders[1])["id"][0], "reject = true\n")
    (folders[1] / "verdicts.toml").write_text(said, encoding="utf-8")
    page = tmp_path / "week.html"
    done = payscope("review", "--week", *map(str, folders), "-o", str(page))
    assert done.status == 0, done.err
    assert ", 1 rejected" in done.out
    text = page.read_text(encoding="utf-8")
    assert "1 rejected, 0 with another verdict" in text
    assert 'href="day1/review.html"' in text
    again = payscope("review", "--week", *map(str, folders), "-o", str(page))
    assert again.status == 0
    assert page.read_text(encoding="utf-8") == text


def test_friction_that_rises_is_dated_and_such_as_does_not_is_not(
    on_day: Callable[..., Path], payscope: Payscope
) -> None:
    folders = [on_day(day, 1.0 + 0.1 * day / 6.0) for day in range(7)]
    state = read_review_state(folders[0])
    assert state is not None
    assert state.friction[0] is not None
    limit = f"{1.3 * state.friction[0]:.0f}"
    rising = payscope("review", "--week", *map(str, folders), "--friction-limit", limit)
    assert "(95 %)" in rising.out or "cannot be predicted" in rising.out
    few = payscope("review", "--week", *map(str, folders[:2]), "--friction-limit", limit)
    assert "cannot be predicted: 2 of at least 4 shifts" in few.out


@pytest.mark.parametrize(
    ("more", "says"),
    [
        (("-o", "week.txt"), "the page of a week is one file"),
        (("-o", "notes.html"), "is not a page of a week"),
        (("--target", "700"), "--week accepts only folders of reviews"),
        (("nowhere",), "holds no review"),
    ],
)
def test_wrong_words_are_one_line_and_write_nothing(
    on_day: Callable[..., Path],
    payscope: Payscope,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    more: tuple[str, ...],
    says: str,
) -> None:
    folder = on_day(0)
    monkeypatch.chdir(tmp_path)
    (tmp_path / "notes.html").write_text("<p>mine</p>", encoding="utf-8")
    done = payscope("review", "--week", str(folder), *more)
    join_to_one_line(done, says)
    assert (tmp_path / "notes.html").read_text(encoding="utf-8") == "<p>mine</p>"


def test_a_limit_of_the_friction_needs_a_week(reviewed: Path, payscope: Payscope) -> None:
    done = payscope("review", str(reviewed), "--friction-limit", "4000")
    assert done.status == 2
    assert "--week" in done.err


@pytest.mark.heavy
@pytest.mark.parametrize("scheme", mark_heavy_after(1, ["light", "dark"]))
def test_the_page_is_accessible_and_scrolls_down_only_on_a_phone(
    on_day: Callable[..., Path], payscope: Payscope, chromium: Any, tmp_path: Path, scheme: str
) -> None:
    from axe_playwright_python.sync_playwright import Axe

    folders = [on_day(day, 1.0 + 0.01 * day) for day in range(4)]
    page = tmp_path / "week.html"
    payscope("review", "--week", *map(str, folders), "-o", str(page), "--friction-limit", "4000")
    context = chromium.new_context(
        viewport={"width": 380, "height": 800}, color_scheme=scheme, offline=True
    )
    tab = context.new_page()
    asked: list[str] = []
    tab.on("request", lambda each: asked.append(each.url))
    tab.goto(page.as_uri())
    assert asked == [page.as_uri()]
    found = Axe().run(tab).response["violations"]
    assert not [each["id"] for each in found if each["impact"] in ("serious", "critical")]
    assert tab.evaluate("document.documentElement.scrollWidth") <= 380
    assert tab.locator("svg title").first.text_content().startswith("Friction of")
    context.close()

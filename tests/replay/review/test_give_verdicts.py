"""Verdicts by mouse, by keyboard and by the command line: each counts in the next review."""

import json
import shutil
from pathlib import Path
from typing import Any

import polars as pl
import pytest

from recordings.review.reviewer_verdicts import VERDICTS, read_verdict_file
from replay.review.review_shift import ReviewOptions, review_shift
from replay.review.write_review import ShiftReview
from tests.replay.shift_review import shift_folder, verdict
from tests.replay.sledge import Payscope, join_to_one_line

pytestmark = [pytest.mark.usefixtures("kept_replays"), pytest.mark.heavy]

DESK, PHONE = 1280, 380


@pytest.fixture(scope="module")
def reviewed(tmp_path_factory: pytest.TempPathFactory) -> ShiftReview:
    folder = tmp_path_factory.mktemp("shift")
    logs, machine, _ = shift_folder(folder)
    return review_shift(logs, machine, folder / "review", ReviewOptions(target_kg=700.0))


@pytest.fixture(scope="module")
def page_file(reviewed: ShiftReview) -> Path:
    return reviewed.folder / "review.html"


@pytest.fixture
def folder(reviewed: ShiftReview, tmp_path: Path) -> Path:
    """A copy of the review, to be judged."""
    return Path(shutil.copytree(reviewed.folder, tmp_path / "review"))


def rows(folder: Path) -> list[dict[str, Any]]:
    return pl.read_parquet(folder / "ledger.parquet").to_dicts()


def save(page: Any, folder: Path) -> None:
    """Press the page's button, and put what it saves into the folder."""
    with page.expect_download() as saved:
        page.locator("#save").click()
    assert saved.value.suggested_filename == VERDICTS
    saved.value.save_as(folder / VERDICTS)


@pytest.mark.parametrize("opened", [(DESK, "light"), (PHONE, "dark")], indirect=True)
def test_by_mouse(opened: Any, folder: Path, payscope: Payscope) -> None:
    opened.locator("#fold summary").click()
    second = opened.locator("#cycles tbody tr").nth(1)
    second.locator("[data-act=reject]").click()
    assert second.locator("[data-act=reject]").get_attribute("aria-pressed") == "true"
    second.locator("[data-act=note]").click()
    opened.locator("#ask-text").fill('hit the "wall" \\ kerb')
    opened.locator("#ask button[value=ok]").click()
    opened.locator("#save").click()
    assert "write your name first" in opened.locator("#said").text_content()
    opened.locator("#author").fill("R. Meier")
    save(opened, folder)
    assert payscope("review", folder).status == 0
    row = rows(folder)[1]
    assert (row["rejected"], row["counted"], row["author"]) == (True, False, "R. Meier")
    assert row["note"] == 'hit the "wall" \\ kerb'


@pytest.mark.parametrize("opened", [(DESK, "light")], indirect=True)
def test_by_keyboard(opened: Any, folder: Path, payscope: Payscope) -> None:
    def press(place: str, *keys: str) -> None:
        opened.locator(place).first.focus()
        for key in keys:
            opened.keyboard.press(key)

    press("#fold summary", "Enter")
    press("#cycles tbody tr [data-act=product]", "Enter")
    opened.keyboard.type("gravel")
    opened.keyboard.press("Enter")
    press("#cycles tbody tr [data-act=reject]", "Space")
    press("#cycles tbody tr [data-act=reject]", "Space")  # and takes it back
    press("#author")
    opened.keyboard.type("R. Meier")
    opened.locator("#save").focus()
    with opened.expect_download() as saved:
        opened.keyboard.press("Enter")
    saved.value.save_as(folder / VERDICTS)
    assert payscope("review", folder).status == 0
    row = rows(folder)[0]
    assert (row["product"], row["rejected"], row["author"]) == ("gravel", False, "R. Meier")
    assert "Tonnes by product" in (folder / "review.html").read_text(encoding="utf-8")


@pytest.mark.parametrize("opened", [(DESK, "light")], indirect=True)
def test_a_product_that_is_cancelled_is_no_verdict(opened: Any) -> None:
    opened.locator("#fold summary").click()
    opened.locator("#cycles tbody tr [data-act=product]").first.click()
    opened.locator("#ask-text").fill("gravel")
    opened.keyboard.press("Escape")
    assert opened.locator("#verdict-file").input_value() == ""


def test_what_a_person_wrote_stays_where_the_page_saves_the_file(
    chromium: Any, folder: Path, payscope: Payscope
) -> None:
    own = '# of the night shift, by phone\n[[shift]]\noperator = "A. Kim"  # not his brother\n'
    (folder / VERDICTS).write_text(own, encoding="utf-8")
    assert payscope("review", folder).status == 0
    tab = chromium.new_page()
    tab.goto((folder / "review.html").as_uri())
    tab.locator("#fold summary").click()
    tab.locator("#cycles [data-act=reject]").first.click()
    tab.locator("#author").fill("R. Meier")
    save(tab, folder)
    tab.close()
    assert (folder / VERDICTS).read_text(encoding="utf-8").startswith(own)
    assert payscope("review", folder).status == 0
    assert (rows(folder)[0]["rejected"], rows(folder)[0]["operator"]) == (True, "A. Kim")


@pytest.mark.parametrize("name", ["number", "id", "clock"])
def test_by_the_command_line(folder: Path, payscope: Payscope, name: str) -> None:
    third = rows(folder)[2]
    clock = third["local_time"].split()[0]
    when = {"number": third["cycle"], "id": third["id"], "clock": clock}[name]
    note = "bucket caught the wall"
    said = payscope("review", folder, "--reject", when, "--note", note, "--author", "R. Meier")
    assert said.status == 0
    row = rows(folder)[2]
    assert (row["rejected"], row["note"], row["author"]) == (True, note, "R. Meier")
    [verdict] = read_verdict_file(folder).cycle
    assert verdict.id == third["id"]


def test_a_cycle_that_is_accepted_again_gives_the_first_sums(
    reviewed: ShiftReview, folder: Path, payscope: Payscope
) -> None:
    payscope("review", folder, "--reject", 2, "--author", "R. Meier")
    payscope("review", folder, "--cycle", 2, "--product", "sand", "--author", "R. Meier")
    assert rows(folder)[1]["rejected"]  # a product takes no rejection back
    said = payscope("review", folder, "--accept", 2, "--author", "A. Kim", "--json")
    shift = json.loads(said.out)["shift"]
    assert shift == pytest.approx(dict(reviewed.shift))
    assert rows(folder)[1]["product"] == "sand"


def test_counting_anew_without_a_verdict_changes_no_number(
    reviewed: ShiftReview, folder: Path, payscope: Payscope
) -> None:
    payscope("review", folder)
    assert pl.read_parquet(folder / "ledger.parquet").equals(reviewed.ledger)
    assert not (folder / VERDICTS).exists()


def test_what_is_said_of_the_shift_is_on_all_cycles_but_those_that_say_otherwise(
    folder: Path, payscope: Payscope
) -> None:
    payscope("review", folder, "--operator", "A. Kim", "--product", "gravel")
    payscope("review", folder, "--cycle", 1, "--product", "sand", "--author", "R. Meier")
    table = pl.read_parquet(folder / "ledger.parquet")
    assert table["product"].to_list() == ["sand"] + ["gravel"] * (table.height - 1)
    assert (table["operator"] == "A. Kim").all()


def test_labels_of_a_part_of_the_shift_are_on_the_loads_dumped_in_it(
    folder: Path, payscope: Payscope
) -> None:
    payscope("review", folder, "--product", "gravel")
    times = [each["local_time"].split(" ")[0] for each in rows(folder)]
    # from the dump of the second load on, before that of the fourth
    said = payscope("review", folder, "--product", "sand", "--from", times[1], "--to", times[3])
    assert said.status == 0, said.err
    table = pl.read_parquet(folder / "ledger.parquet")
    assert table["product"].to_list()[:4] == ["gravel", "sand", "sand", "gravel"]
    week = json.loads(payscope("review", "--week", folder, "--json").out)
    assert {each["name"] for each in week["product"]} == {"gravel", "sand"}
    # what is said of the whole shift afterwards counts
    payscope("review", folder, "--product", "gravel")
    assert set(pl.read_parquet(folder / "ledger.parquet")["product"]) == {"gravel"}


def test_the_same_verdict_twice_is_written_once(folder: Path, payscope: Payscope) -> None:
    for _ in range(2):
        payscope("review", folder, "--truck", "17")
        payscope("review", folder, "--reject", 2, "--author", "R. Meier")
    assert (folder / VERDICTS).read_text(encoding="utf-8").count("[[") == 2


def test_what_a_person_wrote_into_the_file_stays(folder: Path, payscope: Payscope) -> None:
    own = "# mine\n" + verdict(rows(folder)[0]["id"], 'product = "sand"\n')
    (folder / VERDICTS).write_text(own, encoding="utf-8")
    payscope("review", folder, "--reject", 2, "--author", "R. Meier")
    text = (folder / VERDICTS).read_text(encoding="utf-8")
    assert text.startswith(own)
    assert text.count("[[cycle]]") == 2


def test_names_of_persons_and_customers_are_on_page_and_ledger_alone(
    folder: Path, payscope: Payscope
) -> None:
    payscope("review", folder, "--operator", "Xaver Kim", "--customer", "Yard & Sons")
    for name in ("shift.rrd", "review.json"):
        content = (folder / name).read_bytes()
        assert b"Xaver" not in content
        assert b"Sons" not in content
    assert "Yard &amp; Sons" in (folder / "review.html").read_text(encoding="utf-8")


@pytest.mark.parametrize(
    ("words", "part"),
    [
        (["--reject", "2"], "--author"),
        (["--reject", "99", "--author", "x"], "no cycle '99'"),
        (["--reject", "soon", "--author", "x"], "names no cycle"),
        (["--note", "x"], "--cycle"),
        (["--target", "700"], "-m and -o"),
        (["--reject", "2", "--author", "x" * 201], "author"),
        (["--product", "x" * 501], "product"),
        (["--product", "x", "--from", "noon"], "is not a time"),
        (["--product", "x", "--to", "03:00"], "no load is dumped"),
        (["--from", "19:20"], "--product"),
    ],
)
def test_wrong_words_are_one_line_and_change_nothing(
    folder: Path, payscope: Payscope, words: list[str], part: str
) -> None:
    before = (folder / "review.html").read_bytes()
    join_to_one_line(payscope("review", folder, *words), part)
    assert (folder / "review.html").read_bytes() == before
    assert not (folder / VERDICTS).exists()


def test_a_folder_that_is_no_review_needs_a_machine(tmp_path: Path, payscope: Payscope) -> None:
    join_to_one_line(payscope("review", tmp_path), "-m", "-o")


@pytest.mark.heavy
def test_a_review_whose_recording_was_changed_is_refused(folder: Path, payscope: Payscope) -> None:
    with (folder / "shift.rrd").open("ab") as recording:
        recording.write(b"x")
    join_to_one_line(payscope("review", folder), "review its logs again")


@pytest.mark.heavy
def test_a_review_whose_ledger_was_changed_is_refused(
    folder: Path, payscope: Payscope, tmp_path: Path
) -> None:
    ledger = folder / "ledger.parquet"
    payscope("review", folder, "--reject", "1", "--author", "A", "--note", "spilt")
    genuine = pl.read_parquet(ledger)
    for changed in (genuine.with_columns(pl.col("payload_kg") * 2), genuine[1:]):
        changed.write_parquet(ledger)
        for words in (("review", folder), ("review", "--week", folder, "-o", tmp_path / "w.html")):
            join_to_one_line(payscope(*words), "ledger.parquet: was changed", "review its logs")
    genuine.write_parquet(ledger)
    assert payscope("review", folder).status == 0

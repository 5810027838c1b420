"""A reviewer's questions, each answered on the page with two clicks at most."""

from itertools import product
from pathlib import Path
from typing import Any, NamedTuple

import pytest

from replay.review.give_verdicts import RequestedVerdicts, recount_review_with_verdicts
from replay.review.review_shift import ReviewOptions, review_shift
from tests.replay.shift_review import shift_folder
from tests.twins import mark_slow_after

pytestmark = [pytest.mark.usefixtures("kept_replays"), pytest.mark.heavy]

MOST_CLICKS = 2


class Question(NamedTuple):
    """What is asked, where it is clicked, what is typed into "Find", and where the answer stands.

    The answer is the first element that `place` names and that can be seen; it has `words` in it.
    """

    asked: str
    place: str
    words: str
    clicks: tuple[str, ...] = ()
    typed: str = ""


UNFOLD = "#fold summary"
ROW = "#cycles tbody tr:not([hidden])"
FACTS = "dl >> nth=0"
QUESTIONS = (
    Question("how many tonnes", ".headline", " ± "),
    Question("what did the torn log cost", ".warning:has-text('breaks off')", "is unknown"),
    Question("tonnes an hour", FACTS, "of recorded time"),
    Question("which load at 19:16", ROW, "19:16:48", (UNFOLD,), "19:16"),
    Question("why was it not counted", f"{ROW} .note", "caught the wall", (UNFOLD,), "rejected"),
    Question("which load is of gravel", f"{ROW} .said >> nth=1", "gravel", (UNFOLD,), "gravel"),
    Question("tonnes by product", "[aria-label='Tonnes by product']", "gravel"),
    Question("tonnes by operator", "[aria-label='Tonnes by operator']", "A. Kim"),
    Question("how do I reject one", "#said", "not saved yet", (UNFOLD, f"{ROW} [data-act=reject]")),
    Question("where is its recording", "#said", "copied: payscope", (UNFOLD, f"{ROW} .copy")),
    Question("when did it stand longest", FACTS, "idle (> 30 s)"),
    Question("how far is a haul", FACTS, "haul "),
    Question("energy of a tonne", FACTS, "kWh/t"),
    Question("where it goes", "[aria-label='Energy'] tbody", "friction"),
    Question("what is the ± worth", FACTS, "does not average out"),
    Question("which machine and clock", "h1 + .quiet", "America/Santiago"),
)


@pytest.fixture(scope="module")
def page_file(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("shift")
    logs, machine, _ = shift_folder(folder)
    made = review_shift(logs, machine, folder / "review", ReviewOptions())
    labels = {"product": "gravel", "operator": "A. Kim"}
    said = RequestedVerdicts(reject=["1"], note="bucket caught the wall", author="R. Meier")
    recount_review_with_verdicts(made.folder, said)
    recount_review_with_verdicts(made.folder, RequestedVerdicts(labels=labels))
    return made.folder / "review.html"


DESK, PHONE = (1280, "light"), (380, "dark")
#: Of a phone, what is clicked and typed; to scroll shows it the rest of the page.
ASKED = sorted(
    product(QUESTIONS, (DESK, PHONE)),
    key=lambda asked: asked[1] == PHONE and not asked[0].clicks,
)
SOON = len(QUESTIONS) + sum(bool(question.clicks) for question in QUESTIONS)


@pytest.mark.parametrize(
    ("question", "opened"),
    mark_slow_after(SOON, ASKED),
    indirect=["opened"],
    ids=lambda each: each.asked if isinstance(each, Question) else f"{each[0]}",
)
def test_it_is_answered(opened: Any, question: Question) -> None:
    assert len(question.clicks) <= MOST_CLICKS
    for place in question.clicks:
        opened.locator(place).first.click()
    if question.typed:
        opened.fill("#find", question.typed)
    answer = opened.locator(question.place).first
    # copying takes the browser a moment
    answer.wait_for(state="visible", timeout=5_000)
    assert question.words in answer.text_content()

"""The page by itself: its size, and that whatever a log brings is escaped."""

from html.parser import HTMLParser

import polars as pl
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from analysis.model.run_record import InputFile
from recordings.review.review_page import ReviewPage, UsedCalibration, render_review_html
from recordings.review.review_state import ReviewState, TopicSampling
from recordings.review.shift_ledger import add_motion_columns, make_ledger_frame
from tests.analysis.cycles.drawn import drawn_shift
from tests.analysis.cycles.test_cycles import found, summed

BAD = '"><img src=x onerror=alert(1)></script>'


def page(cycles: int, text: str) -> str:
    frames = drawn_shift([700.0] * cycles, noise_kg=20.0)
    state = ReviewState(
        key="",
        recording_sha256="",
        inputs=(InputFile(name=text, sha256="0" * 64, size_bytes=1),),
        resolved={},
        t0_unix_ns=1_700_000_000 * 10**9,
        machine=text,
        begins=text,
        can_weigh=True,
        failed=(),
        losses=(text,),
        notes=(text,),
        gate_shares={"accepted": 1.0},
        gaps_s=((10.0, 20.0),),
        sampling=(
            TopicSampling(topic=text, messages=1, rate_hz=None, longest_s=None, late_1=None),
        ),
        friction=(100.0, 1.0),
        digs=cycles,
    )
    rows = add_motion_columns(make_ledger_frame(found(frames), state.t0_unix_ns, {}), state)
    track = pl.DataFrame({"latitude_deg": [49.0, 49.001], "longitude_deg": [8.0, 8.001]})
    changes = [(text, text, text)]
    return render_review_html(
        ReviewPage(state, rows, summed(frames), None, changes, UsedCalibration(text, text), track)
    )


@pytest.mark.heavy
def test_the_231_cycles_of_a_shift_are_less_than_200_kilobytes() -> None:
    assert len(page(231, "log").encode()) < 200_000


def test_whatever_a_log_brings_is_escaped() -> None:
    shown = page(3, BAD)
    assert BAD not in shown
    assert shown.count("<img") == 0
    assert shown.count("<script>") == 1
    assert shown.count("&lt;img src=x") >= 8


class Elements(HTMLParser):
    """The elements of a page with the names of their attributes, and its texts."""

    def __init__(self, text: str) -> None:
        super().__init__(convert_charrefs=True)
        self.found: list[tuple[str, tuple[str, ...]]] = []
        self.texts: list[str] = []
        self.feed(text)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.found.append((tag, tuple(name for name, _ in attrs)))

    def handle_data(self, data: str) -> None:
        self.texts.append(data)


#: What a stranger may put into a name: markup, quotes, terminal sequences, writing that turns.
STRANGE = st.text(
    st.one_of(
        st.sampled_from("<>&\"'`{}%/=-!\\ \t\r\n\0\x07\x1b\x7f\x9b\u2028\u202e\u200b"),
        st.characters(exclude_categories=["Cs"]),
    ),
    min_size=1,
    max_size=40,
)
PLAIN = Elements(page(2, "plain"))


@pytest.mark.heavy
@settings(max_examples=20)
@given(STRANGE)
@example("{{ 7 * 7 }}")
@example("</style><style>*{display:none}")
@example("\x1b]0;title\x07\u202egnp.exe")
def test_no_name_adds_an_element_or_an_attribute_or_hides_anything(name: str) -> None:
    shown = Elements(page(2, name))
    assert shown.found == PLAIN.found
    assert not [c for text in shown.texts for c in text if not c.isprintable() and c != "\n"]

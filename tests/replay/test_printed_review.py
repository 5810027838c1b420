"""The page of a review on paper: two pages for a whole shift, the loads by the hour."""

import io
from pathlib import Path
from typing import Any

import pytest
from pypdf import PdfReader

from tests.recordings.review.test_review_page import page

#: DIN A4 in points.
A4_PT = (595, 842)


@pytest.mark.heavy
def test_a_shift_of_231_loads_is_two_pages_of_a4_and_says_the_hours(
    chromium: Any, tmp_path: Path
) -> None:
    file = tmp_path / "review.html"
    file.write_text(page(231, "shift.mcap"), encoding="utf-8")
    tab = chromium.new_page()
    tab.goto(file.as_uri())
    printed = PdfReader(io.BytesIO(tab.pdf(prefer_css_page_size=True)))
    tab.close()
    assert len(printed.pages) == 2
    assert [round(float(size)) for size in printed.pages[0].mediabox[2:]] == list(A4_PT)
    text = "".join(each.extract_text() for each in printed.pages)
    assert "231 cycles; ledger.xlsx in the folder of this page has each" in text
    assert "Your verdict" not in text
    assert "22:00 +00:00" in text

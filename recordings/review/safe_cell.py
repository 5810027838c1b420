"""Texts that a spreadsheet takes for texts."""

import re
from typing import Final

#: How a text begins that a spreadsheet computes.
FORMULA: Final = r"^[=+\-@\t\r]"


def safe_cell(text: str) -> str:
    """The text, behind an apostrophe where a spreadsheet would compute it."""
    return f"'{text}" if re.match(FORMULA, text) else text

"""Write the index of the decision records: `python -P docs/decision_index.py`.

A record that a later one cites was looked at again there: the index names both.
"""

import re
from pathlib import Path
from typing import Final

RECORDS: Final = Path(__file__).parent / "decisions"
INDEX: Final = RECORDS / "README.md"
_TITLE: Final = re.compile(r"# (\d{4}):? (.+)")
#: Where records cite one another: by file, or by number in brackets or prose.
_CITED: Final = re.compile(r"\b(00\d{2})\b")
_HEAD: Final = """# Decisions

Choices that someone may want to undo, each with its reasons and figures. All hold as written, but
for what a later record says on the same matter.

| record | what was decided | looked at again in |
|---|---|---|
"""


def index() -> str:
    """The page, from the records' titles and citations."""
    texts = {path: path.read_text(encoding="utf-8") for path in sorted(RECORDS.glob("[0-9]*-*.md"))}
    rows: list[str] = []
    for path, text in texts.items():
        title = _TITLE.match(text)
        if title is None:
            raise SystemExit(f"{path}: begins with no '# NNNN title'")
        later = [
            f"[{other.name[:4]}]({other.name})"
            for other, said in texts.items()
            if other.name > path.name and title[1] in _CITED.findall(said)
        ]
        rows.append(f"| [{title[1]}]({path.name}) | {title[2]} | {', '.join(later)} |\n")
    return _HEAD + "".join(rows)


if __name__ == "__main__":
    INDEX.write_text(index(), encoding="utf-8")

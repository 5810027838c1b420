"""Words: what is said is said as an engineer elsewhere would say it (docs/glossary.md)."""

import re
from pathlib import Path

import pytest
import typer

from replay.commands.cli import app

REPO = Path(__file__).resolve().parent.parent
#: Phrases that were found hard to read, and what to write instead.
AVOID = {
    r"\bwhose each\b": "index of …",
    r"\bnobody wants\b": "not requested",
    r"\bcame upon\b": "is reported",
    r"\bwho takes the\b": "the consumer",
    r"\bis told as\b": "leaks into",
    r"\btells? no (mass|inertia)\b": "no mass estimate: …",
    r"\bof which bytes\b": "with missing bytes",
    r"\bof whom\b": "name it",
}
TEXTS = sorted(
    path
    for folder in ("estimators", "analysis", "recordings", "replay", "docs", "benchmarks")
    for path in (REPO / folder).rglob("*")
    if path.suffix in (".py", ".md") and "decisions" not in path.parts
)
#: A sentence that opens with one of these leaves its subject to be guessed.
FREE_OPENINGS = ("What", "Who", "Whose", "Whatever", "Of")


@pytest.mark.parametrize("path", TEXTS, ids=lambda p: str(p.relative_to(REPO)))
def test_no_text_has_a_phrase_to_avoid(path: Path) -> None:
    text = " ".join(path.read_text(encoding="utf-8").split())
    found = {
        match[0]: better
        for phrase, better in AVOID.items()
        if (match := re.search(phrase, text, re.IGNORECASE))
    }
    assert not found, f"{path.relative_to(REPO)}: {found}"


def test_a_phrase_to_avoid_is_found() -> None:
    for phrase in ("index, whose each is", "mass is told as inertia", "the spins tell no inertia"):
        assert any(re.search(pattern, phrase) for pattern in AVOID)


def test_help_texts_name_their_subject_and_end_in_a_full_stop() -> None:
    commands = typer.main.get_command(app).commands  # pyright: ignore
    for name, command in commands.items():
        texts = [(name, str(command.help).partition("\n")[0])]
        texts += [(f"{name} {p.name}", p.help) for p in command.params if p.name != "help"]
        for where, text in texts:
            assert text.split()[0] not in FREE_OPENINGS, f"{where}: {text}"
            assert text.endswith("."), f"{where}: {text}"


def test_every_name_in_the_glossary_is_in_the_code() -> None:
    sources = "\n".join(p.read_text(encoding="utf-8") for p in TEXTS if p.suffix == ".py")
    rows = re.findall(r"^\|[^|]+\|[^|]+\|([^|]+)\|$", (REPO / "docs/glossary.md").read_text(), re.M)
    names = [name for row in rows for name in re.findall(r"`([\w.]+)`", row)]
    assert len(names) > 30
    for name in names:
        assert re.search(rf"\b{re.escape(name.rpartition('.')[2])}\b", sources), name

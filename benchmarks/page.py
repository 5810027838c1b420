"""Put a measured table where the documentation shows it."""

from pathlib import Path

_DOCS = Path(__file__).resolve().parent.parent / "docs"


def markdown(head: list[str], rows: list[list[str]]) -> str:
    """A table."""
    lines = [head, ["---"] * len(head), *rows]
    return "\n".join(f"| {' | '.join(cells)} |" for cells in lines)


def put(page: str, name: str, text: str) -> None:
    """Replace what stands between `<!-- name -->` and `<!-- end of name -->` in docs/page."""
    path = _DOCS / page
    before, found, rest = path.read_text(encoding="utf-8").partition(f"<!-- {name} -->\n")
    _, ended, after = rest.partition(f"<!-- end of {name} -->")
    if not found or not ended:
        raise SystemExit(f"{path}: no place marked <!-- {name} --> … <!-- end of {name} -->")
    path.write_text(f"{before}{found}{text}\n{ended}{after}", encoding="utf-8")

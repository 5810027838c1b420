"""Writing what was found: `reproduction.md`, or CSV files, and the pictures, all or none."""

from collections.abc import Sequence
from importlib.resources import files
from pathlib import Path
from typing import Final

import polars as pl

from analysis.reproduction.item import Item
from estimators.errors import OutputError
from recordings.output import check_output, staged
from recordings.reproduction.figures import DRAWN, draw
from recordings.reproduction.tables import shown

#: The page that holds every item.
PAGE: Final = "reproduction.md"
#: What is to be said of every item, beside the CSV files.
SENTENCES: Final = "findings.csv"


def check_reproduction(
    names: Sequence[str], folder: Path, output_format: str, *, force: bool
) -> None:
    """Refuse the outputs before the work that they are for; the folder is made where there is none.

    Raises:
        OutputError: one of them is there already, or the folder cannot be written to.
    """
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise OutputError(f"{folder}: cannot be made ({error.strerror})") from error
    for path in _targets(names, folder, output_format):
        check_output(path, force=force)


def write_reproduction(
    items: Sequence[Item], folder: Path, output_format: str, about: str, *, force: bool
) -> list[Path]:
    """Write what was found.

    Args:
        items: tables, figures, claims.
        folder: where to.
        output_format: "md" for one page with every table and sentence, "csv" for a file an item
            with every number and one with the sentences; pictures with both.
        about: a sentence on how it was found.
        force: whether to replace what is there.

    Returns:
        The files.

    Raises:
        OutputError: one of them is there already, or cannot be written.
    """
    targets = _targets([item.name for item in items], folder, output_format)
    with staged(targets, force=force) as stage:
        for item in items:
            if item.name in DRAWN:
                draw(item, stage / _picture(item.name))
        if output_format == "md":
            (stage / PAGE).write_text(_page(items, about), encoding="utf-8")
        else:
            for item in items:
                item.frame.write_csv(stage / f"{item.name}.csv")
            _sentences(items, about).write_csv(stage / SENTENCES)
    return targets


def _targets(names: Sequence[str], folder: Path, output_format: str) -> list[Path]:
    written = [PAGE] if output_format == "md" else [*(f"{n}.csv" for n in names), SENTENCES]
    return [folder / name for name in (*written, *(_picture(n) for n in names if n in DRAWN))]


def _picture(name: str) -> str:
    return f"{name}.png"


def _page(items: Sequence[Item], about: str) -> str:
    from jinja2 import Environment, StrictUndefined

    # Markdown for a reader, not HTML for a browser: nothing to escape
    environment = Environment(undefined=StrictUndefined, keep_trailing_newline=True)  # noqa: S701
    source = files("recordings.reproduction").joinpath("page.md.j2").read_text(encoding="utf-8")
    sections = [
        (item, shown(item), _picture(item.name) if item.name in DRAWN else None) for item in items
    ]
    return environment.from_string(source).render(about=about, sections=sections)


def _sentences(items: Sequence[Item], about: str) -> pl.DataFrame:
    rows = [("", "about", about)]
    for item in items:
        rows += [(item.name, "finding", sentence) for sentence in item.findings]
        rows += [(item.name, "choice", sentence) for sentence in item.choices]
    return pl.DataFrame(rows, schema=["item", "kind", "sentence"], orient="row")

"""Write the results: `reproduction.md` or CSV files, and the pictures; all of them or none."""

from collections.abc import Sequence
from importlib.resources import files
from pathlib import Path
from typing import Any, Final

import polars as pl

from estimators.errors import OutputError
from recordings.paper.paper_items import Item, ItemResult
from recordings.paper.paper_pictures import draw_paper_figure
from recordings.report.atomic_output import require_writable_output, stage_output_files

#: File name of the page with every item.
PAGE: Final = "reproduction.md"
#: File name of the sentences on all items, beside the CSV files.
SENTENCES: Final = "findings.csv"


def require_writable_reproduction_folder(
    items: Sequence[Item[Any]], folder: Path, output_format: str, *, overwrites: bool
) -> None:
    """Raise an error before any work if an output cannot be written; create a missing folder.

    Raises:
        OutputError: an output exists, or the folder cannot be written to.
    """
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise OutputError(f"{folder}: cannot be created ({error.strerror})") from error
    for path in _list_output_paths(items, folder, output_format):
        require_writable_output(path, overwrites=overwrites)


def write_reproduction(
    item_results: Sequence[ItemResult],
    folder: Path,
    output_format: str,
    introduction: str,
    *,
    overwrites: bool,
) -> list[Path]:
    """Write the reproduction of the paper.

    Args:
        item_results: results of tables, figures and claims.
        folder: output folder.
        output_format: "md" for one page with every table and sentence, "csv" for a file per
            item with every number and one with the sentences; pictures with both.
        introduction: sentence on how the results were obtained.
        overwrites: whether to replace existing files.

    Returns:
        Paths of the files.

    Raises:
        OutputError: an output exists, or cannot be written.
    """
    targets = _list_output_paths([each.item for each in item_results], folder, output_format)
    with stage_output_files(targets, overwrites=overwrites) as stage:
        for each in item_results:
            if each.item.picture:
                draw_paper_figure(
                    each.item.picture, each.frame, stage / _make_picture_file_name(each.item)
                )
        if output_format == "md":
            (stage / PAGE).write_text(
                _render_page_markdown(item_results, introduction), encoding="utf-8"
            )
        else:
            for each in item_results:
                each.frame.write_csv(stage / f"{each.item.name}.csv")
            _make_frame_of_sentences(item_results, introduction).write_csv(stage / SENTENCES)
    return targets


def _list_output_paths(items: Sequence[Item[Any]], folder: Path, output_format: str) -> list[Path]:
    tables = [f"{item.name}.csv" for item in items]
    written = [PAGE] if output_format == "md" else [*tables, SENTENCES]
    return [
        folder / name
        for name in (*written, *(_make_picture_file_name(i) for i in items if i.picture))
    ]


def _make_picture_file_name(item: Item[Any]) -> str:
    return f"{item.name}.png"


def _render_page_markdown(item_results: Sequence[ItemResult], introduction: str) -> str:
    from jinja2 import Environment, StrictUndefined

    # Markdown for readers, not HTML for browsers, needs no escaping
    environment = Environment(undefined=StrictUndefined, keep_trailing_newline=True)  # noqa: S701
    source = files("recordings.paper").joinpath("page.md.j2").read_text(encoding="utf-8")
    sections = [
        {
            "title": each.item.title,
            "picture": _make_picture_file_name(each.item) if each.item.picture else None,
            "tables": each.item.tables(each.frame),
            "findings": each.sentences.findings,
            "choices": each.sentences.choices,
        }
        for each in item_results
    ]
    return environment.from_string(source).render(about=introduction, sections=sections)


def _make_frame_of_sentences(item_results: Sequence[ItemResult], introduction: str) -> pl.DataFrame:
    rows = [("", "about", introduction)]
    for each in item_results:
        rows += [(each.item.name, "finding", sentence) for sentence in each.sentences.findings]
        rows += [(each.item.name, "choice", sentence) for sentence in each.sentences.choices]
    return pl.DataFrame(rows, schema=["item", "kind", "sentence"], orient="row")

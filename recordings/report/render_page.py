"""Render an HTML page as one file with its style and script, without network access."""

import base64
import hashlib
from collections.abc import Sequence
from functools import cache
from importlib.metadata import version
from importlib.resources import files
from typing import TYPE_CHECKING, Any, Final

from estimators.errors import join_to_one_line
from recordings.report.number_text import format_number
from recordings.report.svg_shapes import WIDTH

if TYPE_CHECKING:
    from jinja2 import Environment

_HERE: Final = "recordings.report"
_PAGE: Final = "page.html.j2"
_MACROS: Final = "macros.html.j2"
_SCRIPT: Final = "page.js"
_TEMPLATES: Final = ".html.j2"
_PLACE: Final = "/* page.js */"


def render_page_html(
    template_package: str, template: str, *, scripts: Sequence[str] = (), **values: Any
) -> str:
    """Render a page, with all text escaped.

    Args:
        template_package: package with the template and its includes.
        template: name of the template, which fills the block of `page.html.j2`.
        scripts: names of the page's scripts in the package.
        values: values that the template shows.
    """
    environment, digest = load_templates_and_script_digest(template_package, tuple(scripts))
    return environment.get_template(template).render(
        width=WIDTH, version=version("payscope"), script_hash=f"sha256-{digest}", **values
    )


@cache
def load_templates_and_script_digest(
    package: str, scripts: tuple[str, ...]
) -> "tuple[Environment, str]":
    """Load the templates of a package, and compute the digest of the page's script."""
    from jinja2 import DictLoader, Environment, StrictUndefined

    # the files are our own and part of the template, without text from a log
    here = files(_HERE)
    own_scripts = [files(package).joinpath(name) for name in scripts]
    code = "".join(
        each.read_text(encoding="utf-8") for each in (here.joinpath(_SCRIPT), *own_scripts)
    )
    page = here.joinpath(_PAGE).read_text(encoding="utf-8").replace(_PLACE, code)
    macros = here.joinpath(_MACROS).read_text(encoding="utf-8")
    own = {
        each.name: each.read_text(encoding="utf-8")
        for each in files(package).iterdir()
        if each.name.endswith(_TEMPLATES)
    }
    environment = Environment(
        loader=DictLoader({_PAGE: page, _MACROS: macros, **own}),
        undefined=StrictUndefined,
        autoescape=True,
        trim_blocks=True,
        lstrip_blocks=True,
        finalize=_strip_control_characters,
    )
    environment.filters["number"] = format_number
    environment.filters["percent"] = _format_percent
    return environment, base64.b64encode(hashlib.sha256(code.encode()).digest()).decode()


def _strip_control_characters(value: object) -> object:
    """Remove control and text-direction characters, which browsers interpret, from a text."""
    return join_to_one_line(value) if type(value) is str else value


def _format_percent(fraction: float | None) -> str:
    return "–" if fraction is None else f"{fraction:.2%}"

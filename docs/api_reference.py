"""Write the API reference from the docstrings: `python -P docs/api_reference.py`.

`payscope` and `payscope.online` have what their `__all__` names; of the estimators, every public
function and class of the folders in `_ESTIMATORS` has its entry.
"""

import ast
import inspect
import re
import textwrap
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from types import FunctionType, ModuleType
from typing import Final

REPO: Final = Path(__file__).resolve().parent.parent
FOLDER: Final = REPO / "docs" / "api"
#: Characters of a line.
_WIDTH: Final = 98
#: Characters of a line of code, as the formatter has it.
_CODE_WIDTH: Final = 100
#: Pages of the public modules: their title and first sentence.
_MODULES: Final = {
    "payscope": ("payscope", "What `import payscope` gives: scripts and notebooks."),
    "online": (
        "payscope.online",
        "The estimators while the machine drives ([guide](../on-board.md)).",
    ),
}
#: Classes that functions of `payscope` give, by the file that has them.
_RESULTS: Final = {"Log": "replay/logs/log.py", "Run": "analysis/model/run_record.py"}
#: Pages of the estimators: their title, the first sentence, and the files.
_ESTIMATORS: Final = {
    "estimators": (
        "Estimators",
        "One file a method, each with its equation; errors and results that all share.",
        ("estimators/estimate.py", "estimators/errors.py", "estimators/methods/*.py"),
    ),
    "joint-fit": (
        "Joint fit",
        "The numerics of the joint fit and of load states: priors, group effects, partitions.",
        ("estimators/joint/*.py",),
    ),
    "planar": (
        "Planar motion",
        "Mass, yaw inertia and centre of mass of a machine that moves in the plane.",
        ("estimators/planar/*.py",),
    ),
    "numerics": (
        "Numerics",
        "Rolling sums, sandwich deviations, mutual information: what the estimators are made of.",
        ("estimators/numerics/*.py",),
    ),
}
_Definition = ast.FunctionDef | ast.ClassDef
_SECTION: Final = re.compile(r"(Args|Returns|Raises|Yields|Attributes|Warns|Examples?):\s*(.*)")
_TITLES: Final = {"Args": "Arguments"}


def pages() -> dict[str, str]:
    """The text of each page, by its file name."""
    import payscope

    named = {
        "payscope": [*_entries_of(payscope, "payscope"), *_classes_of_results()],
        "online": _entries_of(payscope.online, "payscope.online"),
        **{name: _entries_in(files) for name, (_, _, files) in _ESTIMATORS.items()},
    }
    leads = {
        **_MODULES,
        **{name: (title, lead) for name, (title, lead, _) in _ESTIMATORS.items()},
    }
    written = {
        f"{name}.md": "\n".join([f"# {leads[name][0]}\n", f"{leads[name][1]}\n", *entries])
        for name, entries in named.items()
    }
    index = [
        "# API reference\n",
        "Generated from the docstrings by `python -P docs/api_reference.py`. The errors are in",
        "[estimators](estimators.md); the command line has [a page of its own](../commands.md).\n",
        "| page | what it has |",
        "|---|---|",
        *(f"| [{title}]({name}.md) | {lead} |" for name, (title, lead) in leads.items()),
    ]
    return {"README.md": "\n".join(index) + "\n", **written}


def _entries_of(module: ModuleType, prefix: str) -> list[str]:
    """The entries of what a module names in `__all__`."""
    entries: list[str] = []
    for name in sorted(module.__all__, key=str.lower):
        thing = getattr(module, name)
        if isinstance(thing, ModuleType):
            entries.append(f"## `{prefix}.{name}`\n\nSee [{prefix}.{name}]({name}.md).\n")
            continue
        if not isinstance(thing, type | FunctionType):
            alias = repr(thing).replace("typing.", "").replace("'", '"')
            entries.append(f"## `{prefix}.{name}`\n\n```python\n{name} = {alias}\n```\n")
            continue
        source = Path(inspect.getsourcefile(inspect.unwrap(thing)) or "")
        tree = ast.parse(source.read_text(encoding="utf-8"))
        entries += _entry(next(d for d in _definitions(tree) if d.name == name), prefix)
    return entries


def _classes_of_results() -> Iterator[str]:
    """The entries of the classes that functions of `payscope` give."""
    for name, file in _RESULTS.items():
        tree = ast.parse((REPO / file).read_text(encoding="utf-8"))
        yield from _entry(next(d for d in _definitions(tree) if d.name == name), "")


def _entries_in(patterns: Sequence[str]) -> list[str]:
    """The entries of every public function and class of files, under their modules."""
    entries: list[str] = []
    for path in (path for pattern in patterns for path in sorted(REPO.glob(pattern))):
        tree = ast.parse(path.read_text(encoding="utf-8"))
        public = [each for each in _definitions(tree) if not each.name.startswith("_")]
        module = ".".join(path.relative_to(REPO).with_suffix("").parts)
        if public:
            entries += [f"## `{module}`\n", *_blocks(ast.get_docstring(tree) or "")]
        for each in public:
            entries += _entry(each, path.stem, level=3)
    return entries


def _definitions(tree: ast.Module) -> Iterator[_Definition]:
    return (each for each in tree.body if isinstance(each, _Definition))


def _entry(defined: _Definition, prefix: str, level: int = 2) -> Iterator[str]:
    """Heading, signature and docstring of a function or class; a class has its methods too."""
    name = f"{prefix}.{defined.name}" if prefix else defined.name
    yield f"{'#' * level} `{name}`\n"
    yield f"```python\n{_signature(defined)}\n```\n"
    yield from _blocks(ast.get_docstring(defined) or "")
    if isinstance(defined, ast.ClassDef):
        for method in defined.body:
            if isinstance(method, ast.FunctionDef) and not method.name.startswith("_"):
                said = ast.get_docstring(method) or ""
                if said and not said.startswith("See `"):
                    yield from _entry(method, defined.name, level + 1)


def _field(field: ast.AnnAssign) -> str:
    """A field of a class; a tuple with a value a line where it is long."""
    line = "    " + ast.unparse(field).replace("'", '"')
    if len(line) <= _CODE_WIDTH or not isinstance(field.value, ast.Tuple):
        return line
    values = [f"        {ast.unparse(each)}," for each in field.value.elts]
    begin = line[: line.index(" = ")]
    return "\n".join([f"{begin} = (", *values, "    )"])


def _signature(defined: _Definition) -> str:
    """As Python has it, an argument a line where it is long."""
    if isinstance(defined, ast.ClassDef):
        bases = ", ".join(map(ast.unparse, defined.bases))
        made = [each for each in defined.body if isinstance(each, ast.FunctionDef)]
        make = next((each for each in made if each.name == "__init__"), None)
        head = f"class {defined.name}" + (f"({bases})" if bases else "")
        fields = [
            _field(each)
            for each in defined.body
            if isinstance(each, ast.AnnAssign) and not ast.unparse(each.target).startswith("_")
        ]
        if make is not None:
            return f"{head}\n{_call(make, defined.name)}"
        return "\n".join([f"{head}:", *fields]) if fields else head
    if any(ast.unparse(each).endswith("property") for each in defined.decorator_list):
        return f"{defined.name}: {ast.unparse(defined.returns) if defined.returns else 'Any'}"
    return _call(defined, defined.name)


def _call(function: ast.FunctionDef, name: str) -> str:
    bound = function.args.args and function.args.args[0].arg in ("self", "cls")
    arguments = function.args
    listed = ast.unparse(arguments)
    if bound:
        listed = listed.removeprefix(arguments.args[0].arg).removeprefix(", ")
    parts = [_spaced(part) for part in _split(listed.replace("'", '"'))]
    result = "" if function.returns is None else f" -> {ast.unparse(function.returns)}"
    result = "" if name != function.name else result.replace("'", "")
    line = f"{name}({', '.join(parts)}){result}"
    if len(line) <= _WIDTH:
        return line
    return "\n".join([f"{name}(", *(f"    {part}," for part in parts), f"){result}"])


def _split(listed: str, at: str = ",") -> list[str]:
    """Text apart at the commas, or another letter, that are in no bracket."""
    parts, depth = [""], 0
    for letter in listed:
        depth += (letter in "[({") - (letter in "])}")
        if letter == at and depth == 0:
            parts.append("")
        else:
            parts[-1] += letter
    return [part.strip() for part in parts if part.strip()]


def _spaced(argument: str) -> str:
    """An argument with its annotation has blanks around its default."""
    named, *default = _split(argument, "=")
    return " = ".join([named, "=".join(default)]) if default and ":" in named else argument


def _blocks(docstring: str) -> Iterator[str]:
    """A docstring as Markdown: prose as it is, its sections as lists."""
    prose: list[str] = []
    lines = docstring.splitlines()
    while lines:
        line = lines.pop(0)
        section = _SECTION.fullmatch(line)
        if section is None or (section[2] and section[1] not in ("Raises", "Returns")):
            prose.append(line)
            continue
        if any(prose):
            yield "\n".join(prose).strip("\n") + "\n"
        prose = []
        inside = [section[2]] if section[2] else []
        while lines and (not lines[0].strip() or lines[0].startswith(" ")):
            inside.append(lines.pop(0))
        yield f"**{_TITLES.get(section[1], section[1])}**\n"
        yield _items(textwrap.dedent("\n".join(inside)), named=section[1] != "Returns") + "\n"
    if any(prose):
        yield "\n".join(prose).strip("\n") + "\n"


def _items(text: str, *, named: bool) -> str:
    """The items of a section as a list; unnamed text as one paragraph."""
    if not named:
        paragraphs = re.split(r"\n\s*\n", text.strip())
        return "\n\n".join(_wrap(" ".join(each.split())) for each in paragraphs)
    items: list[str] = []
    for line in filter(str.strip, text.splitlines()):
        name, colon, rest = line.partition(":")
        if line[:1] != " " and colon and re.fullmatch(r"\*{0,2}[\w, .]+", name):
            items.append(f"`{name}`:{rest}")
        elif items:
            items[-1] += f" {line.strip()}"
        else:
            items.append(line.strip())
    return "\n".join(_wrap(item, "- ", "  ") for item in items)


def _wrap(text: str, first: str = "", then: str = "") -> str:
    wrap: Callable[..., str] = textwrap.fill
    return wrap(
        text,
        _WIDTH,
        initial_indent=first,
        subsequent_indent=then,
        break_long_words=False,
        break_on_hyphens=False,
    )


if __name__ == "__main__":
    FOLDER.mkdir(exist_ok=True)
    for name, text in pages().items():
        (FOLDER / name).write_text(text, encoding="utf-8")

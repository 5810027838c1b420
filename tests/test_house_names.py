"""Names and numbers that a stranger can read: the words to avoid are listed in CONTRIBUTING.md.

Each failure says what to write instead. `MORE_TO_RENAME` and `MORE_TO_EXPLAIN` count what is left
from before these rules, by package; they may only become smaller.
"""

import ast
import re
from collections.abc import Iterator
from functools import cache
from pathlib import Path

import pytest

REPO = Path(__file__).resolve().parent.parent
HOUSE = ("estimators", "analysis", "recordings", "replay")
#: Participles that are an adjective or a verb of their own, by what they name.
VERBS = frozenset({"embed", "feed", "need", "proceed", "seed", "speed"})
#: Functions and classes named by a word of the list, or by one participle, from before the rule.
MORE_TO_RENAME = {"estimators": 7, "analysis": 1, "recordings": 1, "replay": 0}
#: Numeric constants of a module without a comment, from before the rule.
MORE_TO_EXPLAIN = {"estimators": 0, "analysis": 0, "recordings": 0, "replay": 0}
#: Numeric constants of modules, outside of the tables of their folders: it may only fall.
MOST_CONSTANTS = 300


def words_to_avoid() -> frozenset[str]:
    """The words of the list in CONTRIBUTING.md."""
    text = (REPO / "CONTRIBUTING.md").read_text(encoding="utf-8")
    listed = re.search(r"no name of its own:\s*(.+?)\.\n", text, re.DOTALL)
    assert listed, "CONTRIBUTING.md: no list of words behind 'no name of its own:'"
    return frozenset(re.findall(r"`(\w+)`", listed[1]))


@cache
def modules(package: str) -> tuple[tuple[str, str, ast.Module], ...]:
    """Path, text and tree of each file of a package."""
    texts = {path: path.read_text(encoding="utf-8") for path in (REPO / package).rglob("*.py")}
    return tuple(
        (path.relative_to(REPO).as_posix(), text, ast.parse(text))
        for path, text in sorted(texts.items())
    )


def is_participle(name: str, avoid: frozenset[str]) -> bool:
    """Whether a name is a word of the list, or one regular participle."""
    word = name.strip("_").lower()
    return word in avoid or (re.fullmatch("[a-z]+ed", word) is not None and word not in VERBS)


def unreadable_names(tree: ast.Module, avoid: frozenset[str]) -> Iterator[tuple[int, str]]:
    """Line and name of functions and classes that are participles; decorated ones are exempt."""
    for node in ast.walk(tree):
        if isinstance(node, ast.FunctionDef) and node.decorator_list:
            continue  # a property reads as an attribute: `log.measured`
        if isinstance(node, ast.FunctionDef | ast.ClassDef) and is_participle(node.name, avoid):
            yield node.lineno, node.name


def is_numeric(value: ast.expr | None) -> bool:
    """Whether an expression is made of numbers alone."""
    match value:
        case ast.Constant(value=bool()):
            return False
        case ast.Constant(value=int() | float()):
            return True
        case ast.UnaryOp(operand=operand):
            return is_numeric(operand)
        case ast.BinOp(left=left, right=right):
            return is_numeric(left) and is_numeric(right)
        case ast.Tuple(elts=elements):
            return bool(elements) and all(map(is_numeric, elements))
        case _:
            return False


def unexplained_constants(text: str, tree: ast.Module) -> Iterator[tuple[int, str]]:
    """Line and name of numeric constants that no comment above, behind or of a group explains."""
    lines = text.splitlines()
    group_end = 0
    for node in tree.body:
        if not isinstance(node, ast.Assign | ast.AnnAssign) or not is_numeric(node.value):
            continue
        target = node.targets[0] if isinstance(node, ast.Assign) else node.target
        explained = (
            lines[node.lineno - 2].startswith("#")
            or "#" in lines[node.lineno - 1]
            or group_end == node.lineno - 1
        )
        if explained:
            group_end = node.end_lineno or node.lineno
        else:
            yield node.lineno, ast.unparse(target)


@pytest.mark.parametrize("package", HOUSE)
def test_functions_are_verbs_and_classes_nouns(package: str) -> None:
    avoid = words_to_avoid()
    found = [
        f"{path}:{line}: {name}"
        for path, _, tree in modules(package)
        for line, name in unreadable_names(tree, avoid)
    ]
    assert len(found) <= MORE_TO_RENAME[package], "\n".join(
        [
            *found,
            f"{len(found)} names in {package} are participles or adverbs, at most "
            f"{MORE_TO_RENAME[package]} may be: name a function by its verb (`refit`, not `again`) "
            "and a class by its noun (`DeclaredComponent`, not `Stated`).",
        ]
    )


@pytest.mark.parametrize("package", HOUSE)
def test_numeric_constants_say_of_what_in_which_unit_and_why(package: str) -> None:
    found = [
        f"{path}:{line}: {name}"
        for path, text, tree in modules(package)
        for line, name in unexplained_constants(text, tree)
    ]
    assert len(found) <= MORE_TO_EXPLAIN[package], "\n".join(
        [
            *found,
            f"{len(found)} numeric constants in {package} have no comment, at most "
            f"{MORE_TO_EXPLAIN[package]} may: write `#: of what, in which unit, how chosen` above "
            "it, or put it into the folder's table (`weighing_limits.py`, `settings.py`).",
        ]
    )


def test_numbers_stand_in_the_table_of_their_folder() -> None:
    found = [
        f"{path}:{node.lineno}"
        for package in HOUSE
        for path, _, tree in modules(package)
        for node in tree.body
        if isinstance(node, ast.Assign | ast.AnnAssign) and is_numeric(node.value)
    ]
    assert len(found) <= MOST_CONSTANTS, "\n".join(
        [
            *found,
            f"{len(found)} numeric constants stand in modules, at most {MOST_CONSTANTS} may: put "
            "those that someone may tune into the table of their folder (`weighing_limits.py`).",
        ]
    )


@pytest.mark.parametrize("package", HOUSE)
def test_no_attribute_is_called_of(package: str) -> None:
    found = [
        f"{path}:{node.lineno}"
        for path, _, tree in modules(package)
        for owner in ast.walk(tree)
        if isinstance(owner, ast.ClassDef)
        for node in owner.body
        if isinstance(node, ast.AnnAssign) and ast.unparse(node.target) == "of"
    ]
    assert not found, "\n".join([*found, "say what it is: `membership`, `level_of_unit`"])


def test_the_rules_find_what_they_forbid() -> None:
    tree = ast.parse("def _weighed(): ...\nclass Known: ...\ndef feed(): ...\ndef weigh(): ...")
    assert list(unreadable_names(tree, frozenset({"known"}))) == [(1, "_weighed"), (2, "Known")]
    text = "import x\n\n_A = 1.0\n#: m\n_B = 2.0\n_C = (3, 4)\n\n_D = 5  # s\nON = True\nE = -6\n"
    assert list(unexplained_constants(text, ast.parse(text))) == [(3, "_A"), (10, "E")]

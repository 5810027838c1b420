"""The house: packages, folders and files import what stands before them, and nothing in a circle.

Imports inside functions and those for types alone count like all others. A folder is the files
directly in it. `python -m pytest -s tests/test_layers.py` prints the order of the folders.
"""

import ast
import subprocess
import sys
from collections.abc import Iterator, Mapping
from functools import cache
from graphlib import CycleError, TopologicalSorter
from pathlib import Path

import pytest

REPO = Path(__file__).resolve().parent.parent
HOUSE = ("estimators", "analysis", "recordings", "replay")
#: Folders import their own files and folders in lines above their own, none beside them.
ORDER = (
    ("estimators",),
    ("estimators/numerics",),
    ("estimators/joint", "estimators/methods"),
    ("estimators/planar",),
    (
        "analysis/calibration",
        "analysis/expressions",
        "analysis/simulation/scenario",
        "analysis/stages",
    ),
    ("analysis/model", "analysis/simulation/motion"),
    (
        "analysis",
        "analysis/calibration/line",
        "analysis/compare",
        "analysis/simulation/plant",
        "analysis/simulation/sensors",
        "analysis/stages/motion",
        "analysis/stages/signals",
    ),
    (
        "analysis/calibration/use",
        "analysis/fleet",
        "analysis/simulation/drive",
        "analysis/simulation/trials",
        "analysis/stages/noise",
    ),
    ("analysis/calibration/campaign", "analysis/simulation/logs", "analysis/stages/gating"),
    ("analysis/online", "analysis/simulation", "analysis/stages/estimation", "analysis/weighing"),
    (
        "analysis/cycles",
        "analysis/diagnosis",
        "analysis/excitation",
        "analysis/paper",
        "analysis/planar",
    ),
    ("analysis/findings",),
    ("analysis/explain",),
    ("recordings/report",),
    ("recordings/fleet", "recordings/paper", "recordings/rrd", "recordings/signatures"),
    ("recordings/calibration/page",),
    ("recordings/notary",),
    (
        "recordings/calibration",
        "recordings/compare",
        "recordings/follow",
        "recordings/plots",
        "recordings/review",
    ),
    ("recordings", "recordings/dcc", "recordings/explain"),
    ("replay/logs/messages",),
    ("replay/logs/decoding", "replay/logs/storage", "replay/logs/tables"),
    ("replay/logs/blocks", "replay/logs/sqlite", "replay/logs/writers"),
    ("replay/logs/bag", "replay/logs/mcap"),
    ("replay/logs/rosbag2",),
    ("replay/logs/converted",),
    ("replay/logs",),
    ("replay/frames", "replay/machines", "replay/notary", "replay/recognise"),
    ("replay/inputs", "replay/simulation"),
    ("replay",),
    ("replay/calibration", "replay/explain", "replay/init", "replay/paper"),
    ("replay/compare", "replay/fleet", "replay/recording", "replay/review", "replay/runs"),
    ("replay/convert", "replay/demo", "replay/follow", "replay/query"),
    ("replay/warm_up",),
    ("replay/commands",),
)
SHOWN = "\n".join(f"{number:4}  {', '.join(folders)}" for number, folders in enumerate(ORDER, 1))
#: Folders of which files elsewhere import what `__init__` has, and no file.
FACES = (
    "replay/logs",
    "replay/logs/storage",
    "replay/logs/blocks",
    "replay/logs/bag",
    "replay/logs/mcap",
    "replay/logs/sqlite",
    "replay/logs/rosbag2",
)
#: Libraries that one package alone may import.
OWNERS = {
    "rerun": "recordings",
    "matplotlib": "recordings",
    "jinja2": "recordings",
    "weasyprint": "recordings",
    "cryptography": "recordings",
    "rfc3161_client": "recordings",
    "rfc8785": "recordings",
    "lxml": "recordings",
    "signxml": "recordings",
    "rosbags": "replay",
    "mcap": "replay",
    "typer": "replay",
    "ray": "replay",
    "obstore": "replay",
    "python_calamine": "replay",
}
#: Lines below which a file that one other file imports is a crumb: it hardly says more than a name.
CRUMB_LINES = 60
#: What is left of crumbs, of files with one importer and of long files: there may only be fewer.
MORE_CRUMBS = 0
MORE_SINGLE = 89
MORE_LONG = 3
#: Lines above which a file is long.
LONG_LINES = 400
#: Largest fraction of functions and methods that may be private, dunders and nested functions not
#: counted; it may only fall.
MOST_PRIVATE = 0.3
FILES = [path for package in HOUSE for path in sorted((REPO / package).rglob("*.py"))]


def shown(path: Path) -> str:
    return path.relative_to(REPO).as_posix()


def folder_of(path: Path) -> str:
    return shown(path.parent)


@cache
def _imported(path: Path) -> frozenset[tuple[str, str]]:
    """Modules that a file imports, each with the name that it imports from it, if one."""
    tree = ast.parse(path.read_text(encoding="utf-8"))
    found: set[tuple[str, str]] = set()
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            found |= {(alias.name, "") for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"{path}: relative import"
            found |= {(str(node.module), alias.name) for alias in node.names}
    return frozenset(found)


def _packages(path: Path) -> set[str]:
    return {module.partition(".")[0] for module, _ in _imported(path)}


def _file_of(module: str) -> Path | None:
    """Our file of a dotted name, None where it is none of ours."""
    place = REPO.joinpath(*module.split("."))
    choices = (place.with_suffix(".py"), place / "__init__.py")
    return next((path for path in choices if path in _OURS), None)


_OURS = frozenset(FILES)


def files_imported(path: Path) -> set[Path]:
    """Our files that a file imports, without itself."""
    found = {_file_of(f"{module}.{name}") or _file_of(module) for module, name in _imported(path)}
    return {file for file in found if file is not None} - {path}


def circle(graph: Mapping[str, set[str]]) -> list[str]:
    """A circle in a graph, empty where there is none."""
    try:
        TopologicalSorter(graph).prepare()
    except CycleError as error:
        return list(reversed(error.args[1]))
    return []


def folder_imports() -> Iterator[tuple[Path, Path]]:
    """A file, and a file of another folder that it imports."""
    for path in FILES:
        for imported in sorted(files_imported(path)):
            if imported.parent != path.parent:
                yield path, imported


def test_no_files_import_each_other_in_a_circle() -> None:
    found = circle({shown(path): {shown(file) for file in files_imported(path)} for path in FILES})
    assert not found, " imports ".join(found)


def test_no_folders_import_each_other_in_a_circle() -> None:
    graph: dict[str, set[str]] = {}
    for path, imported in folder_imports():
        graph.setdefault(folder_of(path), set()).add(folder_of(imported))
    found = circle(graph)
    assert not found, " imports ".join(found)


def test_every_folder_has_its_place_in_the_order() -> None:
    ordered = [folder for folders in ORDER for folder in folders]
    assert sorted(ordered) == sorted({folder_of(path) for path in FILES}), f"the order:\n{SHOWN}"


def test_a_folder_imports_only_folders_above_it_in_the_order() -> None:
    sys.stdout.write(f"\nfolders, each importing only those above it:\n{SHOWN}\n")
    place = {folder: number for number, folders in enumerate(ORDER) for folder in folders}
    faults = [
        f"{shown(path)} imports {shown(imported)}"
        for path, imported in folder_imports()
        if place[folder_of(imported)] >= place[folder_of(path)]
    ]
    assert not faults, "\n".join([*faults, "the order:", SHOWN])


@pytest.mark.parametrize("folder", FACES)
def test_a_folder_with_a_face_is_imported_by_it_alone(folder: str) -> None:
    face = REPO / folder / "__init__.py"
    inner = [
        f"{shown(path)} imports {shown(imported)}"
        for path, imported in folder_imports()
        if folder_of(imported) == folder
        and imported != face
        # the face of a folder is not for the folders in it, which stand before it
        and not folder_of(path).startswith(f"{folder}/")
    ]
    assert not inner, "\n".join(inner)


def test_no_folder_has_the_name_of_what_the_folder_above_gives() -> None:
    """`from replay import run` would give the folder once something in it is imported."""
    for face in FILES:
        if face.name == "__init__.py":
            given = {name for _, name in _imported(face)}
            assert not given & {each.name for each in face.parent.iterdir()}, shown(face)


def test_outside_of_the_readers_a_log_is_what_opens_it_what_it_is_and_its_time() -> None:
    names = {
        name
        for path in FILES
        if not folder_of(path).startswith("replay/logs")
        for module, name in _imported(path)
        if module.startswith("replay.logs")
        and not module.startswith(
            tuple(
                f"replay.logs.{each}" for each in ("converted", "decoding", "messages", "writers")
            )
        )
    }
    # `LogCheck` is what `Log.check` returns; `expand_log_folders` and `group_objects_by_log` say
    # which logs a folder, or a storage without folders, holds; `TABLE` is the topic of a table
    assert names == {
        *("TABLE", "LogCheck", "Log", "TableHints", "TimeAxis"),
        *("expand_log_folders", "group_objects_by_log", "open_log"),
        # what follows a log that grows
        *("ACTIVE", "GrowingLogFile", "open_growing_log"),
    }


@pytest.mark.parametrize("path", FILES, ids=shown)
def test_a_library_has_one_importing_package(path: Path) -> None:
    package = path.relative_to(REPO).parts[0]
    for library in _packages(path) & set(OWNERS):
        assert OWNERS[library] == package, f"{path} imports {library}"


def test_one_file_knows_the_engine_and_one_the_storage() -> None:
    for library, file in (("ray", "ray_engine"), ("obstore", "object_store")):
        knowing = [shown(path) for path in FILES if library in _packages(path)]
        assert knowing == [f"replay/fleet/{file}.py"]


def test_estimators_know_no_frames_and_analysis_no_files() -> None:
    for path in FILES:
        package = path.relative_to(REPO).parts[0]
        if package == "estimators":
            assert "polars" not in _packages(path), path
        if package == "analysis":
            assert not _packages(path) & {"pathlib", "os", "io", "rich"}, path


def test_help_loads_none_of_the_heavy_libraries() -> None:
    heavy = (
        *("numpy", "polars", "numba", "scipy", "rerun", "matplotlib", "rosbags", "pyarrow"),
        *("ray", "obstore"),
    )
    listed = f"[name for name in {heavy!r} if name in sys.modules]"
    code = f"import sys, replay.commands.cli\nprint({listed})"
    loaded = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, check=True, cwd=REPO
    )
    assert loaded.stdout.strip() == "[]"


def test_a_run_begins_without_what_it_may_not_need() -> None:
    late = ("scipy.signal", "scipy.stats", "rerun", "matplotlib", "pyarrow", "rosbags", "pint")
    code = (
        "import sys, replay.commands.cli, replay.commands.progress_bar, replay.runs.run_logs\n"
        f"print([name for name in {late!r} if name in sys.modules])"
    )
    loaded = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, check=True, cwd=REPO
    )
    assert loaded.stdout.strip() == "[]"


def test_a_circle_is_found() -> None:
    assert circle({"a": {"b"}, "b": {"c"}, "c": {"a"}}) in (
        ["a", "b", "c", "a"],
        ["b", "c", "a", "b"],
        ["c", "a", "b", "c"],
    )
    assert circle({"a": {"b", "c"}, "b": {"c"}}) == []


def lines_of(path: Path) -> int:
    return len(path.read_text(encoding="utf-8").splitlines())


def single_imports() -> list[tuple[Path, Path]]:
    """Files with one importer; a command and the part of a face are meant to have one."""
    importers: dict[Path, set[Path]] = {}
    for path in FILES:
        for imported in files_imported(path):
            importers.setdefault(imported, set()).add(path)
    return [
        (path, one)
        for path in FILES
        if path.name != "__init__.py" and len(importers.get(path, ())) == 1
        for one in importers[path]
        if one.name not in ("__init__.py", "cli.py")
    ]


def test_files_that_one_other_imports_become_fewer() -> None:
    found = single_imports()
    assert len(found) <= MORE_SINGLE, "\n".join(
        [
            *(f"{shown(path)} is imported by {shown(one)} alone" for path, one in found),
            f"{len(found)} files, at most {MORE_SINGLE} may be: merge one of them into the file "
            "that imports it, or two of them, where they read as one.",
        ]
    )


def test_long_files_become_fewer() -> None:
    found = {shown(path): lines for path in FILES if (lines := lines_of(path)) > LONG_LINES}
    assert len(found) <= MORE_LONG, f"{found}: at most {MORE_LONG} may have over {LONG_LINES} lines"


def functions_and_methods() -> Iterator[ast.FunctionDef | ast.AsyncFunctionDef]:
    """Functions of modules and methods of their classes, none that is nested and no `__init__`."""
    for path in FILES:
        tree = ast.parse(path.read_text(encoding="utf-8"))
        for owner in (tree, *(node for node in tree.body if isinstance(node, ast.ClassDef))):
            for node in owner.body:
                is_function = isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef)
                if is_function and not node.name.startswith("__"):
                    yield node


def test_private_functions_become_fewer() -> None:
    names = [node.name for node in functions_and_methods()]
    private = sum(name.startswith("_") for name in names)
    assert private <= MOST_PRIVATE * len(names), (
        f"{private} of {len(names)} functions are private, more than {MOST_PRIVATE:.1%}: what is "
        "short and called once stands where it is called; what others could use is public."
    )


def test_no_base_name_occurs_twice() -> None:
    places: dict[str, list[str]] = {}
    for path in FILES:
        if path.name != "__init__.py" and path.parent.name != "commands":
            places.setdefault(path.name, []).append(shown(path))
    twice = [found for found in places.values() if len(found) > 1]
    assert not twice, f"{twice}: name each file for what it alone does"


def test_a_small_file_that_one_other_imports_is_merged_into_it() -> None:
    found = [
        f"{shown(path)} is imported by {shown(one)} alone"
        for path, one in single_imports()
        if lines_of(path) < CRUMB_LINES
    ]
    assert len(found) <= MORE_CRUMBS, "\n".join(
        [
            *found,
            f"{len(found)} files are crumbs, at most {MORE_CRUMBS} may be: merge one of them into "
            "the file that imports it, where the pair reads as one.",
        ]
    )


def test_no_two_classes_share_a_name() -> None:
    """One name, one concept (docs/glossary.md)."""
    places: dict[str, list[str]] = {}
    for path in FILES:
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(node, ast.ClassDef):
                places.setdefault(node.name, []).append(f"{path.relative_to(REPO)}:{node.lineno}")
    assert not {name: found for name, found in places.items() if len(found) > 1}

"""The house: each package imports only those before it, and heavy libraries come late."""

import ast
import subprocess
import sys
from pathlib import Path

import pytest

REPO = Path(__file__).resolve().parent.parent
HOUSE = ("estimators", "analysis", "recordings", "replay")
#: Libraries that one package alone may import.
OWNERS = {
    "rerun": "recordings",
    "matplotlib": "recordings",
    "jinja2": "recordings",
    "rosbags": "replay",
    "mcap": "replay",
    "typer": "replay",
}
FILES = [path for package in HOUSE for path in sorted((REPO / package).rglob("*.py"))]


def _imports(path: Path) -> set[str]:
    tree = ast.parse(path.read_text(encoding="utf-8"))
    names: set[str] = set()
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            names |= {alias.name.partition(".")[0] for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"{path}: relative import"
            names.add(str(node.module).partition(".")[0])
    return names


@pytest.mark.parametrize("path", FILES, ids=lambda p: str(p.relative_to(REPO)))
def test_a_file_imports_only_packages_at_or_before_its_own(path: Path) -> None:
    own = HOUSE.index(path.relative_to(REPO).parts[0])
    later = _imports(path) & set(HOUSE[own + 1 :])
    assert not later, f"{path} imports {later}"


@pytest.mark.parametrize("path", FILES, ids=lambda p: str(p.relative_to(REPO)))
def test_a_library_has_one_importing_package(path: Path) -> None:
    package = path.relative_to(REPO).parts[0]
    for library in _imports(path) & set(OWNERS):
        assert OWNERS[library] == package, f"{path} imports {library}"


def test_estimators_know_no_frames_and_analysis_no_files() -> None:
    for path in FILES:
        package = path.relative_to(REPO).parts[0]
        if package == "estimators":
            assert "polars" not in _imports(path), path
        if package == "analysis":
            assert not _imports(path) & {"pathlib", "os", "io", "rich"}, path


def test_help_loads_none_of_the_heavy_libraries() -> None:
    heavy = ("numpy", "polars", "numba", "scipy", "rerun", "matplotlib", "rosbags", "pyarrow")
    listed = f"[name for name in {heavy!r} if name in sys.modules]"
    code = f"import sys, replay.commands.cli\nprint({listed})"
    loaded = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, check=True, cwd=REPO
    )
    assert loaded.stdout.strip() == "[]"


def test_a_run_begins_without_what_it_may_not_need() -> None:
    late = ("scipy.signal", "scipy.stats", "rerun", "matplotlib", "pyarrow", "rosbags", "pint")
    code = (
        "import sys, replay.commands.cli, replay.commands.progress, replay.replay_logs\n"
        f"print([name for name in {late!r} if name in sys.modules])"
    )
    loaded = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, check=True, cwd=REPO
    )
    assert loaded.stdout.strip() == "[]"


@pytest.mark.parametrize("path", FILES, ids=lambda p: str(p.relative_to(REPO)))
def test_a_file_holds_one_idea_in_at_most_400_lines(path: Path) -> None:
    assert len(path.read_text(encoding="utf-8").splitlines()) <= 400

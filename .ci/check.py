"""Check what changed within a minute: lint, types and the tests nearest to the changed files.

    python .ci/check.py [--since COMMIT] [--seconds 35] [--list]

Changed is what differs from where this branch left the one it follows (`--since` names another
commit), committed or not. Of the tests those run that are changed themselves, that mirror a changed
file (`analysis/planar/planar_terms.py`: `tests/analysis/planar/test_planar_terms*.py`), or that
import one: directly, from the `__init__` of its folder that imports it, or through a helper of the
tests. A table that results depend on (`WATCHED`) names the tests that fix those results. The
nearest tests come first; when the time is over, the others are skipped. Types are checked of the
changed files and of those that import them. `make test` runs everything.
"""

import argparse
import ast
import subprocess
import sys
import time
from collections import defaultdict
from pathlib import Path

REPO = Path(__file__).resolve().parent.parent
PACKAGES = ("estimators", "analysis", "recordings", "replay")
TESTS = Path("tests")
#: What has no importer: the tests that read it, by where it lies or what it ends with.
READ_BY = {
    "docs": "tests/test_documentation.py",
    "examples": "tests/test_documentation.py",
    ".md": "tests/test_documentation.py",
    ".toml": "tests/test_documentation.py",
}
#: Tables of the product: the tests that no import leads to, since they read what follows from them.
WATCHED = {
    "analysis/diagnosis": ("tests/golden/test_golden.py", "tests/test_documentation.py"),
    "analysis/findings": ("tests/golden/test_golden.py",),
    "analysis/model": (
        "tests/golden/test_golden.py",
        "tests/replay/test_versions.py",
        "tests/test_documentation.py",
    ),
}
#: A second each, and what one change to the house most often breaks.
ALWAYS = "tests/test_layers.py"
#: Every page's commands anew take minutes.
QUICK = "not every_command_in_the_documentation"


def main() -> int:
    """Lint, types and tests at once; 0 when all pass."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    parser.add_argument("--since", help="the commit to compare with")
    parser.add_argument("--seconds", type=float, default=35.0, help="after which tests are skipped")
    parser.add_argument("--list", action="store_true", help="say what would run, and run nothing")
    asked = parser.parse_args()
    changed = changed_files(asked.since)
    importers = importers_of()
    tests = tests_of(changed, importers)
    types = typed_of(changed, importers)
    print(f"{len(changed)} changed files, {len(tests)} test files, {len(types)} files to type")
    if asked.list:
        print(*tests, sep="\n")
        return 0
    began = time.monotonic()
    left = [run("ruff", "check", "."), run("ruff", "format", "--check", ".")]
    typing = start("basedpyright", *types) if types else None
    if tests:
        words = ("-n", "logical", "--maxprocesses", "2", f"--seconds={asked.seconds}")
        left.append(run("pytest", *words, "-m", "not slow and not viewer", "-k", QUICK, *tests))
    if typing is not None:
        left.append(typing.wait())
    print(f"checked in {time.monotonic() - began:.0f} s")
    return int(any(left))


def start(tool: str, *words: str) -> subprocess.Popen[bytes]:
    """Start a tool of this environment."""
    return subprocess.Popen([Path(sys.executable).with_name(tool), *words], cwd=REPO)


def run(tool: str, *words: str) -> int:
    """Run it; its exit status."""
    return start(tool, *words).wait()


def git(*words: str) -> list[str]:
    """The lines that git says, none where it fails."""
    said = subprocess.run(["git", *words], cwd=REPO, capture_output=True, text=True, check=False)
    return said.stdout.splitlines() if said.returncode == 0 else []


def changed_files(since: str | None) -> list[Path]:
    """What differs from `since`, or from where this branch left its upstream, or from HEAD."""
    base = [since] if since else git("merge-base", "HEAD", "@{upstream}") or ["HEAD"]
    named = git("diff", "--name-only", *base) + git("ls-files", "--others", "--exclude-standard")
    return sorted({Path(name) for name in named})


def module_of(path: Path) -> str:
    """`analysis/stages/gating/gate.py` is `analysis.stages.gating.gate`."""
    return ".".join(path.with_suffix("").parts).removesuffix(".__init__")


def importers_of() -> dict[str, set[Path]]:
    """The files that import each module and each of its names, inside functions too."""
    found: dict[str, set[Path]] = defaultdict(set)
    for package in (*PACKAGES, str(TESTS)):
        for path in (REPO / package).rglob("*.py"):
            for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
                names: list[str] = []
                if isinstance(node, ast.Import):
                    names = [alias.name for alias in node.names]
                elif isinstance(node, ast.ImportFrom) and node.module:
                    # what is imported may be a module of the package
                    names = [node.module, *(f"{node.module}.{a.name}" for a in node.names)]
                for name in names:
                    found[name].add(path.relative_to(REPO))
    return found


def users_of(name: str, importers: dict[str, set[Path]]) -> set[Path]:
    """The files that import a dotted name, also from an `__init__` that passes it on."""
    users = set(importers.get(name, ()))
    for face in [path for path in users if path.name == "__init__.py"]:
        passed_on = f"{module_of(face)}.{name.rpartition('.')[2]}"
        if passed_on != name:
            users |= users_of(passed_on, importers)
    return users


def files_importing(path: Path, importers: dict[str, set[Path]]) -> set[Path]:
    """The files that import a file, or from a folder's `__init__` what that has from it."""
    module = module_of(path)
    names = [name for name in importers if name.rpartition(".")[0] == module]
    return set(importers.get(module, ())).union(*(users_of(name, importers) for name in names))


def tests_of(changed: list[Path], importers: dict[str, set[Path]]) -> list[str]:
    """The test files to run, nearest first."""
    near: dict[Path, int] = {Path(ALWAYS): 3}

    def add(path: Path, distance: int) -> None:
        if path.name.startswith("test_"):
            near[path] = min(distance, near.get(path, distance))

    for path in changed:
        if path.suffix != ".py":
            for key in (path.parts[0], path.suffix):
                if key in READ_BY:
                    add(Path(READ_BY[key]), 2)
            continue
        add(path, 0)
        folder = REPO / TESTS / path.parent
        for mirror in folder.glob(f"test_{path.stem}*.py"):
            add(mirror.relative_to(REPO), 1)
        for watched in WATCHED.get(path.parent.as_posix(), ()):
            add(Path(watched), 1)
        for importer in files_importing(path, importers):
            add(importer, 2)
            if TESTS in importer.parents:  # a helper: those that use it
                for user in importers.get(module_of(importer), ()):
                    add(user, 3)
    there = [path for path in near if (REPO / path).exists()]
    return [str(path) for path in sorted(there, key=lambda path: (near[path], str(path)))]


def typed_of(changed: list[Path], importers: dict[str, set[Path]]) -> list[str]:
    """The changed files of the packages and those that import them."""
    wanted = set(changed).union(*(files_importing(path, importers) for path in changed))
    return sorted(
        str(path)
        for path in wanted
        if path.suffix == ".py" and path.parts[0] in PACKAGES and (REPO / path).exists()
    )


if __name__ == "__main__":
    sys.exit(main())

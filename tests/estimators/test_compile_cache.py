"""Folders for numba's cache, whoever runs payscope and wherever it lies."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

from estimators import compile_cache, compiled
from estimators.numerics import fit_loss

REPO = Path(compile_cache.__file__).parent.parent


@pytest.fixture
def nowhere(monkeypatch: pytest.MonkeyPatch) -> None:
    """The home cannot be written to, not even by root, and no folder is chosen."""
    monkeypatch.setenv("NUMBA_CACHE_DIR", "")
    monkeypatch.delenv("NUMBA_CACHE_DIR")
    monkeypatch.setenv("XDG_CACHE_HOME", "/dev/null/cache")


@pytest.fixture
def house(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Path:
    """Packages that can be written to: `ls` calls `rolling`, and `walk` calls `wire`."""
    sources = {
        "estimators/compiled.py": "",
        "estimators/ls.py": "from estimators import (\n    compiled,\n    rolling,\n)\n",
        "estimators/rolling.py": "from estimators.compiled import compiled\n",
        "estimators/errors.py": "",
        "replay/walk.py": "from estimators.compiled import compiled\nfrom replay.wire import CDR\n",
        "replay/wire.py": "import replay.gather\n",
        "replay/gather.py": "",
        "replay/cli.py": "from replay.walk import walk\n",
    }
    for name, text in sources.items():
        path = tmp_path / "house" / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text)
    monkeypatch.setattr(compile_cache, "_HOUSE", tmp_path / "house")
    return tmp_path / "house"


def folder(source: Path) -> Path:
    """The folder as a new process would find it."""
    compile_cache._read_source_and_imports.cache_clear()
    return compile_cache.make_cache_folder(source)


def lock(house: Path) -> None:
    """Put files where the folders of compiled functions would be: not even root gets past them."""
    for package in house.iterdir():
        (package / "__pycache__").write_text("")


@pytest.mark.usefixtures("nowhere")
def test_without_a_folder_beside_the_source_or_at_home_it_makes_a_private_one(house: Path) -> None:
    lock(house)
    made = folder(house / "estimators/ls.py").parent
    assert made.is_dir()
    assert made.stat().st_mode & 0o077 == 0


@pytest.mark.usefixtures("nowhere")
def test_a_locked_installation_compiles_into_the_users_cache(
    house: Path, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    lock(house)
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    assert folder(house / "estimators/ls.py").is_relative_to(tmp_path / "payscope")


@pytest.mark.usefixtures("nowhere")
def test_a_folder_that_was_chosen_is_used(
    house: Path, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path / "chosen"))
    made = folder(house / "estimators/ls.py")
    assert made.is_relative_to(tmp_path / "chosen")
    (house / "estimators/rolling.py").write_text("another")
    assert folder(house / "estimators/ls.py") != made


@pytest.mark.usefixtures("nowhere")
@pytest.mark.parametrize(
    ("source", "others"),
    [
        ("estimators/ls.py", ["estimators/ls.py", "estimators/rolling.py"]),
        ("replay/walk.py", ["replay/wire.py", "replay/gather.py", "estimators/compiled.py"]),
    ],
)
def test_a_change_in_any_source_that_is_compiled_in_has_its_own_folder(
    house: Path, source: str, others: list[str]
) -> None:
    """Numba looks at a function's own file alone, and it holds what it calls from others."""
    seen = {folder(house / source)}
    assert folder(house / source) in seen
    assert all(each.is_relative_to(house / source.partition("/")[0]) for each in seen)
    for number, other in enumerate(others, start=1):
        path = house / other
        path.write_text(f"{path.read_text()}# edited\n")
        seen.add(folder(house / source))
        assert len(seen) == number + 1, other


@pytest.mark.usefixtures("nowhere")
@pytest.mark.parametrize("other", ["estimators/errors.py", "replay/walk.py", "replay/cli.py"])
def test_a_change_in_what_a_module_does_not_import_compiles_nothing_anew(
    house: Path, other: str
) -> None:
    before = folder(house / "estimators/ls.py")
    (house / other).write_text("edited")
    assert folder(house / "estimators/ls.py") == before


@pytest.mark.usefixtures("nowhere")
def test_what_old_versions_compiled_is_forgotten(house: Path) -> None:
    for version in range(8):
        (house / "estimators/rolling.py").write_text(str(version))
        last = folder(house / "estimators/ls.py")
    left = list(last.parent.iterdir())
    assert last in left
    assert len(left) == 4


def test_every_compiled_function_is_kept_in_such_a_folder() -> None:
    for package in ("estimators", "analysis", "recordings", "replay"):
        for path in (REPO / package).rglob("*.py"):
            if path != REPO / "estimators/compiled.py":
                assert "njit" not in path.read_text(), path


def test_an_index_that_two_processes_write_at_once_never_names_the_code_of_another(
    tmp_path: Path,
) -> None:
    """Each has read an empty index; the one that adds its form first writes its index last."""
    one, other = (compiled._ContentNamedIndex(str(tmp_path), "loop", "stamp") for _ in range(2))
    one.save("of floats", "code of floats")
    index = tmp_path / "loop.nbi"
    late = index.read_bytes()
    index.unlink()
    other.save("of integers", "code of integers")
    assert other.load("of integers") == "code of integers"
    index.write_bytes(late)
    assert one.load("of floats") == "code of floats"
    assert one.load("of integers") is None


def test_every_compiled_function_is_kept_under_such_names() -> None:
    assert (
        type(fit_loss.sum_autocovariance_loss.compiled._cache._cache_file)
        is compiled._ContentNamedIndex
    )


@pytest.mark.heavy
def test_importing_the_estimators_changes_nothing_of_the_process_and_reads_nothing_above() -> None:
    code = (
        "import os, sys, numba\n"
        "before = dict(os.environ), numba.config.CACHE_DIR\n"
        "opened = []\n"
        "def note(event, args):\n"
        "    if event == 'open':\n"
        "        opened.append(str(args[0]))\n"
        "sys.addaudithook(note)\n"
        "from estimators import compile_cache\n"
        "from estimators.methods import fgls, huber, incremental, ls, pooled, rls, rtls, tls\n"
        "assert (dict(os.environ), numba.config.CACHE_DIR) == before\n"
        "above = [compile_cache._HOUSE / name for name in ('analysis', 'recordings', 'replay')]\n"
        "print([each for each in opened if each.startswith(tuple(map(str, above)))])\n"
    )
    environment = {name: value for name, value in os.environ.items() if name != "NUMBA_CACHE_DIR"}
    ran = subprocess.run(
        [sys.executable, "-c", code],
        capture_output=True,
        text=True,
        check=True,
        cwd=REPO,
        env=environment,
    )
    assert ran.stdout.strip() == "[]"

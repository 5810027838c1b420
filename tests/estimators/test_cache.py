"""A place for numba's cache, whoever runs payscope and wherever it lies."""

import os
from pathlib import Path

import pytest

from estimators import cache


@pytest.fixture
def nowhere(monkeypatch: pytest.MonkeyPatch) -> None:
    """Neither the package's folder nor the home can be written to, not even by root."""
    monkeypatch.setenv("NUMBA_CACHE_DIR", "")
    monkeypatch.delenv("NUMBA_CACHE_DIR")
    monkeypatch.setenv("XDG_CACHE_HOME", "/dev/null/cache")
    monkeypatch.setattr(cache, "_HERE", Path("/dev/null"))


@pytest.fixture
def sources(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Path:
    """A folder of sources that can be written to."""
    folder = tmp_path / "estimators"
    folder.mkdir()
    (folder / "ls.py").write_text("first")
    monkeypatch.setattr(cache, "_HERE", folder)
    return folder


def place() -> Path:
    cache.ensure()
    return Path(os.environ["NUMBA_CACHE_DIR"])


@pytest.mark.usefixtures("nowhere")
def test_without_a_place_beside_the_source_or_at_home_it_makes_a_private_one() -> None:
    made = place()
    assert made.is_dir()
    assert made.stat().st_mode & 0o077 == 0


@pytest.mark.usefixtures("nowhere")
def test_a_locked_installation_compiles_into_the_users_cache(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    assert place().parent == tmp_path / "payscope"


@pytest.mark.usefixtures("nowhere")
def test_a_place_that_was_chosen_is_kept(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("NUMBA_CACHE_DIR", "/chosen")
    assert place() == Path("/chosen")


@pytest.mark.usefixtures("nowhere")
def test_a_change_in_any_source_has_its_own_place_also_in_a_child_process(sources: Path) -> None:
    """Numba looks at a function's own file alone, and it holds what it calls from others."""
    first = place()
    assert first.parent == sources / "__pycache__"
    assert place() == first
    (sources / "rolling.py").write_text("another")
    second = place()
    assert second != first
    readers = sources.parent / "replay/readers"
    readers.mkdir(parents=True)
    (readers / "walk.py").write_text("a third")
    assert place() not in (first, second)


def test_every_package_that_compiles_is_looked_at() -> None:
    house = Path(cache.__file__).parent.parent
    compiling = {
        path.relative_to(house).parts[0]
        for package in ("estimators", "analysis", "recordings", "replay")
        for path in (house / package).rglob("*.py")
        if "import compiled" in path.read_text() or "njit" in path.read_text()
    }
    assert compiling <= set(cache._COMPILED)


@pytest.mark.usefixtures("nowhere")
def test_what_old_versions_compiled_is_forgotten(sources: Path) -> None:
    for version in range(8):
        (sources / "ls.py").write_text(str(version))
        last = place()
    left = list(last.parent.iterdir())
    assert last in left
    assert len(left) == 4

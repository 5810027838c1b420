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


@pytest.mark.usefixtures("nowhere")
def test_without_a_place_beside_the_source_or_at_home_it_makes_a_private_one() -> None:
    cache.ensure()
    made = Path(os.environ["NUMBA_CACHE_DIR"])
    assert made.is_dir()
    assert made.stat().st_mode & 0o077 == 0


@pytest.mark.usefixtures("nowhere")
def test_a_place_that_numba_finds_by_itself_is_left_to_it(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    cache.ensure()
    assert "NUMBA_CACHE_DIR" not in os.environ


@pytest.mark.usefixtures("nowhere")
def test_a_place_that_was_chosen_is_kept(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("NUMBA_CACHE_DIR", "/chosen")
    cache.ensure()
    assert os.environ["NUMBA_CACHE_DIR"] == "/chosen"

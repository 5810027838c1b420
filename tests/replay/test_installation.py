"""Packages of these names exist: one that comes before ours is named in one line."""

import os
import subprocess
import sys
import sysconfig
from pathlib import Path

import pytest

from tests.twins import mark_heavy_after

REPO = Path(__file__).resolve().parents[2]
COMMAND = Path(sys.executable).with_name("payscope")


def payscope(*words: str, path: Path) -> "subprocess.CompletedProcess[str]":
    return subprocess.run(
        [COMMAND, *words],
        env={**os.environ, "PYTHONPATH": str(path)},
        capture_output=True,
        text=True,
        check=False,
    )


@pytest.mark.parametrize(
    "name", mark_heavy_after(1, ["estimators", "analysis", "recordings", "replay"])
)
@pytest.mark.parametrize("content", ["__version__ = '0.3'\n", None], ids=["package", "folder"])
def test_a_package_that_shadows_ours_is_named_in_one_line(
    tmp_path: Path, name: str, content: str | None
) -> None:
    (tmp_path / name).mkdir()
    if content is None:
        # a folder without __init__.py gives way to a package
        assert payscope("--version", path=tmp_path).returncode == 0
        return
    (tmp_path / name / "__init__.py").write_text(content)
    left = payscope("--version", path=tmp_path)
    assert left.returncode == 2
    assert left.stderr.count("\n") == 1
    assert f"payscope: {tmp_path / name}/__init__.py: is imported in the place of" in left.stderr
    assert f"take {tmp_path} off PYTHONPATH" in left.stderr
    assert "environment of its own" in left.stderr


def test_without_one_the_command_runs(tmp_path: Path) -> None:
    assert payscope("--version", path=tmp_path).returncode == 0


def from_checkout(site: Path, *words: str) -> subprocess.CompletedProcess[str]:
    """Start the checkout's file with the packages of `site` alone."""
    return subprocess.run(
        # -S: without the packages of this environment, where payscope is installed
        [sys.executable, "-S", REPO / "payscope.py", *words],
        env={**os.environ, "PYTHONPATH": str(site)},
        capture_output=True,
        text=True,
        check=False,
    )


def link_packages(site: Path, *without: str) -> None:
    site.mkdir()
    for needed in Path(sysconfig.get_path("purelib")).iterdir():
        if not needed.name.startswith(without):
            (site / needed.name).symlink_to(needed)


@pytest.mark.parametrize(
    ("bare", "words"),
    [
        pytest.param(True, ("run", "shift.bag", "-m", "machine.toml"), id="run, nothing it needs"),
        pytest.param(True, ("--version",), id="nothing it needs"),
        pytest.param(False, ("--version",), id="all it needs"),
    ],
)
def test_a_checkout_that_is_not_installed_says_so_in_one_line(
    tmp_path: Path, words: tuple[str, ...], bare: bool
) -> None:
    """Test: its sources on the path, no metadata. Expected: how to install it."""
    site = tmp_path / "site"
    if bare:
        site.mkdir()
    else:
        link_packages(site, "payscope", "_payscope", "__editable__")
    left = from_checkout(site, *words)
    assert (left.returncode, left.stdout) == (2, "")
    assert left.stderr.count("\n") == 1
    assert f"payscope: {REPO}: payscope is not installed in this Python" in left.stderr
    assert "make demo" in left.stderr


def test_a_package_that_it_needs_and_that_is_missing_is_named_in_one_line(tmp_path: Path) -> None:
    """Test: installed without dependencies. Expected: which one, and to install it anew."""
    link_packages(tmp_path / "site", "polars")
    left = from_checkout(tmp_path / "site", "run", "shift.bag", "-m", "machine.toml")
    assert (left.returncode, left.stdout) == (2, "")
    assert left.stderr.startswith("payscope: polars: payscope needs this package")
    assert left.stderr.count("\n") == 1

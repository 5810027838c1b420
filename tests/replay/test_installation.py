"""Packages of these names exist: one that comes before ours is named in one line."""

import os
import subprocess
import sys
import sysconfig
from pathlib import Path

import pytest

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


@pytest.mark.parametrize("name", ["estimators", "analysis", "recordings", "replay"])
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


def test_a_checkout_that_is_not_installed_says_so_in_one_line(tmp_path: Path) -> None:
    """Test: its sources on the path, what it needs, no metadata. Expected: how to install it."""
    (tmp_path / "site").mkdir()
    for needed in Path(sysconfig.get_path("purelib")).iterdir():
        if not needed.name.startswith(("payscope", "_payscope", "__editable__")):
            (tmp_path / "site" / needed.name).symlink_to(needed)
    left = subprocess.run(
        # -S: without the packages of this environment, where payscope is installed
        [sys.executable, "-S", REPO / "payscope.py", "--version"],
        env={**os.environ, "PYTHONPATH": str(tmp_path / "site")},
        capture_output=True,
        text=True,
        check=False,
    )
    assert (left.returncode, left.stdout) == (2, "")
    assert left.stderr.count("\n") == 1
    assert f"payscope: {REPO}: payscope is not installed in this Python" in left.stderr
    assert "make demo" in left.stderr

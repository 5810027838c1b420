"""Cache folders for compiled functions, one for each state of the sources compiled into them.

Numba caches compiled functions, so that only the first use waits for the compiler. But it checks
only a function's own file for changes, while a compiled loop contains functions that it calls from
other files. So a cache folder is named after a module and the sources of all its imports from its
own package and this one; an edit elsewhere causes no recompilation. If neither the folder of the
sources nor the user's folder is writable (an installation by root, a service account), compiled
functions last as long as the process.
"""

import atexit
import hashlib
import os
import re
import shutil
import tempfile
from functools import cache
from importlib.metadata import version
from pathlib import Path
from traceback import walk_tb
from typing import Final, NamedTuple

#: Folder that contains the packages.
_HOUSE: Final = Path(__file__).parent.parent
_NAME: Final = "payscope-numba"
#: Number of folders of other states of a module that are kept: those used last.
_MOST_STATES: Final = 3
#: Top-level import in a module with compiled loops.
_LOOPS: Final = re.compile(rb"^from estimators\.(?:compiled|interpreted) import", re.M)
_IMPORT: Final = re.compile(rb"^(?:from|import) +([\w.]+)(?: +import +(\([^)]*\)|.*))?", re.M)


def make_cache_folder(module_file: Path) -> Path:
    """Make the folder for the compiled functions of a module, given the module's file.

    It is inside NUMBA_CACHE_DIR if that is set.
    """
    inside = module_file.relative_to(_HOUSE)
    module = ".".join(inside.with_suffix("").parts)
    for parent in _list_cache_parents(inside.parts[0]):
        folder = parent / module / _digest_source_and_imports(module_file)
        if _is_writable(folder):
            _remove_outdated_cache_folders(folder)
            return folder
    return _make_temporary_folder() / module


known_folder_of: Final = cache(make_cache_folder)


def is_function_cached(module_file: Path, function_name: str) -> bool:
    """Whether a compiled form of a function is in the cache, given its module's file."""
    return any(known_folder_of(module_file).glob(f"*/{module_file.stem}.{function_name}-*.nbi"))


def are_all_loops_cached() -> bool:
    """Whether `record_that_all_loops_are_cached` was called with the present sources and numba."""
    try:
        return _find_all_cached_marker_path().read_text(encoding="utf-8") == describe_cache_state()
    except OSError:
        return False


def record_that_all_loops_are_cached() -> None:
    """Record that every compiled loop is in the cache."""
    marker = _find_all_cached_marker_path()
    partial = marker.with_name(f"{marker.name}.{os.getpid()}")
    partial.write_text(describe_cache_state(), encoding="utf-8")
    partial.replace(marker)


def find_persistent_cache_folder() -> Path | None:
    """Find the folder of the cache; None if no folder that outlasts the process is writable."""
    folder = _find_all_cached_marker_path().parent
    return None if folder == _make_temporary_folder().parent else folder


def _find_all_cached_marker_path() -> Path:
    return known_folder_of(_HOUSE / Path(__file__).parent.name / "compiled.py").parents[1] / "all"


def describe_cache_state() -> str:
    """Describe the cache: numba's version, and the folder of each module with loops."""
    sources = (path for path in sorted(_HOUSE.glob("*/**/*.py")) if _has_compiled_loops(path))
    return "\n".join([version("numba"), *(str(known_folder_of(each)) for each in sources), ""])


def _has_compiled_loops(module_file: Path) -> bool:
    """Whether a module of this repository contains compiled loops."""
    inside = module_file.relative_to(_HOUSE).parts[0]
    return (_HOUSE / inside / "__init__.py").exists() and bool(
        _LOOPS.search(module_file.read_bytes())
    )


def remove_compile_cache() -> list[Path]:
    """Remove the cache, for when part of it is unreadable; return the removed folders."""
    packages = [path.parent.name for path in _HOUSE.glob("*/__init__.py")]
    kept = {
        parent for package in packages for parent in _list_cache_parents(package) if parent.is_dir()
    }
    for parent in kept:
        shutil.rmtree(parent, ignore_errors=True)
    return sorted(kept)


def remove_unreadable_compiled_code(error: BaseException) -> list[Path]:
    """Remove the compiled code that could not be read.

    The disk was full when it was written, or two processes wrote it at the same time.

    Args:
        error: what reading raised: an EOFError or an UnpicklingError.

    Returns:
        The removed files and folders; none if something else could not be read.
    """
    for frame, _ in walk_tb(error.__traceback__):
        if "numba" in Path(frame.f_code.co_filename).parts:
            return remove_compile_cache()
        if frame.f_code.co_name == "get_code" and frame.f_locals.get("bytecode_path"):
            # a module's: Python up to 3.12 takes a file that a full disk cut short for whole
            bytecode = Path(frame.f_locals["bytecode_path"])
            bytecode.unlink(missing_ok=True)
            return [bytecode]
    return []


def _list_cache_parents(package: str) -> tuple[Path, ...]:
    """Possible parents of a package's cache folders, the preferred one first."""
    chosen = os.environ.get("NUMBA_CACHE_DIR")
    if chosen:
        return (Path(chosen, _NAME),)
    home = os.environ.get("XDG_CACHE_HOME") or os.path.expanduser("~/.cache")  # noqa: PTH111 - no error without a home
    return (_HOUSE / package / "__pycache__" / _NAME, Path(home, "payscope", _NAME))


@cache
def _make_temporary_folder() -> Path:
    """Make a folder that is removed when the process ends."""
    folder = tempfile.mkdtemp(prefix=f"{_NAME}-")
    atexit.register(shutil.rmtree, folder, ignore_errors=True)
    return Path(folder)


class _Source(NamedTuple):
    """Digest of a module's source, and the files that it imports; it names the cache folder."""

    #: path of its file, relative to the packages' folder
    name: str
    package: str
    sha256: bytes
    #: files of its imports from the packages
    imports: tuple[Path, ...]


def _digest_source_and_imports(module_file: Path) -> str:
    """Hash the sources of a module and of its imports from its own package and this one."""
    packages = {Path(__file__).parent.name, _read_source_and_imports(module_file).package}
    found: dict[Path, _Source] = {}
    # include the compiler options, whose module an interpreted loop does not import
    left = [module_file, _HOUSE / Path(__file__).parent.name / "compiled.py"]
    while left:
        path = left.pop()
        if path not in found and (read := _read_source_and_imports(path)).package in packages:
            found[path] = read
            left += read.imports
    digest = hashlib.sha256()
    for each in sorted(found.values()):
        digest.update(each.name.encode() + b"\0" + each.sha256)
    return digest.hexdigest()[:16]


@cache
def _read_source_and_imports(module_file: Path) -> _Source:
    """Hash the source of a module, and find the files of its imports."""
    text, inside = module_file.read_bytes(), module_file.relative_to(_HOUSE)
    modules: set[Path] = set()
    for package, names in _IMPORT.findall(text):
        home = _HOUSE.joinpath(*package.decode().split("."))
        modules.add(home)
        if home.is_dir():  # in a module, imported names are what it defines
            modules |= {home / name for name in re.findall(r"\w+", names.decode())}
    files = (path for each in modules for path in (each.with_suffix(".py"), each / "__init__.py"))
    return _Source(
        inside.as_posix(),
        inside.parts[0],
        hashlib.sha256(text).digest(),
        tuple(path for path in files if path.is_file()),
    )


def _is_writable(folder: Path) -> bool:
    try:
        folder.mkdir(parents=True, exist_ok=True)
        folder.touch()
    except OSError:
        return False
    return os.access(folder, os.W_OK | os.X_OK)


def _remove_outdated_cache_folders(folder: Path) -> None:
    """Remove compiled functions of older sources of a module, except the latest few."""
    others = [each for each in folder.parent.iterdir() if each != folder]
    by_age = sorted(others, key=lambda each: each.stat().st_mtime)
    for each in by_age[: max(0, len(by_age) - _MOST_STATES)]:
        shutil.rmtree(each, ignore_errors=True)

"""The installed command, in a module of its own name.

Distributions with packages named `analysis` or `replay` exist. One that Python finds before ours
is named in one line, before anything of ours is imported; one whose files were installed into our
folders is named when an import fails.
"""

import sys
from importlib import import_module
from importlib.util import find_spec
from pathlib import Path
from typing import NoReturn

_OURS = Path(__file__).resolve().parent
_PACKAGES = ("estimators", "analysis", "recordings", "replay")


def main() -> None:
    """Run the command line, unless another distribution stands in the place of our packages."""
    _run("replay.commands.cli")


def importer() -> None:
    """Run the importer of the Rerun viewer, likewise."""
    _run("replay.commands.importer")


def _run(module: str) -> None:
    for name in _PACKAGES:
        found = find_spec(name)
        if found is None or found.origin is None:
            _refuse(f"{_OURS / name}: the package is not there; install payscope anew")
        theirs = Path(found.origin).resolve()
        on_path = theirs.parents[1] if found.submodule_search_locations else theirs.parent
        if on_path != _OURS:
            _refuse(
                f"{theirs}: is imported in the place of payscope's own package '{name}'; install "
                f"payscope into an environment of its own (pipx install), or take {on_path} off "
                "PYTHONPATH, or start from another folder"
            )
    try:
        import_module(module).main()
    except ImportError as error:
        package = (error.name or "").partition(".")[0]
        if package == "payscope":  # its version is not found: `importlib.metadata`
            _refuse(
                f"{_OURS}: payscope is not installed in this Python ({sys.executable}); run "
                f"'{sys.executable} -m pip install -e {_OURS}', or 'make demo' once and then "
                f"{_OURS / '.venv/bin/payscope'}"
            )
        if package not in _PACKAGES:
            raise
        _refuse(
            f"{_OURS / package}: files of another distribution lie among payscope's own ({error}); "
            "install payscope anew, in an environment of its own (pipx install)"
        )


def _refuse(fault: str) -> NoReturn:
    sys.stderr.write(f"payscope: {fault}\n")
    sys.exit(2)


if __name__ == "__main__":
    main()

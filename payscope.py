"""The public API of scripts and notebooks, and the installed command.

    import payscope

    imu = payscope.scan_log("shift.bag", "/imu/data")

Names are resolved when first used: scanning logs imports none of what recordings need.

Distributions with packages named `analysis` or `replay` exist. One that Python finds before ours
is named in one line, before anything of ours is imported; one whose files were installed into our
folders is named when an import fails.
"""

import gc
import os
import sys
from importlib import import_module
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING, Any, NoReturn

if TYPE_CHECKING:
    from analysis import online
    from recordings import read_recording, write_recording
    from replay import load_machine, open_log, run
    from replay.frames.scan import LogStream, join_topics, scan_log, stream_log
    from replay.frames.topic_source import LossWarning

__all__ = [
    "LogStream",
    "LossWarning",
    "join_topics",
    "load_machine",
    "online",
    "open_log",
    "read_recording",
    "run",
    "scan_log",
    "stream_log",
    "write_recording",
]

_HOMES = {
    "LogStream": "replay.frames.scan",
    "LossWarning": "replay.frames.topic_source",
    "join_topics": "replay.frames.scan",
    "load_machine": "replay",
    "online": "analysis.online",
    "open_log": "replay",
    "read_recording": "recordings",
    "run": "replay",
    "scan_log": "replay.frames.scan",
    "stream_log": "replay.frames.scan",
    "write_recording": "recordings",
}
_OURS = Path(__file__).resolve().parent
_PACKAGES = ("estimators", "analysis", "recordings", "replay")
#: New objects after which Python looks for cycles, 700 where nobody says. A run imports 2,600
#: modules, whose objects all stay: it looked through them for a tenth of a short run.
_OBJECTS_A_COLLECTION = 10_000


def __getattr__(name: str) -> Any:
    if name not in _HOMES:
        raise AttributeError(f"module 'payscope' has no attribute '{name}'")
    if fault := _shadowed():
        raise ImportError(f"payscope: {fault}")
    home = import_module(_HOMES[name])
    # `online` is a module itself
    return home if _HOMES[name].endswith(f".{name}") else getattr(home, name)


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})


def main() -> None:
    """Run the command line, unless another distribution stands in the place of our packages."""
    _run("replay.commands.cli")


def importer() -> None:
    """Run the importer of the Rerun viewer, likewise."""
    _run("replay.commands.importer_command")


def _shadowed() -> str:
    """Which of our packages another distribution stands in the place of; empty where none is."""
    for name in _PACKAGES:
        found = find_spec(name)
        if found is None or found.origin is None:
            return f"{_OURS / name}: the package is not there; install payscope anew"
        theirs = Path(found.origin).resolve()
        on_path = theirs.parents[1] if found.submodule_search_locations else theirs.parent
        if on_path != _OURS:
            return (
                f"{theirs}: is imported in the place of payscope's own package '{name}'; install "
                f"payscope into an environment of its own (pipx install), or take {on_path} off "
                "PYTHONPATH, or start from another folder"
            )
    return ""


def _run(module: str) -> None:
    if fault := _shadowed():
        _refuse(fault)
    gc.set_threshold(_OBJECTS_A_COLLECTION, *gc.get_threshold()[1:])
    # a replay gives the same bits with any number, and threads that wait cost processor time
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    try:
        import_module(module).main()
    except KeyboardInterrupt:  # before the command line is there, which says the same
        sys.exit(130)
    except ImportError as error:
        package = (error.name or "").partition(".")[0]
        if not _is_installed():  # neither its version nor what it needs is found
            _refuse(
                f"{_OURS}: payscope is not installed in this Python ({sys.executable}); run "
                f"'{sys.executable} -m pip install -e {_OURS}', or 'make demo' once and then "
                f"{_OURS / '.venv/bin/payscope'}"
            )
        if package not in _PACKAGES and isinstance(error, ModuleNotFoundError):
            _refuse(
                f"{error.name}: payscope needs this package, which is not installed in this Python "
                f"({sys.executable}); install payscope anew, with what it needs"
            )
        if package not in _PACKAGES:
            raise
        _refuse(
            f"{_OURS / package}: files of another distribution lie among payscope's own ({error}); "
            "install payscope anew, in an environment of its own (pipx install)"
        )
    finally:
        # what was imported goes with the process: Python need not look for cycles in it
        gc.freeze()


def _is_installed() -> bool:
    """Whether this Python has payscope as a distribution."""
    from importlib.metadata import PackageNotFoundError, distribution

    try:
        distribution("payscope")
    except PackageNotFoundError:
        return False
    return True


def _refuse(fault: str) -> NoReturn:
    sys.stderr.write(f"payscope: {fault}\n")
    sys.exit(2)


if __name__ == "__main__":
    main()

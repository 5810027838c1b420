"""The installed command, in a module that nobody else's is named like.

Distributions with packages named `analysis` or `replay` exist. One that Python finds before ours
is named in one line, before anything of ours is imported.
"""

import sys
from importlib.util import find_spec
from pathlib import Path

_OURS = Path(__file__).resolve().parent


def main() -> None:
    """Run the command line, unless another distribution stands in the place of our packages."""
    for name in ("estimators", "analysis", "recordings", "replay"):
        found = find_spec(name)
        if found is None or found.origin is None:
            _refuse(f"{_OURS / name}: the package is not there; install payscope anew")
        elif Path(found.origin).resolve().parents[1] != _OURS:
            _refuse(
                f"{Path(found.origin).parent}: is imported in the place of payscope's own package "
                f"'{name}'; install payscope into an environment of its own (pipx install), or "
                "take that folder off PYTHONPATH"
            )
    from replay.commands.cli import main

    main()


def _refuse(fault: str) -> None:
    sys.stderr.write(f"payscope: {fault}\n")
    sys.exit(2)


if __name__ == "__main__":
    main()

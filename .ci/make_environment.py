"""Create the virtual environment, also where Debian's python3 comes without ensurepip."""

import subprocess
import sys
import venv
from pathlib import Path


def main(folder: str) -> int:
    """Make the environment in `folder`; 0, or 2 with one line that says what is missing."""
    if sys.version_info < (3, 11):
        print(
            f"payscope needs Python 3.11 or newer, this is {sys.version.split()[0]}; "
            "name one with `make PYTHON=python3.12`",
            file=sys.stderr,
        )
        return 2
    try:
        venv.create(folder, with_pip=True, clear=True)
    except (subprocess.CalledProcessError, ModuleNotFoundError):
        # without ensurepip: let a pip that is already there install itself into the environment
        venv.create(folder, with_pip=False, clear=True)
        python = str(Path(folder, "bin", "python"))
        command = [sys.executable, "-m", "pip", "--python", python, "install", "--quiet", "pip"]
        if subprocess.run(command, check=False).returncode:
            print(
                "this python3 has neither ensurepip nor pip; Debian: apt-get install python3-venv",
                file=sys.stderr,
            )
            return 2
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1]))

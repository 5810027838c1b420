"""From a stranger's table to a mass: `init`, the answers to its draft, `run`, for every dialect.

    python -P benchmarks/table_dialects.py [WORD ...]

The drive is one and the same in all files, so the mass tells whether time, separator, sign and unit
were taken as they are meant. Prints a row a file, and how many of each set opened, were drafted and
ran; exits 1 where a mass is wrong.
"""

import math
import sys
import tempfile
from collections import Counter
from pathlib import Path

from analysis.model.machine import Machine
from benchmarks.dialects.dialect_file import MASS_KG, DialectFile
from benchmarks.dialects.every_file import SETS, answered, files_of_set
from estimators.errors import PayscopeError
from replay.commands.common_options import make_time_axis_from_options
from replay.init.guess_machine import draft_machine_file
from replay.logs import Log, open_log
from replay.machines.machine_file import load_machine
from replay.pipeline import run

#: Share that a mass may be off: coarse cells and derived accelerations cost some.
_OFF = 0.03
_ENDS = ("refused", "opened", "withheld", "WRONG", "ran")
#: Channels of which one of each has to be in a draft.
_NEEDED = (("force_x_N", "torque_left_N_m"), ("speed_x_m_s", "speed_left_m_s"))


def outcome(file: DialectFile, folder: Path) -> tuple[str, bool, str]:
    """What became of a file, whether force and speed were drafted, and the mass or the reason."""
    path = folder / f"log{file.suffix}"
    path.write_bytes(file.data)
    machine_path = folder / "machine.toml"
    stage, is_drafted = "refused", False
    try:
        axis = make_time_axis_from_options(None, None, list(file.keys))
        with open_log(path, time=axis) as log:
            draft, _ = draft_machine_file(log, axis)
            stage = "opened"
            is_drafted = all(
                any(f"[channels.{name}]" in draft for name in each) for each in _NEEDED
            )
            machine_path.write_text(answered(draft, file), encoding="utf-8")
            mass_kg = _mass_kg(log, load_machine(machine_path))
    except PayscopeError as error:
        return stage, is_drafted, str(error).replace(f"{folder}/", "")
    if math.isnan(mass_kg):
        return "withheld", is_drafted, "the verdict withholds the mass"
    if abs(mass_kg / MASS_KG - 1) > _OFF:
        return "WRONG", is_drafted, f"{mass_kg:.0f} kg"
    return "ran", is_drafted, f"{mass_kg:.1f} kg"


def is_asked(file: DialectFile, folder: Path) -> bool:
    """Whether a file is refused, or `init` asks for its time, without a person's keys."""
    path = folder / f"log{file.suffix}"
    path.write_bytes(file.data)
    try:
        with open_log(path) as log:
            log.topics()
            _, questions = draft_machine_file(log, None)
    except PayscopeError:
        return True
    return any("[log]" in each for each in questions)


def _mass_kg(log: Log, machine: Machine) -> float:
    loads = run(log, machine).frames["loads"]
    masses = loads["mass_kg"].drop_nulls()
    return float(masses[0]) if masses.len() else math.nan


def main(words: list[str]) -> int:
    """Print the table; 1 where a mass is wrong, or a question was not asked."""
    wrong = 0
    for name in SETS:
        counts: Counter[str] = Counter()
        for file in files_of_set(name):
            if words and not any(word in file.name for word in words):
                continue
            with tempfile.TemporaryDirectory() as folder:
                found, is_drafted, said = outcome(file, Path(folder))
                asked = bool(file.keys) and is_asked(file, Path(folder))
            counts[found] += 1
            counts["drafted"] += is_drafted
            counts["asked before"] += asked
            wrong += found == "WRONG" or (bool(file.keys) and not asked)
            print(
                f"{found:8} {'drafted' if is_drafted else '':8}{'asked' if asked else '':6}"
                f"{file.name:55.55} {said[:150]}",
                flush=True,
            )
        print(f"== {name}: {sum(counts[end] for end in _ENDS)} files, {dict(counts)}")
    return wrong > 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))

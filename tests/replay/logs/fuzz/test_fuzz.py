"""Damaged logs of every container: no crash, no hang, no silent difference, one line at most.

`make fuzz` damages 600 of each. Where a test fails it names files by numbers and keeps them;
`PAYSCOPE_FUZZ_FIRST=1234 PAYSCOPE_FUZZ_FILES=1` with `-k` gives the same one again.
"""

import faulthandler
import os
import shutil
import traceback
from collections.abc import Callable, Iterable, Iterator
from functools import partial
from pathlib import Path
from time import perf_counter

import pytest

from tests.replay.logs.fuzz.campaign import Case, Hang, Tally, at_most, make_case, peak_mb
from tests.replay.logs.fuzz.judgement import Reading, faults_of, faults_of_command, read_all
from tests.replay.logs.fuzz.recorded import START_NS, STEP_NS, STEPS
from tests.replay.logs.fuzz.sources import SOURCES, Source
from tests.replay.sledge import Payscope
from tests.twins import mark_heavy_after

FILES = int(os.environ.get("PAYSCOPE_FUZZ_FILES", "4"))
FIRST = int(os.environ.get("PAYSCOPE_FUZZ_FIRST", "0"))
#: A file of 40 kB is read in some hundredths of a second.
LONGEST_S = 20.0
#: Slabs, and what libraries keep.
MOST_GROWTH_MB = 200.0
MOST_FAULTS = 20
_STDERR = 2
#: One file in so many goes through the command line besides.
INFO_EVERY, RUN_EVERY = 5, 40
MACHINE = """
[machine]
name = "loader"

[channels.force_x_N]
{force}

[channels.speed_x_m_s]
{speed}

[settings.forces]
acceleration = "kinematic"

[settings.gate]
window_samples = 100
"""


def between(number: int) -> tuple[int, int]:
    """Two times of a log."""
    first = number % STEPS
    last = first + (7 * number) % STEPS
    return START_NS + first * STEP_NS, START_NS + last * STEP_NS


def caught(check: Callable[[], Iterable[str]]) -> list[str]:
    """The faults that a check finds; a crash and a hang are faults too."""
    try:
        with at_most(LONGEST_S):
            return list(check())
    except (Exception, Hang) as error:  # noqa: BLE001 - whatever it is
        return ["".join(traceback.format_exception(error, limit=-4))]


def faults(case: Case, number: int, whole: Reading, tally: Tally) -> Iterator[str]:
    began = perf_counter()
    found = read_all(case.path, *between(number))
    tally.slowest = max(tally.slowest, (perf_counter() - began, f"{case.container} {number}"))
    tally.files[case.container, case.damage.__name__, found.outcome] += 1
    yield from faults_of(found, whole, case)


def commands(case: Case, number: int, machine: Path) -> Iterator[tuple[object, ...]]:
    if number % INFO_EVERY == 0:
        yield ("info", case.path, *(["--json"] if number % (2 * INFO_EVERY) else []))
    if number % RUN_EVERY == 3:
        yield ("run", case.path, "-m", machine)


@pytest.fixture
def machine(tmp_path: Path, container: str) -> Path:
    path = tmp_path / "loader.toml"
    fields = {"force": 'field = "force_N"', "speed": 'field = "speed_m_s"'}
    if container not in ("csv", "jsonl", "parquet"):
        fields = {
            "force": 'topic = "/wheels"\nfield = "effort[left]"',
            "speed": 'topic = "/state"\nfield = "speed"',
        }
    path.write_text(MACHINE.format(**fields))
    return path


@pytest.mark.heavy
@pytest.mark.parametrize("container", mark_heavy_after(1, SOURCES))
def test_damage_costs_what_it_hit_and_is_said_in_lines(
    container: str,
    sources: dict[str, Source],
    tally: Tally,
    payscope: Payscope,
    machine: Path,
    tmp_path: Path,
) -> None:
    whole = read_all(sources[container].path, *between(0))
    assert whole.rows
    assert not whole.faults + whole.refused
    at_first = peak_mb()
    found: list[str] = []
    for number in range(FIRST, FIRST + FILES):
        folder = tmp_path / f"{container} {number}"
        case = make_case(sources, container, number, folder)
        # where even an exception is not heard, the process ends with a traceback; the file stays
        faulthandler.dump_traceback_later(3 * LONGEST_S, exit=True, file=_STDERR)
        told = caught(partial(faults, case, number, whole, tally))
        for words in commands(case, number, machine):
            told += caught(partial(faults_of_command, payscope, words))
            tally.commands += 1
        faulthandler.cancel_dump_traceback_later()
        if told:
            found += [f"{container} {number} ({case.damage.__name__}), {folder}: {f}" for f in told]
        else:
            shutil.rmtree(folder)
        if len(found) >= MOST_FAULTS:
            break
    assert not found, "\n".join(found)
    assert peak_mb() - at_first < MOST_GROWTH_MB

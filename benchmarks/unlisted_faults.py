"""Faults that nobody listed: what is shown of each, what is named, and whether mending does harm.

    python -P benchmarks/unlisted_faults.py [--seeds 20] [--first 2800000] [--more] [--clean 100]
                                            [--fault NAME]... [--json FILE] [--read FILE]

Every log is a line of `--json` as it comes, and the campaign goes on where the file ends; `--more`
tries the eighteen faults that nothing was made for. An open answer that is more than three of its
standard uncertainties off, without a finding or a warning of the scale, is wrong.
"""

import os
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Final

import typer

from analysis.model.check_names import replace_former_check_names
from analysis.model.run_record import Run
from benchmarks.kept_trials import read_rows, run_trials
from benchmarks.page import markdown
from benchmarks.unlisted_more import MORE
from benchmarks.unlisted_rows import (
    UNLISTED,
    Unlisted,
    drawn_log,
    memory_log,
    with_usual_sides,
)
from estimators.errors import PayscopeError
from replay.pipeline import run

_CLEAN: Final = "none"
#: Checks that warn of a scale, or of sides that are unlike.
_WARN: Final = ("empty_mass", "side_difference")
_WRONG_U: Final = 3.0


@dataclass(frozen=True)
class FaultTrial:
    """What a log with a fault says.

    Attributes:
        fault: its name; "none" of a clean log.
        size: of it, as it is stated.
        seed: of machine and noise; odd ones are of the independent plant.
        true_kg: mass of the empty machine, as the force moves it.
        mass_kg: of the answer, None where it is withheld.
        u_kg: its standard uncertainty.
        causes: that are named, in their order, each with those that it is not told from.
        failed: checks that failed.
        refused: the error that the replay ended with, if any.
    """

    fault: str
    size: float
    seed: int
    true_kg: float
    mass_kg: float | None
    u_kg: float | None
    causes: Sequence[Sequence[str]]
    failed: Sequence[str]
    refused: str = ""

    @property
    def is_wrong(self) -> bool:
        """Whether an open answer is off, and nothing says so."""
        if self.mass_kg is None or not self.u_kg or self.causes:
            return False
        warned = any(replace_former_check_names(name) in _WARN for name in self.failed)
        return not warned and abs(self.mass_kg - self.true_kg) > _WRONG_U * self.u_kg

    def is_named(self, causes: Sequence[str]) -> bool:
        """Whether one of these causes stands first, or in the class of the first."""
        return bool(self.causes) and bool(set(self.causes[0]) & set(causes))


def try_fault(fault: Unlisted | None, size: float, seed: int, *, odd: bool = False) -> FaultTrial:
    """Draw a log, put the fault into it, replay it."""
    log = drawn_log(seed, odd=odd, both_ways=fault is not None and fault.both_ways)
    log = with_usual_sides(log, seed) if fault is None else fault.put_into(log, size, seed)
    name = _name(fault)
    try:
        replayed = run([memory_log(log)], log.machine)
    except PayscopeError as error:
        return FaultTrial(name, size, seed, log.true_kg, None, None, (), (), str(error))
    return _read_off(replayed, name, size, seed, log.true_kg)


def _name(fault: Unlisted | None) -> str:
    return _CLEAN if fault is None else fault.name


def _read_off(replayed: Run, name: str, size: float, seed: int, true_kg: float) -> FaultTrial:
    loads = replayed.frames["loads"].to_dicts()
    given = [row for row in loads if not row["withheld"] and row["mass_kg"] is not None]
    # of several states, the one that is farthest off
    worst = max(given, key=lambda row: abs(row["mass_kg"] - true_kg) / row["u_kg"], default=None)
    judged = replayed.frames["verdict"]
    return FaultTrial(
        name,
        size,
        seed,
        true_kg,
        None if worst is None else worst["mass_kg"],
        None if worst is None else worst["u_kg"],
        [
            (row["cause"], *(each for each in row["alternatives"].split(", ") if each))
            for row in replayed.frames["findings"].to_dicts()
        ],
        [row["check"] for row in judged.to_dicts() if row["passed"] is False],
    )


def tasks(
    faults: Sequence[Unlisted], seeds: Sequence[int], clean: Sequence[int]
) -> Iterator[tuple[Unlisted | None, float, int]]:
    """Every log, seed by seed, so that whatever is done is done of all faults alike."""
    for seed in seeds:
        for fault in faults:
            for size in fault.sizes:
                yield fault, size, seed
    for seed in clean:
        yield None, 0.0, seed


def table(found: Sequence[FaultTrial], faults: Sequence[Unlisted]) -> str:
    """A row a fault and size."""
    head = ["fault", "size", "logs", "open", "wrong and unsaid", "named first", "else first"]
    lines: list[list[str]] = []
    for fault in faults:
        for size in dict.fromkeys(fault.sizes):
            part = [f for f in found if f.fault == fault.name and f.size == size]
            if part:
                lines.append(_line(fault, size, part))
    clean = [f for f in found if f.fault == _CLEAN]
    if clean:
        named = [f for f in clean if f.causes]
        others = _others(clean, ())
        wrong = sum(f.is_wrong for f in clean)
        opened = sum(f.mass_kg is not None for f in clean)
        lines.append(
            ["none", "", str(len(clean)), str(opened), str(wrong), str(len(named)), others]
        )
    return markdown(head, lines)


def _line(fault: Unlisted, size: float, part: Sequence[FaultTrial]) -> list[str]:
    named = sum(f.is_named(fault.causes) for f in part)
    return [
        fault.name,
        f"{size:.3g}",
        str(len(part)),
        str(sum(f.mass_kg is not None for f in part)),
        str(sum(f.is_wrong for f in part)),
        f"{named} ({100 * named / len(part):.0f} %)",
        _others(part, fault.causes),
    ]


def _others(part: Sequence[FaultTrial], causes: Sequence[str]) -> str:
    counts: dict[str, int] = {}
    for each in part:
        if not each.is_named(causes):
            first = each.causes[0][0] if each.causes else "refused" if each.refused else "nothing"
            counts[first] = counts.get(first, 0) + 1
    return ", ".join(f"{name} {n}" for name, n in sorted(counts.items(), key=lambda c: -c[1]))


def main(
    seeds: int = 20,
    first: int = 2_800_000,
    clean: int = 100,
    more: bool = False,
    fault: Annotated[list[str] | None, typer.Option()] = None,
    lines: Annotated[Path | None, typer.Option("--json")] = None,
    read: Annotated[list[Path] | None, typer.Option("--read")] = None,
) -> None:
    faults = [each for each in (MORE if more else UNLISTED) if not fault or each.name in fault]
    if read:
        print(table([FaultTrial(**row) for row in read_rows(*read)], faults))
        return
    clean_seeds = range(first + 500_000, first + 500_000 + clean)
    found = run_trials(
        tasks(faults, range(first, first + seeds), clean_seeds),
        lambda task: try_fault(*task, odd=task[0] is None and task[2] % 4 == 0),
        lines,
        FaultTrial,
        task_key=lambda task: (_name(task[0]), round(task[1], 6), task[2]),
        result_key=lambda each: (each.fault, round(each.size, 6), each.seed),
    )
    print(table(list(found), faults))


if __name__ == "__main__":
    os.environ.setdefault("POLARS_MAX_THREADS", "1")
    typer.run(main)

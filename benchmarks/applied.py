"""Whether `explain --apply` does harm: the mass before and after, over all causes.

    python -P benchmarks/applied.py [--seeds 8] [--first 2900000] [--fault NAME]... [--json FILE]
                                    [--read FILE]

Every fault of the table of injected faults at one size, and every unlisted fault at its middle one,
on drawn machines, in memory. A log is a line of `--json`, and the campaign goes on where the file
ends. Harm is a mass that is farther from the truth in its own standard uncertainty than it was, or
one that was withheld and is open and wrong.
"""

import os
import tomllib
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Final

import tomlkit
import typer

from analysis.model.answer import Answer, make_answer
from analysis.model.machine import Machine
from analysis.model.settings import Settings
from benchmarks.findings_rows import AXES, design, needed, own_machine, simulated
from benchmarks.kept_trials import read_rows, run_trials
from benchmarks.page import markdown
from benchmarks.unlisted_rows import UNLISTED, Unlisted, drawn_log, memory_log
from estimators.errors import PayscopeError
from replay.explain.try_proposals import ProposalReplays, try_proposals_one_by_one
from replay.inputs.derived_logs import CachedLog, MemoryLog, copy_machine_with_simulated_channels
from replay.logs import Log
from replay.pipeline import run
from tests.trials.drawn_designs import join_designs
from tests.trials.fault_injection import FAULTS, Fault

#: Size of an injected fault, where it has one.
_SIZE: Final = 3.0
#: A mass is wrong from so many of its standard uncertainties on; nearer, noise decides which is
#: farther.
_WRONG_U: Final = 2.0


@dataclass(frozen=True)
class Applied:
    """What mending did to a log.

    Attributes:
        fault: its name.
        seed: of machine and noise.
        true_kg: mass of the machine.
        before: mass and standard uncertainty, None where it is withheld.
        after: likewise, with what was written; as `before` where nothing was.
        causes: of what was written.
        taken_back: cause and why, of what was not.
    """

    fault: str
    seed: int
    true_kg: float
    before: Sequence[float] | None
    after: Sequence[float] | None
    causes: Sequence[str]
    taken_back: Sequence[tuple[str, str]]

    def off_u(self, said: Sequence[float] | None) -> float | None:
        """How far a mass is from the truth in its own standard uncertainty."""
        return None if said is None else abs(said[0] - self.true_kg) / said[1]

    @property
    def is_farther(self) -> bool:
        """Whether it is farther off in its own uncertainty than before."""
        was, now = self.off_u(self.before), self.off_u(self.after)
        return bool(self.causes) and was is not None and now is not None and now > was

    @property
    def is_harmed(self) -> bool:
        """Whether it is wrong, and was not, or was withheld, or less so."""
        was, now = self.off_u(self.before), self.off_u(self.after)
        return bool(self.causes) and now is not None and now > max(_WRONG_U, was or 0.0)


def applied(fault: Fault | Unlisted, seed: int) -> Applied:
    """Draw a log with a fault, and mend its machine file."""
    log, machine, true_kg = _draw_log(fault, seed)
    text = tomlkit.dumps(machine.model_dump(mode="json", exclude_none=True, exclude_defaults=True))

    def load(changed: str, _: Sequence[str]) -> Machine:
        return Machine.model_validate(tomllib.loads(changed))

    log = CachedLog(log)
    try:
        before = run(log, machine)
    except PayscopeError:
        return Applied(fault.name, seed, true_kg, None, None, (), ())
    found = try_proposals_one_by_one(before, ProposalReplays(log, text, load, Path("machine.toml")))
    return Applied(
        fault.name,
        seed,
        true_kg,
        _mass(make_answer(before)),
        _mass(make_answer(found.run)),
        sorted({each.cause for each in found.changes}),
        [(each.proposal.cause, each.why) for each in found.rejected],
    )


def _draw_log(fault: Fault | Unlisted, seed: int) -> tuple[Log, Machine, float]:
    if isinstance(fault, Unlisted):
        drawn = drawn_log(seed, both_ways=fault.both_ways)
        drawn = fault.put_into(drawn, fault.sizes[1], seed)
        return memory_log(drawn), drawn.machine, drawn.true_kg
    size = _SIZE if fault.largest is None else min(_SIZE, fault.largest)
    sections = needed(design(seed, odd=False), [fault])
    if fault.ground is not None:
        sections = join_designs(sections, fault.ground(sections, size))
    log, *_ = simulated(sections, [(fault, size)])
    # as a user has it: the limits of the verdict hold
    own = own_machine(log.scenario, fault.overrides, AXES)
    settings = own.settings.copy_with_changes({"trace.methods": ("pooled",)})
    limits = Settings.model_validate({}).verdict
    own = own.model_copy(update={"settings": settings.model_copy(update={"verdict": limits})})
    return (
        MemoryLog(log),
        copy_machine_with_simulated_channels(own, log),
        log.scenario.machine.mass_kg,
    )


def _mass(said: Answer) -> tuple[float, float] | None:
    known = [(row["mass_kg"], row["u_kg"]) for row in said.loads if row["mass_kg"] is not None]
    return min(known, default=None)


def table(found: Sequence[Applied]) -> str:
    """A row a fault."""
    head = ["fault", "logs", "open", "written", "open after", "farther in u", "harmed", "causes"]
    rows: list[list[str]] = []
    for name in [*dict.fromkeys(each.fault for each in found), "all"]:
        part = [each for each in found if name in (each.fault, "all")]
        causes = sorted({cause for each in part for cause in each.causes})
        rows.append(
            [
                name,
                str(len(part)),
                str(sum(each.before is not None for each in part)),
                str(sum(bool(each.causes) for each in part)),
                str(sum(each.after is not None for each in part)),
                str(sum(each.is_farther for each in part)),
                str(sum(each.is_harmed for each in part)),
                "" if name == "all" else ", ".join(causes),
            ]
        )
    return markdown(head, rows)


def tasks(
    names: Sequence[str] | None, seeds: Sequence[int]
) -> Iterator[tuple[Fault | Unlisted, int]]:
    """Seed by seed, so that whatever is done is done of all faults alike."""
    for seed in seeds:
        for fault in (*UNLISTED, *FAULTS):
            if not names or fault.name in names:
                yield fault, seed


def main(
    seeds: int = 8,
    first: int = 2_900_000,
    fault: Annotated[list[str] | None, typer.Option()] = None,
    lines: Annotated[Path | None, typer.Option("--json")] = None,
    read: Annotated[list[Path] | None, typer.Option("--read")] = None,
) -> None:
    if read:
        print(table([Applied(**row) for row in read_rows(*read)]))
        return
    found = run_trials(
        tasks(fault, range(first, first + seeds)),
        lambda task: applied(*task),
        lines,
        Applied,
        task_key=lambda task: (task[0].name, task[1]),
        result_key=lambda each: (each.fault, each.seed),
    )
    print(table(list(found)))


if __name__ == "__main__":
    os.environ.setdefault("POLARS_MAX_THREADS", "1")
    typer.run(main)

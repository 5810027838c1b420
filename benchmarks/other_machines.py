"""Machines without a bucket: no pile, no load that is none, and loads told where files end.

    python -P benchmarks/other_machines.py alone.jsonl --logs 120
    python -P benchmarks/other_machines.py files.jsonl --logs 120 --files

Two cars, a bus that never stands, a cart, a rack and an arm (`other_machines` of the simulator)
take turns. With `--files` each drives one to seven files with one to seven loads, in order of their
size or shuffled. What a file of results holds is not run again; its table is printed.
"""

import tempfile
import time
from collections.abc import Iterator, Sequence
from contextlib import ExitStack
from dataclasses import asdict, dataclass
from itertools import pairwise
from pathlib import Path
from typing import Annotated, Any, Final

import numpy as np
import polars as pl
import typer

from analysis.model.machine import Machine
from analysis.model.run_record import Run
from analysis.simulation import Scenario, simulate_campaign
from benchmarks.kept_trials import keep, read_rows
from replay import open_log, run
from replay.logs import TimeAxis
from tests.analysis.kinematic_machine import kinematic_machine
from tests.analysis.other_machine_logs import table_of
from tests.trials.other_machines import OTHER_MACHINES

MOST_FILES: Final = 7
#: From one load to the next, over the machine's mass: a bus with labelled loads had 5 %.
STEP_1: Final = 0.06
#: Between two files that count from 0, in s and in samples.
_BETWEEN_S: Final = 10.0
#: How well a machine file knows what turns in the top gear, over that.
_ROTATING_U_1: Final = 0.2
#: Standard uncertainties within which a mass is right.
_K: Final = 2.0


@dataclass(frozen=True, slots=True)
class MachineDraw:
    """A machine, and which load each of its files has.

    Attributes:
        name: of the machine.
        seed: of the machine and its drives.
        level: number of the load of each file.
        order: "one load", "in order" or "shuffled".
    """

    name: str
    seed: int
    level: tuple[int, ...]
    order: str


def draw_machine(number: int, *, files: bool) -> MachineDraw:
    """The machine of a number; kinds of machines take turns."""
    name = list(OTHER_MACHINES)[number % len(OTHER_MACHINES)]
    if not files:
        return MachineDraw(name, number, (0,), "one load")
    dice = np.random.default_rng([number, 27])
    count = int(dice.integers(1, MOST_FILES + 1))
    loads = int(dice.integers(1, count + 1))
    level = np.arange(count) * loads // count
    shuffled = bool(dice.integers(2)) and loads > 1
    if shuffled:
        level = dice.permutation(level)
    order = "one load" if loads == 1 else "shuffled" if shuffled else "in order"
    return MachineDraw(name, number, tuple(level.tolist()), order)


@dataclass(frozen=True, slots=True)
class Told:
    """What a replay says of it.

    Attributes:
        piles: starts that are taken for a pile.
        states: load states of the manoeuvres of each file.
        errors: the mass of each file's load less the truth, over its u; null where it is withheld.
        u_share: its u over the mass.
        said: of the loads.
    """

    piles: int
    states: list[list[int]]
    errors: list[float | None]
    u_share: list[float | None]
    said: str

    def false_changes(self, level: Sequence[int]) -> int:
        """Changes within a file, or between two files with one load."""
        within = sum(max(len(states) - 1, 0) for states in self.states)
        return within + sum(
            one != other and here == there
            for (one, here), (other, there) in _neighbours(self.states, level)
        )

    def missed(self, level: Sequence[int]) -> int:
        """Ends of files at which the load changes, and which are not told."""
        return sum(
            bool(set(one) & set(other)) and here != there
            for (one, here), (other, there) in _neighbours(self.states, level)
        )


def _neighbours(
    states: Sequence[list[int]], level: Sequence[int]
) -> Iterator[tuple[tuple[list[int], int], tuple[list[int], int]]]:
    # a file whose manoeuvres are all left out tells nothing
    seen = [(one, here) for one, here in zip(states, level, strict=True) if one]
    return pairwise(seen)


def replayed(drawn: MachineDraw) -> tuple[Scenario, Run, list[float]]:
    """The scenario, the run, and where each file begins in its time, in s."""
    make = OTHER_MACHINES[drawn.name]
    mass_kg = make(drawn.seed).machine.mass_kg
    # loads that repeat are driven anew: each a little more than the one before
    loads_kg = [STEP_1 * mass_kg * each + 1e-6 * at for at, each in enumerate(drawn.level)]
    place = np.argsort(loads_kg).argsort()
    scenario = make(drawn.seed, tuple(sorted(loads_kg)))
    tables = [table_of(log) for log in simulate_campaign(scenario)]
    begins_s, at_s = [], 0.0
    with tempfile.TemporaryDirectory() as name, ExitStack() as stack:
        logs = []
        for at, which in enumerate(place.tolist()):
            path = Path(name) / f"{at}.parquet"
            tables[which].write_parquet(path)
            logs.append(stack.enter_context(open_log(path, time=TimeAxis("t"))))
            begins_s.append(at_s)
            at_s += float(tables[which]["t"].to_numpy()[-1]) + _BETWEEN_S
        return scenario, run(logs, _machine(scenario)), begins_s


def _machine(scenario: Scenario) -> Machine:
    """The machine file, which knows what turns in the top gear: no log tells it from the mass."""
    mass_kg = scenario.machine.mass_kg
    machine = kinematic_machine("simulated", mass_kg, min(20.0, 0.4 * scenario.sensors.rate_hz))
    turning_kg = (0.0, *scenario.drivetrain.gear_rotating_kg)[-1]
    known = {"rotating_mass_kg": turning_kg, "rotating_mass_u_kg": _ROTATING_U_1 * turning_kg}
    return machine.model_copy(update={"machine": machine.machine.model_copy(update=known)})


def told(drawn: MachineDraw) -> Told:
    """Drive, replay, and see what it says."""
    scenario, made, begins_s = replayed(drawn)
    manoeuvres = made.frames["manoeuvres"]
    middle_s = 5e-10 * (manoeuvres["start_t_ns"] + manoeuvres["end_t_ns"]).to_numpy()
    file = np.searchsorted(begins_s, middle_s, side="right") - 1
    loads = {row["load_id"]: row for row in made.frames["loads"].to_dicts()}
    states = [
        manoeuvres.filter(pl.Series(file == at))["load_id"].unique(maintain_order=True).to_list()
        for at in range(len(drawn.level))
    ]
    errors: list[float | None] = []
    u_share: list[float | None] = []
    for mine, level in zip(states, drawn.level, strict=True):
        true_kg = scenario.machine.mass_kg * (1.0 + STEP_1 * level)
        for state in mine:
            mass_kg, u_kg = loads[state]["mass_kg"], loads[state]["u_kg"]
            if mass_kg is None or loads[state]["withheld"]:
                errors.append(None)
                u_share.append(None)
                continue
            errors.append((mass_kg - true_kg) / u_kg)
            u_share.append(u_kg / mass_kg)
    said = next(iter(loads.values()))["said"] if loads else ""
    return Told(made.frames["digging"].height, states, errors, u_share, said or "")


def table(rows: Sequence[dict[str, Any]]) -> Iterator[str]:
    """A line a machine and order, and of all."""
    yield (
        "machine, order: logs; with a pile; with a false change, as doubted; ends of files with "
        "another load, missed, as doubted; masses, within 2 u; r.m.s. error / u; median u"
    )
    pairs = [(MachineDraw(**row["drawn"]), Told(**row["told"])) for row in rows]
    groups: dict[str, list[tuple[MachineDraw, Told]]] = {}
    for drawn, said in pairs:
        groups.setdefault(f"{drawn.name}, {drawn.order}", []).append((drawn, said))
    for name, group in {**dict(sorted(groups.items())), "all": pairs}.items():
        false = [said for drawn, said in group if said.false_changes(drawn.level)]
        missed = [(said, said.missed(drawn.level)) for drawn, said in group]
        changes = sum(int(np.count_nonzero(np.diff(drawn.level))) for drawn, _ in group)
        z = np.array([each for _, said in group for each in said.errors if each is not None])
        u = [each for _, said in group for each in said.u_share if each is not None]
        yield (
            f"{name}: {len(group)}; {sum(said.piles > 0 for _, said in group)}; "
            f"{len(false)}, {sum(_doubted(said) for said in false)}; "
            f"{changes}, {sum(each for _, each in missed)}, "
            f"{sum(each for said, each in missed if _doubted(said))}; "
            f"{z.size}, {np.count_nonzero(np.abs(z) <= _K)}; "
            f"{np.sqrt(np.mean(z**2)) if z.size else np.nan:.2f}; "
            f"{100.0 * np.median(u) if u else np.nan:.1f} %"
        )


def _doubted(said: Told) -> bool:
    return "states or scatter" in said.said


def main(
    results: Annotated[Path, typer.Argument(help="JSON lines, kept as they come")],
    logs: int = 60,
    first: int = 0,
    files: bool = False,
    minutes: float = 60.0,
) -> None:
    until = time.monotonic() + 60.0 * minutes
    rows = read_rows(results) if results.exists() else []
    done = {row["drawn"]["seed"] for row in rows}
    for number in range(first, first + logs):
        if number in done or time.monotonic() > until:
            continue
        mine = draw_machine(number, files=files)
        rows.append({"drawn": asdict(mine), "told": asdict(told(mine))})
        keep(results, rows[-1])
    print("\n".join(table(rows)))


if __name__ == "__main__":
    typer.run(main)

"""Weighbridge tickets of the empty machine that are wrong: by their own u, and by five.

    python -P benchmarks/wrong_tickets.py [--shifts 40] [--first 0] [--hours 1] [--json FILE]

Each shift has a machine, a ground, instruments and habits of its own (`benchmarks/independent`). It
is replayed twice. The ticket of the first replay has a normal error of its stated standard
uncertainty: nothing may be said of it. That of the second is off by five more, of the standard
uncertainty of the comparison: the log's own of the empty machine, with gain and radius as the
machine file states them, and the ticket's. It has to be said, and no tonnes may rest on it.
"""

import tempfile
from collections.abc import Mapping, Sequence
from contextlib import ExitStack
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Annotated, Any, Final

import numpy as np
import polars as pl
import typer

from benchmarks.independent.shift_logs import ShiftPlan, shift_log, write_shift_log
from benchmarks.kept_trials import run_seeds
from benchmarks.page import markdown
from benchmarks.scale_sources import LOAD_SHARE, TICKET_U_1, K
from replay import load_machine, open_log, run

#: Error of the second ticket, in standard uncertainties of the comparison.
OFF_U: Final = 5.0
#: Checks that compare the log with the ticket.
_CHECKS: Final = ("empty_mass", "empty_mass_ratio", "negative_payload")


@dataclass(frozen=True)
class TicketReplay:
    """What a replay makes of a ticket.

    Attributes:
        off_u: error of the ticket beyond its own, in u of the comparison.
        said: names of failed checks of the empty mass, and of withheld cycles; empty: nothing.
        total_kg: tonnes, 0 where none are counted.
        u_kg: their standard uncertainty.
    """

    off_u: float
    said: list[str]
    total_kg: float
    u_kg: float


@dataclass(frozen=True)
class WrongTicket:
    """A shift under two tickets.

    Attributes:
        seed: of all that is drawn.
        true_kg: what was dumped.
        comparison_u_1: relative standard uncertainty of the comparison; 0 without an empty machine.
        replays: of the drawn ticket and of the wrong one.
    """

    seed: int
    true_kg: float
    comparison_u_1: float
    replays: list[dict[str, Any]]

    def read(self) -> list[TicketReplay]:
        """The replays, as they were kept."""
        return [TicketReplay(**each) for each in self.replays]


def wrong_ticket(seed: int, hours: float) -> WrongTicket:
    """Make a shift, and replay it under a drawn ticket and under a wrong one."""
    log = shift_log(seed, ShiftPlan(hours=hours, load_share=LOAD_SHARE))
    dice = np.random.default_rng([seed, 26_003])
    ticket_kg = log.plant.mass_kg * float(dice.normal(1.0, TICKET_U_1))
    off_u = OFF_U * float(dice.choice([-1.0, 1.0]))
    replays: list[dict[str, Any]] = []
    u_1 = 0.0
    for wrong_u in (0.0, off_u):
        stated_kg = ticket_kg + wrong_u * u_1 * log.plant.mass_kg
        known = log.known._replace(
            empty_mass_kg=stated_kg, empty_mass_u_kg=TICKET_U_1 * log.plant.mass_kg
        )
        with tempfile.TemporaryDirectory() as name, ExitStack() as stack:
            paths, machine_path = write_shift_log(log._replace(known=known), Path(name))
            machine = load_machine(machine_path)
            frames = run([stack.enter_context(open_log(path)) for path in paths], machine).frames
        shift = frames["shift"].row(0, named=True)
        counted = bool(shift["cycles_counted"])
        replays.append(
            asdict(
                TicketReplay(
                    off_u=wrong_u,
                    said=_said_of_empty_mass(frames),
                    total_kg=shift["total_kg"] if counted else 0.0,
                    u_kg=shift["total_u_kg"] if counted else 0.0,
                )
            )
        )
        if shift["gain_1"] is None:
            break
        radius_m = machine.machine.wheel_radius_m
        assert radius_m is not None
        stated = (log.known.force_gain_u or 0.0, (log.known.radius_u_m or 0.0) / radius_m)
        u_1 = float(np.linalg.norm([shift["gain_u_1"], *stated]))
    return WrongTicket(seed, float(sum(log.truth.payload_kg)), u_1, replays)


def _said_of_empty_mass(frames: Mapping[str, pl.DataFrame]) -> list[str]:
    """Failed checks of the empty mass, and the contradiction that withholds cycles."""
    of_empty = pl.col("check").is_in(_CHECKS) & ~pl.col("passed")
    checks = frames["verdict"].filter(of_empty)["check"].to_list()
    withheld = frames["cycles"]["withheld_for"].str.contains("|".join(_CHECKS)).any()
    return sorted({*checks, *(["withheld"] if withheld else [])})


def table(found: Sequence[WrongTicket]) -> str:
    """A row a ticket: what is said of it, and whether the tonnes hold."""
    compared = [each for each in found if len(each.replays) > 1]
    rows: list[list[str]] = []
    for place, name in enumerate(("wrong by its own u", f"wrong by {OFF_U:g} u of the comparison")):
        group = [(each, each.read()[place]) for each in compared]
        told = [(each, one) for each, one in group if one.total_kg]
        held = sum(abs(one.total_kg - each.true_kg) <= K * one.u_kg for each, one in told)
        silent = [one for _, one in told if not one.said]
        rows.append(
            [
                name,
                str(len(group)),
                str(sum(bool(one.said) for _, one in group)),
                str(sum("withheld" in one.said for _, one in group)),
                f"{held} of {len(told)}",
                str(len(silent)),
            ]
        )
    head = ["ticket", "shifts", "said", "tonnes withheld for it", "tonnes within U"]
    u_1 = np.median([each.comparison_u_1 for each in compared])
    return (
        markdown([*head, "tonnes without a word"], rows)
        + f"\n\nu of the comparison: {u_1:.2%} in the median; "
        f"{len(found) - len(compared)} shifts show no empty machine."
    )


def main(
    shifts: int = 40,
    first: int = 0,
    hours: float = 1.0,
    kept: Annotated[Path | None, typer.Option("--json")] = None,
) -> None:
    def one(seed: int) -> WrongTicket:
        made = wrong_ticket(seed, hours)
        print(seed, f"{made.comparison_u_1:.2%}", made.read(), flush=True)
        return made

    trials = run_seeds(range(first, first + shifts), one, kept, WrongTicket)
    print(table(list(trials)))


if __name__ == "__main__":
    typer.run(main)

"""Payload by difference on logs of the independent bench: does the interval hold?

    python -P benchmarks/payloads.py [--situation NAME]... [--plan 5+5] [--logs 60] [--first 0]
                                     [--json FILE] [--read FILE] [--against FILE]

Each log has starts without a load, then as many with one; the machine file says when it was empty,
as `payscope run --empty` does. `--json` keeps a line a log as it comes and goes on where it ended;
two processes take two files. `--read` makes the table of such a file (several, one after another:
repeat it), and `--against` compares u with that of another file, log by log.

Another checkout is judged from this one: `PYTHONPATH=OTHER .venv/bin/python -P
benchmarks/payloads.py` takes OTHER's packages (and its bench, where it has one). Logs of the same
digest are the same logs, and only those are compared.
"""

import hashlib
import tempfile
import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, Final

import numpy as np
import polars as pl
import typer

from benchmarks.independent.machine_file import write_machine_file
from benchmarks.independent.mcap_log import write_mcap
from benchmarks.independent.payload_plans import PLANS, SITUATIONS, payload_log
from benchmarks.kept_trials import read_rows, run_trials
from benchmarks.page import markdown
from replay import load_machine, open_log, run

_NS: Final = 1e9
#: Columns of `loads` that are kept.
_KEPT: Final = (
    *("mass_kg", "u_kg", "payload_kg", "payload_u_kg", "payload_u_random_kg"),
    *("manoeuvres", "empty", "withheld", "withheld_for"),
)


@dataclass(frozen=True)
class PayloadFound:
    """A log's answer beside its truth.

    Attributes:
        situation: what is wrong.
        plan: starts.
        seed: of all that is drawn.
        digest: of the log.
        truth: as the bench gives it.
        loads: rows of the frame `loads`, with `start_s` and `end_s` from the start of the log.
        failed: checks of the verdict that failed.
        seconds: that the replay took.
    """

    situation: str
    plan: str
    seed: int
    digest: str
    truth: dict[str, Any]
    loads: list[dict[str, Any]]
    failed: list[str]
    seconds: float

    @property
    def payload_kg(self) -> float:
        """What was carried; of a load that grows, the mean."""
        return (self.truth["payload_kg"] + self.truth["payload_begin_kg"]) / 2.0

    @property
    def open(self) -> bool:
        """Whether there is an answer for what was carried."""
        return bool(self._loaded) and not any(row["withheld"] for row in self._loaded)

    @property
    def one_state(self) -> bool:
        """Whether the change of load was not found."""
        return any(row["start_s"] < self.truth["empty_to_s"] for row in self._loaded)

    @property
    def _loaded(self) -> list[dict[str, Any]]:
        return [row for row in self.loads if row["end_s"] > self.truth["loaded_from_s"]]

    @property
    def worst(self) -> dict[str, Any]:
        """Of the states that carry the load, the one that is farthest off."""
        return max(self._loaded, key=lambda row: abs(self._deviation(row)))

    def _deviation(self, row: dict[str, Any]) -> float:
        error_kg = row["payload_kg"] - self.payload_kg
        return error_kg / row["payload_u_kg"] if row["payload_u_kg"] else float("inf")

    @property
    def deviation(self) -> float:
        """Error of the payload over its standard uncertainty."""
        return self._deviation(self.worst)

    @property
    def outside(self) -> float:
        """By how many u the payload is none that was carried at any time of a start."""
        row = self.worst
        low_kg, high_kg = self.truth["payload_begin_kg"], self.truth["payload_kg"]
        far_kg = max(low_kg - row["payload_kg"], row["payload_kg"] - high_kg, 0.0)
        return far_kg / row["payload_u_kg"] if row["payload_u_kg"] else float("inf")

    @property
    def mass_deviations(self) -> list[float]:
        """Error of the mass of each state over its standard uncertainty."""
        found: list[float] = []
        for row in self.loads:
            if row["withheld"]:
                continue
            loaded = row["start_s"] + row["end_s"] > 2.0 * self.truth["empty_to_s"]
            true_kg = self.truth["empty_kg"] + (self.payload_kg if loaded else 0.0)
            found.append((row["mass_kg"] - true_kg) / row["u_kg"])
        return found


def found_of(situation: str, plan: str, seed: int) -> PayloadFound:
    """Make a log, replay it, compare."""
    log = payload_log(SITUATIONS[situation], PLANS[plan], seed)
    with tempfile.TemporaryDirectory() as folder:
        path, stated = Path(folder) / "log.mcap", Path(folder) / "machine.toml"
        write_mcap(log.topics, path)
        write_machine_file(stated, log.instruments, log.known)
        digest = hashlib.sha256(path.read_bytes() + stated.read_bytes()).hexdigest()[:16]
        began = time.monotonic()
        with open_log(path) as opened:
            made = run(opened, load_machine(stated))
    loads = made.frames["loads"]
    times = {name: (loads[f"{name[:-2]}_t_ns"] / _NS).to_list() for name in ("start_s", "end_s")}
    rows = loads.select(_KEPT).with_columns(**{k: pl.Series(v) for k, v in times.items()})
    judged = made.frames["verdict"]
    return PayloadFound(
        situation,
        plan,
        seed,
        digest,
        log.truth.to_dict(),
        rows.to_dicts(),
        judged.filter(pl.col("passed").not_())["check"].to_list(),
        time.monotonic() - began,
    )


def read(paths: Sequence[Path]) -> list[PayloadFound]:
    """What earlier runs kept."""
    return [PayloadFound(**row) for row in read_rows(*paths)]


def campaign(wanted: Sequence[tuple[str, str, int]], kept: Path | None) -> Iterator[PayloadFound]:
    """Each wanted log (situation, plan, seed), kept as it comes; what is kept is not made again."""
    return run_trials(
        wanted,
        lambda task: found_of(*task),
        kept,
        PayloadFound,
        task_key=lambda task: task,
        result_key=lambda found: (found.situation, found.plan, found.seed),
    )


def table(found: Sequence[PayloadFound]) -> str:
    """A row a situation and plan, in the order of the situations."""
    head = ["situation", "plan", "logs", "open", "one state", "within 2 u", "> 3 u", "> 4 u"]
    head += ["r.m.s. error / u", "median u, kg", "median u / payload", "masses within 2 u"]
    groups: dict[tuple[str, str], list[PayloadFound]] = {}
    for each in found:
        groups.setdefault((each.situation, each.plan), []).append(each)
    order = {name: place for place, name in enumerate(SITUATIONS)}
    keys = sorted(groups, key=lambda key: (order.get(key[0], len(order)), key[1]))
    rows: list[list[str]] = []
    for key in keys:
        group = groups[key]
        opened = [each for each in group if each.open]
        off = np.abs([each.deviation for each in opened])
        u_kg = np.array([each.worst["payload_u_kg"] for each in opened])
        share = u_kg / [each.payload_kg for each in opened] if opened else u_kg
        masses = np.abs([d for each in group for d in each.mass_deviations])
        rows.append(
            [
                *key,
                str(len(group)),
                str(len(opened)),
                str(sum(each.one_state for each in opened)),
                f"{np.mean(off <= 2.0):.0%}" if opened else "–",
                str(int((off > 3.0).sum())),
                str(int((off > 4.0).sum())),
                f"{np.sqrt(np.mean(off**2)):.2f}" if opened else "–",
                f"{np.median(u_kg):.1f}" if opened else "–",
                f"{np.median(share):.1%}" if opened else "–",
                f"{np.mean(masses <= 2.0):.0%} of {masses.size}" if masses.size else "–",
            ]
        )
    return markdown(head, rows)


def filling(found: Sequence[PayloadFound]) -> str:
    """What of the buckets that fill is wrong and open."""
    opened = [each for each in found if SITUATIONS[each.situation].fills and each.open]
    wrong = sum(abs(each.deviation) > 3.0 for each in opened)
    outside = sum(each.outside > 3.0 for each in opened)
    return (
        f"filling buckets: {len(opened)} open, {wrong} more than 3 u from the mean of what was "
        f"carried, {outside} more than 3 u from anything that was"
    )


def ratios(found: Sequence[PayloadFound], other: Sequence[PayloadFound]) -> str:
    """Uncertainties of the same logs in another campaign, a row a situation and plan."""
    theirs = {each.digest: each for each in other if each.open}
    pairs: dict[tuple[str, str], list[float]] = {}
    for each in found:
        if each.open and each.digest in theirs:
            mine, its = each.worst["payload_u_kg"], theirs[each.digest].worst["payload_u_kg"]
            pairs.setdefault((each.situation, each.plan), []).append(mine / its)
    rows = [
        [*key, str(len(u)), f"{np.median(u):.2f}", f"{np.quantile(u, 0.9):.2f}"]
        for key, u in pairs.items()
    ]
    return markdown(["situation", "plan", "logs", "median u / u there", "90 % quantile"], rows)


def main(
    situation: Annotated[list[str] | None, typer.Option()] = None,
    plan: Annotated[list[str] | None, typer.Option()] = None,
    logs: int = 60,
    first: int = 0,
    kept: Annotated[Path | None, typer.Option("--json")] = None,
    again: Annotated[list[Path] | None, typer.Option("--read")] = None,
    against: Annotated[Path | None, typer.Option()] = None,
) -> None:
    if unknown := set(situation or []) - set(SITUATIONS):
        raise SystemExit(f"no situation {sorted(unknown)}; there are {', '.join(SITUATIONS)}")
    seeds = range(first, first + logs)
    # seed by seed, so that a campaign that is cut short has some of everything
    wanted = [(s, p, k) for k in seeds for s in situation or SITUATIONS for p in plan or PLANS]
    found = read(again) if again else list(campaign(wanted, kept))
    if again and situation:
        found = [each for each in found if each.situation in situation]
    print(table(found))
    if any(SITUATIONS[each.situation].fills for each in found):
        print(f"\n{filling(found)}")
    if against is not None:
        print(f"\n{ratios(found, read([against]))}")


if __name__ == "__main__":
    typer.run(main)

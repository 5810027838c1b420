"""Whether findings name the cause: faults of a size, two at once, and logs without any.

    python -P benchmarks/findings.py [--seeds 50] [--clean 500] [--first 900000] [--minutes 60]
                                     [--json FILE] [--read FILE] [--write]

Every trial is a line of `--json` as it comes; `--minutes` ends the campaign at the seed that it has
reached. `--write` puts the tables into docs/findings.md, with the commit and the day they are of.
"""

import datetime as dt
import subprocess
import time
import traceback
from collections.abc import Iterator
from dataclasses import asdict
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import typer

from benchmarks.findings_rows import AXES, design, found, replayed, without_causes
from benchmarks.findings_tables import (
    of_clean,
    of_delays,
    of_faults,
    of_matrix,
    of_needs,
    of_totals,
)
from benchmarks.findings_trials import BY_NAME, DelayTrial, Trial, delays, pair, trials_of
from benchmarks.kept_trials import keep, read_rows
from benchmarks.page import put
from estimators.errors import PayscopeError
from tests.trials.fault_injection import FAULTS

_REPO = Path(__file__).resolve().parent.parent
FAILS = (PayscopeError, ArithmeticError, LookupError, ValueError)
#: Seeds a fault from which shares say how often something holds.
ENOUGH = 50
#: Pairs of faults a seed, and what each needs to be one of two.
PAIRS = 4


def of_commit() -> dict[str, Any]:
    """The commit that is measured, `-dirty` where files differ from it, and the day."""
    said = subprocess.run(
        ["git", "describe", "--always", "--dirty", "--exclude=*"],
        cwd=_REPO,
        capture_output=True,
        text=True,
        check=True,
    )
    day = dt.datetime.now(dt.UTC).date().isoformat()
    return {"kind": "commit", "commit": said.stdout.strip(), "day": day}


def of_seed(seed: int) -> Iterator[dict[str, Any]]:
    """All faults in one design, some pairs of them, and every delay of the force."""
    sizes: dict[str, float] = {}
    for fault in FAULTS:
        try:
            trials = trials_of(fault, seed)
        except FAILS:  # what a fault needs may be more than this machine can drive
            yield {"kind": "error", "seed": seed, "said": _said(fault.name)}
            continue
        for trial in trials:
            if trial.severity == 10.0:
                sizes[fault.name] = trial.size
            yield {"kind": "fault", **asdict(trial)}
    dice = np.random.default_rng([seed, 20_267])
    names = [name for name in sizes if not BY_NAME[name].ground and not BY_NAME[name].last_runs]
    for _ in range(PAIRS):
        one, two = (str(each) for each in dice.choice(names, 2, replace=False))
        trial = pair(BY_NAME[one], BY_NAME[two], (sizes[one], sizes[two]), seed)
        if trial is not None:
            yield {"kind": "pair", **asdict(trial)}
    for each in delays(seed):
        yield {"kind": "delay", **asdict(each)}


def _said(where: str) -> str:
    return f"{where}: {traceback.format_exc()[-900:]}"


def of_clean_seed(seed: int) -> dict[str, Any]:
    """A log without a fault; every second one of a machine unlike the model."""
    odd = seed % 2 == 1
    sections = without_causes(design(seed, odd=odd))
    named = found(replayed(sections, axes=AXES if seed // 2 % 2 else ()))
    return {"kind": "clean", "seed": seed, "odd": odd, "names": [each[0] for each in named.causes]}


def measured(seeds: int, clean: int, first: int, minutes: float) -> Iterator[dict[str, Any]]:
    """Everything, seed by seed, so that whatever is done is done of all faults alike."""
    began = time.monotonic()
    yield of_commit()
    for number in range(seeds):
        if time.monotonic() - began > 60.0 * minutes:
            return
        share = range(number * clean // seeds, (number + 1) * clean // seeds)
        try:
            for each in share:
                yield of_clean_seed(first + 50_000 + each)
            yield from of_seed(first + number)
        except FAILS:
            yield {"kind": "error", "seed": first + number, "said": _said("pairs or delays")}


def shown(rows: list[dict[str, Any]], *, write: bool) -> None:
    """Print the tables, and put them into the documentation."""

    def of(kind: str) -> list[dict[str, Any]]:
        return [
            {k: v for k, v in row.items() if k != "kind"} for row in rows if row["kind"] == kind
        ]

    def trial(row: dict[str, Any]) -> Trial:
        tuples = {k: tuple(row[k]) for k in ("faults", "places", "names")}
        claimed = None if row["claimed"] is None else tuple(row["claimed"])
        return Trial(**{**row, **tuples, "claimed": claimed})

    every, pairs = [trial(row) for row in of("fault")], [trial(row) for row in of("pair")]
    trials = [each for each in every if each.is_of_its_size]
    clean = [(row["seed"], row["odd"], tuple(row["names"])) for row in of("clean")]
    late = [DelayTrial(**row) for row in of("delay")]
    seeds = len({t.seed for t in trials})
    measured_with = ", ".join(
        dict.fromkeys(f"`{row['commit']}` on {row['day']}" for row in of("commit"))
    )
    few = "" if seeds >= ENOUGH else f"**Fewer seeds than {ENOUGH}: no rate is shown by them.** "
    counted = (
        f"{few}{seeds} seeds a fault, {len(trials)} trials with one fault (of a fault without a "
        "size one log counts three times), "
        f"{len(pairs)} with two, {len(clean)} with none, {len(late)} of delays; "
        f"{len(every) - len(trials)} logs are left out since no size of their fault bends the mass "
        f"as much as asked, within a factor of two; {len(of('error'))} could not be driven."
        f"\n\nMeasured with commit {measured_with}."
    )
    parts = {
        "findings counted": counted,
        "findings totals": of_totals(trials, pairs),
        "findings clean": of_clean(clean),
        "findings delays": of_delays(late),
        "findings faults": of_faults(trials),
        "findings matrix": of_matrix(trials),
        "findings needs": of_needs(),
    }
    for name, text in parts.items():
        print(text, end="\n\n")
        if write:
            put("findings.md", name, text)
    for row in of("error"):
        print(row["seed"], row["said"])


def main(
    seeds: int = 50,
    clean: int = 500,
    first: int = 900_000,
    minutes: float = 600.0,
    kept: Annotated[Path | None, typer.Option("--json")] = None,
    read: Annotated[list[Path] | None, typer.Option("--read")] = None,
    write: bool = False,
) -> None:
    if read:
        shown(read_rows(*read), write=write)
        return
    rows: list[dict[str, Any]] = []
    for row in measured(seeds, clean, first, minutes):
        rows.append(row)
        keep(kept, row)
    shown(rows, write=write)


if __name__ == "__main__":
    typer.run(main)

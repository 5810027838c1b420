"""Whether the answer's interval holds on machines that the model does not describe.

    python -P benchmarks/honesty.py [--seeds 20] [--quick] [--json FILE] [--read FILE] [--write]

Simulates logs of every situation, on the loader and on machines that are drawn, replays them in
memory and compares the mass with the truth. `--json` keeps the answers, a line each, as they come;
`--read` makes the tables of them without another run; `--write` puts them into docs/honesty.md.
"""

import json
import multiprocessing
import os
import time
import traceback
from collections.abc import Iterable
from concurrent.futures import ProcessPoolExecutor
from contextlib import ExitStack
from dataclasses import asdict
from pathlib import Path
from typing import Annotated

import numpy as np
import typer

from benchmarks.honesty_rows import (
    CLEAN,
    INSIDE,
    LOADS,
    NARROW,
    POWER,
    ROWS,
    WIDTHS,
    Task,
    clean_tasks,
    load_tasks,
    log,
    power_tasks,
    row_tasks,
    width_tasks,
)
from benchmarks.kept_trials import read_rows
from benchmarks.page import markdown, put
from benchmarks.weighed import LoadsFound, Weighed
from estimators.errors import PayscopeError

#: Of logs of a power-limited motor, a seed of the rows.
POWER_LOGS = 20
#: Of machines whose load changes, likewise.
LOAD_LOGS = 6
HEAD = ["row", "logs", "withheld", "wrong", "within 2 u", "median error ± median u, kg"]


def tried(task: Task) -> Weighed | str:
    """The log's answer, or what went wrong on the way."""
    try:
        return log(task)
    except (PayscopeError, ArithmeticError, AssertionError, LookupError, ValueError):
        return f"{task}: {traceback.format_exc()}"


def wrong(found: Iterable[Weighed]) -> int:
    """How many answers are more than three standard uncertainties from the truth."""
    return sum(abs(each.deviations) > 3.0 for each in found if each.open)


def within(found: Iterable[Weighed]) -> tuple[int, int]:
    """How many answers are within two, and how many answers there are."""
    opened = [each for each in found if each.open]
    return sum(abs(each.deviations) <= 2.0 for each in opened), len(opened)


def percent(part: float, whole: float) -> str:
    return f"{100.0 * part / whole:.1f} %" if whole else "–"


def line(name: str, found: list[Weighed]) -> list[str]:
    """A row of the table."""
    near, opened = within(found)
    typical = "–"
    if opened:
        errors = [each.error_kg for each in found if each.open]
        widths = [each.u_kg for each in found if each.u_kg is not None]
        typical = f"{np.median(errors):+.0f} ± {np.median(widths):.0f}"
    count = len(found)
    return [
        name,
        str(count),
        str(count - opened),
        str(wrong(found)),
        f"{near} of {opened}",
        typical,
    ]


def total(name: str, found: list[Weighed]) -> list[str]:
    near, opened = within(found)
    count = len(found)
    return [
        name,
        str(count),
        percent(count - opened, count),
        percent(wrong(found), count),
        percent(near, opened),
    ]


def of_rows(found: list[Weighed]) -> tuple[str, str]:
    """The table a row, and the totals."""
    lines: list[list[str]] = []
    for name in ROWS:
        for design in ("loader", "drawn"):
            part = [each for each in found if each.row == name and each.design == design]
            if part:
                lines.append(line(name if design == "loader" else "– drawn machines", part))
    totals: list[list[str]] = []
    for group in ("faulty", "budget", "harmless", "withheld"):
        for design in ("loader", "drawn"):
            part = [f for f in found if ROWS[f.row].group == group and f.design == design]
            totals.append(total(f"{group}, {design}", part))
    faulty = [f for f in found if ROWS[f.row].group in ("faulty", "budget")]
    totals.append(total("all with a fault", faulty))
    inside = [f for f in found if f.row in INSIDE]
    totals.append(total("inside the priors", inside))
    head = ["logs of", "logs", "withheld", "wrong", "open within 2 u"]
    return markdown(HEAD, lines), markdown(head, totals)


def worst(found: list[Weighed]) -> str:
    """Rows of which more than 3 of 20 logs are wrong."""
    listed: list[str] = []
    for name in ROWS:
        for design in ("loader", "drawn"):
            part = [each for each in found if each.row == name and each.design == design]
            if part and wrong(part) > 3.0 / 20.0 * len(part):
                listed.append(f"- {name}, {design}: {wrong(part)} of {len(part)}")
    return "\n".join(listed) or "None."


def of_clean(found: list[Weighed]) -> str:
    lines: list[list[str]] = []
    for name in CLEAN:
        part = [each for each in found if each.row == name]
        opened = [each for each in part if each.open]
        held = sum(abs(each.deviations) < 1.96 for each in opened)
        spread = np.sqrt(np.mean([each.deviations**2 for each in opened])) if opened else np.nan
        widths = [each.u_kg / each.true_kg for each in opened if each.u_kg is not None]
        lines.append(
            [
                name,
                str(len(part)),
                percent(len(part) - len(opened), len(part)),
                percent(held, len(opened)),
                f"{spread:.2f}",
                f"{100 * np.median(widths):.2f} %" if widths else "–",
            ]
        )
    head = ["clean logs", "logs", "withheld", "95 % interval holds", "r.m.s. error / u", "u / m"]
    return markdown(head, lines)


def of_widths(found: list[Weighed]) -> str:
    lines: list[list[str]] = []
    for name in (*WIDTHS, *NARROW):
        part = [each for each in found if each.row == name and each.open]
        if not part:
            lines.append([name, "0", "–", "–", "–"])
            continue
        widths = [each.u_kg / each.true_kg for each in part if each.u_kg is not None]
        over = [each.u_kg / each.pooled_std for each in part if each.u_kg and each.pooled_std]
        lines.append(
            [
                name,
                str(len(part)),
                f"{100 * np.median(widths):.2f} %",
                f"{np.median(over):.1f}" if over else "–",
                f"{np.sqrt(np.mean([each.deviations**2 for each in part])):.2f}",
            ]
        )
    head = ["no nuisances", "logs", "u / m", "u / s of pooled", "r.m.s. error / u"]
    return markdown(head, lines)


def of_power(found: list[Weighed]) -> str:
    part = [each for each in found if each.row == POWER]
    if not part:
        return ""
    opened = [each for each in part if each.open]
    held = sum(abs(each.deviations) < 1.96 for each in opened)
    smallest = min((each.smallest for each in part if each.smallest is not None), default=np.nan)
    lines = [
        ["logs", str(len(part))],
        ["withheld", percent(len(part) - len(opened), len(part))],
        ["95 % interval of the open ones holds", percent(held, len(opened))],
        ["wrong", percent(wrong(part), len(part))],
        ["smallest shown method over the true mass", f"{smallest:.2f}"],
    ]
    return markdown([POWER, ""], lines)


def of_loads(found: list[Weighed]) -> str:
    """States, masses and payloads of machines whose load changes."""
    lines: list[list[str]] = []
    for name in LOADS:
        part = [each.loads for each in found if each.row == name and each.loads is not None]
        if not part:
            continue
        right, count = sum(p.right for p in part), sum(p.found + p.true for p in part)
        masses = np.array([z for p in part for z in p.deviations])
        payloads = np.array([z for p in part for z in p.payload_deviations])
        widths = [u for p in part for u in p.payload_u_kg]
        lines.append(
            [
                name,
                str(len(part)),
                f"{2.0 * right / count:.3f}" if count else "–",
                percent(float((np.abs(masses) < 1.96).sum()), masses.size),
                percent(float((np.abs(payloads) < 1.96).sum()), payloads.size),
                f"{np.sqrt(np.mean(payloads**2)):.2f}" if payloads.size else "–",
                f"{np.median(widths):.1f}" if widths else "–",
            ]
        )
    head = ["loads that change", "logs", "F1 of changes", "mass held", "payload held"]
    return markdown([*head, "r.m.s. payload error / u", "median payload u, kg"], lines)


def mixed(*kinds: Iterable[Task]) -> list[Task]:
    """All tasks, so that whatever is done of them is done of all kinds alike."""
    placed: list[tuple[float, int, Task]] = []
    for number, kind in enumerate(map(list, kinds)):
        placed += [(place / len(kind), number, each) for place, each in enumerate(kind)]
    return [each for _, _, each in sorted(placed, key=lambda item: item[:2])]


def measured(
    tasks: list[Task], processes: int, kept: Path | None
) -> tuple[list[Weighed], list[str]]:
    """Run all tasks; answers and faults. Answers are kept as they come, a line each."""
    began = time.monotonic()
    found: list[Weighed] = []
    faults: list[str] = []
    # the processes are the threads; those of a library would only stand in each other's way
    os.environ |= {"POLARS_MAX_THREADS": "1", "NUMBA_NUM_THREADS": "1", "OMP_NUM_THREADS": "1"}
    context = multiprocessing.get_context("spawn")
    with ExitStack() as opened:
        pool = opened.enter_context(ProcessPoolExecutor(processes, mp_context=context))
        lines = None if kept is None else opened.enter_context(kept.open("w", encoding="utf-8"))
        for number, each in enumerate(pool.map(tried, tasks, chunksize=4), 1):
            if isinstance(each, str):
                faults.append(each)
                continue
            found.append(each)
            if lines is not None:
                content = {**asdict(each), "deviations": each.deviations}
                lines.write(json.dumps(content) + "\n")
                lines.flush()
            if number % 100 == 0:
                print(f"{number} of {len(tasks)}, {time.monotonic() - began:.0f} s", flush=True)
    return found, faults


def kept_answers(path: Path) -> list[Weighed]:
    """Answers that an earlier run kept."""
    found: list[Weighed] = []
    for content in read_rows(path):
        del content["deviations"]
        if content.get("loads"):
            content["loads"] = LoadsFound(**content["loads"])
        found.append(Weighed(**content))
    return found


def shown(found: list[Weighed], *, write: bool) -> None:
    """Print the tables, and put them into the documentation."""
    in_rows = [each for each in found if each.row in ROWS]
    table, totals = of_rows(in_rows)
    clean, power_table = f"{of_clean(found)}\n\n{of_widths(found)}", of_power(found)
    above, loads_table = worst(in_rows), of_loads(found)
    print(
        table,
        totals,
        f"more than 3 of 20 wrong:\n{above}",
        clean,
        power_table,
        loads_table,
        sep="\n\n",
    )
    if write:
        put("honesty.md", "honesty rows", table)
        put("honesty.md", "honesty totals", f"{totals}\n\nMore than 3 of 20 wrong:\n\n{above}")
        put("honesty.md", "honesty clean", clean)
        put("honesty.md", "honesty power", power_table)
        put("honesty.md", "honesty loads", loads_table)


def main(
    seeds: int = 20,
    quick: bool = False,
    processes: int = 2,
    only: str = "",
    kept: Annotated[Path | None, typer.Option("--json")] = None,
    read: Annotated[Path | None, typer.Option("--read")] = None,
    write: bool = False,
) -> None:
    if quick:
        seeds = min(seeds, 3)
    if read is not None:
        shown(kept_answers(read), write=write)
        return
    tasks = mixed(
        row_tasks(seeds),
        clean_tasks(seeds),
        width_tasks(seeds),
        power_tasks(POWER_LOGS * seeds),
        load_tasks(LOAD_LOGS * seeds),
    )
    tasks = [each for each in tasks if not only or only in (each.kind, each.name)]
    found, faults = measured(tasks, processes, kept)
    shown(found, write=write)
    for fault in faults:
        print(fault)
    if faults:
        raise SystemExit(1)


if __name__ == "__main__":
    typer.run(main)

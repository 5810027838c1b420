"""How often intervals of payloads and of a shift's tonnes hold, and how wide they are.

    python -P benchmarks/shift_coverage.py [--shifts 400] [--seed 3000] [--write]

Shifts at manoeuvre level (`benchmarks/shift_manoeuvres.py`), each also with the true boundaries.
`--write` puts the tables into docs/reviewing-a-shift.md.
"""

from dataclasses import dataclass, field
from typing import Final

import numpy as np
import typer

from benchmarks.page import markdown, put
from benchmarks.shift_manoeuvres import ManoeuvreShift, drawn, weighed_shift

K: Final = 2.0


@dataclass
class Covered:
    """Shifts with the boundaries that were found, and the same with the true ones."""

    found: list[ManoeuvreShift] = field(default_factory=list)
    oracle: list[ManoeuvreShift] = field(default_factory=list)
    without: int = 0


def covered(shifts: int, seed: int) -> Covered:
    """Draw shifts, and find their cycles."""
    out = Covered()
    for number in range(shifts):
        truth = drawn(np.random.default_rng([seed + number, 77]))
        found = weighed_shift(truth)
        if not found.u_kg:
            out.without += 1
            continue
        out.found.append(found)
        out.oracle.append(weighed_shift(truth, oracle=True))
        if (number + 1) % 50 == 0:
            print(f"{number + 1} of {shifts}", flush=True)
    return out


def row(name: str, found: np.ndarray, oracle: np.ndarray) -> list[str]:
    """Coverage and the r.m.s. of errors over u, found and with the true boundaries."""
    cells = [name, str(found.size)]
    for x in (found, oracle):
        held = 100.0 * np.mean(np.abs(x) <= K)
        cells += [f"{held:.1f} %", f"{np.sqrt(np.mean(x**2)):.2f}"]
    return cells


def tables(out: Covered) -> str:
    """As the documentation shows them."""
    rows: list[list[str]] = []
    for name in ("whole", "random", "common"):
        both = (
            np.concatenate([getattr(each, name) for each in shifts])
            for shifts in (out.found, out.oracle)
        )
        rows.append(row(f"payload, {name}", *both))
    for place, name in enumerate(("whole", "random", "common")):
        both = (np.array([s.total[place] for s in shifts]) for shifts in (out.found, out.oracle))
        rows.append(row(f"tonnes, {name}", *both))
    true, mine, right = np.array([each.cycles for each in out.found]).sum(axis=0)
    wider = [
        np.median(
            [getattr(f, u) / getattr(o, u) for f, o in zip(out.found, out.oracle, strict=True)]
        )
        for u in ("payload_u_kg", "u_kg")
    ]
    head = ["95 % interval of", "number", "holds", "r.m.s. error / u"]
    head += ["holds, true boundaries", "r.m.s. error / u"]
    said = (
        f"{len(out.found)} shifts, {true} cycles, F1 {2.0 * right / (true + mine):.3f}; "
        f"in {out.without} more no cycle was found. Median U over that with the true boundaries: "
        f"{wider[0]:.2f} of payloads, {wider[1]:.2f} of tonnes."
    )
    return f"{markdown(head, rows)}\n\n{said}"


def main(shifts: int = 400, seed: int = 3000, write: bool = False) -> None:
    text = tables(covered(shifts, seed))
    print(text)
    if write:
        put("reviewing-a-shift.md", "coverage of shifts", text)


if __name__ == "__main__":
    typer.run(main)

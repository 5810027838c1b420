"""Whether reviews of shifts are right: cycles found, tonnes in their interval, nothing invented.

    python -P benchmarks/shifts.py [--shifts 20] [--breaks 4] [--seed 74000] [--json FILE]
                                   [--read FILE] [--write] [--physics]

Simulates shifts of two hours as logs and replays each in one time line, then some more with an hour
of idling in the middle. `--json` keeps what was found, a line a shift, as it comes, and goes on
where it ended; `--read` makes the tables of that without another run; `--write` puts them into
docs/reviewing-a-shift.md. `--physics` drives on real ground, with loads that spill and pour; these
shifts are others than those of the page, and are not written.
"""

import tempfile
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Annotated, Final

import numpy as np
import typer

from benchmarks.kept_trials import read_rows, run_trials
from benchmarks.page import markdown, put
from benchmarks.shift_logs import ShiftFound, reviewed_shift

#: Of an interval of 95 %.
K: Final = 2.0
_HOUR_S: Final = 3600.0


def reviewed(
    seeds: list[tuple[int, float]], kept: Path | None, *, physics: bool
) -> Iterator[ShiftFound]:
    """Each shift, kept as it comes."""

    def review_shift(drawn: tuple[int, float]) -> ShiftFound:
        began = time.monotonic()
        with tempfile.TemporaryDirectory() as folder:
            found = reviewed_shift(drawn[0], Path(folder), break_s=drawn[1], physics=physics)
        print(
            f"{seeds.index(drawn) + 1} of {len(seeds)}: seed {drawn[0]}, F1 {found.f1:.3f}, "
            f"error / u {found.error:+.2f}, {time.monotonic() - began:.0f} s",
            flush=True,
        )
        return found

    return run_trials(
        seeds,
        review_shift,
        kept,
        ShiftFound,
        task_key=lambda drawn: drawn[0],
        result_key=lambda found: found.seed,
    )


def table(found: list[ShiftFound]) -> str:
    """A row a shift."""
    head = ["seed", "mean load", "cycles true / hidden / found", "F1 (dump ± 5 s)"]
    head += ["true t", "reviewed t ± U", "priced beside t ± U", "error / U", "payloads within 2 u"]
    rows = [
        [
            str(each.seed),
            f"{each.mean_load_kg:.0f} kg",
            f"{each.true} / {each.hidden} / {each.found}",
            f"{each.f1:.3f}",
            f"{each.true_t:.2f}",
            each.withheld or f"{each.found_t:.2f} ± {K * each.whole_u_t:.2f}",
            f"{each.lost_t[0]:.2f} ± {K * each.lost_t[1]:.2f}",
            f"{each.error / K:+.2f}",
            f"{100.0 * np.mean(np.abs(each.deviations) <= K):.0f} %" if each.deviations else "–",
        ]
        for each in found
    ]
    return markdown(head, rows)


def totals(found: list[ShiftFound]) -> str:
    """What all shifts together say."""
    right = sum(each.right for each in found)
    whole = sum(each.true + each.found for each in found)
    seen = whole - sum(each.hidden for each in found)
    inside = sum(abs(each.error) <= K for each in found)
    counted = sum(abs(each.error_counted) <= K for each in found)
    deviations = np.array([d for each in found for d in each.deviations])
    idle_s = sum(each.idle_s for each in found)
    rows = [
        ["F1 of all cycles", f"{2.0 * right / max(whole, 1):.3f}"],
        ["F1 of those whose dump was recorded", f"{2.0 * right / max(seen, 1):.3f}"],
        ["tonnes with what is priced within U", f"{inside} of {len(found)}"],
        [
            "counted tonnes alone within their U of all that was dumped",
            f"{counted} of {len(found)}",
        ],
        ["payloads within 2 u", f"{100.0 * np.mean(np.abs(deviations) <= K):.1f} %"],
        ["r.m.s. error of payloads / u", f"{np.sqrt(np.mean(deviations**2)):.2f}"],
        [
            f"cycles invented in {idle_s / _HOUR_S:.1f} idle hours",
            str(sum(each.invented for each in found)),
        ],
    ]
    return markdown(["", "found"], rows)


def main(
    shifts: int = 20,
    breaks: int = 4,
    seed: int = 74_000,
    kept: Annotated[Path | None, typer.Option("--json")] = None,
    again: Annotated[Path | None, typer.Option("--read")] = None,
    write: bool = False,
    physics: bool = False,
) -> None:
    if write and physics:
        raise typer.BadParameter("--write is for the shifts without --physics")
    seeds = [(seed + k, 0.0) for k in range(shifts)]
    seeds += [(seed + 500 + k, _HOUR_S) for k in range(breaks)]
    found = (
        list(reviewed(seeds, kept, physics=physics))
        if again is None
        else [ShiftFound(**row) for row in read_rows(again)]
    )
    text = f"{table(found)}\n\n{totals(found)}"
    print(text)
    if write:
        put("reviewing-a-shift.md", "shifts", text)


if __name__ == "__main__":
    typer.run(main)

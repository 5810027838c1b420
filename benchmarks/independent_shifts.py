"""Shifts of the independent bench through `payscope review`: cycles, tonnes, payloads.

    python -P benchmarks/independent_shifts.py [--shifts 60] [--first 0] [--shorter 1.0]
                                               [--clean] [--said TEXT]... [--json FILE]
                                               [--read FILE]...

Each shift has a machine, a ground, instruments and habits of its own (`benchmarks/independent`),
and is reviewed from its files as the command does. `--json` keeps a line a shift as it comes, with
all that the review says, and goes on where it ended; `--read` judges what was kept, also with
another `--said`: a line of the review that has this text says on top that tonnes may be missing.
`--clean` drives the same cycles on hard level ground with good instruments: what is not found there
is missed by how it is driven, and not by what the ground does to the masses.

The tonnes are what a reader takes for the shift: what was counted and what is priced beside it,
with U (k = 2) of both, against all that was dumped.
"""

import io
import tempfile
import time
import traceback
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Annotated, Any, Final

import numpy as np
import typer
from scipy.optimize import linear_sum_assignment

from benchmarks.independent.shift_logs import ShiftPlan, shift_log, write_shift_log
from benchmarks.kept_trials import read_rows, run_seeds
from benchmarks.page import markdown
from estimators.errors import PayscopeError
from replay.review.review_shift import ReviewOptions, review_shift
from replay.review.write_review import ShiftReview

#: Of an interval of 95 %.
K: Final = 2.0
#: A dump is found when it is so near to a true one.
MATCHED_S: Final = 5.0
#: What the frame `shift` prices beside the counted tonnes: the sum and its standard uncertainty.
PRICED: Final = (("lost_kg", "lost_u_kg"), ("uncounted_kg", "uncounted_u_kg"))
_NS: Final = 1e9
_CYCLE: Final = ("dump_unix_ns", "payload_kg", "payload_u_kg", "counted", "withheld_for")
_WITHHELD, _WITHIN, _SAID, _WRONG = "withheld", "within U", "said", "wrong"
_CRASHED: Final = "crashed"


def match_dumps(mine_s: Sequence[float], true_s: Sequence[float]) -> list[tuple[int, int]]:
    """Match dumps that were found to the true ones: their numbers, in pairs."""
    far_s = np.abs(np.array(mine_s)[:, None] - np.array(true_s)[None, :])
    if not far_s.size:
        return []
    # what is too far to match costs more than all that match together
    cost = np.where(far_s <= MATCHED_S, far_s, MATCHED_S * (1 + sum(far_s.shape)))
    chosen = zip(*linear_sum_assignment(cost), strict=True)
    return [(int(a), int(b)) for a, b in chosen if far_s[a, b] <= MATCHED_S]


@dataclass(frozen=True)
class IndependentShift:
    """A review beside its truth.

    Attributes:
        seed: of all that is drawn.
        truth: as the bench gives it.
        cycles: rows of the ledger.
        shift: the frame `shift`.
        lines: what the review prints.
        refused: why there is no review.
        crashed: where it broke off.
        seconds: that it took.
    """

    seed: int
    truth: dict[str, Any]
    cycles: list[dict[str, Any]]
    shift: dict[str, Any]
    lines: list[str]
    refused: str
    crashed: str
    seconds: float

    @property
    def withheld(self) -> bool:
        """Whether there are no tonnes."""
        return not self.shift or not self.shift["cycles_counted"]

    @property
    def true_t(self) -> float:
        """Everything that was dumped."""
        return sum(self.truth["payload_kg"]) / 1e3

    @cached_property
    def pairs(self) -> list[tuple[int, int]]:
        """Rows of the ledger and the true cycles that they are."""
        mine_s = [(row["dump_unix_ns"] or 0) / _NS for row in self.cycles]
        return match_dumps(mine_s, self.truth["dump_s"])

    @property
    def found(self) -> int:
        """Dumps that the review has."""
        return sum(row["dump_unix_ns"] is not None for row in self.cycles)

    @property
    def f1(self) -> float:
        """Of all cycles."""
        return 2.0 * len(self.pairs) / max(self.found + len(self.truth["dump_s"]), 1)

    @property
    def tonnes(self) -> tuple[float, float]:
        """What a reader takes for the shift, and its standard uncertainty."""
        parts = [("payload_kg", "payload_u_kg"), *PRICED]
        sum_kg = sum(self.shift[name] or 0.0 for name, _ in parts)
        u_kg = np.hypot.reduce([self.shift[u] or 0.0 for _, u in parts])
        return sum_kg / 1e3, float(u_kg) / 1e3

    @property
    def error(self) -> float:
        """Of those tonnes over their standard uncertainty."""
        sum_t, u_t = self.tonnes
        return (sum_t - self.true_t) / u_t if u_t else float("inf")

    @property
    def deviations(self) -> list[float]:
        """Errors of counted payloads over their standard uncertainties."""
        found: list[float] = []
        for here, there in self.pairs:
            row = self.cycles[here]
            if row["counted"] and row["payload_u_kg"]:
                error_kg = row["payload_kg"] - self.truth["payload_kg"][there]
                found.append(error_kg / row["payload_u_kg"])
        return found

    def verdict(self, said: Sequence[str]) -> str:
        """What a reader was told: withheld, within U, said, wrong, or a traceback.

        Args:
            said: texts of which one in a line says that the tonnes may not be whole.
        """
        if self.crashed:
            return _CRASHED
        if self.withheld:
            return _WITHHELD
        if abs(self.error) <= K:
            return _WITHIN
        return _SAID if any(text in line for text in said for line in self.lines) else _WRONG


def reviewed(seed: int, shorter: float = 1.0, *, clean: bool = False) -> IndependentShift:
    """Make a shift's logs, review them, keep what is said.

    Args:
        seed: of everything.
        shorter: share of the drawn length.
        clean: on hard level ground, with good instruments.
    """
    log = shift_log(seed, ShiftPlan(shorter=shorter, clean=clean))
    refused = crashed = ""
    made: ShiftReview | None = None
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        paths, stated = write_shift_log(log, folder)
        began = time.monotonic()
        try:
            made = review_shift(paths, stated, folder / "review", ReviewOptions())
        except PayscopeError as error:
            refused = str(error)
        except Exception:  # noqa: BLE001 - a crash is a result here, and the campaign goes on
            crashed = traceback.format_exc(limit=-3)
        seconds = time.monotonic() - began
    return IndependentShift(
        seed,
        log.truth.to_dict(),
        [] if made is None else made.ledger.select(_CYCLE).to_dicts(),
        {} if made is None else dict(made.shift),
        [] if made is None else _printed(made),
        refused,
        crashed,
        seconds,
    )


def _printed(made: ShiftReview) -> list[str]:
    """What the command prints."""
    from rich.console import Console

    from replay.commands.review import print_shift_review

    screen = Console(file=io.StringIO(), width=400)
    print_shift_review(screen, made)
    assert isinstance(screen.file, io.StringIO)
    text = screen.file.getvalue()
    return [line.rstrip() for line in text.splitlines() if not line.startswith("page: ")]


def read(paths: Sequence[Path]) -> list[IndependentShift]:
    """What earlier runs kept."""
    return [IndependentShift(**row) for row in read_rows(*paths)]


def campaign(
    seeds: Sequence[int], shorter: float, kept: Path | None, *, clean: bool = False
) -> Iterator[IndependentShift]:
    """Each shift, kept as it comes; what is kept is not made again."""

    def review_shift(seed: int) -> IndependentShift:
        found = reviewed(seed, shorter, clean=clean)
        print(f"seed {seed}: F1 {found.f1:.3f}, {found.seconds:.0f} s", flush=True)
        return found

    return run_seeds(seeds, review_shift, kept, IndependentShift)


def table(found: Sequence[IndependentShift], said: Sequence[str]) -> str:
    """A row a shift."""
    head = ["seed", "min", "cycles true / hidden / found", "F1", "mean load", "true t"]
    head += ["tonnes ± U", "error / U", "", "payloads within 2 u", "habits"]
    rows: list[list[str]] = []
    for each in found:
        truth, off = each.truth, np.abs(each.deviations)
        sum_t, u_t = (0.0, 0.0) if each.withheld else each.tonnes
        mean_kg = float(np.mean(truth["payload_kg"])) if truth["payload_kg"] else 0.0
        rows.append(
            [
                str(each.seed),
                f"{truth['minutes']:.0f}",
                f"{len(truth['dump_s'])} / {sum(truth['hidden'])} / {each.found}",
                f"{each.f1:.3f}",
                f"{mean_kg:.0f} kg, {mean_kg / truth['empty_kg']:.0%}",
                f"{each.true_t:.2f}",
                each.refused or ("–" if each.withheld else f"{sum_t:.2f} ± {K * u_t:.2f}"),
                "–" if each.withheld else f"{each.error / K:+.2f}",
                each.verdict(said),
                f"{np.mean(off <= K):.0%} of {off.size}" if off.size else "–",
                ", ".join(truth["habits"]),
            ]
        )
    return markdown(head, rows)


def totals(found: Sequence[IndependentShift], said: Sequence[str]) -> str:
    """What all shifts together say."""
    verdicts = [each.verdict(said) for each in found]
    told = len(found) - verdicts.count(_WRONG) - verdicts.count(_CRASHED)
    silent = [each for each, verdict in zip(found, verdicts, strict=True) if verdict == _WRONG]
    pairs = sum(len(each.pairs) for each in found)
    whole = sum(each.found + len(each.truth["dump_s"]) for each in found)
    hidden = sum(sum(each.truth["hidden"]) for each in found)
    off = np.abs([d for each in found for d in each.deviations])
    counts = ", ".join(f"{name} {verdicts.count(name)}" for name in (_WITHIN, _WITHHELD, _SAID))
    rows = [
        ["F1 of all cycles", f"{2.0 * pairs / max(whole, 1):.3f}"],
        ["F1 of those that were recorded", f"{2.0 * pairs / max(whole - hidden, 1):.3f}"],
        ["tonnes of the shift within U, withheld or said", f"{told} of {len(found)} ({counts})"],
        ["wrong by more than 3 u in silence", str(sum(abs(each.error) > 3.0 for each in silent))],
        [
            "counted payloads within 2 u",
            f"{np.mean(off <= K):.1%} of {off.size}" if off.size else "–",
        ],
        ["r.m.s. error of payloads / u", f"{np.sqrt(np.mean(off**2)):.2f}" if off.size else "–"],
        ["refused", str(sum(bool(each.refused) for each in found))],
        ["crashed", str(sum(bool(each.crashed) for each in found))],
    ]
    return markdown(["", "found"], rows)


def by_habit(found: Sequence[IndependentShift], said: Sequence[str]) -> str:
    """A row a habit: cycles and tonnes of the shifts that have it."""
    rows: list[list[str]] = []
    for habit in sorted({name for each in found for name in each.truth["habits"]}):
        group = [each for each in found if habit in each.truth["habits"]]
        whole = sum(each.found + len(each.truth["dump_s"]) for each in group)
        pairs = sum(len(each.pairs) for each in group)
        wrong = sum(each.verdict(said) == _WRONG for each in group)
        errors = [abs(each.error) / K for each in group if not each.withheld]
        median = f"{np.median(errors):.2f}" if errors else "–"
        f1 = 2.0 * pairs / max(whole, 1)
        rows.append([habit, str(len(group)), f"{f1:.3f}", str(wrong), median])
    return markdown(["habit", "shifts", "F1", "wrong", "median error / U"], rows)


def main(
    shifts: int = 60,
    first: int = 0,
    shorter: float = 1.0,
    clean: bool = False,
    said: Annotated[list[str] | None, typer.Option()] = None,
    kept: Annotated[Path | None, typer.Option("--json")] = None,
    again: Annotated[list[Path] | None, typer.Option("--read")] = None,
) -> None:
    seeds = range(first, first + shifts)
    found = read(again) if again else list(campaign(seeds, shorter, kept, clean=clean))
    told = said or []
    print(f"{table(found, told)}\n\n{totals(found, told)}\n\n{by_habit(found, told)}")


if __name__ == "__main__":
    typer.run(main)

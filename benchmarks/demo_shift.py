"""The demo's shift with its evidence: is the truth inside U, how wide is U, does it verify?

    python -P benchmarks/demo_shift.py [--seeds 40] [--first 0] [--json FILE]

Each seed is a whole `payscope demo` in a folder of its own: campaign, evidence, shift, review. The
evidence is then verified with its logs, so that every replay is made again. `--json` keeps a line
a seed as it comes and goes on where the file ends.
"""

import json
import tempfile
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Final

import numpy as np
import typer

from benchmarks.kept_trials import run_seeds
from benchmarks.page import markdown
from replay.calibration.verify_bundle import verify_bundle
from replay.demo.run_demo import run_demo

#: U is so many standard uncertainties.
K: Final = 2.0


@dataclass(frozen=True)
class DemoShift:
    """What a demo says of its shift.

    Attributes:
        seed: of all that is drawn.
        true_kg: what was dumped in all cycles.
        total_kg: what the review says; 0 where no cycle counts,
        u_kg: its standard uncertainty,
        common_kg: and the part of it that all cycles share.
        cycles: true cycles,
        counted: and those that count.
        outcome: exit status of `verify --logs`; 0: verified.
    """

    seed: int
    true_kg: float
    total_kg: float
    u_kg: float
    common_kg: float
    cycles: int
    counted: int
    outcome: int

    @property
    def is_held(self) -> bool:
        """Whether the truth is inside U."""
        return abs(self.total_kg - self.true_kg) <= K * self.u_kg


def demo_shift(seed: int) -> DemoShift:
    """Make the demo of a seed and compare its shift with the truth."""
    with tempfile.TemporaryDirectory() as scratch:
        folder = Path(scratch) / "demo"
        made = run_demo(folder, seed=seed, overwrites=False, on_stage=lambda _: None)
        verified = verify_bundle(
            folder / "evidence",
            log_folder=folder,
            key_file=folder / "key.pub.pem",
            verification_day=made.calibrated.document.expires,
        )
        truth = json.loads((folder / "shift.cycles.json").read_text(encoding="utf-8"))
    shift = made.reviewed.shift
    return DemoShift(
        seed=seed,
        true_kg=float(sum(each["payload_kg"] for each in truth["cycles"])),
        total_kg=shift["total_kg"],
        u_kg=shift["total_u_kg"],
        common_kg=shift["payload_u_common_kg"],
        cycles=len(truth["cycles"]),
        counted=shift["cycles_counted"],
        outcome=0 if verified.outcome is None else int(verified.outcome),
    )


def table(found: Sequence[DemoShift]) -> str:
    """How many hold, how wide, and whether they verify."""
    told = [each for each in found if each.counted]
    u = np.array([each.u_kg for each in told])
    common = np.array([each.common_kg for each in told])
    total = np.array([each.total_kg for each in told])
    true = np.array([each.true_kg for each in told])
    rows = [
        ["demos", str(len(found))],
        ["that say tonnes", str(len(told))],
        ["truth inside U", f"{sum(each.is_held for each in told)} of {len(told)}"],
        ["r.m.s. error / u", f"{np.sqrt(np.mean(((total - true) / u) ** 2)):.2f}"],
        ["U over the tonnes, median", f"{np.median(K * u / total):.1%}"],
        ["largest", f"{np.max(K * u / total):.1%}"],
        ["its common part, median", f"{np.median(K * common / total):.1%}"],
        ["every cycle counted", f"{sum(each.counted == each.cycles for each in told)}"],
        ["verified with the logs", f"{sum(each.outcome == 0 for each in found)}"],
    ]
    return markdown(["", "found"], rows)


def main(
    seeds: int = 40,
    first: int = 0,
    results: Annotated[Path | None, typer.Option("--json")] = None,
) -> None:
    found: list[DemoShift] = []
    trials = run_seeds(range(first, first + seeds), demo_shift, results, DemoShift)
    for each in trials:
        found.append(each)
        print(each, flush=True)
    if found:
        print(table(found))


if __name__ == "__main__":
    typer.run(main)

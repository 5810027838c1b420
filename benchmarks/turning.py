"""Inertia and centre of mass of independent machines that turn: what their ± is worth.

    python -P benchmarks/turning.py [--logs 60] [--first 0] [--fault NAME]... [--json FILE]

`--json` keeps a line a log as it comes and goes on where it ended, a seed of every fault at a time.

Each log has a machine, a ground and instruments of its own (`benchmarks/independent`, which shares
no code with the model), and one fault; the machine file states the uncertainties that it was drawn
with. A fit that is withheld says nothing. The columns are shares of what is said: within two
standard uncertainties, and beyond three; the root mean square of error over u; the median u.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, Final

import numpy as np
import polars as pl
import typer

from analysis.diagnosis import CheckInputs, judge_log_by_checks
from analysis.model.machine import Machine
from analysis.model.verdict import Verdict
from analysis.planar.centre_of_mass import make_planar_frames
from analysis.stages.gating.gate import gate_windows
from analysis.stages.motion.forces import compute_excitation
from analysis.stages.motion.smooth import smooth_by_trailing_mean
from analysis.stages.noise.channel_noise import estimate_channel_noise
from analysis.stages.signals.align import align_channels_on_grid
from analysis.stages.signals.derive import derive_channels_in_si, read_measured_channels
from benchmarks.independent.turning_logs import FAULTS, TurnLog, turn_log
from benchmarks.kept_trials import run_trials
from benchmarks.page import markdown

#: Of what the ± is judged: value and its uncertainty.
QUANTITIES: Final = {
    "inertia_z_kg_m2": "inertia_z_std_kg_m2",
    "com_x_m": "com_x_std_m",
    "com_y_m": "com_y_std_m",
    "mass_kg": "mass_std_kg",
}


@dataclass(frozen=True)
class Turned:
    """What a log says of its machine.

    Attributes:
        fault: of the log.
        seed: of it.
        rows: of `planar`, each with its kind, values and uncertainties.
        truth: by quantity.
    """

    fault: str
    seed: int
    rows: list[dict[str, Any]]
    truth: dict[str, float]

    def deviations(self, kind: str, quantity: str) -> list[float]:
        """Errors over u of the fits of a kind that say something."""
        return [
            (row[quantity] - self.truth[quantity]) / row[QUANTITIES[quantity]]
            for row in self.rows
            if row["kind"] == kind and row[quantity] is not None
        ]


def planar_of(log: TurnLog) -> pl.DataFrame:
    """Every stage from the topics to `planar`."""
    machine = Machine.model_validate(log.machine)
    settings = machine.settings
    channels, _ = derive_channels_in_si(read_measured_channels(log.topics, machine)[0], machine)
    aligned, _ = align_channels_on_grid(channels, machine)
    excitation = compute_excitation(smooth_by_trailing_mean(aligned, settings.smooth), machine)
    noise = estimate_channel_noise(aligned, excitation, machine)
    gated = gate_windows(excitation, settings, noise)
    opinion = Verdict.from_frame(judge_log_by_checks(CheckInputs(excitation, gated, machine)))
    return make_planar_frames(excitation, gated, opinion, machine, noise)[0]


def turned(fault: str, seed: int) -> Turned:
    """Draw a log and read its machine off it."""
    log = turn_log(FAULTS[fault], seed)
    wanted = ["kind", "reason", "withheld", *QUANTITIES, *QUANTITIES.values()]
    rows = planar_of(log).select(wanted).to_dicts()
    return Turned(fault, seed, rows, log.truth._asdict())


def lines(found: Sequence[Turned]) -> Iterator[list[str]]:
    """A row of the table for each fault and quantity."""
    for fault in dict.fromkeys(each.fault for each in found):
        logs = [each for each in found if each.fault == fault]
        kinds = [("joint", quantity) for quantity in QUANTITIES] + [("arcs", "com_x_m")]
        for kind, quantity in kinds:
            errors = np.array([x for log in logs for x in log.deviations(kind, quantity)])
            u = [
                row[QUANTITIES[quantity]]
                for log in logs
                for row in log.rows
                if row["kind"] == kind and row[quantity] is not None
            ]
            if not errors.size:
                yield [fault, kind, quantity, "0", *["–"] * 4]
                continue
            yield [
                fault,
                kind,
                quantity,
                str(errors.size),
                f"{np.mean(np.abs(errors) <= 2.0):.0%}",
                f"{np.mean(np.abs(errors) > 3.0):.0%}",
                f"{np.sqrt(np.mean(errors**2)):.2f}",
                f"{np.median(u):.3g}",
            ]


HEADS: Final = ["fault", "fit", "of", "said", "within 2 u", "beyond 3 u", "r.m.s.", "median u"]


def main(
    logs: Annotated[int, typer.Option(help="Logs of each fault.")] = 60,
    first: Annotated[int, typer.Option(help="First seed.")] = 0,
    fault: Annotated[list[str] | None, typer.Option(help="Only this; may be repeated.")] = None,
    kept: Annotated[Path | None, typer.Option("--json", help="A line a log.")] = None,
) -> None:
    """Turn, and print how far the answers are from the truth."""
    names = fault or list(FAULTS)
    found = run_trials(
        [(name, seed) for seed in range(first, first + logs) for name in names],
        lambda task: turned(*task),
        kept,
        Turned,
        task_key=lambda task: task,
        result_key=lambda result: (result.fault, result.seed),
    )
    # the table has the faults in their order
    print(markdown(HEADS, list(lines(sorted(found, key=lambda each: names.index(each.fault))))))


if __name__ == "__main__":
    typer.run(main)

"""Memory of a twelve-hour shift: the gate, every estimator, and the recording, in one process.

    python -P benchmarks/memory.py [--hours 12] [--every-window] [--keep FOLDER]

A campaign of starts, simulated at 100 Hz and laid end to end with a pause after each log, goes
through the pipeline from `forces` on. Prints the peak of the resident memory after each stage.
With `--every-window` the gate's threshold is lowered until nearly every window is accepted, which
no real shift comes near: estimates are sparse, and this says what that saves.
"""

import resource
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Annotated

import numpy as np
import polars as pl
import typer

from analysis.diagnosis import CheckInputs, judge_log_by_checks
from analysis.model.machine import Machine
from analysis.model.run_record import Provenance, Run
from analysis.simulation import Scenario
from analysis.stages.estimation.method_estimates import summarise_masses, trace_estimates
from analysis.stages.gating.gate import gate_windows
from analysis.stages.gating.segments import estimate_each_manoeuvre_by_pooling
from analysis.stages.motion.forces import compute_excitation
from analysis.stages.motion.smooth import smooth_by_trailing_mean
from recordings import write_recording
from replay import load_machine, open_log, run
from replay.simulation.simulate_logs import simulate_scenario_to_logs

METHODS = ("ls", "rls", "fgls", "tls", "rtls", "huber", "pooled")
GIB = 2**20  # in the kibibytes of getrusage


def aligned_shift(machine: Machine, hours: float) -> pl.DataFrame:
    """One simulated campaign log over and over, at one rate, until the hours are full."""
    base = Scenario()
    short = base.model_copy(
        update={"campaign": base.campaign.model_copy(update={"loads_kg": (0.0,)})}
    )
    with tempfile.TemporaryDirectory() as folder:
        (log,) = simulate_scenario_to_logs(short, Path(folder) / "campaign.bag")
        once = run(open_log(log), machine).frames["aligned"]
    rows = round(hours * 3600 * machine.settings.align.rate_hz)
    shift = pl.concat([once] * -(-rows // once.height))[:rows]
    step_ns = round(1e9 / machine.settings.align.rate_hz)
    return shift.with_columns(t_ns=pl.int_range(rows, dtype=pl.Int64) * step_ns)


def worker(hours: float, folder: Path, *, every_window: bool) -> None:
    """All stages, in the order of the pipeline, with the peak after each."""
    chosen = [f"settings.trace.methods={list(METHODS)}".replace("'", '"')]
    if every_window:
        chosen += ["settings.gate.threshold_nat=-1", "settings.gate.exclude_braking=false"]
    machine = load_machine("cat262c.toml", chosen)
    settings = machine.settings
    began = time.perf_counter()

    def peak(stage: str) -> None:
        used = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / GIB
        print(f"| {stage} | {used:.2f} | {time.perf_counter() - began:.1f} |", flush=True)

    print("| stage | peak GiB so far | s so far |\n|---|---|---|")
    peak("imports")
    aligned = aligned_shift(machine, hours)
    peak(f"aligned, {aligned.height:,} rows")
    excitation = compute_excitation(smooth_by_trailing_mean(aligned, settings.smooth), machine)
    peak("excitation")
    gated = gate_windows(excitation, settings)
    accepted = int(gated["accepted_x"].sum())
    peak(f"gate, {accepted / excitation.height:.0%} of the windows accepted")
    estimates = trace_estimates(excitation, gated, settings)
    peak(f"trace, {len(METHODS)} methods")
    table = estimate_each_manoeuvre_by_pooling(excitation, gated, settings)
    judged = judge_log_by_checks(CheckInputs(excitation, gated, machine))
    totals = summarise_masses(excitation, gated, estimates, machine)
    peak("segments, verdict, masses")
    frames = {
        "aligned": aligned,
        "excitation": excitation,
        "gate": gated,
        **{f"estimates/{method}": frame for method, frame in estimates.items()},
        "segments": table,
        "masses": totals,
        "verdict": judged,
    }
    sizes = {name: frame.estimated_size("mb") for name, frame in frames.items()}
    written = write_recording(Run(frames, Provenance(settings=settings)), folder / "shift.rrd")
    peak(f"recording, {written.stat().st_size / 1e6:.0f} MB, read back")
    largest = sorted(sizes.items(), key=lambda item: -item[1])[:4]
    print("\nLargest frames: " + ", ".join(f"{name} {size:.0f} MB" for name, size in largest))
    assert np.isfinite(totals["mass_kg"].to_numpy()).all()


def main(
    hours: float = 12.0,
    every_window: bool = False,
    keep: Path | None = None,
    here: Annotated[bool, typer.Option(hidden=True)] = False,
) -> None:
    if here:
        assert keep is not None
        worker(hours, keep, every_window=every_window)
        return
    # in a process of its own, whose peak is nobody else's
    with tempfile.TemporaryDirectory() as folder:
        command = [sys.executable, __file__, "--here", "--hours", str(hours)]
        command += ["--keep", str(keep or folder)]
        command += ["--every-window"] if every_window else []
        raise typer.Exit(subprocess.run(command, check=False).returncode)


if __name__ == "__main__":
    typer.run(main)

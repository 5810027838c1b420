"""The gates compared, at their defaults and where they accept equally much.

    python -P benchmarks/gates.py [--seeds 4] [--write]

A candidate is a window that nothing but the gate refuses. Each gate ranks the same candidates by
its own number; `none` takes them all. The mutual information (10) has candidates of its own: it
does not refuse a negative dependence. `--write` puts the tables into docs/gates.md.
"""

import time
from typing import NamedTuple

import numpy as np
import polars as pl
import typer

from analysis.calibration.campaign.by_method import fit_calibration_line_by_method
from analysis.calibration.campaign.campaign_readings import average_masses_by_method_and_run
from analysis.calibration.campaign.method_errors import compute_rms_mass_errors_by_method
from analysis.model.axes import make_straight_regressor_and_force
from analysis.model.run_record import Run
from analysis.simulation import Scenario
from analysis.stages.estimation.method_estimates import trace_estimates
from analysis.stages.gating.gate import gate_windows
from benchmarks.page import markdown, put
from benchmarks.simulated import joined, scenario
from estimators.methods import ls
from estimators.numerics import mutual_information, nearest_neighbours
from replay import load_machine

METHODS = ("ls", "rls", "pooled")
MACHINE = load_machine(
    "cat262c.toml",
    [
        'settings.trace.methods=["ls","rls","pooled"]',
        "settings.gate.index=ksg",
        "settings.gate.threshold_nat=-1000",
    ],
)
WEAK = {"throttle_force_N": 1500.0, "start_s": 6.0}
CRUISE = {"cruise_s": 20.0}
#: The runs of each load: one part of a campaign after the other.
SITUATIONS: dict[str, tuple[dict[str, object], ...]] = {
    "the paper's starts": ({"runs": 9},),
    "20 s of cruise after each": ({"runs": 4, **CRUISE},),
    "a quarter of the throttle": ({"runs": 6, **WEAK},),
    "all three, mixed": ({"runs": 3}, {"runs": 2, **CRUISE}, {"runs": 3, **WEAK}),
}
#: By gate: its column, whether larger is better, and its default threshold.
GATES = {
    "information": ("mi_x_nat", 1.0, 0.7),
    "gaussian": ("gaussian_x_nat", 1.0, 0.7),
    "ksg": ("ksg_x_nat", 1.0, 0.7),
    "variance": ("predicted_std_x", -1.0, 30.0),
}
SHARES = (0.8, 0.5, 0.2)


class Chosen(NamedTuple):
    """Which windows (rows,) a gate accepts, and of which it chose."""

    accepted: np.ndarray
    candidates: np.ndarray


def chosen_windows(gated: pl.DataFrame, either_sign: np.ndarray) -> dict[tuple[str, str], Chosen]:
    """By gate and threshold, which windows it accepts, of how many.

    Args:
        gated: the gate of `MACHINE`; what it accepts are the candidates.
        either_sign: (rows,) the candidates where no sign of the dependence is refused.
    """
    candidates = gated["accepted_x"].to_numpy()
    chosen = {("none", "–"): Chosen(candidates, candidates)}
    gated = gated.with_columns(
        gaussian_x_nat=mutual_information.correlation_to_gaussian_information(
            gated["corr_x_1"].to_numpy()
        )
    )
    for name, (column, sign, default) in GATES.items():
        candidate = either_sign if name == "gaussian" else candidates
        merit = sign * gated[column].to_numpy()
        chosen[name, "default"] = Chosen(candidate & (merit >= sign * default), candidate)
        for share in SHARES:
            least = np.quantile(merit[candidate], 1.0 - share)
            chosen[name, f"best {100 * share:.0f} %"] = Chosen(
                candidate & (merit >= least), candidate
            )
    return chosen


def one_seed(parts: tuple[dict[str, object], ...], seed: int) -> dict[tuple[str, str], list[float]]:
    """Numbers by gate and threshold, in the order of the table's columns."""
    loads_kg = Scenario().campaign.loads_kg
    plans = [scenario(seed + 1000 * k, loads_kg=loads_kg, **p) for k, p in enumerate(parts)]
    replayed, runs = joined(*plans, machine=MACHINE)
    frame = replayed.frames["excitation"]
    gated = gate_windows(frame, MACHINE.settings)
    either_sign = gate_windows(
        frame, MACHINE.settings.copy_with_changes({"gate.index": "gaussian"})
    )
    truth = frame.select("t_ns").join_asof(
        runs.select(pl.col("start_ns").alias("t_ns"), "mass_kg"), on="t_ns"
    )
    found: dict[tuple[str, str], list[float]] = {}
    chosen = chosen_windows(gated, either_sign["accepted_x"].to_numpy())
    for which, (accepted, candidates) in chosen.items():
        judged = gated.with_columns(accepted_x=accepted)
        estimates = trace_estimates(frame, judged, MACHINE.settings)
        windows = estimates["ls"].join(truth, on="t_ns", suffix="_true").drop_nulls("mass_kg")
        error = (windows["mass_kg"] - windows["mass_kg_true"]).to_numpy()
        named = {f"estimates/{method}": table for method, table in estimates.items()}
        by_run = average_masses_by_method_and_run(Run(named, replayed.provenance), runs)
        errors = compute_rms_mass_errors_by_method(fit_calibration_line_by_method(by_run))
        left_out = dict(errors.select("method", "rmse_left_out_kg").iter_rows())
        raw = by_run.filter(pl.col("method") == "ls")
        raw_error = (raw["mass_kg"] - raw["reference_kg"]).drop_nulls().to_numpy()
        found[which] = [
            100.0 * accepted.sum() / candidates.sum(),
            100.0 * raw["mass_kg"].null_count() / raw.height,
            float(np.median(np.abs(error))),
            float(np.sqrt(np.mean(error**2))),
            float(raw_error.mean()),
            float(np.sqrt(np.mean(raw_error**2))),
            *(np.nan if left_out[m] is None else left_out[m] for m in METHODS),
        ]
    return found


HEAD = [
    "gate",
    "threshold",
    "accepted %",
    "runs without %",
    "window: median error kg",
    "window: RMSE kg",
    "run, LS: bias kg",
    "run, LS: RMSE kg",
    *(f"left out, {method} kg" for method in METHODS),
]


def compare(situation: str, seeds: int) -> str:
    """The table of one situation: means over the seeds (root mean squares of the RMSE)."""
    by_gate: dict[tuple[str, str], list[list[float]]] = {}
    for seed in range(1, seeds + 1):
        for which, numbers in one_seed(SITUATIONS[situation], seed).items():
            by_gate.setdefault(which, []).append(numbers)
    rows: list[list[str]] = []
    for (name, threshold), numbers in by_gate.items():
        values = np.array(numbers)
        squares = HEAD[2:].index("window: RMSE kg"), HEAD[2:].index("run, LS: RMSE kg")
        mean = values.mean(axis=0)
        for column in squares:
            mean[column] = np.sqrt((values[:, column] ** 2).mean())
        share = [f"{value:.0f}" for value in mean[:2]]
        rows.append([name, threshold, *share, *(f"{value:.1f}" for value in mean[2:])])
    return markdown(HEAD, rows)


def cost() -> str:
    """Microseconds a window, on the same windows in one process."""
    replayed, _ = joined(scenario(1, runs=3), machine=MACHINE)
    frame = replayed.frames["excitation"]
    A, f = make_straight_regressor_and_force(frame, MACHINE.settings)
    window = MACHINE.settings.gate.window_samples
    complete = np.convolve(np.isfinite(A).all(axis=1) & np.isfinite(f), np.ones(window))[: f.size]
    index = np.flatnonzero(complete > window - 0.5).astype(np.int64)
    acc = A[:, 0].copy()
    calls = {
        "information": lambda: mutual_information.compute_window_correlation(acc, f, window),
        "gaussian": lambda: mutual_information.correlation_to_gaussian_information(
            mutual_information.compute_window_correlation(acc, f, window)[0]
        ),
        "ksg": lambda: nearest_neighbours.estimate_window_mutual_information(
            acc, f, window, index, 4
        ),
        "variance": lambda: ls.compute_window_statistics(A, f, window, index),
    }
    rows: list[list[str]] = []
    for name, call in calls.items():
        call()
        began = time.perf_counter()
        call()
        rows.append([name, f"{1e6 * (time.perf_counter() - began) / index.size:.3g}"])
    return markdown(["gate", "µs a window"], rows)


def main(seeds: int = 4, write: bool = False) -> None:
    tables: list[str] = []
    for situation in SITUATIONS:
        tables.append(f"**{situation.capitalize()}**\n\n{compare(situation, seeds)}")
        print(tables[-1], flush=True)
    tables.append(f"**Cost**\n\n{cost()}")
    print(tables[-1])
    if write:
        put("gates.md", "make gates", f"Over {seeds} seeds.\n\n" + "\n\n".join(tables))


if __name__ == "__main__":
    typer.run(main)
